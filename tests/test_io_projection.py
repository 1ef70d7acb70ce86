"""Map projections of bodies: formulas by hand, PROJ's names, and maps that cannot be drawn."""

import sys

import numpy as np
import pytest

from photoclinometry.io.rasters.globe import find_globe, geographic, name_of, semi_axes
from photoclinometry.io.rasters.projection import degrees_words, site_projection
from photoclinometry.model.errors import InputError

pytest.importorskip("rasterio")

VESTA = 255_000.0


def on_sphere(lon_deg, lat_deg, height, radius=VESTA):
    """Body-fixed positions (n, 3)."""
    lon, lat = np.radians(lon_deg), np.radians(lat_deg)
    direction = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    return (radius + np.asarray(height))[..., None] * direction


LON, LAT, HEIGHT = np.array([15.6, 20.0, -7.0]), np.array([-9.4, -3.0, -30.0]), np.array([0.0, 500.0, -900.0])


def test_equirectangular_is_longitude_and_latitude_times_the_radius():
    found = site_projection(find_globe("Vesta"), "equirectangular", on_sphere(LON, LAT, HEIGHT))
    expected = np.stack([VESTA * np.radians(LON), VESTA * np.radians(LAT), HEIGHT], -1)
    np.testing.assert_allclose(found.from_body(on_sphere(LON, LAT, HEIGHT)), expected, atol=1e-6)
    assert found.crs.to_authority() == ("IAU_2015", "200000410")


def test_orthographic_is_the_view_from_above_its_centre():
    position = on_sphere(LON, LAT, HEIGHT)
    found = site_projection(find_globe("vesta"), "orthographic", position, (15.0, -10.0))
    center, ground = np.array([15.0, -10.0]), on_sphere(LON, LAT, 0.0 * HEIGHT)
    east = np.array([-np.sin(np.radians(15.0)), np.cos(np.radians(15.0)), 0.0])
    north = np.cross(on_sphere(*center, 0.0)[()] / VESTA, east)
    expected = np.stack([ground @ east, ground @ north, HEIGHT], -1)
    np.testing.assert_allclose(found.from_body(position), expected, atol=1e-5)
    assert found.crs.to_dict()["proj"] == "ortho"
    assert semi_axes(found.crs) == (VESTA, VESTA)
    middle = site_projection(find_globe("vesta"), "orthographic", position)
    assert np.abs(middle.from_body(position)[:, :2].mean(0)).max() < 0.05 * np.ptp(expected[:, 0])


@pytest.mark.parametrize("pole", [1, -1])
def test_polar_stereographic_is_about_the_nearer_pole(pole):
    lat, lon = pole * np.array([80.0, 89.0, 60.0]), np.array([15.0, 200.0, -60.0])
    found = site_projection(find_globe("ceres"), "polar-stereographic", on_sphere(lon, lat, HEIGHT, 469_700.0))
    radius = semi_axes(found.crs)[0]
    far = 2.0 * radius * np.tan(np.radians(90.0 - np.abs(lat)) / 2.0)
    east_north = np.stack([far * np.sin(np.radians(lon)), -pole * far * np.cos(np.radians(lon))], -1)
    moved = found.from_body(on_sphere(lon, lat, HEIGHT, radius))
    np.testing.assert_allclose(moved, np.c_[east_north, HEIGHT], atol=1e-5)
    assert name_of(found.crs) == f"Ceres (2015) - Sphere / Ocentric / {'North' if pole > 0 else 'South'} Polar"


@pytest.mark.parametrize("projection", ["equirectangular", "orthographic", "polar-stereographic"])
@pytest.mark.parametrize(("body", "radii"), [("vesta", None), ("Bennu", (244.8,)), ("x", (289e3, 287e3))])
def test_the_way_back_is_the_inverse(projection, body, radii):
    globe = find_globe(body, radii)
    position = on_sphere(LON + 180.0, LAT - 40.0, 0.05 * globe.radii_m[0] * HEIGHT / 900.0, globe.radii_m[0])
    found = site_projection(globe, projection, position)
    np.testing.assert_allclose(found.to_body(found.from_body(position)), position, rtol=0, atol=1e-8 * globe.radii_m[0])


def test_radii_make_a_globe_that_is_named_after_them():
    globe = find_globe("Bennu", (245.5,))
    assert globe.name == "Bennu, sphere of 245.5 m"
    assert semi_axes(globe.crs) == (245.5, 245.5)
    equator = np.array([[0.0, 245.5, 0.0], [0.0, 0.0, 200.0]])
    np.testing.assert_allclose(
        geographic(find_globe("x", (245.5, 200.0)), equator), [[90, 0, 0], [0, 90, 0]], atol=1e-9
    )
    assert find_globe("vesta", (260e3,)).radii_m == (260e3, 260e3)  # what is given goes before what is known


