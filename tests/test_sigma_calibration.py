"""Uncertainties against errors: chi-squares by hand, and draws from the stated covariances that come out as honest."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.compare import compare_with_truth
from photoclinometry.evaluate.metrics import calibration, normalised_square
from photoclinometry.evaluate.sigma_calibration import scene_errors, sigma_metrics, tangent_error
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, sphere_step
from photoclinometry.model.scene import BODY_FIXED, OWN
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.surface.relief import local_frame
from scenes import bumpy_surface, synthetic_scene
from truths import on_bumps, truth_of

OF_LANDMARKS = ("position", "normal", "albedo")
KINDS = (*OF_LANDMARKS, "rotation", "translation", "sun", "scale", "bias")


def test_normalised_square_by_hand():
    """Error (3, 4) with sigmas 3 and 4 is (1 + 1) / 2; with sigma 5 alike (25 / 25) / 2; scalars need no axis."""
    error = np.array([[3.0, 4.0]])
    assert normalised_square(error, np.array([[3.0, 4.0]])) == pytest.approx([1.0])
    assert normalised_square(error, np.array([5.0])) == pytest.approx([0.5])
    assert normalised_square(error, np.diag([9.0, 16.0])[None]) == pytest.approx([1.0])
    assert normalised_square(np.array([3.0]), np.array([1.5])) == pytest.approx([4.0])


def test_normalised_square_sees_correlation():
    """Along the long axis of [[2, 1], [1, 2]] (variance 3) an error of sqrt(3) counts one, across it three."""
    covariance = np.array([[[2.0, 1.0], [1.0, 2.0]]] * 2)
    error = np.sqrt(1.5) * np.array([[1.0, 1.0], [1.0, -1.0]])
    assert normalised_square(error, covariance) == pytest.approx([0.5, 1.5])


def test_what_cannot_be_normalised_is_left_out():
    covariance = np.array([np.eye(2), np.diag([1.0, -1.0]), np.full((2, 2), np.nan), np.zeros((2, 2))])
    assert np.isfinite(normalised_square(np.ones((4, 2)), covariance)).tolist() == [True, False, False, False]
    assert np.isnan(normalised_square(np.array([1.0, np.nan]), np.array([0.0, 1.0]))).all()
    assert calibration(np.ones(2), np.zeros(2), "x") == {}
    with pytest.raises(ValueError, match="does not go with"):
        normalised_square(np.ones((4, 2)), np.ones((4, 3)))


def test_covariances_that_are_singular_but_for_rounding_are_left_out():
    """Of rank 1 in floating point: some have a least eigenvalue above zero, and yet no inverse."""
    axis = np.random.default_rng(0).normal(size=(2000, 3))
    covariance = np.einsum("ni,nj->nij", axis, axis)
    least = np.linalg.eigvalsh(covariance)[:, 0]
    assert np.sum(least > 0) > 100
    assert np.isnan(normalised_square(np.ones((2000, 3)), covariance)).all()
    nearly = covariance + 1e-9 * np.eye(3)
    assert normalised_square(axis, nearly) == pytest.approx(1.0 / 3.0, rel=1e-4)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_draws_from_the_covariance_are_calibrated_and_half_the_sigma_is_four_times_off(size):
    rng = np.random.default_rng(size)
    root = rng.normal(size=(20_000, size, size))
    covariance = root @ np.swapaxes(root, -1, -2)
    error = np.einsum("nij,nj->ni", root, rng.normal(size=(20_000, size)))
    found = calibration(error, covariance, "x")
    assert found["x_nees"] == pytest.approx(1.0, abs=0.05)
    assert found["x_nees_median"] == pytest.approx(1.0, abs=0.05)
    assert found["x_within_68_percent"] == pytest.approx(68.27, abs=1.5)
    assert found["x_within_95_percent"] == pytest.approx(95.45, abs=1.0)
    assert calibration(error, covariance / 4, "x")["x_nees"] == pytest.approx(4 * found["x_nees"])


def test_tangent_error_undoes_a_step():
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(50, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    step = rng.uniform(-2.0, 2.0, (50, 2))
    np.testing.assert_allclose(tangent_error(direction, sphere_step(direction, step)), step, atol=1e-12)
    np.testing.assert_array_equal(tangent_error(direction, direction), 0.0)


def disturbed(sigma: dict[str, float], seed: int = 1):
    """A scene off by normal errors of known sigmas, that reports those; and the exact one in another frame.

    Only the kinds in `sigma` are off.
    """
    true = synthetic_scene(size=24, views=30)
    rng = np.random.default_rng(seed)
    views, marks = true.views, true.landmarks

    def noise(kind, *shape):
        return sigma.get(kind, 0.0) * rng.normal(size=shape)

    count, many = len(views), len(marks)
    pose = views.body_from_cam
    found = replace(
        true,
        views=replace(
            views,
            body_from_cam=Rigid(
                pose.rotation @ so3_exp(noise("rotation", count, 3)),
                pose.translation + noise("translation", count, 3),
            ),
            sun=sphere_step(views.sun, noise("sun", count, 2)),
            scale=views.scale + noise("scale", count),
            bias=views.bias + noise("bias", count),
        ),
        landmarks=replace(
            marks,
            position=marks.position + noise("position", many, 3),
            normal=sphere_step(marks.normal, noise("normal", many, 2)),
            albedo=marks.albedo + noise("albedo", many),
        ),
        uncertainty={
            kind: np.full(count if kind in KINDS[3:] and kind != "albedo" else many, s) for kind, s in sigma.items()
        },
    )
    return found, transform_scene(Similarity(0.01, so3_exp(np.array([0.2, 0.5, -0.3])), np.ones(3)), true)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_that_reports_its_own_sigma_is_calibrated(kind):
    """Errors drawn with the stated sigma; half of it stated gives four times the square. 30 views have a spread."""
    sigma = {"position": 3.0, "normal": 0.02, "albedo": 0.01, "sun": 1e-3, "rotation": 1e-3, "translation": 500.0}
    sigma = {kind: sigma.get(kind, 0.02)}
    scene, true = disturbed(sigma)
    found = sigma_metrics(scene, true.views, true.landmarks, 1.0)
    count = len(scene.uncertainty[kind])
    assert found[f"{kind}_sigma_nees"] == pytest.approx(1.0, abs=5.0 / np.sqrt(count))
    bold = replace(scene, uncertainty={kind: scene.uncertainty[kind] / 2})
    ratio = sigma_metrics(bold, true.views, true.landmarks, 1.0)[f"{kind}_sigma_nees"] / found[f"{kind}_sigma_nees"]
    assert ratio == pytest.approx(4.0)


def test_heights_are_judged_by_themselves():
    """Sigmas of heights are right, those across are stated ten times too small."""
    scene, true = disturbed({"position": 3.0})
    axes = local_frame(scene).rotation
    stated = np.tile(axes @ np.diag([0.3, 0.3, 3.0]) ** 2 @ axes.T, (len(scene.landmarks), 1, 1))
    found = sigma_metrics(replace(scene, uncertainty={"position": stated}), true.views, true.landmarks, 1.0)
    assert found["height_sigma_nees"] == pytest.approx(1.0, abs=0.2)
    assert found["height_sigma_nees_median"] == pytest.approx(1.0, abs=0.2)
    assert found["position_sigma_nees"] == pytest.approx(67.0, rel=0.2)


SIZES = {"position": 3, "translation": 3, "rotation": 3, "normal": 2, "sun": 2}


@pytest.mark.parametrize(
    ("kind", "form"),
    [(kind, "alike") for kind in KINDS] + [(kind, form) for kind in SIZES for form in ("along axes", "covariance")],
)
def test_uncertainties_say_the_same_of_a_scene_in_another_frame(kind, form):
    """Squares over what is stated do not depend on frame and unit, so what is stated must follow both."""
    scene, true = disturbed({kind: 0.01})
    stated = scene.uncertainty[kind]
    if form != "alike":
        size = SIZES[kind]
        half = np.random.default_rng(2).uniform(0.005, 0.02, (len(stated), size, size))
        stated = half[:, 0] if form == "along axes" else half @ np.swapaxes(half, 1, 2) + 1e-5 * np.eye(size)
    scene = replace(scene, uncertainty={kind: stated})
    moved = transform_scene(Similarity(1e-2, so3_exp(np.array([-0.7, 1.5, 0.4])), np.array([5.0, 2.0, 1.0])), scene)
    expected = sigma_metrics(scene, true.views, true.landmarks, 1.0)
    assert sigma_metrics(moved, true.views, true.landmarks, 1.0) == pytest.approx(expected, rel=1e-6)


def test_a_body_fixed_scene_is_compared_where_it_is():
    """Moved by 5 m as a whole it is off by that; in a frame of its own that means nothing."""
    true = synthetic_scene(size=8)
    off = transform_scene(Similarity(1.0, np.eye(3), np.array([3.0, 4.0, 0.0])), true)
    for frame, expected in ((BODY_FIXED, 5.0), (OWN, 0.0)):
        found = scene_errors(replace(off, frame=frame), true.views, true.landmarks, 1.0)
        for kind in ("position", "center"):
            np.testing.assert_allclose(np.linalg.norm(found[kind], axis=-1), expected, atol=1e-6)


def test_scales_of_uncalibrated_images_are_compared_with_that_of_the_reference_view():
    """Exposures of 1000, the reference's scale held at 1 and known to nothing, albedos off by a tenth."""
    true = replace(synthetic_scene(size=8), brightness="dn")
    exposed = replace(true.views, scale=1000.0 * np.linspace(1.0, 1.5, len(true.views)))
    ratio = exposed.scale / exposed.scale[true.reference]
    found = scene_errors(replace(true, views=replace(exposed, scale=1.01 * ratio)), exposed, true.landmarks, 1.1)
    np.testing.assert_allclose(found["scale"], 0.0, atol=1e-12)
    off = np.where(np.arange(len(ratio)) == true.reference, 0.0, 0.02)
    found = scene_errors(replace(true, views=replace(exposed, scale=ratio + off)), exposed, true.landmarks, 1.1)
    np.testing.assert_allclose(found["scale"], off, atol=1e-12)


