"""Cholesky factors for Python threads: LAPACK and BLAS, called so that other threads run meanwhile.

Functions of `scipy.linalg` hold the interpreter's lock while they compute, so that threads of them take turns; `ctypes`
lets go of it. Matrices are C-contiguous float64 arrays. Fortran sees them transposed: its upper triangle is the lower
one here.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
from numba.extending import get_cython_function_address


def _fortran(module: str, name: str, arguments: int) -> Callable[..., None]:
    """A function of SciPy's LAPACK or BLAS, all of whose arguments are pointers."""
    address = get_cython_function_address(f"scipy.linalg.cython_{module}", name)
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)


_dpotrf, _dpotri = _fortran("lapack", "dpotrf", 5), _fortran("lapack", "dpotri", 5)
_dtrsm = _fortran("blas", "dtrsm", 11)

_LOWER, _NO, _RIGHT = (ctypes.create_string_buffer(letter) for letter in (b"U", b"N", b"R"))
"""In Fortran's letters."""


def factorize(matrix: np.ndarray) -> None:
    """Replaces the lower triangle of a matrix (n, n) by L, with matrix = L L^T; the part above the diagonal stays.

    Raises LinAlgError where the matrix is not positive definite.
    """
    if _in_place(_dpotrf, matrix):
        raise np.linalg.LinAlgError(f"a matrix of {len(matrix)} rows is not positive definite")


def invert(factor: np.ndarray) -> None:
    """Replaces L (n, n), a lower triangle, by that of the inverse of L L^T.

    Raises LinAlgError where L has a zero on its diagonal.
    """
    if _in_place(_dpotri, factor):
        raise np.linalg.LinAlgError(f"a factor of {len(factor)} rows has no inverse")


def solve_lower(factor: np.ndarray, right: np.ndarray) -> None:
    """Replaces right (n, m) by L^-1 right; factor: (n, n) whose lower triangle is L."""
    _check(factor, right)
    n, m, one = ctypes.c_int(len(right)), ctypes.c_int(right.shape[1]), ctypes.c_double(1.0)
    of = ctypes.byref
    _dtrsm(_RIGHT, _LOWER, _NO, _NO, of(m), of(n), of(one), factor.ctypes.data, of(n), right.ctypes.data, of(m))


def _in_place(function: Callable[..., None], matrix: np.ndarray) -> int:
    """LAPACK's `info`: zero where all went well."""
    _check(matrix, matrix)
    n, info = ctypes.c_int(len(matrix)), ctypes.c_int()
    function(_LOWER, ctypes.byref(n), matrix.ctypes.data, ctypes.byref(n), ctypes.byref(info))
    return info.value


def _check(factor: np.ndarray, right: np.ndarray) -> None:
    """Raises ValueError for wrong shapes and types, which pointers do not carry."""
    arrays = factor, right
    if factor.shape != (len(right), len(right)) or any(a.dtype != float or not a.flags.c_contiguous for a in arrays):
        raise ValueError("a square matrix and as many rows are needed, both of C-contiguous float64")
