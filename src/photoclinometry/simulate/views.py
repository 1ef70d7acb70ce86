"""The views of a simulated site: true poses and Suns, measured Suns, pose priors.

Every kind of random number has its own stream, so that the same seed under another lighting or photometry shows the
same ground from the same places.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, so3_exp
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Views
from photoclinometry.simulate.options import SimulationOptions, simulated_camera
from photoclinometry.simulate.presets import Preset
from photoclinometry.simulate.trajectory import draw_poses, draw_suns, ground_half_extent, measure_suns, named_lighting


class Stream(IntEnum):
    """The random streams of a simulation; the surface has stream 1."""

    POSES = 2
    SUNS = 3
    SUN_NOISE = 4
    POSE_NOISE = 5
    HOT_PIXELS = 6
    EXPOSURE = 7
    SMEAR = 8
    ALTIMETRY = 9


def stream(options: SimulationOptions, purpose: Stream, view: int | None = None) -> np.random.Generator:
    """The random numbers for one purpose, of one view if it is given."""
    return np.random.default_rng([options.seed, int(purpose), *([] if view is None else [view])])


def draw_views(options: SimulationOptions, preset: Preset) -> tuple[tuple[Camera, ...], Views]:
    """The cameras and the true views of a site, with measured Suns, scale 1 and bias 0."""
    count, camera = options.views or preset.views, simulated_camera(options, preset)
    gsd = np.array([preset.gsd[k % len(preset.gsd)] for k in range(count)])
    poses = draw_poses(
        stream(options, Stream.POSES),
        gsd * preset.focal_px,
        camera,
        _max_emission(options, preset, gsd),
        options.pointing_jitter_px,
    )
    sun = draw_suns(stream(options, Stream.SUNS), count, named_lighting(options.lighting))
    return (camera,) * count, measured_views(options, camera, poses, sun)


def measured_views(options: SimulationOptions, camera: Camera, poses: Rigid, sun: np.ndarray) -> Views:
    """Views with true poses (K,) and Suns (K, 3) in B, and measured Suns; scale 1 and bias 0."""
    count = len(poses)
    sigma, common_sigma = np.radians(options.sun_sigma_deg), np.radians(options.sun_common_sigma_deg)
    suffix = "fits" if options.brightness == "iof" else "png"
    return Views(
        name=tuple(f"images/{k:03d}.{suffix}" for k in range(count)),
        cameras=(camera,) * count,
        body_from_cam=poses,
        sun=sun,
        scale=np.ones(count),
        bias=np.zeros(count),
        dark_level=np.zeros(count),
        sun_measured=measure_suns(stream(options, Stream.SUN_NOISE), sun, poses, sigma, common_sigma),
        sun_sigma=np.full(count, sigma),
        sun_common_sigma=np.full(count, common_sigma),
        arc=np.zeros(count, int),
    )


def _max_emission(options: SimulationOptions, preset: Preset, gsd: np.ndarray) -> np.ndarray:
    """Greatest emission angle [rad] of views with the given ground sample distances."""
    return np.radians(options.max_emission_deg) * min(preset.gsd) / gsd


def half_extent(options: SimulationOptions, preset: Preset, camera: Camera, radius: float) -> float:
    """Half the width of the square of ground [m] on a sphere that covers the views of any seed."""
    return max(
        ground_half_extent(
            camera,
            gsd * preset.focal_px,
            float(_max_emission(options, preset, np.array(gsd))),
            options.pointing_jitter_px,
            radius,
        )
        for gsd in set(preset.gsd)
    )


def pose_priors(options: SimulationOptions, body_from_cam: Rigid) -> list[PosePrior | None]:
    """Priors (K,) like those of a navigation team, with errors of the stated standard deviations; None without any."""
    count = len(body_from_cam)
    if options.pose_sigma is None:
        return [None] * count
    rotation, translation = float(np.radians(options.pose_sigma[0])), float(options.pose_sigma[1])
    rng = stream(options, Stream.POSE_NOISE)
    turn = so3_exp(rotation * rng.standard_normal((count, 3)))
    shift = translation * rng.standard_normal((count, 3))
    common = options.pose_common_sigma or (0.0, 0.0)
    common_rotation, common_translation = float(np.radians(common[0])), float(common[1])
    turn = turn @ so3_exp(common_rotation * rng.standard_normal(3))
    shift += common_translation * rng.standard_normal(3)
    # The shift is that of the camera's centre, so that an error of the attitude does not move the camera.
    noisy = Rigid(body_from_cam.rotation @ turn, body_from_cam.translation + shift).inverse()
    return [PosePrior(noisy[k], rotation, translation, common_rotation, common_translation) for k in range(count)]