def test_relative_albedos_are_compared_after_the_common_factor():
    scene, true = disturbed({"albedo": 0.01, "scale": 0.01})
    doubled = replace(
        scene,
        landmarks=replace(scene.landmarks, albedo=2 * scene.landmarks.albedo),
        views=replace(scene.views, scale=scene.views.scale / 2),
        uncertainty={"albedo": 2 * scene.uncertainty["albedo"], "scale": scene.uncertainty["scale"] / 2},
    )
    found = sigma_metrics(doubled, true.views, true.landmarks, 0.5)
    assert found == pytest.approx(sigma_metrics(scene, true.views, true.landmarks, 1.0))


def test_albedos_that_are_all_off_by_a_factor_are_right_relative_to_each_other():
    scene, true = disturbed({"albedo": 0.01})
    bright = replace(
        scene,
        landmarks=replace(scene.landmarks, albedo=1.5 * scene.landmarks.albedo),
        uncertainty=dict.fromkeys(("albedo", "albedo_relative"), 1.5 * scene.uncertainty["albedo"]),
    )
    found = sigma_metrics(bright, true.views, true.landmarks, 1.0)
    assert found["albedo_relative_sigma_nees"] == pytest.approx(1.0, abs=0.3)
    assert found["albedo_sigma_nees"] > 10.0


