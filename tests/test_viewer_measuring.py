"""Measures in the viewer, in a real browser: profiles, angles and areas are those of the landmarks, and are saved."""

import csv

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from browser import why_no_browser
from photoclinometry.surface.relief import local_frame
from viewer_pages import MIDDLE, box_of, downloaded, page_of, rows_of, scene_of

pytestmark = pytest.mark.skipif(why_no_browser() is not None, reason=str(why_no_browser()))


@pytest.fixture(scope="module")
def scene():
    return scene_of()


@pytest.fixture(scope="module")
def file(scene, folder):
    return page_of(folder, scene)


def test_a_profile_has_the_heights_and_sigmas_of_the_map(page, scene, folder):
    """Clicked on the map, read from its CSV: between landmarks, along a straight line."""
    page.press("p")
    page.drag((300.0, 200.0))
    page.drag((560.0, 480.0))
    assert len(page.state("points")) == 2
    assert not page.run("return document.getElementById('chart').hidden")
    page.click("#save-csv")
    with open(downloaded(folder, "*-profile.csv"), encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    table = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    local = local_frame(scene).inverse()(scene.landmarks.position) / scene.gsd
    x, y = table["x_gsd"], table["y_gsd"]
    along = np.hypot(x - x[0], y - y[0])
    np.testing.assert_allclose(table["distance_gsd"], along, atol=1e-4)
    assert np.abs((x - x[0]) * (y[-1] - y[0]) - (y - y[0]) * (x[-1] - x[0])).max() < 1e-2
    up = local_frame(scene).rotation[:, 2]
    sigma = np.sqrt(scene.uncertainty["position"] @ up @ up) / scene.gsd
    wanted = LinearNDInterpolator(local[:, :2], np.stack([local[:, 2], sigma], -1))(x, y)
    np.testing.assert_allclose(table["height_gsd"], wanted[:, 0], atol=0.02)
    assert np.abs(table["height_sigma_gsd"] - wanted[:, 1]).mean() < 0.01
    shown = rows_of(page, "measures")
    assert float(shown["along the mean plane"].split()[0]) == pytest.approx(along[-1], rel=1e-3)
    assert " ± " in shown["height of B above A"]


def test_a_measurement_is_brought_into_sight(page):
    """In a window that is lower than the panel: chart, values and buttons, to the pixel that scrolling rounds to."""
    page.press("p")
    page.drag((300.0, 200.0))
    assert rows_of(page, "measures") == {}
    page.drag((560.0, 480.0))
    height = page.run("return innerHeight")
    for part in ("chart", "measures", "save-csv"):
        _, top, _, bottom = box_of(page, part)
        assert 0 <= top < bottom <= height + 1, part


def test_a_click_beside_the_map_says_that_there_is_no_ground(page):
    page.press("p")
    page.drag((20.0, 400.0))
    assert page.state("points") == []
    hint = "return document.getElementById('tool-hint').textContent"
    assert "no ground" in page.run(hint)
    page.drag(MIDDLE)
    assert "no ground" not in page.run(hint)


def test_angles_and_areas_are_saved_with_their_units(page, folder):
    page.run("viewer.store.update({ tool: 'angle', points: [[5, 5], [33, 6], [30, 32]] })")
    shown = rows_of(page, "measures")
    page.click("#save-csv")
    with open(downloaded(folder, "*-angle.csv"), encoding="utf-8") as stream:
        rows = {row["quantity"]: row for row in csv.DictReader(stream)}
    assert rows.keys() == shown.keys()
    assert f"{rows['angle at B']['value']}{rows['angle at B']['unit']}" == shown["angle at B"]
    assert f"{rows['A to B']['value']} {rows['A to B']['unit']}" == shown["A to B"]
    page.run("viewer.store.update({ tool: 'area', points: [[5, 5], [33, 6], [30, 32]] })")
    page.click("#save-csv")
    with open(downloaded(folder, "*-area.csv"), encoding="utf-8") as stream:
        assert {row["unit"] for row in csv.DictReader(stream)} == {"GSD²", "GSD"}


def test_angles_and_areas_are_those_of_the_landmarks(page, scene):
    corners = [[5, 5], [33, 6], [30, 32], [8, 28]]
    local = local_frame(scene).inverse()(scene.landmarks.position) / scene.gsd
    a, b, c, _ = points = [local[40 * row + col] for col, row in corners]
    page.run("viewer.store.update({ tool: 'angle', points: arguments[0] })", corners[:3])
    cosine = (a - b) @ (c - b) / np.linalg.norm(a - b) / np.linalg.norm(c - b)
    assert float(rows_of(page, "measures")["angle at B"].removesuffix("°")) == pytest.approx(
        np.degrees(np.arccos(cosine)), rel=1e-3
    )
    page.run("viewer.store.update({ tool: 'area', points: arguments[0] })", corners)
    x, y = np.array(points)[:, :2].T
    plane = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    shown = rows_of(page, "measures")
    assert float(shown["area in the mean plane"].split()[0]) == pytest.approx(plane, rel=1e-3)
    assert float(shown["of it mapped"].split()[0]) == pytest.approx(plane, rel=0.03)
    assert float(shown["area of the surface"].split()[0]) > float(shown["of it mapped"].split()[0])
