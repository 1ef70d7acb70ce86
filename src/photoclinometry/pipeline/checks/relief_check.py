"""Whether the relief of a map agrees with the parallax of its images.

Brightness gives slopes, and with them relief in proportion to the strength of the shading. Spoiled images (compression,
a response that is not linear, haze) or wrong Sun directions shrink or stretch the relief, while every residual stays
small. Matches of the images as they came, before any map existed, give heights without shading. These are noisy from
landmark to landmark, but not over long distances.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.geometry import align_similarity, tangent_basis, unit
from photoclinometry.model.robust import FEWEST_FOR_SIGMA, jackknife_sigma
from photoclinometry.model.sampling import gaussian, masked_filter
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn

log = logging.getLogger(__name__)

SMOOTHING = 1 / 20
"""Heights are compared after smoothing by a Gaussian of this share of the map's shorter side: matching errors average
out there, and relief of many wavelengths is left."""

BLOCKS = 4
"""The map is divided into BLOCKS x BLOCKS blocks; each is left out once (jackknife)."""

MOST_OFF, FAR_OFF = 0.05, 0.2
"""Shares by which relief may differ from that of parallax without being called wrong, and without making the whole map
untrustworthy. 18 simulated maps, whose ground has another reflectance than the one inverted, are all within 0.007. The
map of four clean images of Vesta is at 0.96; saved as JPEG, with gamma or with distortion they give 0.6 to 0.9."""

SPOILED_SPREAD, SOUND_SPREAD = 0.25, 0.01
"""Standard deviations of relief over parallax about 1, of maps of spoiled images and of sound ones, the errors of the
parallax apart. The first is that of the spoiled maps of Vesta, the second that of simulated maps."""

EVIDENCE = 3.0
"""How many times likelier the relief must be for a spoiled map than for a sound one before it is called wrong:
"positive" evidence (Kass and Raftery 1995, Bayes Factors). Of 330 simulated maps and tiles of sound images none has
more than 1. Of 13 maps of the images of Vesta as JPEG, with gamma or with distortion nine have more than 3; the others
have 0.92 to 0.95 of their relief. A limit of three standard deviations missed one of 0.78 +- 0.08."""

MATCH_CORRELATION_PX = 25.0
"""Side of the square of pixels whose dense matches have the same error [px]: 20 to 35 px in 18 maps from matches alone.
It holds for the first matches. Residuals of a map made from brightness belong to later matches."""

_MOST_EXPONENT = 700.0
"""Largest exponent whose exponential is still finite."""


@dataclass(frozen=True)
class ReliefCheck:
    """Relief of a map over that of the parallax."""

    ratio: float
    sigma: float
    """Standard deviation."""

    def is_off(self, by: float = MOST_OFF) -> bool:
        """Whether the two differ by more than this share, and not by errors of the parallax."""
        return abs(self.ratio - 1.0) > by and self.evidence > EVIDENCE

    @property
    def evidence(self) -> float:
        """The Bayes factor of a spoiled map against a sound one: how many times likelier the ratio is for the first."""
        sound, spoiled = (math.hypot(self.sigma, spread) for spread in (SOUND_SPREAD, SPOILED_SPREAD))
        squared = (self.ratio - 1.0) ** 2 * (sound**-2 - spoiled**-2)
        return sound / spoiled * math.exp(min(0.5 * squared, _MOST_EXPONENT))

    def metrics(self) -> dict[str, float]:
        """For metrics.json."""
        return {"relief_over_parallax": self.ratio, "relief_over_parallax_sigma": self.sigma}


def relief_by_parallax(
    scene: Scene, position: np.ndarray, pixel: np.ndarray, correlation_px: float = MATCH_CORRELATION_PX
) -> ReliefCheck | None:
    """The relief of a map compared with that of points triangulated from matches made without the map.

    position: (M, 3) of the points, in any frame; pixel: (M, 2) int (row, col) of each in the reference image. None
    where too few points are in the map, too. correlation_px: side of the square of pixels whose matches err alike.
    """
    mine, others = _shared(scene, pixel)
    if len(mine) < FEWEST_FOR_SIGMA:
        return None
    found, matched = scene.landmarks.position[mine], position[others]
    matched = align_similarity(matched, found)(matched)
    up = unit(scene.landmarks.normal[mine].mean(axis=0))
    across = (found - found.mean(axis=0)) @ tangent_basis(up)
    plane = np.column_stack([across, np.ones(len(found))])
    cells = scene.region.cells(scene.landmarks.pixel[mine])
    heights = np.full((*scene.region.grid_shape, 2), np.nan)
    for column, points in enumerate((found, matched)):
        height = points @ up
        heights[(*cells, column)] = height - plane @ np.linalg.lstsq(plane, height, rcond=None)[0]
    smooth, _ = masked_filter(heights, gaussian(max(1.0, SMOOTHING * min(scene.region.grid_shape))))
    of_map, of_matches = smooth[cells].T
    block = _blocks(cells, scene.region.grid_shape)
    both, alone = (np.bincount(block, product, BLOCKS**2) for product in (of_map * of_matches, of_map * of_map))
    if not both.sum() > 0.0:
        return None
    ratio = float(alone.sum() / both.sum())
    without = (alone.sum() - alone) / (both.sum() - both)
    without = without[np.bincount(block, minlength=BLOCKS**2) > 0]
    # Chance errors of the matches: few independent ones fit into a small map, and the jackknife does not see them.
    left = np.sum((of_matches - of_map / ratio) ** 2) / alone.sum() * ratio**2
    chance = left / max(1.0, len(mine) * (scene.region.stride / correlation_px) ** 2)
    return ReliefCheck(ratio=ratio, sigma=math.hypot(float(jackknife_sigma(without)), math.sqrt(chance)))


def warn_of_relief(check: ReliefCheck | None) -> None:
    """Warns where relief and parallax contradict each other."""
    if check is not None and check.is_off():
        warn(
            log, "relief-contradicts",
            "the relief of the map is %.2f of that which the parallax of the images shows (standard deviation %.2f): "
            "look for images that are not linear in radiance (JPEG, gamma, contrast), haze, wrong Suns, or distortion "
            "that was left in", check.ratio, check.sigma,
        )  # fmt: skip


def _shared(scene: Scene, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of landmarks of the map, and of the points of the same pixels."""
    width = max(int(scene.landmarks.pixel[:, 1].max()), int(pixel[:, 1].max())) + 1
    keys = [rows.astype(np.int64) @ [width, 1] for rows in (scene.landmarks.pixel, pixel)]
    _, mine, others = np.intersect1d(*keys, assume_unique=True, return_indices=True)
    return mine, others


def _blocks(cells: tuple[np.ndarray, np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """(n,) which block each cell of a grid of a shape is in."""
    row, col = (np.minimum(BLOCKS * index // size, BLOCKS - 1) for index, size in zip(cells, shape, strict=True))
    return BLOCKS * row + col
