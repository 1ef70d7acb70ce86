"""A whole run on a small simulated site: what it recovers, what it leaves, and how it goes on."""

import json
import logging
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions
from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.io.meshes.ply import read_ply
from photoclinometry.io.models.colmap import read_colmap
from photoclinometry.io.scene_file import read_scene
from photoclinometry.io.site import RegionRequest, read_site, write_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.errors import ReconstructionError, RunFolderError, SiteError
from photoclinometry.photometry.point_spread import psf_sigma_px
from photoclinometry.pipeline import joint_estimate, products
from photoclinometry.pipeline.run import RunOptions, choose_reflectance, run
from photoclinometry.simulate.truth_file import read_truth

BEFORE = ["sparse", "distortion", "inconsistent_views", "region", "dense"]
"""The stages before the first estimate that a run folder keeps."""

AFTER = ["reflectance", "suns", "response", "last_estimate"]
"""Those after the relighting iterations."""

pytestmark = pytest.mark.usefixtures("no_figures", "photometry_as_stated")


NEVER_KEPT = {"images", "initialise", "products", "report"}


def stages_of(folder):
    return json.loads((folder / "metrics.json").read_text())["stages"]


def kept_by(run_folder):
    """The stages that the folder of the small site keeps."""
    kept = [s["stage"] for s in stages_of(run_folder) if s["stage"] not in NEVER_KEPT]
    relit = relighting_of(run_folder)
    assert relit in (["relighting_1", "relighting_2"], ["relighting_1", "relighting_2", "relighting_3"])  # by rounding
    assert kept == [*BEFORE, "first_estimate", *relit, *AFTER]
    return kept


def relighting_of(run_folder):
    return [s["stage"] for s in stages_of(run_folder) if s["stage"].startswith("relighting")]


def resumed(folder):
    """The stages that the last run in a folder read back."""
    return [s["stage"] for s in stages_of(folder) if s["resumed"]]


def test_a_run_recovers_the_truth(mapped):
    metrics = evaluate_against_truth(mapped.result.scene, read_truth(mapped.truth)).metrics
    assert mapped.result.adjustment.converged
    assert len(mapped.result.scene.landmarks) > 0.95 * 32 * 32
    assert metrics["surface_distance_mean_gsd"] < 0.2
    assert metrics["normal_error_mean_deg"] < 4.0
    assert metrics["albedo_error_mean_percent"] < 3.0
    assert metrics["sun_error_mean_deg"] < 1.0
    assert metrics["camera_pointing_error_mean_deg"] < 1.0


def test_every_product_is_there_and_reads_back(mapped):
    scene = mapped.result.scene
    stored = read_scene(mapped.run / "scene.h5")
    np.testing.assert_array_equal(stored.landmarks.position, scene.landmarks.position)
    np.testing.assert_array_equal(stored.tracks.brightness, scene.tracks.brightness)
    ply = read_ply(mapped.run / "landmarks.ply")
    np.testing.assert_allclose(ply.position, scene.landmarks.position, rtol=1e-6, atol=1e-6)
    assert ply.normal.shape == ply.position.shape
    assert len(ply.albedo) == len(ply.position)
    assert len(ply.faces) > len(ply.position)
    names, _, poses, points = read_colmap(mapped.run / "sparse")
    assert sorted(names) == sorted(scene.views.name)
    assert len(points) == len(scene.landmarks)
    at = [scene.views.name.index(name) for name in names]
    np.testing.assert_allclose(poses.translation, scene.views.body_from_cam.translation[at], rtol=1e-9)
    assert mapped.result.report == mapped.run / "report" / "index.html"
    assert "<html" in mapped.result.report.read_text()


