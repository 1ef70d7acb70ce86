"""Whether the brightness of images shows the relief of a sparse model, or its reverse.

Keypoints hardly distinguish a model from its reverse where rays are nearly parallel (`sfm/reversal.py`): the reverse
has hills for hollows, and the cameras on the other side. Shading distinguishes them, since the Sun's direction in each
image is known and slopes towards the Sun are bright. The right one of the two is that whose slopes correlate with the
images' brightness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import unit
from photoclinometry.model.image import Image
from photoclinometry.model.sampling import sample_image
from photoclinometry.model.sparse import SparseModel
from photoclinometry.photometry.sparse_planes import as_blurred, sparse_planes

NEIGHBOURS = 16
"""Points, itself included, whose plane is the ground at a point: half as many as where slopes themselves are wanted
(`surface.neighbours.PLANE_NEIGHBOURS`), since only the signs of slopes count here, and more patches decide better."""

FEWEST_POINTS = NEIGHBOURS
"""Views that see fewer points, less than one patch of ground, are not used."""

CERTAIN = 3.0
"""Standard deviations between the two correlations beyond which brightness decides."""


@dataclass(frozen=True)
class ReliefShading:
    """Correlations of the shading of a model, and of its reverse, with the brightness of the images."""

    correlation: float
    """Of the predicted with the measured brightness, about the mean of each view."""
    reverse: float
    """The same of the reversed model."""
    patches: float
    """Patches of ground that were compared: points over NEIGHBOURS."""

    @property
    def sigma(self) -> float:
        """Standard deviation of the difference of the two correlations if brightness depended on albedo alone.

        A correlation of n independent pairs has a standard deviation of 1 / sqrt(n). The reverse of a slope is as dark
        as the slope is bright, so that the difference has twice that.
        """
        return 2.0 / np.sqrt(max(self.patches, 1.0))

    @property
    def shows(self) -> Literal["model", "reverse", "neither"]:
        """Which of the two the images show."""
        difference = self.correlation - self.reverse
        if not abs(difference) > CERTAIN * self.sigma:
            return "neither"
        return "model" if difference > 0 else "reverse"


def relief_shading(
    sparse: SparseModel, images: Sequence[Image], cameras: Sequence[Camera], sun_in_cam: np.ndarray
) -> ReliefShading:
    """The shading of a sparse model compared with the images.

    images, cameras: all K. sun_in_cam: (K, 3) unit vectors towards the Sun in C. Brightness is predicted by the mean of
    Lambert's and Lommel and Seeliger's laws at albedo 1; which law it is matters little for the sign of a correlation.

    The reverse needs no model of its own: seen along a line of sight e, a normal n becomes 2 (n e) e - n. The cosine of
    emission mu stays, and that of incidence, mu0, becomes 2 mu cos(phase) - mu0.
    """
    if len(sparse.points) < FEWEST_POINTS:
        return ReliefShading(0.0, 0.0, 0.0)
    normal, blur = sparse_planes(sparse, NEIGHBOURS)
    point, compared = sparse.point_of_observation, np.zeros(len(sparse.points), bool)
    products = np.zeros((2, 3))
    for k in np.flatnonzero(sparse.registered).tolist():
        own = np.flatnonzero(sparse.point_view == k)
        at = point[own]
        line = sparse.body_from_cam.translation[k] - sparse.points[at]
        if len(own) < FEWEST_POINTS:
            continue
        gsd = float(np.median(np.linalg.norm(line, axis=-1)) / np.mean(cameras[k].focal_px))
        brightness, valid = sample_image(as_blurred(images[k], blur, gsd), sparse.point_xy[own])
        towards, sun = unit(line), sparse.body_from_cam.rotation[k] @ sun_in_cam[k]
        mu, mu0 = np.sum(normal[at] * towards, -1), normal[at] @ sun
        used = valid & (mu > 0)
        if used.sum() < FEWEST_POINTS:
            continue
        compared[at[used]] = True
        measured = _relative(brightness[used])
        for n, cosine in enumerate((mu0, 2.0 * mu * (towards @ sun) - mu0)):
            predicted = _relative(_shaded(cosine[used], mu[used]))
            products[n] += measured @ predicted, measured @ measured, predicted @ predicted
    covariance, *variances = products.T
    scale = np.sqrt(np.prod(variances, axis=0))
    correlation = np.divide(covariance, scale, out=np.zeros(2), where=scale > 0)
    return ReliefShading(*correlation.tolist(), patches=compared.sum() / NEIGHBOURS)


def _shaded(mu0: np.ndarray, mu: np.ndarray) -> np.ndarray:
    lit = np.maximum(mu0, 0.0)
    return 0.5 * lit + lit / (lit + mu)


def _relative(brightness: np.ndarray) -> np.ndarray:
    """Relative deviations from the mean; zeros where nothing is bright."""
    mean = brightness.mean()
    return brightness / mean - 1.0 if mean > 0 else np.zeros_like(brightness)
