"""Ground control points place a map, take part in its estimate, and are compared with it."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from adjustments import not_adjusted
from estimate_starts import INDEPENDENT, start_of
from photoclinometry.adjust import ScenePriors, adjust
from photoclinometry.model.control import ControlPixel, ControlPoint
from photoclinometry.model.geometry import Similarity, so3_exp
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.folder.run_folder import adopt_stages, open_run
from photoclinometry.pipeline.frame.control import (
    agreeing_points,
    control_metrics,
    control_table,
    ground_control,
    place_by_control,
    warn_of_contradictions,
)
from photoclinometry.pipeline.products import RunSummary, write_products
from photoclinometry.registration.alignment import transform_poses, transform_scene
from photoclinometry.simulate.truth import truth_maps
from photoclinometry.simulate.truth_file import read_truth
from runs import draw_no_figures
from scenes import synthetic_scene

OWN_FROM_BODY = Similarity(1.0 / 60.0, so3_exp(np.array([0.3, -0.2, 1.0])), np.array([5.0, -3.0, 2.0]))


@pytest.fixture(scope="module")
def known():
    """A scene in metres with four control points on its ground, measured in every view to a tenth of a pixel."""
    scene = synthetic_scene(size=16, views=6, keypoint_noise_px=0.3, brightness_noise=0.01)
    rng = np.random.default_rng(1)
    points = []
    for n, j in enumerate((0, 15, 240, 130)):
        position = scene.landmarks.position[j]
        pixels = []
        for k, view in enumerate(scene.views.name):
            x, y = scene.views.project(k, position[None])[0] + 0.1 * rng.normal(size=2)
            pixels.append(ControlPixel(view, float(x), float(y), 0.1))
        points.append(ControlPoint(name=f"P{n}", position=position, sigma=np.full(3, 1.0), pixels=tuple(pixels)))
    return scene, tuple(points)


def test_a_scene_in_a_frame_of_its_own_is_placed(known):
    scene, points = known
    placed = place_by_control(transform_scene(OWN_FROM_BODY, scene), points)
    assert placed is not None
    assert placed.frame == BODY_FIXED
    off = np.linalg.norm(placed.landmarks.position - scene.landmarks.position, axis=1)
    assert off.max() < 0.5 * scene.gsd


def test_the_estimate_takes_frame_and_scale_from_control(known):
    """From a start off by 20 m, without gauge or pose priors: the map is in place to a tenth of a pixel, in metres."""
    scene, points = known
    control = ground_control(points, scene.views)
    found = adjust(start_of(scene), INDEPENDENT, priors=ScenePriors(control=control))
    assert found.converged
    off = np.median(found.scene.landmarks.position - scene.landmarks.position, axis=0)
    assert np.linalg.norm(off) < 0.1 * scene.gsd
    rows = control_table(points, found.control, found.scene.views)
    assert [row.name for row in rows] == ["P0", "P1", "P2", "P3"]
    assert control_metrics(rows)["control_point_off_rms_sigmas"] < 2.0
    sigma = np.sqrt(np.einsum("jaa->ja", found.scene.uncertainty["position"])).max()
    assert np.isfinite(sigma)


def test_a_wrong_point_is_named(caplog):
    """Of eight: of four points which one it is cannot be told, since the map tilts and stretches until others lie as
    far off."""
    scene, points = drawn_points(np.random.default_rng(1), 8)
    points[1] = replace(points[1], position=points[1].position + [300.0, 0.0, 0.0])
    found = adjust(start_of(scene), INDEPENDENT, priors=ScenePriors(control=ground_control(points, scene.views)))
    with caplog.at_level(logging.WARNING):
        warn_of_contradictions(control_table(points, found.control, found.scene.views))
    assert any("P1" in record.message for record in caplog.records)


def drawn_points(rng, count, sigma=10.0, pixel=0.3):
    """Points of the ground of a scene of six views, off by what they state."""
    scene = synthetic_scene(size=16, views=6)
    points = []
    for n, j in enumerate(rng.choice(len(scene.landmarks), count, replace=False)):
        position = scene.landmarks.position[j]
        pixels = [
            ControlPixel(view, *(scene.views.project(k, position[None])[0] + pixel * rng.normal(size=2)), pixel)
            for k, view in enumerate(scene.views.name)
        ]
        known = position + sigma * rng.normal(size=3)
        points.append(ControlPoint(name=f"P{n}", position=known, sigma=np.full(3, sigma), pixels=tuple(pixels)))
    return scene, points


def test_one_wrong_point_of_five_or_more_is_left_out():
    """By 40 of its sigmas, in any direction; of four points none can be told, and none is left out."""
    rng = np.random.default_rng(3)
    for count in (4, 5, 6, 8):
        scene, points = drawn_points(rng, count)
        direction = rng.normal(size=3)
        off = 400.0 * direction / np.linalg.norm(direction)
        points[1] = replace(points[1], position=points[1].position + off)
        left = {point.name for point in points} - {point.name for point in agreeing_points(points, scene.views)}
        assert left == (set() if count == 4 else {"P1"}), count


def test_sound_points_are_not_left_out():
    """Of 60 tables of six points one at most loses a point: a thousandth is to."""
    rng = np.random.default_rng(5)
    lost = 0
    for _ in range(60):
        scene, points = drawn_points(rng, 6)
        lost += len(agreeing_points(points, scene.views)) < 6
    assert lost <= 1


def test_a_point_that_is_left_out_is_in_the_table_and_named(caplog):
    scene, points = drawn_points(np.random.default_rng(1), 6)
    points[2] = replace(points[2], position=points[2].position + [0.0, 500.0, 0.0])
    control = ground_control(agreeing_points(points, scene.views), scene.views)
    found = adjust(start_of(scene), INDEPENDENT, priors=ScenePriors(control=control))
    rows = control_table(points, found.control, found.scene.views)
    assert [row.name for row in rows if not row.used] == ["P2"]
    assert control_metrics(rows)["control_points_left_out"] == 1
    with caplog.at_level(logging.WARNING):
        warn_of_contradictions(rows)
    assert "control point P2 is left out: it is" in caplog.text
    assert all(row.off_sigmas < 3.0 for row in rows if row.used)


def test_too_few_points_and_points_on_a_line_do_not_place(known, caplog):
    scene, points = known
    with caplog.at_level(logging.WARNING):
        assert place_by_control(scene, points[:2]) is None
        middle = 0.5 * (points[0].position + points[1].position)
        line = (*points[:2], replace(points[2], position=middle))
        assert place_by_control(scene, line) is None
    assert "at least 3" in caplog.text
    assert "on a line" in caplog.text


def test_control_points_in_unregistered_views_are_left_out(known):
    scene, points = known
    stranger = replace(points[0], pixels=(ControlPixel("images/999.fits", 1.0, 2.0, 1.0),))
    assert ground_control([stranger], scene.views) is None
    control = ground_control([stranger, points[1]], scene.views)
    assert control is not None
    assert control.name == ("P1",)


def test_metrics_say_what_control_points_change_beside_pose_priors(known, tmp_path, monkeypatch):
    """Priors off by 3 degrees, 2 % and a kilometre. Without them there is no frame that control points could change."""
    draw_no_figures(monkeypatch)
    scene, points = known
    off = Similarity(1.02, so3_exp(np.radians([0.0, 0.0, 3.0])), np.array([900.0, -700.0, 500.0]))
    poses = transform_poses(off, scene.views.body_from_cam)
    priors = {name: PosePrior(poses[k].inverse(), 1e-4, 10.0) for k, name in enumerate(scene.views.name)}
    adjustment = replace(
        not_adjusted(replace(scene, frame=BODY_FIXED)),
        control={point.name: point.position for point in points},
        pose_priors_used=np.ones(len(priors), bool),
    )
    summary = RunSummary(adjustment=adjustment, config={}, left_out={}, pose_priors=priors, control=points)
    metrics = write_products(open_run(tmp_path / "both"), summary).metrics
    middle = scene.landmarks.position.mean(0)
    assert metrics["control_moved_m"] == pytest.approx(np.linalg.norm(middle - off(middle[None])[0]), rel=1e-6)
    assert metrics["control_turned_deg"] == pytest.approx(3.0, rel=1e-6)
    assert metrics["control_scaled_percent"] == pytest.approx(100.0 * (1.0 / 1.02 - 1.0), rel=1e-6)
    alone = replace(summary, pose_priors={}, adjustment=replace(adjustment, pose_priors_used=np.zeros(0, bool)))
    metrics = write_products(open_run(tmp_path / "alone"), alone).metrics
    assert metrics["control_points"] == 4
    assert "control_moved_m" not in metrics
    unused = replace(summary, control=(), adjustment=replace(adjustment, control={}))
    assert "control_moved_m" not in write_products(open_run(tmp_path / "unused"), unused).metrics


def test_a_run_with_control_is_body_fixed_and_in_metres(mapped, tmp_path, no_figures, photometry_as_stated):
    """Four points of the true ground, measured to a tenth of a pixel in all views: frame and scale are the truth's."""
    scene, truth = mapped.result.scene, read_truth(mapped.truth)
    ground = truth_maps(truth, scene.views.name[scene.reference], scene.region)
    rng, lines = np.random.default_rng(0), ["point,view,x_px,y_px,sigma_px,x_m,y_m,z_m,sigma_m"]
    for n, (row, col) in enumerate(((4, 4), (4, 27), (27, 5), (26, 26))):
        position = ground.position[row, col]
        for k, view in enumerate(truth.views.name):
            x, y = truth.views.project(k, position[None])[0] + 0.1 * rng.normal(size=2)
            lines.append(",".join([f"P{n}", view, *(f"{number:.6f}" for number in (x, y, 0.1, *position, 1.0))]))
    table = tmp_path / "points.csv"
    table.write_text("\n".join(lines), encoding="utf-8")
    adopt_stages(mapped.run, tmp_path / "run", ["sparse", "inconsistent_views", "region", "dense", "first_estimate"])
    found = pipeline.run(mapped.site, tmp_path / "run", pipeline.RunOptions(control=table))
    assert found.scene.frame == BODY_FIXED
    assert found.metrics["control_points"] == 4
    assert found.metrics["control_point_off_rms_sigmas"] < 3.0
    row, col = found.scene.cells
    off = found.scene.landmarks.position - ground.position[row, col]
    assert np.linalg.norm(np.median(off, axis=0)) < 0.2 * found.scene.gsd
