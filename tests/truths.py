"""An analytic surface as truth to compare scenes with, and frames other than theirs."""

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.geometry import Similarity, so3_exp
from photoclinometry.model.scene import Scene
from scenes import BumpySurface

OTHER_FRAME = Similarity(0.002, so3_exp(np.array([0.4, -1.1, 0.7])), np.array([3.0, -2.0, 5.0]))
TURNED_FRAME = Similarity(0.01, so3_exp(np.array([0.3, -0.2, 0.9])), np.array([5.0, 6.0, 7.0]))
"""Another, whose unit of length is a hundred of theirs."""


def on_bumps(surface: BumpySurface):
    """Nearest points of an analytic height field, by Newton steps along its gradient."""

    def closest(points):
        foot = points.copy()
        for _ in range(20):
            xy = foot[:, :2]
            normal = surface.normal(xy)
            above = points - np.concatenate([xy, surface.height(xy)[:, None]], -1)
            slide = above - np.sum(above * normal, -1, keepdims=True) * normal
            foot = foot + slide
        foot[:, 2] = surface.height(foot[:, :2])
        return foot, np.ones(len(points), bool)

    return closest


@dataclass
class TrueMaps:
    """The attributes of `simulate.truth.TruthMaps`, of an analytic surface."""

    position: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    hit: np.ndarray
    normal_mean: np.ndarray
    albedo_mean: np.ndarray


def truth_of(scene: Scene) -> TrueMaps:
    """The maps of a scene, taken for the truth."""
    landmarks = scene.landmarks
    normal, albedo = scene.grid(landmarks.normal), scene.grid(landmarks.albedo)
    hit = np.isfinite(albedo)
    return TrueMaps(scene.grid(landmarks.position), normal, albedo, hit, normal, albedo)
