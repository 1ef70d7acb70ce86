"""Standard deviations along a direction and of a length, from any form in which a scene states uncertainties.

These forms are sigmas (n,) alike in all directions, sigmas (n, d) along d axes, or covariances (n, d, d).
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.errors import InputError


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


def _check(stated: np.ndarray, count: int, axes: int) -> None:
    if stated.shape not in ((count,), (count, axes), (count, axes, axes)):
        raise InputError(
            f"an uncertainty has shape {stated.shape}, expected {count} of {axes} numbers; run the site again"
        )
