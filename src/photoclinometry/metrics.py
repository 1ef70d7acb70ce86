"""How far a map is from another, and from its images: Eqs. 36-40 as functions of arrays.

Eqs. 37 and 38 compare maps, Eq. 39 landmarks with the measured brightness, Eq. 40 renderings with images.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.geometry import angle_between


def spread(values: np.ndarray, name: str, unit: str) -> dict[str, float]:
    """Mean, median, RMS and 90th percentile of the finite values' sizes, as {name}_mean_{unit} and so on.

    Empty where nothing is finite: a figure that does not exist is left out, never zero.
    """
    finite = np.abs(values[np.isfinite(values)])
    if finite.size == 0:
        return {}
    return {
        f"{name}_mean_{unit}": float(finite.mean()),
        f"{name}_median_{unit}": float(np.median(finite)),
        f"{name}_rms_{unit}": float(np.sqrt(np.mean(finite**2))),
        f"{name}_p90_{unit}": float(np.percentile(finite, 90)),
    }


def landmark_error(position: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Distance (n,) of points (n, 3) to the nearest point of a reference map (m, 3) (Eq. 36).

    Between points, so that it is never less than the distance to the surface, and a coarse map makes it larger.
    """
    from scipy.spatial import KDTree

    return KDTree(reference).query(position)[0]


def normal_error(normal: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Angle [rad] between normals (..., 3), of any length (Eq. 37; atan2 where the paper has arccos)."""
    return angle_between(normal, reference)


def albedo_error(albedo: np.ndarray, reference: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """|factor a - b| / b of albedos (...,), dimensionless (Eq. 38)."""
    return np.abs(factor * albedo - reference) / reference


def albedo_factor(albedo: np.ndarray, reference: np.ndarray) -> float:
    """The one factor that brings relative albedos nearest to the reference: the median of their quotients."""
    return float(np.nanmedian(reference / albedo))


def photometric_error(predicted: np.ndarray, measured: np.ndarray, landmark: np.ndarray, count: int) -> np.ndarray:
    """RMS residual over a landmark's observations / its mean measured brightness, dimensionless (Eq. 39).

    predicted, measured: (N,); landmark: (N,) index below `count`. (count,), NaN for landmarks without
    observations or whose mean brightness is not positive.
    """
    seen = np.bincount(landmark, minlength=count)
    square = np.bincount(landmark, (predicted - measured) ** 2, count)
    total = np.bincount(landmark, measured, count)
    usable = (seen > 0) & (total > 0)
    error = np.full(count, np.nan)
    error[usable] = np.sqrt(square[usable] * seen[usable]) / total[usable]
    return error


def psnr(image: np.ndarray, rendered: np.ndarray, mask: np.ndarray, peak: float) -> float:
    """Peak signal-to-noise ratio [dB] over the masked pixels: 10 log10(1 / MSE) (Eq. 40).

    Both images are divided by `peak`, the brightness that counts as 1. Infinite where they agree exactly, NaN
    where the mask is empty.
    """
    if not mask.any():
        return float("nan")
    mse = np.mean(((rendered[mask] - image[mask]) / peak) ** 2)
    return float("inf") if mse == 0 else float(-10.0 * np.log10(mse))
