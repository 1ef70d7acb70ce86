"""Conjugate gradients, and the eigenvalues that they meet on the way."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

Operator = Callable[[np.ndarray], np.ndarray]
"""From a vector (n,) to one."""


@dataclass
class Krylov:
    """A solution by conjugate gradients and the coefficients of the iteration."""

    x: np.ndarray
    """(n,)."""
    alpha: list[float] = field(default_factory=list)
    beta: list[float] = field(default_factory=list)
    broke_down: bool = False
    """Whether rounding has made the matrix or the preconditioner indefinite."""

    @property
    def iterations(self) -> int:
        return len(self.alpha)

    def ritz_values(self) -> np.ndarray:
        """Approximate eigenvalues (iterations,) of the preconditioned matrix, ascending: the extreme ones come first.

        Golub and Van Loan (2013), Matrix Computations, 11.3.
        """
        alpha, beta = np.array(self.alpha), np.array(self.beta)
        diagonal = 1.0 / alpha
        diagonal[1:] += beta[:-1] / alpha[:-1]
        off = np.sqrt(beta[:-1]) / alpha[:-1]
        return np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))


def conjugate_gradients(
    multiply: Operator,
    precondition: Operator,
    b: np.ndarray,
    *,
    max_iterations: int,
    truncation: float = 0.0,
    enough: float = 0.0,
) -> Krylov:
    """Solves H x = b (n,) for a symmetric positive definite H.

    It ends when the last iteration lowered x^T H x - 2 b^T x by less than the share `truncation` of the mean over
    iterations (Nash and Sofer 1990, doi:10.1016/0167-6377(90)90064-D), or when as many iterations again would lower
    it by less than `enough`. It ends early, with what it has, where rounding has made H or the preconditioner
    indefinite.
    """
    out = Krylov(np.zeros_like(b))
    residual = b.copy()
    z = precondition(residual)
    direction, fit, gained = z.copy(), float(np.vdot(residual, z)), 0.0
    while out.iterations < max_iterations and fit > 0.0:
        product = multiply(direction)
        curvature = float(np.vdot(direction, product))
        if not curvature > 0.0 or not math.isfinite(curvature):
            out.broke_down = True
            break
        alpha = fit / curvature
        out.x += alpha * direction
        product *= alpha
        residual -= product
        z = precondition(residual)
        gain, fit, last = alpha * fit, float(np.vdot(residual, z)), fit
        direction *= fit / last
        direction += z
        gained += gain
        out.alpha.append(alpha)
        out.beta.append(max(fit, 0.0) / last)
        out.broke_down = fit < 0.0
        if out.iterations * gain <= max(truncation * gained, enough):
            break
    return out
