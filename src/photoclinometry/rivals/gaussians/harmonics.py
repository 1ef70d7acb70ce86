"""Brightness by the direction of view: real spherical harmonics (Kerbl et al. 2023, section 4).

brightness = max(0, 1 / 2 + sum_k y_k(d) coefficient_k),    d the unit vector from the camera to the Gaussian
"""

from __future__ import annotations

import numpy as np

MOST_DEGREE = 2
OFFSET = 0.5
_Y0 = 0.5 / np.sqrt(np.pi)
_Y1 = np.sqrt(3.0 / (4.0 * np.pi))
_Y2 = 0.5 * np.sqrt(15.0 / np.pi)
_Y20 = 0.25 * np.sqrt(5.0 / np.pi)


def basis(direction: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Harmonics (N, m) up to a degree of unit vectors (N, 3), and their derivatives (N, m, 3) by x, y, z; m =
    (degree + 1)^2."""
    x, y, z = direction.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    terms = [(_Y0 * one, (zero, zero, zero))]
    if degree >= 1:
        terms += [
            (-_Y1 * y, (zero, -_Y1 * one, zero)),
            (_Y1 * z, (zero, zero, _Y1 * one)),
            (-_Y1 * x, (-_Y1 * one, zero, zero)),
        ]
    if degree >= 2:
        terms += [
            (_Y2 * x * y, (_Y2 * y, _Y2 * x, zero)),
            (-_Y2 * y * z, (zero, -_Y2 * z, -_Y2 * y)),
            (_Y20 * (2 * z * z - x * x - y * y), (-2 * _Y20 * x, -2 * _Y20 * y, 4 * _Y20 * z)),
            (-_Y2 * x * z, (-_Y2 * z, zero, -_Y2 * x)),
            (0.5 * _Y2 * (x * x - y * y), (_Y2 * x, -_Y2 * y, zero)),
        ]
    return np.stack([value for value, _ in terms], -1), np.stack([np.stack(by, -1) for _, by in terms], 1)


def brightness(coefficient: np.ndarray, direction: np.ndarray, degree: int) -> np.ndarray:
    """(N,) of coefficients (N, m) seen along directions (N, 3)."""
    values, _ = basis(direction, degree)
    return np.maximum(0.0, OFFSET + np.sum(values * coefficient[:, : values.shape[1]], -1))


def brightness_back(
    coefficient: np.ndarray, direction: np.ndarray, degree: int, by_brightness: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of a loss by the coefficients (N, m) and by the direction (N, 3), from those by `brightness` (N,)."""
    values, slopes = basis(direction, degree)
    count = values.shape[1]
    seen = np.where(OFFSET + np.sum(values * coefficient[:, :count], -1) > 0.0, by_brightness, 0.0)
    by_coefficient = np.zeros_like(coefficient)
    by_coefficient[:, :count] = seen[:, None] * values
    return by_coefficient, seen[:, None] * np.einsum("nk,nki->ni", coefficient[:, :count], slopes)


def first_coefficient(value: np.ndarray) -> np.ndarray:
    """(N,) the coefficient of degree 0 that gives brightnesses (N,)."""
    return (value - OFFSET) / _Y0
