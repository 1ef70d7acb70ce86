"""Views held out of a map: placed by their poses alone, measured like the others, and of no influence on it."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions
from photoclinometry.cli import main
from photoclinometry.evaluate.evaluate import evaluate_scene, held_out_table, view_psnr
from photoclinometry.evaluate.held_out import held_out_mask, held_out_views, resect, resect_views
from photoclinometry.io.held_out import read_held_out, write_held_out
from photoclinometry.io.run_files import HELD_OUT_FILE
from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.matching.flow import FlowMatcher
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import Rigid, so3_exp, so3_log
from photoclinometry.model.reflectance import published
from photoclinometry.model.scene import Scene
from photoclinometry.model.sparse import SparseModel, without_views
from photoclinometry.pipeline.folder.run_folder import open_run
from photoclinometry.pipeline.folder.stage import Keyed
from photoclinometry.pipeline.run import RunOptions, run
from photoclinometry.pipeline.sparse_stages import choose_views
from scenes import sparse_model_of, synthetic_images, synthetic_scene

FEW = {"densify": DensifyOptions(min_views=4), "adjust": AdjustOptions(max_reweightings=1)}


def moved(pose: Rigid, seed: int, px: float) -> Rigid:
    """The pose turned so that its picture moves by about `px` pixels of 1e-4 rad."""
    rng = np.random.default_rng(seed)
    return Rigid(pose.rotation @ so3_exp(1e-4 * px * rng.normal(size=3)), pose.translation)


def without(scene: Scene, view: int) -> Scene:
    """The scene as a run that held one view out leaves it."""
    rest = np.array([k for k in range(len(scene.views)) if k != view])
    tracks, seen = scene.tracks, scene.tracks.view != view
    count = np.bincount(tracks.landmark[seen], minlength=len(scene.landmarks))
    fields = {k: getattr(tracks, k)[seen] for k in ("keypoint", "keypoint_sigma", "brightness", "lit")}
    index = np.searchsorted(rest, tracks.view[seen]).astype(np.int32)
    tracks = replace(tracks, start=np.concatenate([[0], np.cumsum(count)]), view=index, **fields)
    return replace(scene, views=scene.views[rest], tracks=tracks)


def under_one_sun(scene: Scene) -> Scene:
    """The scene with one Sun in all views, so that they match well; its tracks' brightness is not theirs."""
    sun = np.tile(scene.views.sun[0], (len(scene.views), 1))
    measured = np.einsum("kji,kj->ki", scene.views.body_from_cam.rotation, sun)
    return replace(scene, views=replace(scene.views, sun=sun, sun_measured=measured))


def test_exact_pixels_give_the_exact_pose():
    scene = synthetic_scene(size=20)
    true = scene.views.body_from_cam[3]
    keypoint = scene.views.project(3, scene.landmarks.position)
    start = Rigid(true.rotation @ so3_exp(np.array([1e-3, -8e-4, 5e-3])), true.translation * 1.002 + 300.0)
    pose, residual = resect(scene.landmarks.position, keypoint, np.full(400, 0.1), scene.views.cameras[3], start)
    assert residual.max() < 1e-6
    np.testing.assert_allclose(pose.translation, true.translation, rtol=1e-5)
    assert np.linalg.norm(so3_log(pose.rotation.T @ true.rotation)) < 1e-5


def test_a_fifth_of_wrong_pixels_does_not_move_the_pose():
    scene = synthetic_scene(size=20)
    rng = np.random.default_rng(0)
    exact = scene.views.project(3, scene.landmarks.position)
    keypoint = exact + 0.1 * rng.normal(size=exact.shape)
    keypoint[:80] += rng.uniform(5.0, 20.0, (80, 2))
    pose, _ = resect(
        scene.landmarks.position, keypoint, np.full(400, 0.1), scene.views.cameras[3], scene.views.body_from_cam[3]
    )
    found = scene.views.cameras[3].pixel_from_cam(pose.inverse()(scene.landmarks.position))
    assert np.linalg.norm(found - exact, axis=-1).max() < 0.1


