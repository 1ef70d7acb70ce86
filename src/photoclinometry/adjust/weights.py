"""How much each measurement counts in the estimate, given what its errors are taken to be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photoclinometry.adjust.layout import Measurements, spread
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.scene import Scene

DIRECT_SLACK = 50.0
"""Where brightness follows a landmark (`ImageSlopes`), its keypoints are held this many times looser: they then hold
what no image shows, and nothing else. Matches were found with the very map that brightness is to correct."""

ANCHOR_SLACK = 4.0
"""Anchors are then held this many times looser: brightness that errs alike over many pixels counts for little, but its
slopes differ from pixel to pixel and say more than that of where views stand."""

RAY_SIGMA_PX = 0.004
"""How near such a landmark stays to its pixel's ray of the reference view [px]: which point of the ground it is, is a
choice."""


class Weights(NamedTuple):
    """How much each measurement counts in the estimate."""

    keypoint: np.ndarray
    """(N,) 1 / sigma [1/px]."""
    brightness: np.ndarray
    """(N,) 1 / sigma, zero where brightness does not count."""
    keypoint_limit: np.ndarray
    """(J,) Huber limits in sigmas."""
    brightness_limit: float


def weights_of(scene: Scene, options: AdjustOptions, lit, own, noise: Noise, direct: np.ndarray | None) -> Weights:
    """Of all observations (N,), of which brightness counts where lit (N,).

    own: (J,) landmarks of the map, the rest are anchors; direct: (J,) those whose brightness follows them, None where
    none does (`ImageSlopes`).
    """
    tracks = scene.tracks
    shared = options.keypoint_slack * noise.keypoint_factor * noise.keypoint_correlation_px
    factor = np.where(own, shared, noise.anchor_factor)
    if direct is not None:
        factor *= np.where(direct, DIRECT_SLACK, np.where(own, 1.0, ANCHOR_SLACK))
    sigma = tracks.keypoint_sigma * factor[tracks.landmark]
    limit = options.keypoint_loss / np.where(own, noise.keypoint_correlation_px, 1.0)
    if direct is not None:
        limit[direct] = np.inf
        sigma[direct[tracks.landmark] & (tracks.view == scene.reference)] = RAY_SIGMA_PX
    return Weights(
        keypoint=1.0 / sigma,
        brightness=lit / (noise.brightness_sigma * noise.brightness_correlation_px) if lit.any() else lit.astype(float),
        keypoint_limit=limit,
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
