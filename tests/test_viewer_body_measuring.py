"""Measures on whole bodies in the viewer, in a real browser: profiles, lengths and areas on a sphere."""

import csv

import numpy as np
import pytest

from browser import why_no_browser
from photoclinometry.output.viewer import body_content as content
from photoclinometry.output.viewer import write_body_viewer
from viewer_bodies import RADIUS, body_of, round_one
from viewer_data import unpacked
from viewer_pages import downloaded, rows_of

pytestmark = pytest.mark.skipif(why_no_browser() is not None, reason=str(why_no_browser()))


@pytest.fixture(scope="module")
def sphere(folder):
    body = body_of(round_one, spacing=8.0)
    stored = content.body_content(body)
    return write_body_viewer(folder / "sphere.html", body), unpacked(stored["landmarks"]["position"])


def places_near(vertices, *points):
    """Places of the vertices nearest to points, and the vertices."""
    index = [int(np.argmin(np.linalg.norm(vertices - point, axis=-1))) for point in points]
    return [[i % 1024, i // 1024] for i in index], vertices[index]


def test_a_profile_over_a_sphere_is_an_arc(window, sphere, folder):
    """Its length is radius times angle, and it stands above its chord as a circle does."""
    file, vertices = sphere
    window.open(file)
    places, (a, b) = places_near(vertices, [200, 0, 0], [80, 120, 139])
    window.run("viewer.store.update({ tool: 'profile', points: arguments[0] })", places)
    shown = rows_of(window, "measures")
    chord, angle = np.linalg.norm(b - a), np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
    assert float(shown["distance"].split()[0]) == pytest.approx(chord, rel=1e-3)
    assert float(shown["along the surface"].split()[0]) == pytest.approx(RADIUS * angle, rel=5e-3)
    window.click("#save-csv")
    with open(downloaded(folder, "dented-profile.csv"), encoding="utf-8") as stream:
        table = [{name: float(value or "nan") for name, value in row.items()} for row in csv.DictReader(stream)]
    along, height = (np.array([row[name] for row in table]) for name in ("distance_m", "height_m"))
    circle = np.sqrt(np.maximum(RADIUS**2 - (along - chord / 2) ** 2, 0)) - np.sqrt(RADIUS**2 - chord**2 / 4)
    np.testing.assert_allclose(height, circle, atol=0.5)
    assert (np.diff(along) > 0).all()
    np.testing.assert_allclose([np.hypot(np.hypot(r["x_m"], r["y_m"]), r["z_m"]) for r in table], RADIUS, atol=0.5)


def test_the_scale_bar_is_of_the_ground_and_the_wheel_stops_above_it(window, sphere):
    """Of the sphere at the point below the camera, near by and far away."""
    window.open(sphere[0])
    width, height = window.run("return viewer.size()")
    ratio = window.run("return viewer.ratio()")
    for _ in range(12):
        center, focal = window.run("const c = viewer.camera(); return [c.center, c.focal[0]]")
        above = np.linalg.norm(center) - RADIUS
        assert above > 0.01 * RADIUS
        bar = window.run("return viewer.groundPerPixel()") * focal
        assert bar == pytest.approx(above, rel=0.1, abs=0.02 * RADIUS)
        window.wheel(0.5 * width / ratio, 0.5 * height / ratio, -400)
        window.settle()
    assert above < 0.1 * RADIUS


def test_areas_are_of_the_side_that_is_pointed_at(window, sphere):
    """A region around a point of a sphere: neither the ground behind the body nor more than its own."""
    file, vertices = sphere
    window.open(file)
    tilt, turns = np.radians(25.0), np.radians(np.arange(0, 360, 30))
    ring = RADIUS * np.stack([np.sin(tilt) * np.cos(turns), np.sin(tilt) * np.sin(turns), np.cos(tilt) + 0 * turns], -1)
    places, _ = places_near(vertices, *ring)
    window.run("viewer.store.update({ tool: 'area', points: arguments[0] })", places)
    shown = rows_of(window, "measures")
    plane = float(shown["area in the plane across the mean normal"].split()[0])
    assert plane == pytest.approx(0.5 * 12 * (RADIUS * np.sin(tilt)) ** 2 * np.sin(np.radians(30)), rel=0.03)
    assert float(shown["of it mapped"].split()[0]) == pytest.approx(plane, rel=0.03)
    # The area of a cap over that of its base is 2 / (1 + cos(tilt)); that of the polygon in it is nearly so.
    ratio = float(shown["area of the surface"].split()[0]) / float(shown["of it mapped"].split()[0])
    assert ratio == pytest.approx(2.0 / (1.0 + np.cos(tilt)), rel=0.01)