@pytest.mark.parametrize("model", ["lunar-lambert", "mcewen"])
def test_a_view_is_found_in_the_map_and_rendered_nearly_as_well_as_those_used(model):
    """From a pose 3 px off. What is left is the matches' error: 0.05 px; uncalibrated scale and bias are found."""
    scene = under_one_sun(synthetic_scene(size=40, reflectance=published(model, "vesta")))
    images, left = synthetic_images(scene), 4
    rough = np.stack([moved(pose, 0, 3.0).rotation for pose in scene.views.body_from_cam])
    poses = Rigid(rough, scene.views.body_from_cam.translation)
    views = replace(scene.views, scale=np.ones(6), bias=np.zeros(6), body_from_cam=poses)
    map_ = without(scene, left)
    resected = resect_views(map_, views, np.array([left]), images, FlowMatcher())
    assert resected.keypoints[0] > 1200
    assert resected.keypoint_rms_px[0] < 0.15
    found = held_out_views(views, resected)
    assert found.name == (scene.views.name[left],)
    np.testing.assert_allclose(found.scale, scene.views.scale[left], rtol=0.02)
    off = found.project(0, scene.landmarks.position) - scene.views.project(left, scene.landmarks.position)
    assert np.linalg.norm(off, axis=-1).max() < 0.1
    quality = held_out_table(map_, found, images)[0]["psnr_db"]
    assert quality > view_psnr(scene, left, images[left])["psnr_db"] - 6.0
    assert quality > 45.0


def test_a_view_that_shows_something_else_is_left_out():
    scene = synthetic_scene(size=24)
    images = synthetic_images(scene)
    noise = np.random.default_rng(0).normal(0.1, 0.02, images[4].brightness.shape).astype(np.float32)
    images[4] = replace(images[4], brightness=noise)
    resected = resect_views(without(scene, 4), scene.views, np.array([4]), images, FlowMatcher())
    assert len(resected.index) == 0
    assert len(held_out_views(scene.views, resected)) == 0


def test_an_uncalibrated_view_in_the_dark_is_left_out():
    """Its ground can be found, but no brightness is a measurement that its scale could be fitted to."""
    scene = under_one_sun(synthetic_scene(size=24, reflectance=published("mcewen")))
    images = synthetic_images(scene)
    below = replace(scene.views, sun_measured=-scene.views.sun_measured)
    assert len(resect_views(without(scene, 4), scene.views, np.array([4]), images, FlowMatcher()).index) == 1
    assert len(resect_views(without(scene, 4), below, np.array([4]), images, FlowMatcher()).index) == 0


def test_held_out_figures_are_those_of_their_own_views():
    """An exact view held out has the PSNR that it has as a view, and changes no other figure."""
    scene = synthetic_scene(size=20)
    images = synthetic_images(scene)
    map_, aside = without(scene, 2), scene.views[[2]]
    rows = held_out_table(map_, aside, images)
    expected = view_psnr(scene, 2, images[2])["psnr_db"]
    assert [row["psnr_db"] for row in rows] == [pytest.approx(expected)]
    used = [image for image in images if image.name in map_.views.name]
    plain, metrics = evaluate_scene(map_, used), evaluate_scene(map_, used, held_out=rows)
    assert metrics.pop("views_held_out") == 1
    assert metrics.pop("psnr_held_out_mean_db") == metrics.pop("psnr_held_out_min_db") == pytest.approx(expected)
    assert metrics == plain


def test_held_out_views_leave_nothing_in_the_sparse_model():
    """Three points, seen by 3, 2 and 2 views: without view 1 by two, one and two, and the second is dropped."""
    sparse = SparseModel(
        registered=np.ones(3, bool),
        body_from_cam=Rigid(np.stack([np.eye(3)] * 3), np.zeros((3, 3))),
        points=np.arange(9.0).reshape(3, 3),
        point_start=np.array([0, 3, 5, 7]),
        point_view=np.array([0, 1, 2, 0, 1, 0, 2], np.int32),
        point_xy=np.arange(14.0).reshape(7, 2),
        mean_reprojection_px=0.1,
    )
    rest = without_views(sparse, np.array([False, True, False]))
    assert rest.registered.tolist() == [True, False, True]
    assert rest.points.tolist() == [[0, 1, 2], [6, 7, 8]]
    assert rest.point_start.tolist() == [0, 2, 4]
    assert rest.point_view.tolist() == [0, 2, 0, 2]
    assert rest.point_xy.tolist() == [[0, 1], [4, 5], [10, 11], [12, 13]]


