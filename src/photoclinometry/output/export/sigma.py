"""Standard deviations of landmarks for maps and tables, from any form of `evaluate/sigma_calibration.py`."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.errors import InputError


def sigma_along(stated: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(n,) standard deviation along unit vectors (n, d) of uncertainties stated as (n,), (n, d) or (n, d, d)."""
    stated, direction = np.asarray(stated, float), np.asarray(direction, float)
    _check(stated, len(direction), direction.shape[1])
    if stated.ndim == 1:
        return stated
    if stated.ndim == 2:
        return np.sqrt(np.sum((stated * direction) ** 2, axis=-1))
    return np.sqrt(np.einsum("ni,nij,nj->n", direction, stated, direction))


def sigma_mean(stated: np.ndarray, size: int) -> np.ndarray:
    """(n,) root mean square over `size` axes of the standard deviations, in any form of `sigma_along`."""
    stated = np.asarray(stated, float)
    _check(stated, len(stated), size)
    if stated.ndim == 1:
        return stated
    square = stated**2 if stated.ndim == 2 else np.diagonal(stated, axis1=1, axis2=2)
    return np.sqrt(np.mean(square, axis=-1))


def _check(stated: np.ndarray, count: int, size: int) -> None:
    if stated.shape not in ((count,), (count, size), (count, size, size)):
        raise InputError(
            f"an uncertainty has shape {stated.shape}, expected {count} of {size} numbers; run the site again"
        )
