"""Measures of error as functions of arrays: the paper's Eqs. 36 to 40, and the calibration of standard deviations.

Eqs. 36 to 38 compare maps, Eq. 39 landmarks with measured brightness, Eq. 40 renderings with images.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.geometry import angle_between

_SHARES = ((0.6827, "68"), (0.9545, "95"))
"""Probability within one and two standard deviations of a normal distribution, and its name in figures."""


def spread(values: np.ndarray, name: str, unit: str) -> dict[str, float]:
    """Mean, median, RMS and 90th percentile of the absolute finite values, as {name}_mean_{unit} and so on.

    Empty if no value is finite: a figure that does not exist is omitted, never zero.
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

    It is a distance between points, so never less than that to the surface, and larger for a coarser map.
    """
    from scipy.spatial import KDTree

    return KDTree(reference).query(position)[0]


def along_and_sideways(error: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of positions (n, 3) in two parts (n,): along unit normals (n, 3), signed, and the length of the rest."""
    along = np.sum(error * normal, axis=-1)
    return along, np.linalg.norm(error - along[:, None] * normal, axis=-1)


def normal_error(normal: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Angle [rad] between normals (..., 3), of any length (Eq. 37; atan2 where the paper has arccos)."""
    return angle_between(normal, reference)


def albedo_error(albedo: np.ndarray, reference: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """|factor a - b| / b of albedos (...,), dimensionless (Eq. 38)."""
    return np.abs(factor * albedo - reference) / reference


def albedo_factor(albedo: np.ndarray, reference: np.ndarray) -> float:
    """The factor from relative albedos to the reference: the median of reference / albedo."""
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


def normalised_square(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Normalised estimation error squared over its degrees of freedom (n,): e' S^-1 e / d, 1 on average if S is right.

    error: (n, d), or (n,) for d = 1. covariance: that stated for each error, as (n, d, d) covariances, or as
    standard deviations, (n, d) along each axis or (n,) equal along all, in the error's unit. NaN where the
    covariance is not positive definite, or either is not finite. Raises ValueError for other shapes.
    Bar-Shalom, Li, Kirubarajan (2001), Estimation with Applications to Tracking and Navigation, section 5.4.
    """
    error = np.asarray(error, float)
    error = error[:, None] if error.ndim == 1 else error
    covariance = np.asarray(covariance, float)
    count, size = error.shape
    if covariance.shape in ((count,), (count, size)):
        sigma = covariance.reshape(count, -1)
        return np.mean((error / np.where(sigma > 0, sigma, np.nan)) ** 2, axis=-1)
    if covariance.shape != (count, size, size):
        raise ValueError(f"covariance of shape {covariance.shape} does not go with errors of shape {error.shape}")
    usable = np.array(np.isfinite(covariance).all((-1, -2)) & np.isfinite(error).all(-1))
    variance, axis = np.linalg.eigh(covariance[usable])
    along = np.einsum("nij,ni->nj", axis, error[usable])
    is_definite = variance[:, 0] > size * np.finfo(float).eps * variance[:, -1]  # less is rounding
    found = np.full(count, np.nan)
    found[usable] = np.mean(along**2 / np.where(is_definite[:, None], variance, np.nan), -1)
    return found


def calibration(error: np.ndarray, covariance: np.ndarray, name: str) -> dict[str, float]:
    """Whether stated uncertainties agree with errors; arguments as `normalised_square`. Empty without usable errors.

    {name}_nees: the mean normalised square, 1 if calibrated, above 1 if the errors are larger than stated.
    {name}_nees_median: the median over that of the chi-square distribution, which outliers do not change.
    {name}_within_68_percent and _within_95_percent: the share of errors inside the ellipsoids that should hold 68.27
    and 95.45 percent.
    """
    from scipy.special import chdtri

    size = 1 if np.ndim(error) == 1 else np.shape(error)[1]
    square = normalised_square(error, covariance)
    square = square[np.isfinite(square)]
    if square.size == 0:
        return {}
    metrics = {
        f"{name}_nees": float(square.mean()),
        f"{name}_nees_median": float(np.median(square) * size / chdtri(size, 0.5)),
    }
    for share, label in _SHARES:
        inside = square * size <= chdtri(size, 1.0 - share)
        metrics[f"{name}_within_{label}_percent"] = 100.0 * float(inside.mean())
    return metrics
