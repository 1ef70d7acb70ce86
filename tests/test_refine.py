"""A text model is refined to the truth it was spoiled from, and what its files do not say is asked for."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.io.models.text_model import read_text_model, write_text_model
from photoclinometry.io.scene_file import read_scene
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, align_similarity, angle_between, so3_exp, unit
from photoclinometry.model.reflectance import published
from photoclinometry.pipeline import joint_estimate
from photoclinometry.pipeline.refine import RefineOptions, photometry, read_start, refine
from runs import draw_no_figures
from scenes import GSD, LUNAR_LAMBERT, synthetic_scene

DATA = Path(__file__).parents[2] / "shared" / "data" / "model-format"
UNIT = 0.301
OPTIONS = RefineOptions(reflectance="lunar-lambert", body="vesta", albedo_unit=UNIT)


def with_albedo(scene, albedo):
    return replace(scene, landmarks=replace(scene.landmarks, albedo=albedo))


@pytest.fixture(scope="module")
def truth():
    return synthetic_scene(size=12, views=6, keypoint_noise_px=0.05, brightness_noise=1e-3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, truth):
    """The truth with poses, normals, positions and albedos spoiled, as a model whose albedos are in units of UNIT."""
    rng = np.random.default_rng(1)
    views, landmarks = truth.views, truth.landmarks
    count = len(landmarks)
    turn = so3_exp(3e-5 * rng.normal(size=(len(views), 3)))
    turn[0] = np.eye(3)
    pose = views.body_from_cam
    spoiled = replace(
        truth,
        views=replace(views, body_from_cam=Rigid(turn @ pose.rotation, pose.translation)),
        landmarks=replace(
            landmarks,
            position=landmarks.position + 0.2 * GSD * rng.normal(size=(count, 3)),
            normal=unit(landmarks.normal + 0.1 * rng.normal(size=(count, 3))),
            albedo=landmarks.albedo * (1 + 0.05 * rng.normal(size=count)) / UNIT,
        ),
    )
    path = tmp_path_factory.mktemp("model") / "spoiled"
    write_text_model(path, spoiled, point_id=1000 + np.arange(count), image_id=10 * np.arange(6))
    return path


@pytest.fixture
def no_report(monkeypatch):
    """Figures are drawn elsewhere; `test_report.py` proves them."""
    draw_no_figures(monkeypatch)


def test_a_spoiled_model_is_refined_and_written_in_its_own_numbers(folder, truth, tmp_path, no_report):
    start = read_start(folder, OPTIONS)
    result = refine(start, tmp_path / "out", OPTIONS)
    found, before, true = result.scene.landmarks, start.model.scene.landmarks, truth.landmarks
    assert result.adjustment.converged

    def normal_error(landmarks):
        return np.sqrt(np.mean(angle_between(landmarks.normal, true.normal) ** 2))

    assert normal_error(found) < 0.3 * normal_error(before)
    assert np.std(found.albedo / true.albedo) < 0.3 * np.std(before.albedo / true.albedo)
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {
        "model",
        "landmarks.ply",
        "sparse",
        "scene.h5",
        "metrics.json",
        "config.toml",
    }
    model = read_text_model(tmp_path / "out" / "model")
    assert model.point_id.tolist() == list(range(1000, 1144))
    assert model.image_id.tolist() == [0, 10, 20, 30, 40, 50]
    kept = read_scene(tmp_path / "out" / "scene.h5")
    assert model.scene.landmarks.position.tobytes() == kept.landmarks.position.tobytes()
    assert model.scene.landmarks.normal.tobytes() == kept.landmarks.normal.tobytes()
    np.testing.assert_allclose(model.scene.landmarks.albedo * UNIT, kept.landmarks.albedo, rtol=1e-15)
    np.testing.assert_allclose(model.scene.views.sun, kept.views.sun, atol=1e-14)

    def not_again(*_, **__):
        raise AssertionError("estimated twice")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_estimate, "adjust", not_again)
        again = refine(start, tmp_path / "out", OPTIONS)
        assert again.scene.landmarks.position.tobytes() == found.position.tobytes()
        with pytest.raises(AssertionError, match="estimated twice"):
            refine(start, tmp_path / "out", replace(OPTIONS, shadow_threshold=1e-6))


def test_albedos_in_another_unit_are_refused_with_the_unit(folder):
    with pytest.raises(InputError, match=r"000\.fits is 0\.3\d* times .* --albedo-unit 0\.3"):
        read_start(folder, replace(OPTIONS, albedo_unit=None))


def test_coefficients_given_as_the_authors_give_them_equal_the_published_ones(folder):
    c0 = 0.301
    given = RefineOptions(
        reflectance="lunar-lambert",
        phase_weighting=LUNAR_LAMBERT.values[:2],
        phase_coefficients=(c0, *(c0 * c for c in LUNAR_LAMBERT.values[2:])),
    )
    start, expected = read_start(folder, given), read_start(folder, OPTIONS)
    assert start.albedo_unit == c0
    reflectance = start.model.scene.reflectance
    assert reflectance is not None
    np.testing.assert_allclose(reflectance.parameter_vector, LUNAR_LAMBERT.parameter_vector, rtol=1e-15)
    np.testing.assert_array_equal(start.model.scene.landmarks.albedo, expected.model.scene.landmarks.albedo)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"phase_weighting": (0.8, -0.4)}, "give both"),
        ({"phase_weighting": (0.8, -0.4), "phase_coefficients": (0.0, 1.0)}, "c_0, is positive"),
        ({"reflectance": "mcewen", "phase_weighting": (0.8, -0.4)}, "has no coefficients to be given"),
        ({"reflectance": "hapke", "phase_weighting": (0.8, -0.4)}, "has no coefficients to be given"),
        ({"body": "bennu"}, "no published lunar-lambert coefficients"),
        ({"shadow_threshold": 9.0}, r"reference image images/000\.fits has too few lit"),
        ({"min_observations": 7}, "no landmark has enough lit observations"),
        ({"reference": "images/9.fits"}, r"holds no image 'images/9\.fits'"),
    ],
)
def test_options_that_cannot_be_met_are_refused(folder, changes, message):
    with pytest.raises(InputError, match=message):
        read_start(folder, replace(OPTIONS, **changes))


@pytest.mark.parametrize(
    ("reflectance", "body", "brightness", "disk"),
    [
        ("auto", "vesta", "iof", "lunar-lambert"),
        ("auto", None, "dn", "mcewen"),
        ("minnaert", "vesta", "iof", "minnaert"),
        ("akimov", None, "dn", "akimov"),
    ],
)
def test_brightness_follows_from_the_reflectance(reflectance, body, brightness, disk):
    found, kind, unit_ = photometry(RefineOptions(reflectance=reflectance, body=body))
    assert found == published(disk, body)
    assert (kind, unit_) == (brightness, 1.0)
    assert photometry(RefineOptions(reflectance="none"))[0] is None


def test_images_and_landmarks_with_few_observations_are_left_out(truth, tmp_path):
    """View 2 is dark but for 99 keypoints, and the last 20 landmarks in all but five views."""
    tracks = truth.tracks
    lit = np.ones((144, 6), bool)
    lit[99:, 2] = False
    lit[124:, 4] = False
    write_text_model(tmp_path / "model", replace(truth, tracks=replace(tracks, lit=lit.ravel())))
    options = replace(OPTIONS, albedo_unit=1.0, min_observations=5)
    start = read_start(tmp_path / "model", options)
    assert start.left_out == ("images/002.fits",)
    assert start.model.image_id.tolist() == [0, 1, 3, 4, 5]
    assert start.model.point_id.tolist() == list(range(124))
    scene = start.model.scene
    assert (len(scene.views), len(scene.landmarks), len(scene.tracks)) == (5, 124, 620)
    # All that is left still explains itself: keypoints project, and brightness follows.
    for k in range(5):
        seen = scene.tracks.view == k
        predicted = scene.views.project(k, scene.landmarks.position[scene.tracks.landmark[seen]])
        assert np.abs(predicted - scene.tracks.keypoint[seen]).max() < 0.3


def test_geometry_alone_needs_no_light(truth, tmp_path):
    dark = replace(truth, tracks=replace(truth.tracks, lit=np.zeros(len(truth.tracks), bool)))
    write_text_model(tmp_path / "model", dark)
    scene = read_start(tmp_path / "model", RefineOptions(reflectance="none")).model.scene
    assert (len(scene.landmarks), scene.reflectance) == (144, None)


@pytest.mark.data
def test_the_authors_graph_is_minimised_from_their_cost_to_below_theirs():
    """Half the sum of squares, with the noise and gates of their configuration; accuracy about as theirs.

    Theirs ends 0.06 % above the minimum, landmarks 0.103 GSD and normals 0.486 deg off. What this graph determines
    least is a tilt that all normals share, 0.36 deg at the minimum: without it they are 0.495 deg off.
    """
    if not (DATA / "site_2500").exists():
        pytest.skip(f"the model in the authors' format is not at {DATA}")
    with np.load(DATA / "site_2500_truth.npz") as stored:
        truth = dict(stored)
    options = RefineOptions(
        reflectance="lunar-lambert",
        phase_weighting=tuple(truth["phase_weighting"]),
        phase_coefficients=tuple(truth["phase_correction"]),
        shadow_threshold=float(truth["shadow_threshold"]),
    )
    scene = read_start(DATA / "site_2500", options).model.scene
    independent = AdjustOptions(
        brightness_sigma=float(truth["sigma_inten"]),
        keypoint_correlation_px=1.0,
        brightness_correlation_px=1.0,
        smooth_sigma_rad=float(truth["sigma_smooth"]),
        keypoint_loss=np.inf,
        brightness_loss=np.inf,
        reflectance_sigma=0.0,
        max_reweightings=1,
        uncertainty=False,
    )
    adjustment = adjust(scene, independent)
    np.testing.assert_array_equal(adjustment.lit, truth["obs_valid"])
    cost = [0.5 * iteration.total for iteration in adjustment.log]
    assert cost[0] == pytest.approx(158_735, abs=0.5)
    assert adjustment.converged
    assert cost[-1] < 6_493.76
    found = adjustment.scene.landmarks
    aligned = align_similarity(found.position, truth["X_true"])
    offset = np.linalg.norm(aligned(found.position) - truth["X_true"], axis=1)
    assert np.sqrt(np.mean(offset**2)) / truth["gsd_km"] < 0.1045
    tilt = angle_between(_without_common_tilt(found.normal, truth["n_true"]), truth["n_true"])
    assert np.mean(tilt) < math.radians(0.5)
    ratio = found.albedo / truth["a_true"]
    assert np.mean(np.abs(ratio / np.median(ratio) - 1)) < 4.9e-3


def _without_common_tilt(normal, like):
    """Normals (J, 3) turned as one to be as near to others as may be (Kabsch 1976)."""
    u, _, v = np.linalg.svd(like.T @ normal)
    return normal @ (u @ v).T
