"""A small body: sparse model and shape by poor pose priors, the plan, and the whole command with two tiles."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.api.maps import read_scene
from photoclinometry.body import run as library
from photoclinometry.body.options import BodyOptions, TilePlanOptions
from photoclinometry.body.run import map_body, map_one_tile, owner_of_body, plan_body
from photoclinometry.cli import main
from photoclinometry.io.meshes.shape_ply import read_shape_ply
from photoclinometry.io.run_files import PRODUCTS
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import Similarity
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.model.warning import MANY_ALIKE
from photoclinometry.output.viewer.run_page import run_page
from photoclinometry.pipeline.folder.records import write_record
from photoclinometry.pipeline.folder.run_folder import check_run, claimed_run
from photoclinometry.pipeline.folder.run_mark import MARK
from photoclinometry.pipeline.folder.run_owner import owner_of_site
from photoclinometry.pipeline.options import RelightOptions, RunOptions
from photoclinometry.registration.alignment import refine_on_surface
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.simulate.bodies.truth import read_body_truth
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site
from photoclinometry.surface.closed_mesh import is_watertight, signed_volume
from viewer_data import data_of

pytest.importorskip("embreex")

OPTIONS = BodyOptions(
    plan=TilePlanOptions(tile_px=64, max_views=9),
    run=RunOptions(check_views=False, relight=RelightOptions(iterations=1)),
)
WORDS = ["--plan.tile-px", "64", "--plan.max-views", "9", "--run.relight.iterations", "1"]
"""The same options of `phomo body`."""


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    """The folder of a simulated body, and its plan."""
    folder = tmp_path_factory.mktemp("body")
    options = SimulationOptions(preset="topshape", views=80, image_size=192, seed=2, pose_sigma=(0.05, 10.0))
    simulate_site(options, folder / "site")
    model = plan_body(folder / "site" / "site.toml", folder / "body", OPTIONS)
    return folder, model, read_body_truth(folder / "site" / "truth.h5")


def test_poor_priors_join_images_that_hardly_match(body):
    _, model, truth = body
    sparse = model.posed.sparse.value
    assert sparse.registered.sum() >= 40
    assert sparse.mean_reprojection_px < 0.4
    assert model.posed.frame == BODY_FIXED
    surface = MeshSurface(truth.surface.vertices, truth.surface.faces, closed=True)
    off = np.linalg.norm(surface(sparse.points)[0] - sparse.points, axis=-1) / truth.gsd
    assert np.median(off) < 2.5
    assert {model.site.views[k].name for k in np.flatnonzero(~sparse.registered)} == {
        model.site.views[k].name for k in sparse.why_unregistered()
    }


def test_the_coarse_shape_is_closed_and_of_the_true_volume(body):
    _, model, truth = body
    shape = model.shape.value
    assert is_watertight(shape.faces)
    true = signed_volume(truth.surface.vertices, truth.surface.faces)
    assert signed_volume(shape.vertices, shape.faces) == pytest.approx(true, rel=0.03)


def test_the_plan_covers_most_of_the_body(body):
    _, model, _ = body
    plan = model.plan.value
    assert plan.area["planned"] > 0.7
    assert sum(tile.new_area for tile in plan.tiles) == pytest.approx(
        plan.area["planned"] * sum_of_areas(model.shape.value), rel=0.02
    )


def test_commands_of_tiles_are_printed_one_a_line(body, capsys, monkeypatch):
    folder, model, _ = body
    site, out = str(folder / "site" / "site.toml"), str(folder / "body")
    words = [*WORDS, "--run.reflectance", "lunar-lambert"]  # given: no tile is mapped to choose it
    main(["body", site, "--out", out, *words, "--workers", "3", "--print-tasks"])
    lines = capsys.readouterr().out.splitlines()
    called = []
    monkeypatch.setattr(library, "map_one_tile", lambda *given: called.append(given))
    for line in lines:
        program, *words = shlex.split(line)
        assert program == "phomo"
        main(words)
    options = replace(OPTIONS, run=replace(OPTIONS.run, reflectance="lunar-lambert"))
    assert called == [(folder / "site" / "site.toml", folder / "body", options, n) for n in range(len(called))]
    assert len(called) == len(model.plan.value.tiles)


def sum_of_areas(shape):
    a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


@pytest.fixture(scope="module")
def mapped(body):
    """The result of the whole command, where the plan has two neighbouring tiles only, and an earlier one had more."""
    folder, model, _ = body
    site, out = folder / "site" / "site.toml", folder / "body"
    shape, plan = model.shape.value, model.plan.value
    middle = shape.vertices[shape.faces].mean(1)
    first = middle[plan.tile_of_face == 0].mean(0)
    apart = [np.linalg.norm(middle[plan.tile_of_face == n].mean(0) - first) for n in range(len(plan.tiles))]
    two = replace(plan, tiles=tuple(plan.tiles[n] for n in np.argsort(apart)[:2]))
    write_record(out / "stages" / "plan.npz", model.plan.key, two)
    (out / "tiles" / "0007").mkdir(parents=True)
    return map_body(site, out, OPTIONS, workers=2)


def test_a_body_is_mapped_by_processes_to_one_closed_surface(body, mapped):
    folder, _, _ = body
    written = read_shape_ply(folder / "body" / "body.ply")
    np.testing.assert_allclose(written.vertices, mapped.shape.vertices, rtol=1e-6)
    assert is_watertight(written.faces)
    assert mapped.metrics["tiles_mapped"] == 2
    assert 0.2 < np.mean(written.views > 0) < 0.95  # elsewhere it is coarse, with few vertices
    assert mapped.report.is_file()
    assert run_page(folder / "body") == folder / "body" / "report" / "viewer.html"
    page = data_of((folder / "body" / "report" / "viewer.html").read_text())["scene"]
    assert page["facets"] == len(written.faces)
    assert len(page["views"]) == sum(picture is not None for picture in page["pictures"])
    (folder / "body" / "report" / "viewer.html").unlink()
    again = data_of(run_page(folder / "body").read_text())["scene"]
    assert (again["facets"], again["pictures"]) == (page["facets"], page["pictures"])
    assert again["reflectance"] == page["reflectance"]
    document = json.loads((folder / "body" / "metrics.json").read_text())
    assert max(row["tie_points_px"] for row in document["tiles"]) < 0.4
    placed = {row["name"] for row in document["views"] if row["placed_by_surface"]}
    assert mapped.metrics["images_placed_by_surface"] == len(placed)
    left_out = {warned.view for warned in mapped.warnings if warned.code == "view-unregistered"}
    assert not left_out & placed
    assert len(left_out) + len(placed) == mapped.metrics["images"] - mapped.metrics["images_registered"]
    assert mapped.metrics["psnr_mean_db"] > 15.0
    assert mapped.metrics["disk_brightness_explained_percent"] > 30.0
    assert mapped.trusted
    assert (document["trusted"], document["not_trusted_because"]) == (True, [])


def test_info_of_a_body_has_its_figures_and_a_few_warnings_of_each_kind(body, mapped, capsys):
    folder, _, _ = body
    main(["info", str(folder / "body")])
    said = capsys.readouterr().out
    assert said.startswith(f"body: a whole body, {mapped.metrics['facets']:,.0f} facets")
    assert f"{mapped.metrics['images_registered']:.0f}" in said
    left_out = [warned for warned in mapped.warnings if warned.code == "view-unregistered"]
    assert len(left_out) > MANY_ALIKE
    assert said.count("is left out") == MANY_ALIKE
    more = f"and {len(left_out) - MANY_ALIKE} more like it, listed in metrics.json [view-unregistered]"
    assert more in " ".join(said.split())


def test_renderings_of_tiles_are_told_by_the_tiles_alone(body, mapped):
    """Ground that is rough to the pixel has renderings of 29 dB; of the body whole disks are compared."""
    folder, _, _ = body
    of_tile = json.loads((folder / "body" / "tiles" / "0000" / "metrics.json").read_text())
    assert "renderings-differ" in {warned["code"] for warned in of_tile["warnings"]}
    assert "renderings-differ" not in {warned.code for warned in mapped.warnings}


def test_a_body_that_is_not_to_be_trusted_ends_with_exit_code_3(body, mapped, monkeypatch, capsys):
    folder, _, _ = body
    monkeypatch.setattr("photoclinometry.body.products.why_untrusted", lambda *_: ("the Suns are wrong",))
    with pytest.raises(SystemExit) as end:
        main(["body", str(folder / "site" / "site.toml"), "--out", str(folder / "body"), *WORDS])
    assert end.value.code == 3
    said = capsys.readouterr()
    assert said.out.strip() == str(folder / "body" / "report" / "index.html")
    assert said.err.splitlines()[-1] == "phomo: the map is written, but not to be trusted: the Suns are wrong"
    document = json.loads((folder / "body" / "metrics.json").read_text())
    assert (document["trusted"], document["not_trusted_because"]) == (False, ["the Suns are wrong"])
    assert "Do not trust" in mapped.report.read_text(encoding="utf-8")


def test_neighbouring_tiles_are_one_surface_by_their_shared_cameras(body, mapped):
    _, _, truth = body
    known = mapped.surface.views > 0
    position, normal = mapped.surface.vertices[known], mapped.surface.normals[known]
    surface = MeshSurface(truth.surface.vertices, truth.surface.faces, closed=True)
    start = Similarity(1.0, np.eye(3), np.zeros(3))
    truth_from_body = refine_on_surface(position, normal, surface, start).similarity
    at = truth_from_body(position)
    off = np.linalg.norm(surface(at)[0] - at, axis=-1) / truth.gsd
    assert off.mean() < 0.4
    assert mapped.metrics["step_between_tiles_median_gsd"] < 0.3


def test_tiles_finish_with_the_model_that_one_of_them_chose(body, mapped):
    """Which that is, images of so small a tile hardly tell."""
    folder, _, _ = body
    tiles = sorted((folder / "body" / "tiles").iterdir())
    assert len(tiles) == 2
    assert len({read_scene(tile).reflectance.name for tile in tiles}) == 1
    assert sum((tile / "stages" / "reflectance.npz").is_file() for tile in tiles) == 1
    assert (folder / "body" / "stages" / "reflectance.npz").is_file()


def test_one_process_coordinates_while_others_map_tiles(body, mapped):
    folder, _, _ = body
    site, out = folder / "site" / "site.toml", folder / "body"
    with claimed_run(out, owner_of_body(read_site(site))):
        map_one_tile(site, out, OPTIONS, 0)
        with pytest.raises(RunFolderError, match="has been writing to this folder"):
            map_body(site, out, OPTIONS)


def test_all_that_a_body_leaves_is_known_to_be_its_own(body, mapped):
    """What is not known stops `--overwrite`."""
    folder, _, _ = body
    assert mapped.folder == folder / "body"
    assert {path.name for path in mapped.folder.iterdir()} <= PRODUCTS | {MARK}


def test_tiles_of_another_plan_are_refused(body, mapped):
    folder, _, _ = body
    site, out = folder / "site" / "site.toml", folder / "body"
    other = replace(OPTIONS, plan=replace(OPTIONS.plan, tile_px=80))
    with pytest.raises(RunFolderError, match=r"plan\.npz: not made yet, or of other options"):
        map_one_tile(site, out, other, 0)
    with pytest.raises(InputError, match="there is no tile 2: the plan has 2"):
        map_one_tile(site, out, OPTIONS, 2)


def test_a_folder_of_a_body_is_none_of_phomo_run(body):
    folder, _, _ = body
    site = read_site(folder / "site" / "site.toml")
    check_run(folder / "body", owner_of_body(site))
    with pytest.raises(RunFolderError, match="belongs to"):
        check_run(folder / "body", owner_of_site(site))
