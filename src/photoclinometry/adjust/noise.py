"""The size of the measurements' errors, and the extent over which they are correlated, found from the residuals.

Errors of neighbouring landmarks are not independent. Matches are found over windows and follow the shading where the
light has moved; images are blurred; errors of a reflectance model are the same on neighbouring ground. If errors that n
landmarks share were counted n times, parameters that all landmarks determine together (poses, Suns, the large shape)
would be trusted far too much. Therefore n such observations count as one: the standard deviation of each is multiplied
by sqrt(n).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from photoclinometry.model.robust import robust_sigma
from photoclinometry.model.sampling import gaussian, masked_filter
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import brightness_residuals

LOCAL_NOISE_SIGMA = 1.0
"""Standard deviation of the Gaussian over which noise is measured from place to place [landmarks]: misfits are as
local as the edges, boulders and shadows that make them."""

PRIOR_FREEDOM = 2.0
"""Number of squared residuals of the usual size that are added to those about a landmark. A single landmark that is lit
in four views has one degree of freedom, whose square is near zero as often as not."""

SAME_SIGMA, SAME_CORRELATION = 0.1, 0.2
"""The noise of two reweighting iterations counts as equal if no standard deviation differs by more than the first
share, and no correlation by more than the second: the estimate then changes by less than a tenth of its sigmas."""

MIN_BRIGHTNESS_SHARE = 1e-4
"""Noise of brightness is at least this share of the median brightness: no detector measures better."""

MIN_FREEDOM = 0.1
"""Share of the residuals that count as degrees of freedom at least, where parameters are as many as residuals."""

CHANCE_SIGMAS = 1.5
"""Differences of Suns, scales and biases from their priors that count as chance, in standard deviations."""

MAX_VIEW_PRIOR_FACTOR = 5.0
"""Largest `Noise.view_prior_factor` [-]. Beyond it, brightness would have no influence on Suns."""

MIN_SCALE_SCATTER = 1e-3
"""Least standard deviation of calibrated scales [-]: no camera repeats its response better."""

MIN_VIEWS_FOR_PHASE = 7
"""Fewest views whose scales may follow a parabola in the phase angle. With fewer views the parabola explains too much
of the scatter."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """The assumed errors of all measurements."""

    keypoint_factor: float
    """On each keypoint's own standard deviation."""
    keypoint_correlation_px: float
    """Side of the square of reference pixels in which keypoints share an error."""
    pose_only_keypoint_factor: float
    """As `keypoint_factor`, for keypoints of pose-only tie points, whose own positions follow the matches."""
    sparse_keypoint_factor: float
    """On the standard deviation of each sparse tie point's keypoint; their errors are independent."""
    brightness_sigma: float
    """In the images' brightness; zero without photometry."""
    brightness_correlation_px: float
    """As for keypoints."""
    view_prior_factor: float = 1.0
    """Factor by which the assumed standard deviations of Suns, scales and biases are smaller than the stated ones. It
    stands for errors of brightness common to a view, which no residual shows, since the view's Sun, scale and bias
    follow them."""
    scale_scatter: float = np.inf
    """Measured standard deviation of calibrated scales, whatever is stated; infinite until it is measured, and for
    scales that are free."""

    def close_to(self, other: Noise) -> bool:
        """Whether sigmas differ by SAME_SIGMA at most, correlations by SAME_CORRELATION."""
        for f in fields(self):
            a, b = getattr(self, f.name), getattr(other, f.name)
            if (
                np.isfinite(a) != np.isfinite(b)
                or abs(a - b) > (SAME_CORRELATION if f.name.endswith("_px") else SAME_SIGMA) * b
            ):
                return False
        return True


def keypoint_factor(scene: Scene, residual: np.ndarray, which: np.ndarray) -> float:
    """Standard deviation of the whitened residuals of landmarks `which` (J,), each of which takes three of freedom."""
    mine = which[scene.tracks.landmark]
    whitened = residual[mine] / scene.tracks.keypoint_sigma[mine, None]
    return fitted_sigma(whitened, parameters=3 * int(np.count_nonzero(which)))


def noise_is_measurable(scene: Scene, lit: np.ndarray) -> bool:
    """Whether lit residuals determine the noise: a normal and an albedo fit any three brightnesses.

    Degrees of freedom must be MIN_FREEDOM of the residuals.
    """
    residuals = np.count_nonzero(lit)
    landmarks = np.count_nonzero(np.bincount(scene.tracks.landmark[lit]))
    return bool(residuals - 3 * landmarks >= MIN_FREEDOM * residuals)


