"""A coarse shape as one track of an altimeter: its errors are counted once, and it places a map within its sigmas."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions, PosePriors, ScenePriors, adjust
from photoclinometry.model.altimetry import track_of_surface
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.registration.alignment import transform_scene
from scenes import GSD, bumpy_surface, synthetic_scene

INDEPENDENT = AdjustOptions(keypoint_correlation_px=1, brightness_correlation_px=1)
SIGMA_M, SHIFT_M = 40.0, 10.0
STEP, BLUR = GSD, 1.6 * GSD
"""Distance of the coarse shape's points, and the sigma of the Gaussian that its errors are smoothed by [m]."""
SIDE = np.sqrt(4.0 * np.pi) * BLUR
"""Of the square in which errors are alike [m]: the root of their correlation's integral, exp(-d^2 / (4 BLUR^2))."""


def coarse_shape(rng):
    """(n, 3) points over the ground of `synthetic_scene`, off by smooth errors of SIGMA_M and by a shift."""
    from scipy.ndimage import gaussian_filter

    line = np.arange(-26 * GSD, 26 * GSD, STEP)
    xy = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    smooth = gaussian_filter(rng.normal(size=(len(line) + 40,) * 2), BLUR / STEP)[20:-20, 20:-20]
    error = SIGMA_M * smooth.ravel() / np.std(smooth)
    return np.column_stack([xy, bumpy_surface().height(xy) + error]) + SHIFT_M * rng.normal(size=3)


@pytest.fixture(scope="module")
def known():
    """A scene of six views, moved by 160 m, and pose priors that have 600 m and 0.06 degrees in common."""
    true = replace(synthetic_scene(size=32, views=6, keypoint_noise_px=0.3, brightness_noise=0.01), frame=BODY_FIXED)
    priors = PosePriors(
        body_from_cam=true.views.body_from_cam,
        rotation_sigma=np.full(6, 1e-4),
        center_sigma=np.full(6, 20.0),
        common_rotation_sigma=1e-3,
        common_center_sigma=600.0,
    )
    return true, transform_scene(Similarity(1.0, np.eye(3), np.array([40.0, -30.0, 150.0])), true), priors


def errors_in_sigmas(known, tracks):
    """Of the map's place along x, y and z, and of its tilt about x and y; and sigmas of its place [m]."""
    true, start, priors = known
    found = adjust(start, INDEPENDENT, priors=ScenePriors(pose_priors=priors, altimetry=tracks))
    off, arm = found.scene.landmarks.position - true.landmarks.position, true.landmarks.position.copy()
    arm -= arm.mean(0)
    east, north = np.linalg.lstsq(arm[:, :2], off[:, 2], rcond=None)[0]
    sigma = np.sqrt(np.diag(found.frame_covariance))
    return np.r_[off.mean(0), north, -east] / sigma[[3, 4, 5, 0, 1]], sigma[3:6]


def test_a_coarse_shape_places_a_map_within_its_sigmas_and_all_of_its_points_do_not(known):
    """Three draws. Without the shape, each axis of the place is known to 600 m; with it, height to 25 m and the others
    to 150 m. All points, as if their errors were independent, tilt the map by five sigmas and more."""
    thinned, every = [], []
    for seed in range(3):
        points = coarse_shape(np.random.default_rng([seed, 5]))
        error, sigma = errors_in_sigmas(known, track_of_surface(points, SIDE, SIGMA_M, SHIFT_M))
        assert np.all(sigma < [150.0, 150.0, 25.0])
        thinned.append(error)
        every.append(errors_in_sigmas(known, track_of_surface(points, 0.5 * STEP, SIGMA_M, SHIFT_M))[0])
    assert np.abs(thinned).max() < 3.0
    assert np.sqrt(np.mean(np.square(thinned))) < 1.5
    assert np.abs(every).max() > 5.0
    assert np.sqrt(np.mean(np.square(every))) > 2.0


def test_points_of_the_track_are_as_far_apart_as_is_said():
    """Of a grid of 10 m, thinned to 25 m: every point is within 25 m of one that stays."""
    grid = np.stack(np.meshgrid(np.arange(0, 200, 10.0), np.arange(0, 200, 10.0)), -1).reshape(-1, 2)
    tracks = track_of_surface(np.column_stack([grid, np.zeros(len(grid))]), 25.0, 3.0, 7.0)
    apart = np.linalg.norm(tracks.position[:, None] - tracks.position, axis=-1)
    assert apart[~np.eye(len(tracks), dtype=bool)].min() > 25.0
    near = np.linalg.norm(grid[:, None] - tracks.position[:, :2], axis=-1).min(1)
    assert near.max() <= 25.0
    assert (tracks.sigma == 3.0).all()
    assert tracks.shift_sigma.tolist() == [7.0]


@pytest.mark.parametrize(
    ("points", "numbers", "message"),
    [
        (np.zeros((4, 2)), (1.0, 1.0, 1.0), r"of shape \(4, 2\)"),
        (np.full((4, 3), np.nan), (1.0, 1.0, 1.0), "not finite"),
        (np.zeros((4, 3)), (1.0, 0.0, 1.0), "sigma is 0; give metres above 0"),
    ],
)
def test_a_surface_that_is_none_is_refused(points, numbers, message):
    with pytest.raises(InputError, match=message):
        track_of_surface(points, *numbers)
