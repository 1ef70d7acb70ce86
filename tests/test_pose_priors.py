"""Pose priors in a run: the map comes into their frame, a wrong one is named and has no say, none change nothing."""

import json
from dataclasses import replace

import numpy as np
import pytest

from drawn_priors import priors_of, with_priors
from matched import OPTIONS, matched_problem
from photoclinometry.adjust import PosePriors, ScenePriors, adjust
from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.io.held_out import read_held_out
from photoclinometry.io.run_files import HELD_OUT_FILE
from photoclinometry.io.scene_file import read_scene
from photoclinometry.io.site import read_site
from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, so3_log
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import BODY_FIXED, OWN
from photoclinometry.pipeline.folder.stage import digest
from photoclinometry.pipeline.frame.pose_priors import (
    place_by_priors,
    prior_metrics,
    prior_table,
    priors_in_frame,
    usable_priors,
    warn_of_outliers,
)
from photoclinometry.pipeline.run import RunOptions, run
from photoclinometry.registration.alignment import transform_poses, transform_scene
from photoclinometry.simulate.truth_file import read_truth
from scenes import synthetic_scene

METRIC = Similarity(3.7, so3_exp(np.array([0.4, -1.1, 2.0])), np.array([2.6e5, -9e4, 4e4]))
"""From a made-up scene's frame to the body-fixed one."""
SIGMA_DEG, SIGMA_M = 0.01, 100.0
BEFORE = ["sparse", "distortion", "inconsistent_views", "region", "dense"]
"""The stages before the first estimate."""
DISTANCE_M = 6.3e5
"""Of the small site's cameras, spread over a fifth of it."""


def turned(prior, degrees):
    """The prior with its camera turned about its x axis, where it stands."""
    pose = prior.cam_from_body
    turn = so3_exp(np.array([np.radians(degrees), 0.0, 0.0]))
    return replace(prior, cam_from_body=Rigid(turn @ pose.rotation, turn @ pose.translation))


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=8)


@pytest.fixture(scope="module")
def priors(scene):
    poses = transform_scene(METRIC, scene).views.body_from_cam
    return priors_of(scene.views.name, poses, 1e-4, 100.0, np.random.default_rng(0), noise=0.0)


def test_a_scene_is_placed_in_metres(scene, priors):
    moved = place_by_priors(scene, priors).scene
    assert (scene.frame, scene.unit, moved.frame, moved.unit) == (OWN, None, BODY_FIXED, "m")
    assert moved.gsd == pytest.approx(METRIC.scale * scene.gsd)
    np.testing.assert_allclose(moved.landmarks.position, METRIC(scene.landmarks.position), atol=1e-4)


def test_of_less_than_three_priors_the_log_says_that_they_are_not_used(scene, priors, caplog):
    some = {"of another view": next(iter(priors.values()))}
    assert usable_priors(some, scene) == {}
    assert not caplog.records
    for name in scene.views.name[:2]:
        some[name] = priors[name]
        assert usable_priors(some, scene) == {}
    assert "2 of the 6 views have a pose prior, at least 3 are needed" in caplog.text
    some[scene.views.name[2]] = priors[scene.views.name[2]]
    assert list(usable_priors(some, scene)) == list(scene.views.name[:3])


def test_priors_of_another_convention_are_not_used(scene, priors, caplog):
    """Cameras that look along -z, y up: every attitude is off by half a turn, and no frame makes it right."""
    flip = np.diag([1.0, -1.0, -1.0])
    wrong = {
        name: replace(p, cam_from_body=Rigid(flip @ p.cam_from_body.rotation, flip @ p.cam_from_body.translation))
        for name, p in priors.items()
    }
    assert place_by_priors(scene, wrong) is None
    assert "not used" in caplog.text


def test_the_estimate_is_given_the_priors_that_agree_and_no_others(scene, priors, caplog):
    name = scene.views.name[3]
    some = {n: p for n, p in priors.items() if n != scene.views.name[5]} | {name: turned(priors[name], 1.0)}
    known = place_by_priors(scene, some).pose_priors
    free = [n for n, sigma in zip(scene.views.name, known.center_sigma, strict=True) if np.isinf(sigma)]
    assert free == [name, scene.views.name[5]]
    assert f"{name} is off by" in caplog.text
    np.testing.assert_array_equal(np.isinf(known.center_sigma), np.isinf(known.rotation_sigma))
    used = np.isfinite(known.center_sigma)
    true = METRIC(scene.views.body_from_cam.translation)
    np.testing.assert_allclose(known.body_from_cam.translation[used], true[used], atol=1e-3)


