"""Alignment recovers known similarities, also from degenerate cameras, and changes only what surfaces determine."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.evaluate import (
    keypoint_residual_px,
    landmark_photometric_error,
)
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, so3_log
from photoclinometry.model.mesh import grid_faces
from photoclinometry.model.scene import Scene
from photoclinometry.registration.alignment import align_poses, refine_on_surface, transform_poses, transform_scene
from photoclinometry.registration.closest_points import MeshSurface
from scenes import bumpy_surface, synthetic_scene
from truths import OTHER_FRAME, on_bumps


@pytest.fixture(scope="module")
def scene() -> Scene:
    return synthetic_scene(size=30)


@pytest.mark.parametrize("layout", ["spread", "coplanar", "collinear"])
def test_pose_alignment_recovers_a_similarity_also_from_degenerate_centres(layout):
    rng = np.random.default_rng(1)
    centers = rng.normal(size=(6, 3)) * {"spread": (9, 9, 9), "coplanar": (9, 9, 0), "collinear": (9, 0, 0)}[layout]
    poses = Rigid(so3_exp(rng.normal(size=(6, 3))), centers)
    found = align_poses(poses, transform_poses(OTHER_FRAME, poses), distance=30.0)
    assert found.scale == pytest.approx(OTHER_FRAME.scale, rel=1e-12)
    np.testing.assert_allclose(found.rotation, OTHER_FRAME.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, OTHER_FRAME.translation, atol=1e-12)


def test_pose_alignment_of_noisy_collinear_centres_keeps_the_orientation():
    """Centres on a line say nothing about turning around it; axes good to 1 mrad do."""
    rng = np.random.default_rng(2)
    centers = np.stack([np.linspace(0, 100, 8), *(0.01 * rng.normal(size=(2, 8)))], -1)
    poses = Rigid(so3_exp(rng.normal(size=(8, 3))), centers)
    true = transform_poses(OTHER_FRAME, poses)
    turned = so3_exp(1e-3 * rng.normal(size=(8, 3)))
    true = Rigid(true.rotation @ turned, true.translation + 2e-5 * rng.normal(size=(8, 3)))
    found = align_poses(poses, true, distance=500.0)
    assert np.linalg.norm(so3_log(found.rotation @ OTHER_FRAME.rotation.T)) < 2e-3


def test_pose_alignment_refuses_cameras_at_one_place():
    poses = Rigid(np.stack([np.eye(3)] * 3), np.ones((3, 3)))
    with pytest.raises(InputError, match="one place"):
        align_poses(poses, poses, distance=1.0)


def test_a_transformed_scene_predicts_the_same_images(scene):
    moved = transform_scene(OTHER_FRAME, scene)
    np.testing.assert_allclose(keypoint_residual_px(moved), 0.0, atol=1e-7)
    np.testing.assert_allclose(landmark_photometric_error(moved), 0.0, atol=1e-9)
    assert moved.gsd == pytest.approx(scene.gsd * OTHER_FRAME.scale)


def test_covariances_turn_with_the_scene_and_what_nothing_determines_stays_infinite(scene):
    """R C R^T by hand; of an infinite covariance neither a warning nor NaN comes."""
    stated = np.tile(np.diag([1.0, 4.0, 9.0]), (len(scene.landmarks), 1, 1))
    stated[3] = np.diag([np.inf] * 3)
    moved = transform_scene(OTHER_FRAME, replace(scene, uncertainty={"position": stated}))
    turn = OTHER_FRAME.scale * OTHER_FRAME.rotation
    np.testing.assert_allclose(moved.uncertainty["position"][0], turn @ stated[0] @ turn.T)
    np.testing.assert_array_equal(moved.uncertainty["position"][3], stated[3])


def test_surface_refinement_repairs_scale_and_tilt(scene):
    wrong = Similarity(1.003, so3_exp(np.array([2e-3, -3e-3, 2e-3])), np.array([20.0, -30.0, 40.0]))
    marks = transform_scene(wrong, scene).landmarks
    fit = refine_on_surface(
        marks.position, marks.normal, on_bumps(bumpy_surface()), Similarity(1.0, np.eye(3), np.zeros(3))
    )
    assert fit.determined == 7
    back = fit.similarity @ wrong
    assert back.scale == pytest.approx(1.0, abs=1e-6)
    assert np.abs(fit.distance).max() < 1e-3


def test_surface_refinement_leaves_alone_what_a_plane_cannot_tell():
    """On a plane, height and two tilts are determined; sliding, turning about the normal and scale are not."""
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(-1, 1, (400, 2)), np.full((400, 1), 0.2)], -1)
    normals = np.tile([0.0, 0.0, 1.0], (400, 1))

    def plane(p):
        return p * [1.0, 1.0, 0.0], np.ones(len(p), bool)

    fit = refine_on_surface(points, normals, plane, Similarity(1.5, np.eye(3), np.zeros(3)))
    assert fit.determined == 3
    assert fit.similarity.scale == pytest.approx(1.5)
    np.testing.assert_allclose(fit.similarity.translation[:2], 0.0, atol=1e-9)
    np.testing.assert_allclose(fit.distance, 0.0, atol=1e-9)


def test_nearest_point_of_a_mesh_is_that_of_all_its_triangles(scene):
    position = scene.grid(scene.landmarks.position)
    faces = grid_faces(position, np.ones(position.shape[:2], bool))
    mesh = MeshSurface(scene.landmarks.position, faces)
    points = scene.landmarks.position[::37] + np.random.default_rng(4).normal(size=(25, 3)) * 20.0
    foot, inside = mesh(points)
    # a fine barycentric sampling of every triangle is never nearer, and nearly as near
    weights = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12
    samples = np.einsum("wk,fkd->fwd", weights, mesh.vertices[faces]).reshape(-1, 3)
    sampled = np.array([np.linalg.norm(samples - p, axis=-1).min() for p in points])
    exact = np.linalg.norm(points - foot, axis=-1)
    assert (exact <= sampled + 1e-9).all()
    assert (sampled**2 - exact**2 < 5.0**2).all()
    assert inside.mean() > 0.7
    _, inside = mesh(np.array([[1e4, 1e4, 0.0], [0.0, 0.0, 10.0]]))
    assert inside.tolist() == [False, True]
