"""Standard deviations along a direction and of a length, from any form in which a scene states uncertainties.

These forms are sigmas (n,) equal in all directions, sigmas (n, d) along d axes, or covariances (n, d, d).
"""

from __future__ import annotations

import math

import numpy as np

from photoclinometry.model.errors import InputError

UNTOLD_NORMAL_RAD = math.sqrt(0.5 * (math.pi - 2.0))
"""Standard deviation about each tangent axis of an undetermined normal: for directions spread evenly over the
hemisphere above the ground, the mean square of the angle from its axis is pi - 2."""


def sigma_along(stated: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(n,) standard deviation along unit vectors (n, d), or along one (d,). Raises InputError for other shapes."""
    stated, direction = np.asarray(stated, float), np.asarray(direction, float)
    if direction.ndim == 1:
        direction = np.broadcast_to(direction, (*stated.shape[:1], len(direction)))
    _check(stated, *direction.shape)
    if stated.ndim == 1:
        return np.abs(stated)
    if stated.ndim == 2:
        return np.linalg.norm(stated * direction, axis=-1)
    return np.sqrt(np.einsum("ni,nij,nj->n", direction, stated, direction))


def sigma_of_length(stated: np.ndarray, axes: int) -> np.ndarray:
    """(n,) root mean square length of errors over all `axes`. Raises InputError for other shapes.

    Of a covariance it is the root of the trace. Of a normal, whose errors have two axes, it is the standard deviation
    of the angle between the normal and the true one.
    """
    stated = np.asarray(stated, float)
    _check(stated, len(np.atleast_1d(stated)), axes)
    if stated.ndim == 1:
        return np.sqrt(axes) * np.abs(stated)
    if stated.ndim == 2:
        return np.linalg.norm(stated, axis=-1)
    return np.sqrt(np.trace(stated, axis1=1, axis2=2))


def largest_sigma(stated: np.ndarray) -> np.ndarray:
    """(n,) standard deviation along the axis on which it is largest, of uncertainties in any form; infinite where one
    of them is."""
    stated = np.abs(np.asarray(stated, float)) if np.ndim(stated) < 3 else np.asarray(stated, float)
    if stated.ndim == 1:
        return stated
    if stated.ndim == 2:
        return stated.max(axis=-1)
    finite = np.isfinite(stated).all((1, 2))
    found = np.full(len(stated), np.inf)
    found[finite] = np.sqrt(np.linalg.eigvalsh(stated[finite])[:, -1])
    return found


def _check(stated: np.ndarray, count: int, axes: int) -> None:
    if stated.shape not in ((count,), (count, axes), (count, axes, axes)):
        raise InputError(
            f"an uncertainty has shape {stated.shape}, expected {count} of {axes} numbers; run the site again"
        )
