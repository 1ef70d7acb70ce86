"""Terrain models as GeoTIFF: coordinates, heights and gaps come through; maps that cannot serve are refused."""

import sys

import numpy as np
import pytest

from photoclinometry.io.ground import read_ground
from photoclinometry.io.rasters.geotiff import read_dtm
from photoclinometry.model.errors import InputError

rasterio = pytest.importorskip("rasterio")

VESTA = "+proj=stere +lat_0=10 +lon_0=20 +a=285000 +b=229000 +units="
HEIGHT = np.arange(24, dtype=np.int16).reshape(4, 6) - 5


PLACE = rasterio.Affine(10.0, 0.0, -30.0, 0.0, -20.0, 40.0)


def write(path, height=HEIGHT, crs=VESTA + "m", transform=PLACE, **profile):
    shape = {"count": 1, "height": height.shape[0], "width": height.shape[1], "dtype": height.dtype}
    with rasterio.open(path, "w", driver="GTiff", transform=transform, crs=crs, **shape, **profile) as file:
        file.write(height, 1)
        file.scales, file.offsets = (0.5,), (100.0,)
    return path


def test_heights_lie_on_the_map_and_gaps_are_masked(tmp_path):
    dtm = read_dtm(write(tmp_path / "a.tif", nodata=3))
    np.testing.assert_array_equal(dtm.height[0], 100.0 + 0.5 * HEIGHT[0])  # scale and offset of the file
    np.testing.assert_array_equal(dtm.valid, HEIGHT != 3)
    assert (dtm.corner, dtm.pixel) == ((-30.0, 40.0), (10.0, 20.0))
    assert dtm.radius == pytest.approx((2 * 285000.0 + 229000.0) / 3)


def test_maps_in_kilometres_become_metres(tmp_path):
    dtm = read_ground(write(tmp_path / "a.tif", crs=VESTA + "km"))
    assert (dtm.corner, dtm.pixel) == ((-30_000.0, 40_000.0), (10_000.0, 20_000.0))


def test_a_map_of_no_body_is_flat(tmp_path):
    assert read_dtm(write(tmp_path / "a.tif", crs=None)).radius is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"crs": "EPSG:4326"}, "in degrees.*gdalwarp"),
        ({"transform": rasterio.Affine(10, 1, 0, 1, -10, 0)}, "rotated or not north up"),
        ({"transform": rasterio.Affine(10, 0, 0, 0, 10, 0)}, "rotated or not north up"),
        ({"transform": rasterio.Affine.identity(), "crs": None}, "no map coordinates"),
        ({"height": np.full((4, 4), 7.0), "nodata": 7.0}, "no pixel has a height"),
        ({"height": np.full((4, 4), np.nan)}, "no pixel has a height"),
    ],
)
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_maps_that_cannot_serve_are_refused(tmp_path, change, message):
    path = write(tmp_path / "bad.tif", **change)
    with pytest.raises(InputError, match=message):
        read_dtm(path)


def test_a_broken_file_is_refused(tmp_path):
    path = write(tmp_path / "a.tif")
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(InputError, match="cannot be read as a GeoTIFF"):
        read_ground(path)


def test_without_rasterio_the_extra_is_named(tmp_path, monkeypatch):
    path = write(tmp_path / "a.tif")
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(InputError, match=r"photoclinometry\[geo\]"):
        read_dtm(path)