def test_held_out_views_that_do_not_register_are_not_left_out(tmp_path):
    """Three of five views are used: none of them is missing because of its images."""
    scene = synthetic_scene(size=8, views=6)
    sparse = sparse_model_of(scene, np.array([True, True, True, False, False, False]))
    posed = SimpleNamespace(views=scene.views, sparse=Keyed(sparse, "sparse"), without=lambda views: views)
    found = choose_views(open_run(tmp_path), posed, np.array([False, False, True, False, True, True]), None)
    assert found.left_out == {scene.views.name[3]: "not registered"}
    assert found.used.tolist() == [False, False, True, False, True, True]


def test_names_that_cannot_be_held_out_are_refused():
    names = [f"images/{k:03d}.fits" for k in range(4)]
    assert held_out_mask(names, ["images/001.fits"]).tolist() == [False, True, False, False]
    assert not held_out_mask(names, []).any()
    with pytest.raises(InputError, match=r"no view '001' .* nearest: images/001.fits"):
        held_out_mask(names, ["001"])
    with pytest.raises(InputError, match="reference view"):
        held_out_mask(names, ["images/000.fits"], "images/000.fits")
    with pytest.raises(InputError, match="2 of 4 views are held out, at least 3 must remain"):
        held_out_mask(names, names[2:])


def test_held_out_views_are_kept_exactly(tmp_path):
    views = synthetic_scene(size=4).views[[1, 3]]
    write_held_out(tmp_path / HELD_OUT_FILE, views)
    found = read_held_out(tmp_path / HELD_OUT_FILE)
    assert found.name == views.name
    assert found.cameras == views.cameras
    np.testing.assert_array_equal(found.body_from_cam.rotation, views.body_from_cam.rotation)
    np.testing.assert_array_equal(found.sun, views.sun)
    assert read_held_out(tmp_path / "none.json") is None
    (tmp_path / HELD_OUT_FILE).write_text('{"name": ["a"]}')
    with pytest.raises(RunFolderError, match="damaged"):
        read_held_out(tmp_path / HELD_OUT_FILE)


def test_a_run_holds_views_out_and_evaluates_on_them(mapped, tmp_path, no_figures, photometry_as_stated):
    """The sparse stage is read back; the map is made of 5 views; the sixth is rendered; without it, it is forgotten."""
    folder = mapped.copy(tmp_path / "run")
    aside = next(n for k, n in enumerate(mapped.result.scene.views.name) if k != mapped.result.scene.reference)
    result = run(mapped.site, folder, RunOptions(hold_out=(aside,), **FEW))
    assert aside not in result.scene.views.name
    assert result.left_out == {}
    assert len(result.scene.views) == 5
    assert result.metrics["views_held_out"] == 1
    assert result.metrics["psnr_held_out_mean_db"] > 30
    summary = json.loads((folder / "metrics.json").read_text())
    assert [s["stage"] for s in summary["stages"] if s["resumed"]] == ["sparse", "distortion"]
    assert [row["name"] for row in summary["views"] if row.get("held_out")] == [aside]

    main(["evaluate", str(folder), "--out", str(tmp_path / "evaluation")])
    metrics = json.loads((tmp_path / "evaluation" / "evaluation.json").read_text())
    assert metrics["psnr_held_out_mean_db"] == pytest.approx(result.metrics["psnr_held_out_mean_db"])

    with pytest.raises(InputError, match="no view 'other'"):
        run(mapped.site, folder, RunOptions(hold_out=("other",)))
