"""Laws of rigid transforms, rotations and the sphere."""

import numpy as np
import pytest

from photoclinometry.model.geometry import (
    Rigid,
    Similarity,
    align_similarity,
    angle_between,
    similarities_of,
    skew,
    so3_exp,
    so3_log,
    sphere_step,
    tangent_basis,
    unit,
)

RNG = np.random.default_rng(0)
SPREAD = np.concatenate([unit(RNG.normal(size=(200, 3))), np.eye(3), -np.eye(3)])


def random_rigid(seed):
    rng = np.random.default_rng(seed)
    return Rigid(so3_exp(rng.normal(size=(5, 3))), rng.normal(size=(5, 3)))


def test_one_transform_of_many_points_is_many_transforms():
    one, points = random_rigid(3)[0], RNG.normal(size=(4, 7, 3))
    alike = Rigid(np.tile(one.rotation, (4, 7, 1, 1)), np.tile(one.translation, (4, 7, 1)))
    np.testing.assert_allclose(one(points), alike(points), rtol=0, atol=1e-14)


def test_transforms_form_a_group():
    a, b, x = random_rigid(1), random_rigid(2), RNG.normal(size=(5, 3))
    np.testing.assert_allclose((a @ b)(x), a(b(x)), atol=1e-14)
    np.testing.assert_allclose((a @ a.inverse())(x), x, atol=1e-14)


def test_similarities_form_a_group():
    a = Similarity(2.5, so3_exp(np.array([0.1, 0.2, -0.4])), np.array([1.0, 2, 3]))
    x = RNG.normal(size=(7, 3))
    np.testing.assert_allclose(a.inverse()(a(x)), x, atol=1e-14)
    np.testing.assert_allclose((a @ a.inverse())(x), x, atol=1e-14)


def test_exponential_is_a_rotation_and_log_undoes_it():
    omega = np.concatenate([RNG.normal(size=(50, 3)), 1e-9 * RNG.normal(size=(5, 3)), np.zeros((1, 3))])
    rotation = so3_exp(omega)
    np.testing.assert_allclose(
        rotation @ np.swapaxes(rotation, 1, 2), np.broadcast_to(np.eye(3), (56, 3, 3)), atol=1e-14
    )
    keep = np.linalg.norm(omega, axis=1) < 3
    np.testing.assert_allclose(so3_log(rotation[keep]), omega[keep], atol=1e-9)


def test_quarter_turn_about_z():
    np.testing.assert_allclose(so3_exp(np.array([0, 0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_skew_is_the_cross_product():
    a, b = RNG.normal(size=(2, 9, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(a), b), np.cross(a, b))


def test_tangent_basis_is_orthonormal_everywhere():
    frame = np.concatenate([tangent_basis(SPREAD), SPREAD[..., None]], -1)
    np.testing.assert_allclose(np.swapaxes(frame, 1, 2) @ frame, np.broadcast_to(np.eye(3), frame.shape), atol=1e-14)


def test_sphere_step_moves_by_its_length():
    step = RNG.uniform(-1, 1, (len(SPREAD), 2))
    moved = sphere_step(SPREAD, step)
    np.testing.assert_allclose(angle_between(moved, SPREAD), np.linalg.norm(step, axis=1), atol=1e-13)
    np.testing.assert_array_equal(sphere_step(SPREAD, np.zeros_like(step)), unit(SPREAD))


def test_angles_are_exact_where_arccos_is_not():
    tiny = 1e-9
    assert angle_between(np.array([1.0, 0, 0]), np.array([np.cos(tiny), np.sin(tiny), 0])) == pytest.approx(tiny)


def test_many_alignments_are_those_one_by_one():
    source, target = RNG.normal(size=(2, 20, 3, 3))
    scale, rotation, translation = similarities_of(source, target)
    for k in range(20):
        one = align_similarity(source[k], target[k])
        assert scale[k] == pytest.approx(one.scale)
        np.testing.assert_allclose(rotation[k], one.rotation, atol=1e-12)
        np.testing.assert_allclose(translation[k], one.translation, atol=1e-12)
    assert np.isnan(similarities_of(np.ones((1, 3, 3)), target[:1])[0]).all()


def test_alignment_recovers_a_similarity():
    true = Similarity(3.2, so3_exp(np.array([0.3, -1.0, 2.0])), np.array([5.0, -2, 1]))
    points = RNG.normal(size=(10, 3))
    found = align_similarity(points, true(points))
    np.testing.assert_allclose(found(points), true(points), atol=1e-12)
    assert found.scale == pytest.approx(3.2)
    with pytest.raises(ValueError, match="at least 3"):
        align_similarity(points[:2], points[:2])