def brightness_noise(scene: Scene, residual: np.ndarray, lit: np.ndarray) -> float:
    """Standard deviation of the lit residuals; each landmark's normal and albedo take three of freedom.

    At least MIN_BRIGHTNESS_SHARE of the median brightness.
    """
    landmarks = int(np.count_nonzero(np.bincount(scene.tracks.landmark[lit])))
    floor = MIN_BRIGHTNESS_SHARE * float(np.median(scene.tracks.brightness[lit]))
    return max(fitted_sigma(residual[lit], parameters=3 * landmarks), floor)


def local_noise(scene: Scene, lit: np.ndarray, sigma: np.ndarray | float, mapped: np.ndarray) -> np.ndarray:
    """Mean square of the brightness residuals about each landmark of the map, over that of noise of `sigma`.

    sigma: of each observation (N,), or of all; mapped: (J,) bool; returns one number for each of these, 1 where no
    brightness counts. Each landmark's normal and albedo take three of freedom. The average is a Gaussian of
    LOCAL_NOISE_SIGMA landmarks: some twelve landmarks, of whose residuals the mean square is known to a tenth or
    so. Where there are few, it is nearer to 1 (PRIOR_FREEDOM).
    """
    tracks, count = scene.tracks, len(scene.landmarks)
    of = tracks.landmark[lit]
    number = np.bincount(of, minlength=count)[mapped]
    if not np.all(sigma) or not number.any():
        return np.ones(len(number))
    square = np.bincount(of, (brightness_residuals(scene) / sigma)[lit] ** 2, count)[mapped]
    cells = scene.region.cells(scene.landmarks.pixel[mapped])
    grid = np.full((*scene.region.grid_shape, 2), np.nan)
    grid[cells] = np.stack([square, np.maximum(number - 3.0, MIN_FREEDOM * number)], -1)
    average, share = masked_filter(grid, gaussian(LOCAL_NOISE_SIGMA))
    # of independent noise, the average is as exact as a plain mean of this many values
    landmarks = 4.0 * np.pi * LOCAL_NOISE_SIGMA**2 * share[cells]
    total, freedom = landmarks * np.moveaxis(average[cells], -1, 0)
    return (total + PRIOR_FREEDOM) / (freedom + PRIOR_FREEDOM)


def view_prior_factor(excess: float, factor: float) -> float:
    """The factor under which Suns, scales and biases stay within about their priors' standard deviations.

    excess: their typical difference in stated standard deviations, found under `factor`. Where all of a view's
    brightness is off, by relief finer than a pixel or by the model, Suns, scales and biases follow it far beyond the
    errors of navigation and calibration, because many landmarks outweigh these. The priors then have to count for more.
    Differences fall by the square of the factor.
    """
    if factor == 1.0 and excess < CHANCE_SIGMAS:
        return 1.0
    return float(np.clip(factor * np.sqrt(excess), 1.0, MAX_VIEW_PRIOR_FACTOR))


def scale_scatter(scale: np.ndarray, phase: np.ndarray | None = None) -> float:
    """Standard deviation of scales (K,) about 1, MIN_SCALE_SCATTER at least; infinite where all are 1 still.

    phase: (K,) phase angles [rad] of the views, where the phase function is estimated. With enough views, the part that
    a parabola in phase explains is no scatter but the remaining error of the phase function. If scales were as loose as
    calibration states them, or as this part makes them, they would absorb the error, and it would not be found.
    """
    if np.all(scale == 1.0):
        return np.inf
    off, freedom = scale - 1.0, len(scale)
    if phase is not None and freedom >= MIN_VIEWS_FOR_PHASE:
        parabola = np.vander(phase - phase.mean(), 3)
        off = off - parabola @ np.linalg.lstsq(parabola, off, rcond=None)[0]
        freedom -= 3
    return max(float(np.sqrt(np.sum(off**2) / freedom)), MIN_SCALE_SCATTER)


def fitted_sigma(residual: np.ndarray, parameters: int) -> float:
    """Standard deviation from the median absolute residual, with `parameters` fitted to the residuals."""
    freedom = max(residual.size - parameters, MIN_FREEDOM * residual.size) / residual.size
    return robust_sigma(residual) / float(np.sqrt(freedom))
