"""How much each measurement counts in the estimate, given what its errors are taken to be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photoclinometry.adjust.companions import COPY_STEP, Roles
from photoclinometry.adjust.layout import Measurements, spread
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.model.scene import Scene

DIRECT_SIGMA_PX = 25.0
"""Keypoints' standard deviation where brightness follows their landmark (`ImageSlopes`) [px]: they then hold what no
image shows, and nothing else. Matches were found with the very map that brightness is to correct."""

ANCHOR_SLACK = 4.0
"""Beside copies, anchors' standard deviations are this many times what their residuals say: a feature that shading
makes goes where the shading goes, alike in all views of about one light, which then agree on what is wrong."""

RAY_SIGMA_PX = 0.004
"""How near a landmark that brightness follows stays to its pixel's ray of the reference view [px]: which point of the
ground it is, is a choice."""


class Weights(NamedTuple):
    """How much each measurement counts in the estimate."""

    keypoint: np.ndarray
    """(N,) 1 / sigma [1/px]."""
    brightness: np.ndarray
    """(N,) 1 / sigma, zero where brightness does not count."""
    keypoint_limit: np.ndarray
    """(J,) Huber limits in sigmas."""
    brightness_limit: float


def weights_of(scene: Scene, options: AdjustOptions, lit: np.ndarray, roles: Roles, noise: Noise) -> Weights:
    """Of all observations (N,), of which brightness counts where lit (N,)."""
    tracks = scene.tracks
    own = options.keypoint_slack * noise.keypoint_factor
    shared = noise.keypoint_correlation_px
    copied = max(1.0, shared / COPY_STEP)
    directly = bool(roles.direct.any())
    among = copied if directly else shared  # few that stay with their matches must not follow noise instead
    alike = np.select([roles.mapped, roles.copy], [among, copied], 1.0)
    anchors = noise.anchor_factor * (ANCHOR_SLACK if directly else 1.0)
    factor = alike * np.where(roles.anchor, anchors, own)
    sigma = tracks.keypoint_sigma * factor[tracks.landmark]
    if directly:
        loose = np.where(tracks.view == scene.reference, RAY_SIGMA_PX, DIRECT_SIGMA_PX)
        sigma = np.where(roles.direct[tracks.landmark], loose, sigma)
    return Weights(
        keypoint=1.0 / sigma,
        brightness=lit / (noise.brightness_sigma * noise.brightness_correlation_px) if lit.any() else lit.astype(float),
        keypoint_limit=np.where(roles.direct, np.inf, options.keypoint_loss / alike),
        brightness_limit=options.brightness_loss / noise.brightness_correlation_px,
    )


def weighted(measured: Measurements, weights: Weights, place: np.ndarray) -> Measurements:
    """The measurements with weights and loss limits."""
    size = measured.brightness.size
    return measured._replace(
        keypoint_weight=spread(weights.keypoint, place, size, np.float32),
        brightness_weight=spread(weights.brightness, place, size, np.float32),
        keypoint_limit=weights.keypoint_limit,
        brightness_limit=weights.brightness_limit,
    )
