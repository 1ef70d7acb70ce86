"""Cloud-optimised GeoTIFFs, read back with rasterio."""

import numpy as np
import pytest

from photoclinometry.io.rasters.cog import BLOCK, Band, RasterPlace, write_cog
from photoclinometry.io.rasters.globe import iau_crs, name_of, semi_axes
from photoclinometry.io.rasters.projection import local_crs
from photoclinometry.model.errors import RunFolderError

rasterio = pytest.importorskip("rasterio")

BANDS = (Band(description="height", unit="m"), Band(description="albedo", unit=""))


def picture(height=2 * BLOCK + 10, width=BLOCK + 3):
    rng = np.random.default_rng(0)
    return rng.normal(size=(height, width, 2)), rng.random((height, width)) > 0.2


def write(path, values, valid, crs=None):
    place = RasterPlace(corner=(-500.0, 800.0), pixel=2.5, crs=crs)
    write_cog(path, values, valid, BANDS, place=place, about={"SCENE": "bumps"})
    return path


@pytest.mark.parametrize("crs", [200000410, 200000430, None], ids=str)
def test_bands_come_back_with_place_gaps_and_meaning(tmp_path, crs):
    from rasterio.warp import transform

    values, valid = picture()
    crs = None if crs is None else iau_crs(crs)
    with rasterio.open(write(tmp_path / "a.tif", values, valid, crs)) as file:
        band = file.read(masked=True)
        np.testing.assert_array_equal(~np.ma.getmaskarray(band), np.stack([valid, valid]))
        np.testing.assert_array_equal(band[0][valid], values[valid, 0].astype(np.float32))
        np.testing.assert_array_equal(band[1][valid], values[valid, 1].astype(np.float32))
        assert file.transform == rasterio.Affine(2.5, 0, -500, 0, -2.5, 800)
        assert file.xy(0, 0) == (-498.75, 798.75)
        assert file.descriptions == ("height", "albedo")
        assert file.units == ("m", None)
        assert file.tags()["SCENE"] == "bumps"
        if crs is None:
            assert file.crs is None
        else:  # GeoTIFF's keys do not hold every equivalent way to write a reference system
            at = {"xs": [10.0, 20.0], "ys": [80.0, 70.0]}
            np.testing.assert_allclose(transform(crs, file.crs, **at), list(at.values()), atol=1e-9)
            assert (name_of(file.crs), semi_axes(file.crs)) == (name_of(crs), semi_axes(crs))


def test_the_layout_is_cloud_optimised_and_overviews_leave_gaps_out(tmp_path):
    values, valid = np.full((1000, 1000, 2), 7.0), picture(1000, 1000)[1]
    with rasterio.open(write(tmp_path / "a.tif", values, valid)) as file:
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert file.overviews(1) == [2, 4]
        assert file.block_shapes[0] == (BLOCK, BLOCK)
    with rasterio.open(tmp_path / "a.tif", overview_level=1) as file:
        coarse = file.read(1, masked=True)
        assert coarse.shape == (250, 250)
        np.testing.assert_array_equal(coarse.compressed(), 7.0)


def test_a_local_plane_is_no_map_of_a_body(tmp_path):
    with rasterio.open(write(tmp_path / "a.tif", *picture(20, 30), local_crs('a "local" map'))) as file:
        assert not file.crs.is_geographic
        assert not file.crs.is_projected
        assert file.crs.to_dict(projjson=True)["type"] == "EngineeringCRS"
        assert file.crs.to_dict(projjson=True)["name"] == "a 'local' map"


def test_what_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RunFolderError):
        write(tmp_path / "file" / "a.tif", *picture(20, 30))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
