"""What scenes, sites and results show of themselves: short lines, and a table with a picture that is true."""

import base64
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

import photoclinometry as pcm
from photoclinometry.model.display import PICTURE_PX, card, png_of_grey, scene_picture, thumbnail
from photoclinometry.model.scene import BODY_FIXED
from scenes import synthetic_scene
from sites import picture, write_small_site


def embedded_picture(html: str) -> np.ndarray:
    """The picture in a card, decoded: (h, w, 4), blue, green, red, opacity."""
    found = re.search(r'src="data:image/png;base64,([^"]+)"', html)
    assert found is not None, html
    return cv2.imdecode(np.frombuffer(base64.b64decode(found[1]), np.uint8), cv2.IMREAD_UNCHANGED)


def test_a_png_decodes_to_the_values_that_went_in():
    grey = np.linspace(0.0, 1.0, 256).reshape(8, 32)
    grey[2, 3] = np.nan
    decoded = cv2.imdecode(np.frombuffer(png_of_grey(grey), np.uint8), cv2.IMREAD_UNCHANGED)
    there = np.isfinite(grey)
    np.testing.assert_array_equal(decoded[..., 3], np.where(there, 255, 0))
    np.testing.assert_array_equal(decoded[..., 0][there], np.arange(256).reshape(8, 32)[there])


def test_a_thumbnail_is_small_and_averages_what_there_is():
    values = np.tile([0.0, 2.0], (2 * PICTURE_PX, PICTURE_PX))
    values[:, PICTURE_PX:] += 10.0
    values[:2, :2] = np.nan
    small = thumbnail(values)
    assert small.shape == (PICTURE_PX, PICTURE_PX)
    assert np.isnan(small[0, 0])
    assert set(small[np.isfinite(small)]) == {0.0, 1.0}
    assert np.isnan(thumbnail(np.full((3, 5), np.nan))).all()
    assert np.isfinite(thumbnail(np.full((3, 5), 7.0))).all()


def test_the_relief_is_lit_from_the_upper_left_of_the_reference_image():
    """Ground that faces the upper left is brighter, whatever the frame."""
    scene = replace(synthetic_scene(size=16, views=3), reflectance=None)
    pose = scene.views.body_from_cam[scene.reference]
    facing = np.array([-0.5, -0.5, -1.0]) / np.sqrt(1.5)
    away = np.array([0.5, 0.5, -1.0]) / np.sqrt(1.5)
    left = scene.landmarks.pixel[:, 1] < scene.region.col + 8
    normal = np.where(left[:, None], facing, away) @ pose.rotation.T
    shown = scene_picture(replace(scene, landmarks=replace(scene.landmarks, normal=normal)))
    assert (shown[:, :8] == 1.0).all()
    assert (shown[:, 8:] == 0.0).all()


def test_a_scene_says_in_one_line_what_it_is():
    scene = synthetic_scene(size=8, views=3)
    assert repr(scene) == (
        "<Scene 'bumps': 3 views, 64 landmarks, GSD 60 (own unit); lunar-lambert; I/F; own frame; no sigmas>"
    )
    other = replace(
        scene, body="vesta", frame=BODY_FIXED, reflectance=None, uncertainty={"position": np.zeros((64, 3, 3))}
    )
    assert repr(other) == (
        "<Scene 'bumps' (vesta): 3 views, 64 landmarks, GSD 60 m; geometry alone; I/F; body-fixed frame; with sigmas>"
    )
    for part in (scene.views, scene.landmarks, scene.tracks, pcm.render(scene)):
        assert repr(part).startswith(f"<{type(part).__name__}")
        assert len(repr(part)) < 100


def test_a_scene_without_landmarks_shows_itself_too():
    scene = synthetic_scene(size=8, views=3)
    none = np.zeros(0, int)
    empty = replace(scene, landmarks=scene.landmarks[none], tracks=scene.tracks.of_landmarks(none)[0])
    assert "0 landmarks, GSD unknown" in repr(empty)
    assert (embedded_picture(empty._repr_html_())[..., 3] == 0).all()


def test_a_notebook_shows_albedo_and_relief_side_by_side():
    scene = synthetic_scene(size=40, views=3)
    shown = embedded_picture(scene._repr_html_())
    assert shown.shape == (40, 81, 4)
    albedo = scene.grid(scene.landmarks.albedo)
    assert np.corrcoef(shown[:, :40, 0].ravel(), albedo.ravel())[0, 1] > 0.99
    assert (shown[:, 40, 3] == 0).all()
    assert "lunar-lambert" in scene._repr_html_()


def test_a_site_shows_its_reference_image(tmp_path):
    site = pcm.read_site(write_small_site(tmp_path))
    assert repr(site) == (
        f"<Site 'small' (vesta): 4 views; I/F; region 40 x 20 px in images/1.fits; {tmp_path / 'site.toml'}>"
    )
    shown = embedded_picture(site._repr_html_())[..., 0]
    assert np.corrcoef(shown.ravel(), picture(1).ravel())[0, 1] > 0.99


def test_a_picture_that_cannot_be_drawn_costs_no_table(tmp_path):
    site = pcm.read_site(write_small_site(tmp_path))
    (tmp_path / "images" / "1.fits").unlink()
    html = site._repr_html_()
    assert "no picture: ImageError" in html
    assert "1.fits" in html
    assert "PINHOLE 64 x 64 px" in html


def test_names_are_text_not_markup():
    html = card("<b>", {"a & b": "<script>"}, lambda: np.zeros((2, 2)), "<i>")
    assert not re.search(r"<(b|script|i)>", html)
    assert "&lt;script&gt;" in html


@pytest.mark.parametrize("converged", [True, False])
def test_a_result_says_how_the_run_went(mapped, converged):
    adjustment = replace(mapped.result.adjustment, converged=converged, message="stopped after 30 steps")
    result = replace(mapped.result, adjustment=adjustment, left_out={"images/004.fits": "not registered"})
    state = "converged" if converged else "not converged: stopped after 30 steps"
    assert f"estimate {state}; views left out images/004.fits; {mapped.run}>" in repr(result)
    html = result._repr_html_()
    assert state in html
    assert str(mapped.result.report) in html
    assert embedded_picture(html).shape[1] > 2 * 32
