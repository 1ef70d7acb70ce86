"""A truth of another site is refused; a map with wrong Suns, or with wrong poses, may be measured."""

from dataclasses import replace

import numpy as np
import pytest

import photoclinometry as pcm
from commands import phomo
from photoclinometry.evaluate.same_site import check_same_site
from photoclinometry.io.meshes.shape_ply import write_shape_ply
from photoclinometry.io.models.colmap import write_colmap
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, so3_exp, unit
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.simulate.bodies.surface import BodySurface
from photoclinometry.simulate.bodies.truth import BodyTruth, write_body_truth
from photoclinometry.simulate.options import SimulationOptions, chosen_preset
from photoclinometry.simulate.photometry import named_photometry
from photoclinometry.simulate.truth import SiteFacts
from photoclinometry.simulate.truth_file import read_truth, write_truth
from photoclinometry.simulate.views import draw_views
from photoclinometry.surface.closed_mesh import icosahedron, refine, vertex_normals
from scenes import synthetic_scene


def facts(seed, views=8):
    options = SimulationOptions(seed=seed, views=views)
    return SiteFacts(
        name="demo",
        body="vesta",
        views=draw_views(options, chosen_preset(options))[1],
        psf_sigma_px=0.5,
        brightness="iof",
        photometry=named_photometry("lunar-lambert", "vesta"),
    )


def check(views, truth, suns=True):
    measured = views.sun_measured if suns else None
    check_same_site("t.h5", truth, views.name, views.cameras, views.body_from_cam, measured)


def turned(poses, sigma_deg):
    """Poses, each turned by its own error."""
    error = np.random.default_rng(0).normal(scale=np.radians(sigma_deg), size=(len(poses), 3))
    return Rigid(poses.rotation @ so3_exp(error), poses.translation)


def mixed(views):
    """Another site with images of the same names."""
    other = views[np.roll(np.arange(len(views)), 3)]
    return replace(other, name=views.name)


@pytest.mark.parametrize("suns", [True, False], ids=["with Suns", "by poses alone"])
def test_a_map_of_some_views_in_a_frame_of_its_own_has_its_truth(suns):
    truth = facts(0)
    poses, turn = truth.views.body_from_cam, so3_exp(np.array([0.4, -1.1, 0.7]))
    own = replace(truth.views, body_from_cam=Rigid(turn @ poses.rotation, 0.01 * poses.translation @ turn.T))
    check(own[[6, 0, 3]], replace(truth, name="renamed"), suns)


@pytest.mark.parametrize("suns", [True, False], ids=["with Suns", "by poses alone"])
def test_the_truth_of_another_site_is_refused(suns):
    words = r"^t\.h5: is the truth of another site: .* by \d+ degrees differ .*; give the truth\.h5 that lies beside"
    with pytest.raises(InputError, match=words):
        check(facts(0).views, facts(1), suns)


def test_maps_with_wrong_suns_or_wrong_poses_are_measured():
    truth = facts(0)
    check(replace(truth.views, sun_measured=-truth.views.sun_measured), truth)
    check(replace(truth.views, body_from_cam=turned(truth.views.body_from_cam, 30.0)), truth)


def test_images_of_other_names_or_sizes_are_refused():
    truth = facts(0, views=3)
    with pytest.raises(InputError, match=r"it has 3 of the map's 8 views, and not 'images/003\.fits'; give"):
        check(facts(0).views, truth)
    small = tuple(Camera("PINHOLE", 64, 48, (9.0, 9.0, 32.0, 24.0)) for _ in range(3))
    with pytest.raises(InputError, match=r"'images/000\.fits' has \d+ x \d+ px there, and 64 x 48 px in the map"):
        check(replace(truth.views, cameras=small), truth)


def test_evaluate_refuses_the_truth_of_another_site(mapped, tmp_path, capsys):
    truth = read_truth(mapped.truth)
    write_truth(tmp_path / "truth.h5", replace(truth, views=mixed(truth.views)))
    assert phomo("evaluate", mapped.run, "--truth", tmp_path / "truth.h5", "--no-images", "--out", tmp_path) == 2
    assert "truth.h5: is the truth of another site: its Suns by" in capsys.readouterr().err
    assert not (tmp_path / "evaluation.json").exists()


def test_evaluate_refuses_the_truth_of_another_body(tmp_path):
    pytest.importorskip("embreex")
    vertices, faces = refine(*icosahedron(), 0.2, unit)
    scene, facts_of = synthetic_scene(size=8, views=5), vars(facts(0, views=5))
    surface = BodySurface(vertices, faces, vertex_normals(vertices, faces), np.full(len(vertices), 0.2), 0.2)
    truth = BodyTruth(surface=surface, gsd=0.1, **facts_of | {"views": scene.views})
    folder = tmp_path / "body"
    write_shape_ply(folder / "body.ply", ShapeModel(vertices, faces, surface.normals, surface.albedo))
    write_colmap(folder / "sparse", scene)
    write_body_truth(tmp_path / "truth.h5", truth)
    assert pcm.evaluate(folder, truth=tmp_path / "truth.h5").metrics["images_placed"] == 5
    other = replace(truth, views=replace(scene.views, body_from_cam=turned(scene.views.body_from_cam, 60.0)))
    write_body_truth(tmp_path / "other.h5", other)
    with pytest.raises(InputError, match=r"other\.h5: is the truth of another site: the relative rotations of its"):
        pcm.evaluate(folder, truth=tmp_path / "other.h5")