@pytest.mark.parametrize("height", [-40e3, 0.0, 40e3])
def test_latitudes_and_heights_far_from_a_flat_spheroid_are_exact(height):
    """On an ellipse the normal of latitude phi has its foot at (a^2 cos, c^2 sin) / sqrt(a^2 cos^2 + c^2 sin^2)."""
    a, c = 289e3, 229e3
    lon, lat = np.linspace(-179.0, 179.0, 41), np.linspace(-90.0, 90.0, 41)
    sine, cosine = np.sin(np.radians(lat)), np.cos(np.radians(lat))
    root = np.sqrt((a * cosine) ** 2 + (c * sine) ** 2)
    across, z = (a * a / root + height) * cosine, (c * c / root + height) * sine
    position = np.stack([across * np.cos(np.radians(lon)), across * np.sin(np.radians(lon)), z], -1)
    found = geographic(find_globe("x", (a, c)), position)
    np.testing.assert_allclose(found[:, 1:], np.stack([lat, np.full(41, height)], -1), atol=1e-7)
    np.testing.assert_allclose(found[1:-1, 0], lon[1:-1], atol=1e-9)


def test_maps_across_longitude_180_are_not_torn():
    position = on_sphere(np.array([179.0, -179.0]), np.zeros(2), np.zeros(2))
    found = site_projection(find_globe("vesta"), "equirectangular", position)
    assert found.crs.to_authority() == ("IAU_2015", "200000415")
    np.testing.assert_allclose(found.from_body(position)[:, 0], VESTA * np.radians([-1.0, 1.0]), atol=1e-6)
    bennu = site_projection(find_globe("bennu", (VESTA,)), "equirectangular", position)
    np.testing.assert_allclose(bennu.from_body(position)[:, 0], VESTA * np.radians([-1.0, 1.0]), atol=1e-6)


@pytest.mark.parametrize(
    ("projection", "lon", "lat", "center", "message"),
    [
        ("equirectangular", [0, 10], [60, 88], None, "latitude 88.0.*polar-stereographic"),
        ("equirectangular", [0, 120, 240], [0, 0, 0], None, "around the body"),
        ("polar-stereographic", [0, 10], [-3, 10], None, "crosses the equator.*--projection equirectangular"),
        ("polar-stereographic", [0, 10], [-12, -10], None, "latitude -10.0.* 70 % too long; choose .* equirectangular"),
        ("polar-stereographic", [0, 10], [29, 50], None, "latitude 29.0.* 35 % too long"),
        ("orthographic", [0, 10], [0, 10], (200.0, 91.0), "not a longitude and latitude"),
        ("orthographic", [0, 10], [0, 10], (170.0, 0.0), "2 of 2 landmarks lie on the far side"),
        ("orthographic", [0, 10], [0, 10], (-170.0, -5.0), "orthographic map about 170 W, 5 S"),
    ],
)
def test_maps_that_cannot_be_drawn_are_refused(projection, lon, lat, center, message):
    position = on_sphere(np.array(lon, float), np.array(lat, float), np.zeros(len(lon)))
    with pytest.raises(InputError, match=message):
        site_projection(find_globe("vesta"), projection, position, center).from_body(position)


@pytest.mark.parametrize(
    ("lon", "lat", "words"),
    [
        (-135.14, -10.0, "135.14 W, 10 S"),
        (224.86, -10.0, "135.14 W, 10 S"),
        (42.0, 56.0, "42 E, 56 N"),
        (180.0, 0.0, "180 W, 0 N"),
        (0.0, 90.0, "0 E, 90 N"),
    ],
)
def test_longitudes_are_named_east_or_west(lon, lat, words):
    assert degrees_words(lon, lat) == words


def test_orthographic_maps_are_named_by_west_and_south():
    position = on_sphere(np.array([-136.0, -134.0]), np.array([-11.0, -9.0]), np.zeros(2))
    found = site_projection(find_globe("vesta"), "orthographic", position, (-135.14, -10.0))
    assert "Orthographic about 135.14 W, 10 S" in found.crs.to_wkt()


def test_a_flat_spheroid_has_no_polar_map_that_can_be_read_back():
    with pytest.raises(InputError, match=r"cannot read.*orthographic"):
        site_projection(find_globe("x", (289e3, 229e3)), "polar-stereographic", on_sphere(LON, LAT - 40.0, HEIGHT))


@pytest.mark.parametrize("radii", [(), (1.0, 2.0), (3.0, 2.0, 1.0), (-1.0,), (float("nan"),), (0.0,)])
def test_radii_that_are_no_globe_are_refused(radii):
    with pytest.raises(InputError, match="one of a sphere"):
        find_globe("bennu", radii)


def test_a_body_that_proj_does_not_know_asks_for_radii(monkeypatch):
    with pytest.raises(InputError, match=r"'bennu'.*--radii-m"):
        find_globe("bennu")
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(InputError, match=r"photoclinometry\[geo\]"):
        find_globe("vesta")
