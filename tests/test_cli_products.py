"""`phomo render`, `evaluate` and `info` on a run folder: what they write, and what they refuse."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tyro

from photoclinometry.api.given import view_index
from photoclinometry.cli.evaluate import evaluate
from photoclinometry.cli.info import info
from photoclinometry.cli.render import render
from photoclinometry.io.images import read_image, write_fits
from photoclinometry.io.meshes.ply import write_ply
from photoclinometry.io.models.colmap import write_colmap
from photoclinometry.io.run_files import site_path
from photoclinometry.io.scene_file import write_scene
from photoclinometry.io.similarity import read_similarity
from photoclinometry.io.site import Site, SiteView, write_site
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.geometry import Similarity, so3_exp
from photoclinometry.model.scene import BODY_FIXED, OWN, SHARED
from photoclinometry.photometry.render import render_view
from photoclinometry.registration.alignment import transform_scene
from scenes import synthetic_images, synthetic_scene


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A site with its images, and a finished run of it."""
    folder = tmp_path_factory.mktemp("place")
    scene = synthetic_scene(size=24, views=4)
    views = []
    for k, image in enumerate(synthetic_images(scene)):
        write_fits(folder / image.name, image.brightness)
        views.append(
            SiteView(
                name=image.name,
                image=folder / image.name,
                camera=scene.views.cameras[k],
                sun=scene.views.sun_measured[k],
            )
        )
    site = folder / "site.toml"
    write_site(site, Site(scene.name, None, "iof", tuple(views), None, site))
    run = folder / "run"
    run.mkdir()
    write_scene(run / "scene.h5", scene)
    (run / "config.toml").write_text(f"site = '{site}'\n")
    (run / "metrics.json").write_text(json.dumps({"metrics": {"psnr_mean_db": 41.5, "views": 4}}))
    return SimpleNamespace(scene=scene, site=site, run=run)


def command(function, *arguments):
    return tyro.cli(function, args=[str(a) for a in arguments])


def test_render_writes_the_brightness_as_fits(place, tmp_path):
    out = command(render, place.run, "--out", tmp_path / "view.fits", "--view", "002.fits")
    image = read_image(out)
    expected, mask = render_view(place.scene, 2)
    np.testing.assert_array_equal(image.valid, mask)
    np.testing.assert_allclose(image.brightness[mask], expected[mask], rtol=1e-6)


def test_render_relights_on_the_reference_grid_as_png(place, tmp_path):
    arguments = ("--sun-azimuth-deg", 315, "--sun-elevation-deg", 20, "--geometry", "reference", "--cast-shadows")
    out = command(render, place.run, "--out", tmp_path / "relit.png", *arguments)
    brightness = read_image(out).brightness
    assert brightness.shape == (24, 24)
    assert brightness.max() == 65534


def test_evaluate_writes_what_it_prints(place, capsys):
    metrics = command(evaluate, place.run)
    assert metrics["psnr_min_db"] > 50
    written = json.loads((place.run / "evaluation" / "evaluation.json").read_text())
    assert written["completeness_percent"] == 100.0
    assert "photometric error" in (place.run / "evaluation" / "evaluation.md").read_text()
    assert "photometric error" in capsys.readouterr().out


def test_evaluate_against_its_own_map_finds_no_difference(place, tmp_path):
    write_ply(tmp_path / "map.ply", place.scene, mesh=True)
    write_colmap(tmp_path / "sparse", place.scene)
    arguments = ("--reference", tmp_path / "map.ply", "--cameras", tmp_path / "sparse", "--no-images")
    metrics = command(evaluate, place.run, *arguments, "--maps", "--out", tmp_path / "evaluation")
    assert metrics["surface_distance_rms_m"] < 1e-3
    drawn = {path.name for path in (tmp_path / "evaluation" / "maps").iterdir()}
    assert {"difference_surface_distance_m.png", "difference_albedo_error_percent.png"} <= drawn
    assert metrics["normal_error_rms_deg"] < 1e-3
    assert metrics["camera_position_error_rms_m"] < 1e-3
    assert "psnr_mean_db" not in metrics


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("km", 1000.0)])
def test_a_map_elsewhere_georeferences_the_run(place, tmp_path, unit, metres):
    """What `phomo export --transform` takes brings the run onto the other map, in metres."""
    true = Similarity(2.5, so3_exp(np.array([0.3, -0.5, 0.2])), np.array([100.0, 2000.0, -300.0]))
    moved = transform_scene(true, place.scene)
    write_ply(tmp_path / "map.ply", moved, mesh=True)
    write_colmap(tmp_path / "sparse", moved)
    arguments = ("--reference", tmp_path / "map.ply", "--cameras", tmp_path / "sparse", "--no-images")
    command(evaluate, place.run, *arguments, "--unit", unit, "--out", tmp_path / "found")
    found = read_similarity(tmp_path / "found" / "reference_from_scene.toml")
    expected = metres * moved.landmarks.position
    np.testing.assert_allclose(found(place.scene.landmarks.position), expected, atol=1e-5 * np.ptp(expected))


def test_evaluate_says_how_to_go_on_without_the_site(place, tmp_path):
    with pytest.raises(RunFolderError, match="--site"):
        site_path(tmp_path)
    with pytest.raises(RunFolderError, match="--no-images"):
        site_path(place.run, tmp_path / "moved.toml")


def test_info_describes_a_site_and_a_run(place, capsys):
    info(place.site)
    site = capsys.readouterr().out
    assert "images/003.fits" in site
    assert "chosen automatically" in site
    info(place.run)
    run = capsys.readouterr().out
    assert "576 landmarks" in run
    assert "41.5\u00a0dB" in run


@pytest.mark.parametrize(
    ("frame", "tables", "words"),
    [
        (OWN, {}, "of the images alone"),
        (SHARED, {}, "that of a larger model"),
        (BODY_FIXED, {"pose_priors": [{"used": True}], "control_points": []}, "body-fixed, by pose priors"),
        (BODY_FIXED, {"pose_priors": [], "control_points": [{"used": True}]}, "body-fixed, by ground control points"),
        (
            BODY_FIXED,
            {"pose_priors": [{"used": True}, {"used": False}], "control_points": [{"used": True}]},
            "body-fixed, by pose priors and ground control points",
        ),
        (BODY_FIXED, {"pose_priors": [{"used": False}]}, "body-fixed"),
    ],
)
def test_info_says_what_placed_the_map(place, tmp_path, capsys, frame, tables, words):
    write_scene(tmp_path / "scene.h5", replace(place.scene, frame=frame))
    (tmp_path / "metrics.json").write_text(json.dumps(tables))
    info(tmp_path)
    assert f"frame: {words}\n" in capsys.readouterr().out


def test_views_are_found_by_name_file_name_or_stem(place):
    assert [view_index(place.scene, n) for n in ("images/001.fits", "001.fits", "001", None)] == [1, 1, 1, 0]