def test_residuals_after_the_estimate_by_hand(scene, priors, caplog):
    """One camera 300 m from its prior of 100 m, one turned by 1e-3 rad from its prior of 1e-4."""
    moved = place_by_priors(scene, priors).scene
    poses = moved.views.body_from_cam
    center, rotation = poses.translation.copy(), poses.rotation.copy()
    center[0] += [0.0, 300.0, 0.0]
    rotation[1] = so3_exp(np.array([1e-3, 0.0, 0.0])) @ rotation[1]
    off = replace(moved, views=replace(moved.views, body_from_cam=Rigid(rotation, center)))
    used = np.arange(len(center)) != 1
    rows = prior_table(off, priors, used)
    assert rows[0].center_off_m == pytest.approx(300.0)
    assert rows[0].off_sigmas == pytest.approx(3.0 / np.sqrt(6.0), rel=1e-6)
    assert rows[1].rotation_off_deg == pytest.approx(np.degrees(1e-3))
    assert [row.used for row in rows] == used.tolist()
    metrics = prior_metrics(rows)
    assert (metrics["pose_priors_used"], metrics["pose_priors_left_out"]) == (5, 1)
    assert metrics["pose_prior_center_rms_m"] == pytest.approx(300.0 / np.sqrt(5.0))
    caplog.clear()
    warn_of_outliers(rows)
    [record] = caplog.records
    assert record.getMessage().startswith(f"{scene.views.name[1]}: its pose prior contradicts the images")
    assert prior_table(off, priors, np.zeros(0, bool)) == []
    assert prior_metrics([]) == {}


def test_an_error_that_all_priors_share_counts_with_each_ones_own(scene, priors):
    """A camera 500 m from its prior of 300 m and 400 m in common is one sigma off along that axis."""
    shared = {
        name: replace(prior, translation_sigma=300.0, common_translation_sigma=400.0) for name, prior in priors.items()
    }
    moved = place_by_priors(scene, shared).scene
    center = moved.views.body_from_cam.translation.copy()
    center[0] += [0.0, 500.0, 0.0]
    poses = Rigid(moved.views.body_from_cam.rotation, center)
    off = replace(moved, views=replace(moved.views, body_from_cam=poses))
    row = prior_table(off, shared, np.ones(len(center), bool))[0]
    assert row.center_sigma_m == pytest.approx(500.0)
    assert row.off_sigmas == pytest.approx(1.0 / np.sqrt(6.0), rel=1e-6)


def test_the_place_of_a_map_is_no_better_known_than_the_error_that_its_priors_share():
    """With independent errors of 10 m the mean of six is known to a few metres; a common one of 500 m stays, each axis,
    and what images and priors say of attitude and scale does not change."""
    scene = synthetic_scene(size=12, views=6, keypoint_noise_px=0.3, brightness_noise=0.01)
    poses = scene.views.body_from_cam
    own = PosePriors(body_from_cam=poses, rotation_sigma=np.full(6, 1e-5), center_sigma=np.full(6, 10.0))
    alone, both = (
        np.sqrt(np.diag(adjust(scene, OPTIONS, priors=ScenePriors(pose_priors=priors)).frame_covariance))
        for priors in (own, replace(own, common_center_sigma=500.0))
    )
    assert np.all(alone[3:6] < 30.0)
    np.testing.assert_allclose(both[3:6], np.hypot(alone[3:6], 500.0), rtol=0.02)
    np.testing.assert_allclose(both[[0, 1, 2, 6]], alone[[0, 1, 2, 6]], rtol=0.05)


def test_the_key_of_a_stage_tells_priors_to_the_last_digit(priors):
    name, prior = next(iter(priors.items()))
    pose = prior.cam_from_body
    nearly = Rigid(pose.rotation, pose.translation * (1.0 + 2e-16))
    assert digest(priors) == digest(dict(reversed(priors.items())))
    assert digest(priors) != digest(priors | {name: replace(prior, cam_from_body=nearly)})


def test_the_estimate_does_not_depend_on_frame_and_unit():
    """The same problem in its own frame, and 280 km from the origin with other axes and a unit 3.7 times as long."""
    start, truth = matched_problem(16, 6)
    rng = np.random.default_rng(1)
    own = priors_of(start.views.name, truth.views.body_from_cam, 1e-3, 5.0, rng)
    metric = {
        name: PosePrior(transform_poses(METRIC, prior.cam_from_body.inverse()).inverse(), 1e-3, METRIC.scale * 5.0)
        for name, prior in own.items()
    }
    moved = transform_scene(METRIC, start)
    here = adjust(start, OPTIONS, priors=ScenePriors(pose_priors=priors_in_frame(start, own))).scene
    there = adjust(moved, OPTIONS, priors=ScenePriors(pose_priors=priors_in_frame(moved, metric)))
    back = transform_scene(METRIC.inverse(), there.scene)
    assert there.pose_priors_used.all()
    np.testing.assert_allclose(back.landmarks.position, here.landmarks.position, atol=0.02 * start.gsd)
    np.testing.assert_allclose(back.landmarks.albedo, here.landmarks.albedo, atol=1e-4)


@pytest.fixture(scope="module")
def known(mapped):
    """Priors of the small site, off by what they state, but for the last view's, which is turned by a degree more."""
    site, true = read_site(mapped.site), read_truth(mapped.truth).views
    poses = true.body_from_cam[[true.name.index(view.name) for view in site.views]]
    names = [view.name for view in site.views]
    # A draw as it should be on the average: 14.5 and 15.7 are the squares of 15 turns and 15 places, in sigmas.
    found = priors_of(names, poses, np.radians(SIGMA_DEG), SIGMA_M, np.random.default_rng(4))
    return found | {names[-1]: turned(found[names[-1]], 1.0)}


