"""Correlation of the errors of landmarks' positions, and the resulting variance of quantities of many landmarks.

`Scene.uncertainty` has the covariance P_j of each position alone. Errors of neighbours are correlated, since they share
smoothness, errors of keypoints, and views; those of landmarks far apart have only the common errors of all. With r(d)
their correlation at a distance of d reference pixels, and q a quantity with derivatives g_j by the positions x_j,

    cov(x_j, x_k) = P_j^1/2 r(d_jk) P_k^1/2
    var(q) = sum_jk g_j^T cov(x_j, x_k) g_k

r is a sum of exponentials, so that no variance is negative. Errors of a known frame, its place, attitude and scale, do
not depend on distance: they are taken out of P, and added as a similarity that moves all landmarks.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.model.geometry import Similarity, point_moves


@dataclass(frozen=True, kw_only=True)
class ErrorCorrelation:
    """Correlation of position errors by distance, and the errors of the frame."""

    length_px: np.ndarray
    """(n,) of exponentials exp(-d / length) [reference px]."""
    share: np.ndarray
    """(n,) share of each exponential in the variance; the rest belongs to each landmark alone."""
    frame: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    """(7, 7) covariance of the map's similarity error: rotation [rad], translation [units of B] and scale, about the
    pivot; empty where the map has a frame of its own."""
    pivot: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """(3,) in B."""

    def at(self, distance_px: np.ndarray) -> np.ndarray:
        """Correlation (...) of different landmarks at distances (...) in reference pixels; 1 at none."""
        decay = np.exp(-np.asarray(distance_px, float)[..., None] / self.length_px) @ self.share
        return np.where(np.asarray(distance_px) == 0.0, 1.0, decay)

    def transformed(self, similarity: Similarity) -> ErrorCorrelation:
        """The same in the target frame of a similarity; distances in the image stay."""
        if not self.frame.size:
            return self
        by = np.eye(7)
        by[:3, :3], by[3:6, 3:6] = similarity.rotation, similarity.scale * similarity.rotation
        return replace(self, frame=by @ self.frame @ by.T, pivot=similarity(self.pivot[None])[0])


def variance_of(
    correlation: ErrorCorrelation, covariance: np.ndarray, position: np.ndarray, cell: np.ndarray, gradient: np.ndarray,
    spacing_px: float,
) -> float:  # fmt: skip
    """Variance of a quantity of n landmarks, to first order.

    covariance: (n, 3, 3) of positions, errors of the frame included; position: (n, 3); cell: (n, 2) row and column in
    the map's grid; gradient: (n, 3) derivatives by positions; spacing_px: between neighbouring cells.
    """
    of_frame = 0.0
    if correlation.frame.size:
        moves = point_moves(position, correlation.pivot)
        covariance = covariance - moves @ correlation.frame @ np.swapaxes(moves, 1, 2)
        along = np.einsum("ni,nia->a", gradient, moves)
        of_frame = float(along @ correlation.frame @ along)
    value, vector = np.linalg.eigh(covariance)
    root = (vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]) @ np.swapaxes(vector, 1, 2)
    whitened = np.einsum("nij,nj->ni", root, gradient)
    low = cell.min(0)
    rows, cols = cell.max(0) - low + 1
    grid = np.zeros((rows, cols, 3))
    np.add.at(grid, tuple((cell - low).T), whitened)
    row, col = np.mgrid[1 - rows : rows, 1 - cols : cols]
    kernel = correlation.at(spacing_px * np.hypot(row, col))
    size, axes = kernel.shape, (0, 1)
    of_kernel = np.fft.rfft2(np.fft.ifftshift(kernel), size, axes)[:, :, None]
    spread = np.fft.irfft2(np.fft.rfft2(grid, size, axes) * of_kernel, size, axes)
    return max(float(np.sum(grid * spread[:rows, :cols])), 0.0) + of_frame