def test_metrics_and_config_say_what_was_done(mapped):
    metrics = json.loads((mapped.run / "metrics.json").read_text())
    assert metrics["left_out"] == []
    assert metrics["brought_in"] == []
    assert metrics["metrics"]["converged"] == 1
    assert metrics["metrics"]["psnr_mean_db"] > 30
    assert metrics["metrics"]["psf_sigma_px"] == psf_sigma_px(load_images(read_site(mapped.site)))
    assert [v["name"] for v in metrics["views"]] == [v.name for v in read_site(mapped.site).views]
    assert [s["stage"] for s in metrics["stages"]][1:6] == BEFORE
    assert all(s["wall_s"] >= 0 and not s["resumed"] for s in metrics["stages"])
    first, *others = metrics["relighting_iterations"]
    assert [first["iteration"], *(r["iteration"] for r in others)] == list(range(len(others) + 1))
    assert others[-1]["keypoint_residual_median_px"] < first["keypoint_residual_median_px"]
    *relit, last = others  # the last is of the images, whose smooth errors it leaves in the residuals
    assert relit[-1]["photometric_error_mean_percent"] < first["photometric_error_mean_percent"]
    assert last["photometric_error_mean_percent"] < 1.0
    assert "Relighting iterations" in mapped.result.report.read_text()
    config = tomllib.loads((mapped.run / "config.toml").read_text())
    assert config["site"] == str(mapped.site.resolve())
    assert config["reflectance"] == "auto"
    assert config["flow"].keys() <= {f for f in RunOptions().flow.__dataclass_fields__}


def test_a_second_run_reads_every_stage_back(mapped, tmp_path, adjust_nothing):
    folder = mapped.copy(tmp_path / "run")
    again = run(mapped.site, folder)
    assert resumed(folder) == kept_by(mapped.run)
    assert not adjust_nothing
    np.testing.assert_array_equal(again.scene.landmarks.position, mapped.result.scene.landmarks.position)
    assert again.adjustment.log == mapped.result.adjustment.log
    assert again.adjustment.noise == mapped.result.adjustment.noise
    assert again.metrics == mapped.result.metrics


def test_how_a_view_came_in_is_said(mapped, tmp_path):
    """As if the sparse stage had needed the relief for a view."""
    folder = mapped.copy(tmp_path / "run")
    file = folder / "stages" / "sparse.npz"
    with np.load(file) as stored:
        arrays = dict(stored)
    arrays["value.brought_in"] = np.where(np.arange(len(arrays["value.registered"])) == 2, "the relief", "")
    np.savez(file, **arrays)
    run(mapped.site, folder)
    name = read_site(mapped.site).views[2].name
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["brought_in"] == [{"name": name, "by": "the relief"}]
    assert [row["name"] for row in metrics["views"] if row.get("brought_in_by") == "the relief"] == [name]


def test_changed_options_redo_what_depends_on_them_and_no_more(mapped, tmp_path, adjust_nothing):
    folder = mapped.copy(tmp_path / "run")
    run(mapped.site, folder, RunOptions(matcher="flow", adjust=AdjustOptions(smooth_neighbours=6)))
    assert resumed(folder) == BEFORE
    run(mapped.site, folder, RunOptions(matcher="flow", reflectance="akimov"))
    assert resumed(folder) == [*BEFORE[:2], *BEFORE[3:]]
    run(mapped.site, folder, RunOptions(matcher="flow", matching_passes=1, reflectance="akimov"))
    assert resumed(folder) == BEFORE[:-1]
    assert len(adjust_nothing) == 3


def test_a_changed_region_redoes_region_and_later(mapped, tmp_path, adjust_nothing):
    folder = mapped.copy(tmp_path / "run")
    result = run(mapped.changed_site(tmp_path / "site", region=RegionRequest(size_px=(24, 20))), folder)
    assert resumed(folder) == BEFORE[:-2]
    assert (result.scene.region.width, result.scene.region.height) == (24, 20)