@pytest.mark.usefixtures("no_figures", "photometry_as_stated")
def test_a_run_comes_out_in_the_frame_of_the_truth_and_names_a_wrong_prior(mapped, known, tmp_path, caplog):
    """Of six priors of 0.01 degrees and 100 m one is wrong by a degree. The poses of so small a site by itself are
    off by up to 0.3 degrees, so that only the estimate with all of them tells."""
    folder = mapped.copy(tmp_path / "run")
    site, bad = with_priors(mapped, known, tmp_path / "site"), sorted(known)[-1]
    result = run(site, folder, RunOptions())
    summary = json.loads((folder / "metrics.json").read_text())
    assert [s["stage"] for s in summary["stages"] if s["resumed"]] == BEFORE
    assert [row["name"] for row in summary["pose_priors"] if not row["used"]] == [bad]
    assert f"{bad}: its pose prior contradicts the images and is left out" in caplog.text
    [row] = [row for row in summary["pose_priors"] if not row["used"]]
    assert row["rotation_off_deg"] == pytest.approx(1.0, abs=0.1)

    scene, truth = read_scene(folder / "scene.h5"), read_truth(mapped.truth)
    assert scene.frame == summary["frame"] == BODY_FIXED
    metrics, before = (evaluate_against_truth(s, truth).metrics for s in (scene, mapped.result.scene))
    # Four sigmas of the mean of five priors. A place on the ground is off as a camera is, as the point where it looks,
    # and, along the line of sight, by the scale, which follows from the distances between cameras.
    four = 4.0 / np.sqrt(5.0)
    of_scale = DISTANCE_M * SIGMA_M / (0.2 * DISTANCE_M)
    place = np.linalg.norm([SIGMA_M, DISTANCE_M * np.radians(SIGMA_DEG), of_scale])
    assert metrics["frame_offset_m"] < four * np.sqrt(3.0) * place
    assert metrics["frame_turn_deg"] < four * np.sqrt(3.0) * SIGMA_DEG
    assert abs(metrics["frame_scale_error_percent"]) < four * 100.0 * SIGMA_M / (0.2 * DISTANCE_M)
    assert result.metrics["gsd_m"] == pytest.approx(DISTANCE_M / 10714.0, rel=0.05)
    for name, slack in (("surface_distance_mean_gsd", 1.2), ("normal_error_mean_deg", 1.2)):
        assert metrics[name] < slack * before[name]
    assert metrics["camera_relative_rotation_error_mean_deg"] < 0.5 * before["camera_relative_rotation_error_mean_deg"]
    assert metrics["position_sigma_nees"] < 4.0

    again = run(site, folder, RunOptions())
    assert json.loads((folder / "metrics.json").read_text())["pose_priors"] == summary["pose_priors"]
    np.testing.assert_array_equal(again.scene.landmarks.position, scene.landmarks.position)


@pytest.mark.usefixtures("no_figures", "photometry_as_stated")
def test_priors_that_are_not_used_change_nothing(mapped, known, tmp_path):
    """Switched off, all is read back from the run without priors: the keys of every stage are the same."""
    folder = mapped.copy(tmp_path / "run")
    for site, options in (
        (with_priors(mapped, known, tmp_path / "six"), RunOptions(pose_priors=False)),
        (with_priors(mapped, dict(list(known.items())[:2]), tmp_path / "two"), RunOptions()),
    ):
        result = run(site, folder, options)
        summary = json.loads((folder / "metrics.json").read_text())
        assert [s["stage"] for s in summary["stages"] if s["resumed"]][:5] == BEFORE
        assert not [s["stage"] for s in summary["stages"] if not s["resumed"] and "estimate" in s["stage"]]
        assert (summary["frame"], summary["pose_priors"]) == (OWN, [])
        assert result.metrics == mapped.result.metrics


@pytest.mark.usefixtures("no_figures", "photometry_as_stated")
def test_a_view_held_out_is_placed_in_the_frame_of_the_priors(mapped, known, tmp_path, adjust_nothing):
    """Its own prior has no say, nor is it needed."""
    loose = {n: replace(p, rotation_sigma_rad=2e-3, translation_sigma=1e3) for n, p in known.items()}
    folder, aside, few = mapped.copy(tmp_path / "run"), sorted(known)[1], DensifyOptions(min_views=4)
    run(
        with_priors(mapped, loose, tmp_path / "site"),
        folder,
        RunOptions(hold_out=(aside,), matcher="flow", densify=few),
    )
    [pose], truth = read_held_out(folder / HELD_OUT_FILE).body_from_cam, read_truth(mapped.truth).views
    true = truth.body_from_cam[truth.name.index(aside)]
    # The sparse poses are off by some tenths of a degree, seen from 630 km.
    assert np.linalg.norm(pose.translation - true.translation) < 2e-2 * np.linalg.norm(true.translation)
    assert np.degrees(np.linalg.norm(so3_log(pose.rotation @ true.rotation.T))) < 1.5