def test_an_evaluation_against_truth_includes_what_the_scene_states():
    scene = synthetic_scene(size=16)
    true, rng = truth_of(scene), np.random.default_rng(0)
    albedo = scene.landmarks.albedo + 0.01 * rng.normal(size=256)
    stated = {"albedo": np.full(256, 0.01), "position": np.full((256, 3), 1.0)}
    found = replace(scene, landmarks=replace(scene.landmarks, albedo=albedo), uncertainty=stated)
    metrics = compare_with_truth(found, scene.views, true, on_bumps(bumpy_surface())).metrics
    assert metrics["albedo_sigma_nees"] == pytest.approx(1.0, abs=0.3)
    assert metrics["position_sigma_nees"] == pytest.approx(0.0, abs=1e-9)
    assert not any(
        "sigma" in key for key in compare_with_truth(scene, scene.views, true, on_bumps(bumpy_surface())).metrics
    )


def test_uncertainties_of_a_wrong_shape_are_refused_and_unknown_ones_left_alone():
    scene, true = disturbed({"normal": 0.01})
    scene = replace(scene, uncertainty={"normal": np.ones((len(scene.landmarks), 3)), "mood": np.ones(3)})
    with pytest.raises(InputError, match="uncertainty of normal"):
        sigma_metrics(scene, true.views, true.landmarks, 1.0)
    scene = replace(scene, uncertainty={"mood": np.ones(3)})
    assert sigma_metrics(scene, true.views, true.landmarks, 1.0) == {}