def test_an_interrupted_run_goes_on_where_it_was(mapped, tmp_path, monkeypatch, adjust_nothing):
    folder = mapped.copy(tmp_path / "run")
    options = RunOptions(adjust=AdjustOptions(smooth_sigma_rad=0.3))
    stand_in = joint_estimate.adjust

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(joint_estimate, "adjust", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run(mapped.site, folder, options)
    monkeypatch.setattr(joint_estimate, "adjust", stand_in)
    run(mapped.site, folder, options)
    assert resumed(folder) == BEFORE
    run(mapped.site, folder, options)
    assert resumed(folder) == [s["stage"] for s in stages_of(folder) if s["stage"] not in NEVER_KEPT]


def test_a_scene_is_never_taken_for_that_of_other_options(mapped, tmp_path, monkeypatch, adjust_nothing):
    """Killed when scene.h5 was written and nothing else, the run of the earlier options leaves its own."""
    folder = mapped.copy(tmp_path / "run")

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(products, "_tables", killed)
        with pytest.raises(KeyboardInterrupt):
            run(mapped.site, folder, RunOptions(reflectance="akimov"))
    assert read_scene(folder / "scene.h5").reflectance.name == "akimov"
    run(mapped.site, folder)
    # The other options do not have it, and it follows the last relighting iteration.
    own = ["reflectance"] if relighting_of(folder) == relighting_of(mapped.run) else []
    assert resumed(folder) == [*BEFORE[:2], *BEFORE[3:], *own]
    assert read_scene(folder / "scene.h5").reflectance.name == "lunar-lambert"


@pytest.mark.parametrize("damage", [None, b"", b"\x89HDF nothing"])
def test_a_missing_or_damaged_scene_is_written_again(mapped, tmp_path, damage):
    folder = mapped.copy(tmp_path / "run")
    (folder / "scene.h5").unlink()
    if damage is not None:
        (folder / "scene.h5").write_bytes(damage)
    run(mapped.site, folder)
    assert resumed(folder) == kept_by(mapped.run)
    position = read_scene(folder / "scene.h5").landmarks.position
    np.testing.assert_array_equal(position, mapped.result.scene.landmarks.position)


def test_a_damaged_stage_is_made_again_with_a_warning(mapped, tmp_path, adjust_nothing, caplog):
    folder = mapped.copy(tmp_path / "run")
    file = folder / "stages" / "dense.npz"
    file.write_bytes(file.read_bytes()[:1000])
    run(mapped.site, folder)
    assert resumed(folder) == [name for name in kept_by(mapped.run) if name != "dense"]
    assert any("dense.npz: damaged" in r.getMessage() for r in caplog.records if r.levelno == logging.WARNING)


def test_geometry_alone_leaves_photometry_out(mapped, tmp_path):
    folder = mapped.copy(tmp_path / "run")
    result = run(mapped.site, folder, RunOptions(reflectance="none"))
    assert resumed(folder) == [*BEFORE[:2], *BEFORE[3:]]
    assert result.scene.reflectance is None
    assert read_scene(folder / "scene.h5").reflectance is None
    np.testing.assert_array_equal(result.scene.landmarks.albedo, 1.0)
    assert not [name for name in result.metrics if "psnr" in name or "photometric" in name or "brightness" in name]
    metrics = evaluate_against_truth(result.scene, read_truth(mapped.truth)).metrics
    assert metrics["surface_distance_mean_gsd"] < 0.3
    assert not [name for name in metrics if "albedo" in name]


def test_auto_takes_lunar_lambert_for_calibrated_images_of_a_known_body_only():
    assert choose_reflectance("none", "vesta") is None
    assert choose_reflectance("auto", "vesta").name == "lunar-lambert"
    assert choose_reflectance("auto", None).name == "mcewen"
    assert choose_reflectance("minnaert", "vesta").name == "minnaert"


def test_images_of_nothing_alike_do_not_make_a_map(mapped, tmp_path):
    """Every image of another place: the failure is the images', not the user's."""
    from scipy.ndimage import gaussian_filter

    from photoclinometry.io.images import write_fits

    site = read_site(mapped.site)
    rng = np.random.default_rng(0)
    for view in site.views:
        ground = gaussian_filter(rng.normal(size=(view.camera.height, view.camera.width)), 2.0)
        write_fits(tmp_path / view.name, 0.15 + 0.2 * ground)
    write_site(tmp_path / "site.toml", site)
    with pytest.raises(ReconstructionError):
        run(tmp_path / "site.toml", tmp_path / "run")


def test_a_wrong_site_or_folder_leaves_nothing_behind(mapped, tmp_path):
    with pytest.raises(SiteError, match="no such file"):
        run(tmp_path / "none.toml", tmp_path / "run")
    assert not (tmp_path / "run").exists()
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(RunFolderError, match="is not a run folder"):
        run(mapped.site, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_importing_the_package_loads_nothing_heavy():
    heavy = ("pycolmap", "matplotlib", "cv2", "astropy", "embreex")
    code = f"import sys, photoclinometry; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
