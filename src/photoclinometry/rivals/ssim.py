"""Structural similarity of two pictures over a mask, and its derivative.

Wang et al. (2004), IEEE Transactions on Image Processing 13, doi:10.1109/TIP.2003.819861: windows of 11 x 11 pixels, a
Gaussian of 1.5. Means are normalised convolutions, so that pixels outside the mask do not count.
"""

from __future__ import annotations

import numpy as np

WINDOW, SIGMA_PX = 11, 1.5
C1, C2 = 0.01**2, 0.03**2
"""The paper's constants (K1 L)^2 and (K2 L)^2 for a peak L = 1."""


def ssim(picture: np.ndarray, other: np.ndarray, mask: np.ndarray) -> float:
    """Mean structural similarity over the mask (h, w) of pictures (h, w) whose peak is 1; NaN of an empty mask."""
    return float(_map(picture, other, mask)[0][mask].mean()) if mask.any() else float("nan")


def ssim_and_gradient(picture: np.ndarray, other: np.ndarray, mask: np.ndarray) -> tuple[float, np.ndarray]:
    """`ssim` and its derivative (h, w) by the first picture; 0 outside the mask."""
    value, (x, y, mean_x, mean_y, a1, a2, b1, b2, share) = _map(picture, other, mask)
    weight = mask / max(int(mask.sum()), 1)
    by_square, by_product = -value / b2 * weight, 2.0 * a1 / (b1 * b2) * weight
    by_mean = (2.0 * mean_y * a2 / (b1 * b2) - 2.0 * mean_x * value / b1) * weight
    by_mean -= 2.0 * mean_x * by_square + mean_y * by_product

    def back(values: np.ndarray) -> np.ndarray:
        """The adjoint of the mean over the mask."""
        return _blur(values / share)

    gradient = back(by_mean) + 2.0 * x * back(by_square) + y * back(by_product)
    return float((value * weight).sum()), np.where(mask, gradient, 0.0)


def _map(picture: np.ndarray, other: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Similarity (h, w), and what its derivative is made of."""
    x, y = np.where(mask, picture, 0.0), np.where(mask, other, 0.0)
    share = np.maximum(_blur(mask.astype(float)), 1e-9)
    mean_x, mean_y, xx, yy, xy = (_blur(v) / share for v in (x, y, x * x, y * y, x * y))
    a1, a2 = 2.0 * mean_x * mean_y + C1, 2.0 * (xy - mean_x * mean_y) + C2
    b1, b2 = mean_x**2 + mean_y**2 + C1, xx - mean_x**2 + yy - mean_y**2 + C2
    return a1 * a2 / (b1 * b2), (x, y, mean_x, mean_y, a1, a2, b1, b2, share)


def _blur(values: np.ndarray) -> np.ndarray:
    import cv2

    return cv2.GaussianBlur(values, (WINDOW, WINDOW), SIGMA_PX, borderType=cv2.BORDER_CONSTANT)
