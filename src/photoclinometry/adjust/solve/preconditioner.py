"""The preconditioner for landmarks: a Chebyshev polynomial that copes with the smoothness between neighbours.

The coupling of neighbours is what makes the problem stiff, and only landmarks take part in it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.graph.rows import COMPILED
from photoclinometry.adjust.graph.smoothness import Neighbours, add_product, couple
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE
from photoclinometry.adjust.solve.blocks import apply_blocks
from photoclinometry.adjust.solve.krylov import conjugate_gradients


@njit(parallel=True, **COMPILED)
def chebyshev_step(neighbours, rows, inverse, b, x, direction, keep, gain, x_out, direction_out):
    """One term: direction_out = keep direction + gain D^-1 (b - P x), x_out = x + direction_out."""
    for j in prange(x.shape[0]):
        a = couple(np.uint32(j), neighbours, rows, x)
        r0, r1, r2 = b[j, 0] - a[0], b[j, 1] - a[1], b[j, 2] - a[2]
        r3, r4, r5 = b[j, 3] - a[3], b[j, 4] - a[4], b[j, 5]
        for i in range(LANDMARK_SIZE):
            # D^-1 (b - D x - N x) = D^-1 (b - N x) - x
            defect = (
                inverse[j, i, 0] * r0
                + inverse[j, i, 1] * r1
                + inverse[j, i, 2] * r2
                + inverse[j, i, 3] * r3
                + inverse[j, i, 4] * r4
                + inverse[j, i, 5] * r5
                - x[j, i]
            )
            d = keep * direction[j, i] + gain * defect
            direction_out[j, i] = d
            x_out[j, i] = x[j, i] + d


def lowest_eigenvalue(
    neighbours: Neighbours, rows: np.ndarray, block: np.ndarray, inverse: np.ndarray, iterations: int = 12
) -> float:
    """About the smallest eigenvalue of D^-1 P (see `solve_approximately`), from above.

    The smallest Ritz value of some conjugate gradients with a random right-hand side; zero where rounding hides it.
    block, inverse: (J, 6, 6) float32, D and D^-1.
    """
    shape = inverse.shape[:2]

    def multiply(x: np.ndarray) -> np.ndarray:
        out = np.zeros(shape, np.float32)
        add_product(neighbours, rows, block, x.reshape(shape), out)
        return out.ravel()

    def precondition(x: np.ndarray) -> np.ndarray:
        out = np.empty(shape, np.float32)
        apply_blocks(inverse, x.reshape(shape), np.float32(1.0), out)
        return out.ravel()

    b = np.random.default_rng(0).normal(size=shape).ravel().astype(np.float32)
    found = conjugate_gradients(multiply, precondition, b, max_iterations=iterations)
    return float(found.ritz_values()[0]) if found.iterations else 0.0


def chebyshev_degree(low: float, reduction: float) -> int:
    """Degree at which errors along eigenvalues of (low, 2) shrink by the factor `reduction`."""
    return math.ceil(math.acosh(1.0 / reduction) / math.acosh((2.0 + low) / (2.0 - low)))


def solve_approximately(
    neighbours: Neighbours, rows: np.ndarray, inverse: np.ndarray, b: np.ndarray, degree: int, low: float
) -> np.ndarray:
    """A Chebyshev polynomial in D^-1 P applied to b (J, 6): the preconditioner for landmarks.

    P is the landmarks' part of the normal equations, D its 6 x 6 diagonal blocks, `inverse` D^-1. A residual
    touches at most two landmarks, so the eigenvalues of D^-1 P lie below 2 by construction; those above `low` are
    damped evenly. Saad (2003), Iterative Methods for Sparse Linear Systems, Alg. 12.1.
    """
    center, radius = (2.0 + low) / 2.0, (2.0 - low) / 2.0
    single = np.float32
    x = np.empty_like(b)
    apply_blocks(inverse, b, single(1.0 / center), x)
    direction, x_next, direction_next = x.copy(), np.empty_like(x), np.empty_like(x)
    ratio = center / radius
    rho = 1.0 / ratio
    for _ in range(degree - 1):
        rho_next = 1.0 / (2.0 * ratio - rho)
        keep, gain = single(rho_next * rho), single(2.0 * rho_next / radius)
        chebyshev_step(neighbours, rows, inverse, b, x, direction, keep, gain, x_next, direction_next)
        x, x_next = x_next, x
        direction, direction_next = direction_next, direction
        rho = rho_next
    return x
