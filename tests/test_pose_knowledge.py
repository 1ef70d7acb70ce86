"""What keypoints tell of poses, and how far a prior is from what all else tells: in a narrow field, and by hand."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import Rigid, skew, so3_exp
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.projection import keypoint_residuals
from photoclinometry.registration.georeference import CONTRADICTS, agreement
from photoclinometry.registration.pose_knowledge import POSE, disagreement, pose_information
from scenes import synthetic_scene

ROTATION_SIGMA, CENTER_SIGMA = np.radians(0.001), 20.0
"""Of priors of cameras at 600 km: 10 m on the ground and 20 m."""
MATCHES_PX = 0.05
ODD = 3
"""The view whose pose or prior is another."""


@pytest.fixture(scope="module")
def scene():
    """40 x 40 landmarks in a field of 0.6 degrees, seen in eight views."""
    exact = synthetic_scene(size=40, views=8)
    sigma = np.full(len(exact.tracks), MATCHES_PX)
    return replace(exact, tracks=replace(exact.tracks, keypoint_sigma=sigma))


@pytest.fixture(scope="module")
def information(scene):
    return pose_information(scene)


def moved(poses, view, turn, shift):
    """Poses of which one is turned by a rotation vector and shifted, both along its own axes."""
    rotation, center = poses.rotation.copy(), poses.translation.copy()
    center[view] += rotation[view] @ shift
    rotation[view] = rotation[view] @ so3_exp(np.asarray(turn))
    return Rigid(rotation, center)


def priors_of(scene, poses, seed=0):
    """Priors by name, off by their sigmas."""
    rng, known = np.random.default_rng(seed), {}
    for k, name in enumerate(scene.views.name):
        turn, shift = ROTATION_SIGMA * rng.normal(size=3), CENTER_SIGMA * rng.normal(size=3)
        pose = moved(poses, k, turn, shift)[k]
        known[name] = PosePrior(pose.inverse(), ROTATION_SIGMA, CENTER_SIGMA)
    return known


def test_keypoints_tell_nothing_of_the_frame(scene, information):
    """Neither rotations, nor shifts, nor sizes of all have information; the other directions have."""
    center = scene.views.body_from_cam.translation
    free = np.zeros((len(center), POSE, 7))
    free[:, :3, :3] = np.eye(3)
    free[:, 3:, :3] = -skew(center)
    free[:, 3:, 3:6] = np.eye(3)
    free[:, 3:, 6] = center
    free = free.reshape(-1, 7) / np.linalg.norm(free.reshape(-1, 7), axis=0)
    size = np.sqrt(np.diag(information))
    along = free * size[:, None]
    along /= np.linalg.norm(along, axis=0)
    assert np.abs(information / np.outer(size, size) @ along).max() < 1e-6
    values = np.linalg.eigvalsh(information / np.outer(size, size))
    assert np.count_nonzero(values < 1e-13) == 7


def test_the_information_of_a_turn_about_the_line_of_sight_is_that_of_the_moved_keypoints(scene, information):
    """Where landmarks are nearly known by seven other views, it is what the keypoints move by, in sigmas."""
    angle = 1e-6
    poses = moved(scene.views.body_from_cam, ODD, [0.0, 0.0, angle], np.zeros(3))
    rolled = replace(scene, views=replace(scene.views, body_from_cam=poses))
    shift = (keypoint_residuals(rolled) - keypoint_residuals(scene))[scene.tracks.view == ODD] / MATCHES_PX / angle
    squares = 4 * 4 * np.mean(np.sum(shift**2, -1))  # 4 x 4 squares of 12 px, of which one landmark counts each
    axis = scene.views.body_from_cam.rotation[ODD][:, 2]
    block = slice(POSE * ODD, POSE * ODD + 3)
    assert axis @ information[block, block] @ axis == pytest.approx(squares, rel=0.35)


def test_disagreement_is_that_with_the_prior_left_out(scene, information):
    """Beside the plain statement, which solves for all else without the prior."""
    count, rng = len(scene.views), np.random.default_rng(2)
    sigma = np.tile(np.repeat([ROTATION_SIGMA, CENTER_SIGMA], 3), (count, 1))
    offset = 3.0 * sigma * rng.normal(size=sigma.shape)
    used = np.arange(count) != 5
    found = disagreement(information, offset, sigma, np.arange(count), used)
    for k in range(count):
        weight = np.where((used & (np.arange(count) != k))[:, None], sigma**-2.0, 0.0).ravel()
        size = np.sqrt(np.diag(information) + weight)
        whole = (information + np.diag(weight)) / np.outer(size, size)
        covariance = np.linalg.inv(whole) / np.outer(size, size)
        own = slice(POSE * k, POSE * k + POSE)
        off = offset[k] - (covariance @ (weight * offset.ravel()))[own]
        square = off @ np.linalg.solve(covariance[own, own] + np.diag(sigma[k] ** 2), off)
        assert found[k] == pytest.approx(np.sqrt(square / POSE), rel=0.02)


def test_sound_priors_agree_where_the_scene_has_traded_place_for_attitude(scene):
    """A view shifted by 100 sigmas of its prior and turned back to the same ground: its keypoints hardly notice."""
    shift = np.array([100.0 * CENTER_SIGMA, 0.0, 0.0])
    distance = np.linalg.norm(scene.views.body_from_cam.translation[ODD])
    poses = moved(scene.views.body_from_cam, ODD, [0.0, -shift[0] / distance, 0.0], shift)
    traded = replace(scene, views=replace(scene.views, body_from_cam=poses))
    keypoints = keypoint_residuals(traded)[traded.tracks.view == ODD]
    assert np.sqrt(np.mean(np.sum((keypoints - keypoints.mean(0)) ** 2, -1))) < 10 * MATCHES_PX
    fit = agreement(traded, priors_of(scene, scene.views.body_from_cam))
    assert fit.deviation[ODD] > 20.0
    assert fit.used.all()
    assert fit.disagreement.max() < 2.0


WRONG = {
    "12 sigmas across": ([0.0, 0.0, 0.0], [12.0 * CENTER_SIGMA, 0.0, 0.0]),
    "a degree": ([0.0, np.radians(1.0), 0.0], [0.0, 0.0, 0.0]),
    "30 sigmas of attitude": ([30.0 * ROTATION_SIGMA, 0.0, 0.0], [0.0, 0.0, 0.0]),
}


@pytest.mark.parametrize("error", WRONG)
@pytest.mark.parametrize("seed", range(3))
def test_a_wrong_prior_is_left_out_and_no_other(scene, error, seed):
    wrong = priors_of(scene, moved(scene.views.body_from_cam, ODD, *map(np.array, WRONG[error])), seed)
    fit = agreement(scene, wrong)
    assert np.flatnonzero(~fit.used).tolist() == [ODD]
    assert fit.disagreement[ODD] > CONTRADICTS
