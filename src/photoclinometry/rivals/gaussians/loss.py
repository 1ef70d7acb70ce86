"""The loss of one view, and its derivatives by all parameters of a cloud.

Kerbl et al. (2023), Eq. 7:  L = (1 - share) L1 + share (1 - SSIM),  over the pixels of a mask.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.rivals.gaussians.blending import Blended, Tiles, blend, blend_back, tiles_of
from photoclinometry.rivals.gaussians.cloud import Cloud
from photoclinometry.rivals.gaussians.colour import Colour, Light
from photoclinometry.rivals.gaussians.projection import Ellipses, Pinhole, project, project_back
from photoclinometry.rivals.ssim import ssim_and_gradient

SIMILARITY_SHARE = 0.2
"""Share of 1 - SSIM in the loss (Kerbl et al. 2023)."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """One view: the part of its picture that shows the map."""

    camera: Pinhole
    light: Light
    picture: np.ndarray
    """(height, width) brightness, of peak 1."""
    mask: np.ndarray
    """(height, width) bool."""


@dataclass(frozen=True)
class Rendering:
    """A cloud drawn in a view, with what the derivatives need."""

    ellipses: Ellipses
    tiles: Tiles
    value: np.ndarray
    """(N, 1) brightness of each Gaussian."""
    made: Blended

    @property
    def picture(self) -> np.ndarray:
        """(height, width)."""
        return self.made.value[..., 0]


@dataclass(frozen=True)
class Gradients:
    """A loss and its derivatives."""

    loss: float
    by: dict[str, np.ndarray]
    """By the arrays of `Cloud.parameters`."""
    by_center: np.ndarray
    """(N, 2) by where Gaussians project [1/px]; what the density control looks at."""
    by_gain: float
    by_offset: float
    seen: np.ndarray
    """(N,) bool: the Gaussian is in the picture."""


def draw(cloud: Cloud, colour: Colour, camera: Pinhole, light: Light, shape: tuple[int, int]) -> Rendering:
    """A cloud as a camera sees it."""
    ellipses = project(cloud, camera)
    tiles = tiles_of(ellipses, shape)
    value = colour.brightness(cloud, light)[:, None]
    return Rendering(ellipses, tiles, value, blend(ellipses, cloud.opacity, value, tiles, shape))


def draw_values(
    cloud: Cloud, camera: Pinhole, value: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Any values (N, C) of the Gaussians, weighted as their brightness is: means (height, width, C), coverage."""
    ellipses = project(cloud, camera)
    made = blend(ellipses, cloud.opacity, value, tiles_of(ellipses, shape), shape)
    covered = 1.0 - made.left
    return made.value / np.maximum(covered, 1e-9)[..., None], covered


def picture_loss(picture: np.ndarray, target: Target) -> tuple[float, np.ndarray]:
    """Loss of a picture (height, width), and its derivative by that."""
    off = np.where(target.mask, picture - target.picture, 0.0)
    count = max(int(target.mask.sum()), 1)
    similar, by_picture = ssim_and_gradient(picture, target.picture, target.mask)
    loss = (1.0 - SIMILARITY_SHARE) * float(np.abs(off).sum()) / count + SIMILARITY_SHARE * (1.0 - similar)
    return loss, (1.0 - SIMILARITY_SHARE) * np.sign(off) / count - SIMILARITY_SHARE * by_picture


def gradients(cloud: Cloud, colour: Colour, target: Target, gain: float = 1.0, offset: float = 0.0) -> Gradients:
    """The loss of gain * rendering + offset, and its derivatives."""
    drawn = draw(cloud, colour, target.camera, target.light, target.mask.shape)
    loss, by_picture = picture_loss(gain * drawn.picture + offset, target)
    by_center, by_conic, by_opacity, by_value = blend_back(
        drawn.ellipses, cloud.opacity, drawn.value, drawn.tiles, drawn.made, (gain * by_picture)[..., None]
    )
    own = colour.back(cloud, target.light, by_value[:, 0])
    by = project_back(cloud, target.camera, by_center, by_conic, own.by_normal)
    by["position"] += own.by_position
    by["logit"] = by_opacity * cloud.opacity * (1.0 - cloud.opacity)
    seen = np.zeros(len(cloud), bool)
    seen[drawn.tiles.entry] = True
    return Gradients(
        loss, by | own.by_colour, by_center, float(np.sum(by_picture * drawn.picture)), float(by_picture.sum()), seen
    )
