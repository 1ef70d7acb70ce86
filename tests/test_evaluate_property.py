"""The evaluation of truth plus known perturbations returns those perturbations, whatever they are."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from photoclinometry.evaluate.compare import compare_with_truth, evaluate_against_map
from photoclinometry.io.meshes.ply import PlyMap
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, sphere_step, tangent_basis
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.scene import Scene
from photoclinometry.registration.alignment import transform_scene
from scenes import GSD, bumpy_surface, synthetic_scene
from truths import on_bumps, truth_of

QUICK = settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])

angles = st.floats(-3.0, 3.0)
frames = st.builds(
    lambda log_scale, turn, move: Similarity(10.0**log_scale, so3_exp(np.array(turn)), 1e3 * np.array(move)),
    st.floats(-3.0, 3.0),
    st.tuples(angles, angles, angles),
    st.tuples(angles, angles, angles),
)
seeds = st.integers(0, 2**32 - 1)


@cache
def exact() -> Scene:
    return synthetic_scene(size=18, views=5)


def measure(found: Scene, frame: Similarity) -> dict[str, float]:
    """The figures of a scene whose truth is `exact()`, given in another frame."""
    true = exact()
    moved = transform_scene(frame.inverse(), found)
    return compare_with_truth(moved, true.views, truth_of(true), on_bumps(bumpy_surface())).metrics


def random_steps(seed: int, count: int, size: float) -> np.ndarray:
    """Steps (count, 2) of one size in random directions of a tangent plane."""
    heading = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, count)
    return size * np.stack([np.cos(heading), np.sin(heading)], -1)


@QUICK
@given(frame=frames, seed=seeds, angle_deg=st.floats(0.01, 60.0))
def test_normals_turned_by_an_angle_are_off_by_it(frame, seed, angle_deg):
    """The map's own normals do not move it: its points lie on the surface."""
    marks = exact().landmarks
    normal = sphere_step(marks.normal, random_steps(seed, len(marks), np.deg2rad(angle_deg)))
    found = measure(replace(exact(), landmarks=replace(marks, normal=normal)), frame)
    for statistic in ("mean", "median", "rms", "p90"):
        assert found[f"normal_error_{statistic}_deg"] == pytest.approx(angle_deg, rel=1e-3, abs=2e-3)
    assert found["surface_distance_rms_gsd"] < 1e-4


@QUICK
@given(frame=frames, percent=st.floats(0.1, 30.0), factor=st.floats(0.5, 2.0))
def test_albedos_off_by_a_share_and_a_common_factor_are_told_apart(frame, percent, factor):
    """A third is brighter by a share, two thirds are not, so that these tell the factor."""
    marks = exact().landmarks
    sign = np.where(np.arange(len(marks)) % 3 == 0, 1.0 + percent / 100, 1.0)
    found = measure(replace(exact(), landmarks=replace(marks, albedo=factor * marks.albedo * sign)), frame)
    assert found["albedo_factor"] == pytest.approx(1.0 / factor)
    assert found["albedo_error_mean_percent"] == pytest.approx(percent / 3.0, rel=1e-6)
    off = np.abs(factor * np.array([1.0 + percent / 100, 1.0, 1.0]) - 1.0)
    assert found["albedo_error_absolute_mean_percent"] == pytest.approx(100.0 * off.mean(), rel=1e-6)


@QUICK
@given(frame=frames, seed=seeds, share=st.floats(0.001, 0.3))
def test_heights_off_by_a_share_of_the_gsd_are_that_far_from_the_surface(frame, seed, share):
    """Up and down along the normals, at random; the alignment has seven numbers for 324 landmarks, and takes little."""
    marks = exact().landmarks
    sign = np.random.default_rng(seed).permutation(np.arange(len(marks)) % 2 * 2 - 1)
    position = marks.position + share * GSD * sign[:, None] * marks.normal
    found = measure(replace(exact(), landmarks=replace(marks, position=position)), frame)
    assert found["alignment_scale"] == pytest.approx(frame.scale, rel=0.03)
    assert found["surface_distance_rms_gsd"] == pytest.approx(share, rel=0.05)
    assert found["surface_distance_rms_m"] == pytest.approx(share * GSD, rel=0.05)
    assert found["surface_distance_rms_m"] <= found["landmark_error_rms_m"] <= found["position_error_rms_m"]


