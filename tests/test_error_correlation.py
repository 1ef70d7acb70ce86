"""How errors of different landmarks go together: sums over all pairs, frames, and a dense inverse."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dense_covariances import dense_covariance, linearized_at_truth
from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.adjust.covariance import between_landmarks
from photoclinometry.adjust.covariance.between_landmarks import LENGTHS, correlation_by_distance
from photoclinometry.adjust.covariance.marginals import ErrorModel, marginals
from photoclinometry.io.scene_file import read_scene, write_scene
from photoclinometry.model.error_correlation import ErrorCorrelation
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity, skew, so3_exp
from photoclinometry.registration.alignment import transform_scene
from scenes import synthetic_scene

SHARES = ErrorCorrelation(length_px=np.array([1.0, 8.0]), share=np.array([0.3, 0.5]))


def scene_with(correlation=SHARES, stride=1, seed=0):
    """A scene whose positions have full covariances, the same in no two landmarks."""
    rng = np.random.default_rng(seed)
    scene = synthetic_scene(size=9, views=3)
    by = rng.normal(size=(len(scene.landmarks), 3, 3))
    position = by @ np.swapaxes(by, 1, 2)
    region = replace(scene.region, stride=stride, height=stride * 9, width=stride * 9)
    corner = (region.row, region.col)
    pixel = np.asarray(corner + stride * (scene.landmarks.pixel - corner), scene.landmarks.pixel.dtype)
    return replace(
        scene,
        region=region,
        landmarks=replace(scene.landmarks, pixel=pixel),
        uncertainty={"position": position},
        error_correlation=correlation,
    )


def heights_off(found, true):
    """(J,) after the best similarity of the positions, to first order."""
    arm = true - true.mean(0)
    moves = np.concatenate([-skew(arm), np.broadcast_to(np.eye(3), (len(arm), 3, 3)), arm[:, :, None]], axis=2)
    off = (found - true).ravel()
    by_frame = moves.reshape(-1, 7)
    return (off - by_frame @ np.linalg.lstsq(by_frame, off)[0]).reshape(-1, 3)[:, 2]


def root(matrix):
    value, vector = np.linalg.eigh(matrix)
    return (vector * np.sqrt(value)) @ vector.T


@pytest.mark.parametrize("stride", [1, 3])
def test_the_variance_is_the_sum_over_all_pairs(stride):
    scene = scene_with(stride=stride)
    rng = np.random.default_rng(1)
    chosen = rng.permutation(len(scene.landmarks))[:30]
    gradient = rng.normal(size=(30, 3))
    position, pixel = scene.uncertainty["position"], scene.landmarks.pixel.astype(float)
    expected = 0.0
    for j, g in zip(chosen, gradient, strict=True):
        for k, h in zip(chosen, gradient, strict=True):
            d = math.hypot(*(pixel[j] - pixel[k]))
            r = 1.0 if j == k else 0.3 * math.exp(-d) + 0.5 * math.exp(-d / 8.0)
            expected += r * g @ root(position[j]) @ root(position[k]) @ h
    assert scene.sigma_of(chosen, gradient) == pytest.approx(math.sqrt(expected))


def test_one_landmark_has_the_sigma_that_is_stated():
    scene = scene_with()
    along = np.array([0.3, -0.5, 0.8])
    stated = math.sqrt(along @ scene.uncertainty["position"][7] @ along)
    assert scene.sigma_of(7, along) == pytest.approx(stated)
    alone = replace(SHARES, share=np.zeros(2))
    pair = scene_with(alone).sigma_of([7, 8], [along, -along])
    assert pair == pytest.approx(math.sqrt(stated**2 + along @ scene.uncertainty["position"][8] @ along))


def test_errors_of_a_known_frame_move_all_landmarks_alike():
    """Half a unit of place, 1e-3 of scale: differences do not have the first, distances have the second."""
    frame = np.diag([0.0, 0.0, 0.0, 0.25, 0.25, 0.25, 1e-6])
    scene = scene_with(replace(SHARES, frame=frame))
    arm = scene.landmarks.position - SHARES.pivot
    moves = np.concatenate([-skew(arm), np.broadcast_to(np.eye(3), (81, 3, 3)), arm[:, :, None]], axis=2)
    whole = scene.uncertainty["position"] + moves @ frame @ np.swapaxes(moves, 1, 2)
    placed = replace(scene, uncertainty={"position": whole})
    a, b = 3, 77
    between = scene.landmarks.position[b] - scene.landmarks.position[a]
    length = np.linalg.norm(between)
    gradient = np.stack([-between, between]) / length
    own = scene_with().sigma_of([a, b], gradient)
    assert placed.sigma_of([a, b], gradient) == pytest.approx(math.hypot(own, 1e-3 * length))


def test_quantities_are_the_same_in_every_frame_and_after_a_file(tmp_path):
    frame = np.diag([1e-6, 2e-6, 3e-6, 0.1, 0.2, 0.3, 1e-6])
    scene = scene_with(replace(SHARES, frame=frame, pivot=np.array([1.0, 2.0, 3.0])))
    scene = replace(scene, uncertainty={"position": scene.uncertainty["position"] + 1e3 * np.eye(3)})
    similarity = Similarity(2.5, so3_exp(np.array([0.3, -0.2, 0.5])), np.array([5.0, 6.0, 7.0]))
    moved = transform_scene(similarity, scene)
    gradient = np.random.default_rng(2).normal(size=(2, 3))
    here, there = scene.sigma_of([3, 40], gradient), moved.sigma_of([3, 40], gradient @ similarity.rotation.T)
    assert there == pytest.approx(2.5 * here)
    write_scene(tmp_path / "scene.h5", scene)
    assert read_scene(tmp_path / "scene.h5").sigma_of([3, 40], gradient) == here


def test_what_is_not_known_is_said():
    scene = scene_with()
    unknown = scene.uncertainty["position"].copy()
    unknown[5] = np.inf
    assert replace(scene, uncertainty={"position": unknown}).sigma_of([5, 6], np.eye(3)[:2]) == math.inf
    for bare in (replace(scene, uncertainty={}), replace(scene, error_correlation=None)):
        with pytest.raises(InputError, match="does not state how errors"):
            bare.sigma_of(5, np.eye(3)[0])


def test_correlations_by_distance_are_those_of_the_dense_inverse():
    """Of a map so small that nothing is approximated: mean correlations of positions to 0.05 at every distance."""
    scene = synthetic_scene(size=6, views=3)
    at, built = linearized_at_truth(scene)
    covariance, views = dense_covariance(scene, built)
    own = covariance[views:, views:].reshape(36, 6, 36, 6)[:, :3, :, :3]
    trace = np.einsum("jiki->jk", own)
    expected = trace / np.sqrt(np.outer(np.diag(trace), np.diag(trace)))
    cell = np.stack(scene.cells, -1)
    errors = ErrorModel(keypoint=np.ones(36))
    found = ErrorCorrelation(
        length_px=np.array(LENGTHS),
        share=correlation_by_distance(at, errors, marginals(at, errors).common, cell, exact=True, shared_side=1.0),
    )
    distance = np.hypot(*(cell[:, None] - cell[None]).transpose(2, 0, 1))
    for low, high in ((0.9, 1.1), (1.9, 2.3), (2.9, 3.3), (3.9, 5.2)):
        some = (distance > low) & (distance < high)
        assert found.at(distance[some]).mean() == pytest.approx(expected[some].mean(), abs=0.05)


def test_sums_over_many_landmarks_scatter_as_stated(monkeypatch):
    """Heights of noisy estimates, ten draws: means over squares of 5 x 5, and differences of neighbours, scatter by
    as many of their sigmas as single heights do. By sigmas of independent errors they would not."""
    monkeypatch.setattr(between_landmarks, "RUN", 256)  # the whole map
    truth = synthetic_scene(size=16, views=6)
    cell, draws, up = np.stack(truth.cells, -1), [], np.array([0.0, 0.0, 1.0])
    for seed in range(10):
        rng, tracks = np.random.default_rng(seed), truth.tracks
        moved = tracks.keypoint + rng.normal(0.0, 0.1, tracks.keypoint.shape)
        lit = tracks.brightness * (1.0 + rng.normal(0.0, 0.01, len(tracks)))
        noisy = replace(truth, tracks=replace(tracks, keypoint=moved, brightness=lit))
        draws.append(adjust(noisy, AdjustOptions()).scene)
    height = np.array([heights_off(found.landmarks.position, truth.landmarks.position) for found in draws])
    scatter = (height - height.mean(0)) * math.sqrt(10 / 9)
    single, squares, pairs, independent = [], [], [], []
    for found, off in zip(draws, scatter, strict=True):
        variance = found.uncertainty["position"][:, 2, 2]
        single.append(np.mean(off**2 / variance))
        for corner in np.ndindex(3, 3):
            first = 5 * np.array(corner)
            inside = np.flatnonzero(((cell >= first) & (cell < first + 5)).all(1))
            sigma = found.sigma_of(inside, np.tile(up / 25.0, (25, 1)))
            squares.append((off[inside].mean() / sigma) ** 2)
            independent.append(off[inside].mean() ** 2 / (variance[inside].sum() / 25.0**2))
            a, b = inside[:2]
            pairs.append(((off[a] - off[b]) / found.sigma_of([a, b], [up, -up])) ** 2)
    assert 0.5 < np.mean(squares) / np.mean(single) < 2.0
    assert 0.4 < np.mean(pairs) / np.mean(single) < 2.0
    assert np.mean(independent) / np.mean(single) > 2.5


def test_ground_that_not_all_views_see_is_no_obstacle():
    """The last view sees the half of the map that comes first."""
    truth = synthetic_scene(size=20, views=6, brightness_noise=0.003)
    tracks = truth.tracks
    kept = np.flatnonzero((tracks.view < 5) | (truth.cells[1][tracks.landmark] < 10))
    count = np.bincount(tracks.landmark[kept], minlength=len(truth.landmarks))
    fewer = replace(
        tracks,
        start=np.r_[0, np.cumsum(count)],
        **{name: getattr(tracks, name)[kept] for name in ("view", "keypoint", "keypoint_sigma", "brightness", "lit")},
    )
    found = adjust(replace(truth, tracks=fewer), AdjustOptions()).scene.error_correlation
    assert (found.share >= 0.0).all()
    assert 0.0 < found.share.sum() <= 1.0