@QUICK
@given(frame=frames, seed=seeds, angle_deg=st.floats(0.001, 20.0))
def test_suns_moved_by_an_angle_are_off_by_it(frame, seed, angle_deg):
    views = exact().views
    sun = sphere_step(views.sun, random_steps(seed, len(views), np.deg2rad(angle_deg)))
    found = measure(replace(exact(), views=replace(views, sun=sun)), frame)
    assert found["sun_error_mean_deg"] == pytest.approx(angle_deg, rel=1e-3, abs=1e-4)


@QUICK
@given(frame=frames, seed=seeds, offset=st.floats(0.001, 5.0))
def test_keypoints_moved_by_pixels_are_off_by_them(frame, seed, offset):
    tracks = exact().tracks
    keypoint = tracks.keypoint + random_steps(seed, len(tracks), offset)
    found = measure(replace(exact(), tracks=replace(tracks, keypoint=keypoint)), frame)
    assert found["keypoint_error_mean_px"] == pytest.approx(offset, rel=1e-3, abs=1e-4)


@QUICK
@given(frame=frames, view=st.integers(0, 4), angle_deg=st.floats(0.001, 0.5))
def test_one_camera_turned_is_off_against_every_other_and_the_rest_are_not(frame, view, angle_deg):
    """About its own axis, so that where it points does not change. Of 10 pairs it is in 4."""
    views = exact().views
    rotation = views.body_from_cam.rotation.copy()
    rotation[view] = rotation[view] @ so3_exp(np.array([0.0, 0.0, np.deg2rad(angle_deg)]))
    poses = Rigid(rotation, views.body_from_cam.translation)
    found = measure(replace(exact(), views=replace(views, body_from_cam=poses)), frame)
    assert found["camera_relative_rotation_error_max_deg"] == pytest.approx(angle_deg, rel=1e-6, abs=1e-6)
    assert found["camera_relative_rotation_error_mean_deg"] == pytest.approx(0.4 * angle_deg, rel=1e-6, abs=1e-6)


@QUICK
@given(frame=frames, gain=st.floats(0.7, 1.4))
def test_one_view_that_is_brighter_has_its_scale_off_by_that(frame, gain):
    views = exact().views
    scale = views.scale.copy()
    scale[2] *= gain
    found = measure(replace(exact(), views=replace(views, scale=scale)), frame)
    assert found["scale_error_mean_percent"] == pytest.approx(100.0 * abs(gain - 1.0) / 5.0, rel=1e-6, abs=1e-6)


@QUICK
@given(frame=frames, seed=seeds, share=st.floats(0.01, 0.1), angle_deg=st.floats(2.0, 20.0))
def test_against_another_map_the_same_is_found(frame, seed, share, angle_deg):
    """Their normals are turned, our heights are off; they have poses. Of a coarse mesh distances are inexact."""
    true, marks = exact(), exact().landmarks
    theirs = transform_scene(frame, true)
    normal = sphere_step(theirs.landmarks.normal, random_steps(seed, len(marks), np.deg2rad(angle_deg)))
    reference = PlyMap(theirs.landmarks.position, normal, theirs.landmarks.albedo, landmark_faces(theirs))
    sign = np.random.default_rng(seed).permutation(np.arange(len(marks)) % 2 * 2 - 1)
    position = marks.position + share * GSD * sign[:, None] * marks.normal
    found = evaluate_against_map(
        replace(true, landmarks=replace(marks, position=position)),
        reference,
        names=true.views.name,
        body_from_cam=theirs.views.body_from_cam,
        unit="m",
    ).metrics
    assert found["surface_distance_rms_gsd"] == pytest.approx(share, rel=0.1)
    assert found["normal_error_median_deg"] == pytest.approx(angle_deg, rel=0.05)
    assert found["albedo_error_median_percent"] == pytest.approx(0.0, abs=0.1)


def test_steps_have_their_size():
    """The perturbations above are what they say."""
    normal = exact().landmarks.normal
    moved = sphere_step(normal, random_steps(0, len(normal), 0.1))
    np.testing.assert_allclose(np.sum(moved * normal, -1), np.cos(0.1))
    assert tangent_basis(normal).shape == (len(normal), 3, 2)
