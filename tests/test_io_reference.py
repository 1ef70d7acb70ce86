"""Maps to compare with: heights on a projected grid land where the projection says, runs bring their poses."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry import evaluate
from photoclinometry.io.rasters.geotiff import read_dtm_mesh
from photoclinometry.io.reference import read_reference
from photoclinometry.io.scene_file import write_scene
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity, so3_exp
from photoclinometry.registration.alignment import transform_scene
from scenes import bumpy_surface, synthetic_scene

RADIUS = 262_000.0


def write_dtm(path, height, west, north, cell, crs=None, down=True):
    """A GeoTIFF of heights (rows, cols); its first cell's corner is (west, north); rows go south if `down`."""
    import rasterio
    from rasterio.transform import Affine

    transform = Affine(cell, 0.0, west, 0.0, -cell if down else cell, north)
    options = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": crs, "transform": transform}
    with rasterio.open(path, "w", height=height.shape[0], width=height.shape[1], **options) as file:
        file.write(height, 1)
    return path


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize("down", [True, False], ids=["rows go south", "rows go north"])
def test_a_grid_without_a_projection_is_x_y_height_with_faces_upwards(tmp_path, down):
    height = np.array([[1.0, 2.0, 3.0], [4.0, np.nan, 6.0], [7.0, 8.0, 9.0]])
    found = read_dtm_mesh(write_dtm(tmp_path / "dtm.tif", height, 100.0, 200.0, 10.0, down=down))
    assert found.position[0].tolist() == [105.0, 195.0 if down else 205.0, 1.0]
    assert found.position[4].tolist() == [125.0, 185.0 if down else 215.0, 6.0]
    assert len(found.position) == 8
    corner = found.position[found.faces]
    up = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2]
    assert len(up) == 4  # of each cell the three corners that are there
    assert (up > 0).all()


@pytest.mark.parametrize(
    ("crs", "per_radian", "polar"),
    [
        (f"+proj=eqc +R={RADIUS} +units=m +no_defs", RADIUS, RADIUS),
        (f"+proj=longlat +R={RADIUS} +no_defs", 180.0 / np.pi, RADIUS),
        (f"+proj=longlat +a={RADIUS} +b=220000 +no_defs", 180.0 / np.pi, 220_000.0),
    ],
    ids=["equirectangular", "degrees", "ellipsoid"],
)
def test_projected_heights_are_where_longitude_and_latitude_say(tmp_path, crs, per_radian, polar):
    """By hand: on an ellipsoid with geodetic latitude, (N + h) cos lat, and (N b^2 / a^2 + h) sin lat."""
    cell = 0.001 * per_radian
    path = write_dtm(tmp_path / "dtm.tif", np.full((2, 3), 500.0), 0.3 * per_radian, 0.4 * per_radian, cell, crs)
    lon, lat = np.meshgrid(0.3 + 0.001 * np.array([0.5, 1.5, 2.5]), 0.4 - 0.001 * np.array([0.5, 1.5]))
    prime = RADIUS**2 / np.sqrt((RADIUS * np.cos(lat)) ** 2 + (polar * np.sin(lat)) ** 2)
    across = (prime + 500.0) * np.cos(lat)
    z = (prime * (polar / RADIUS) ** 2 + 500.0) * np.sin(lat)
    expected = np.stack([across * np.cos(lon), across * np.sin(lon), z], -1).reshape(-1, 3)
    np.testing.assert_allclose(read_dtm_mesh(path).position, expected, atol=1e-3)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_a_run_is_compared_with_a_terrain_model(tmp_path):
    """Heights of the very surface that the scene was made of, sampled twice per GSD: a few per cent of a GSD."""
    scene = synthetic_scene(size=24, views=3)
    axis = np.arange(-1500.0, 1500.0, 30.0) + 15.0
    x, y = np.meshgrid(axis, axis[::-1])
    path = write_dtm(tmp_path / "dtm.tif", bumpy_surface().height(np.stack([x, y], -1)), -1500.0, 1500.0, 30.0)
    metrics = evaluate(scene, reference=path).metrics
    assert metrics["overlap_percent"] == 100.0
    assert metrics["surface_distance_rms_gsd"] < 0.02
    assert metrics["normal_error_rms_deg"] < 4.0


def test_another_run_brings_its_own_poses(tmp_path):
    """In another frame, with albedos 5 % brighter in one half: that, and nothing else, is found."""
    scene = synthetic_scene(size=24, views=4)
    other = transform_scene(Similarity(0.01, so3_exp(np.array([0.3, 0.2, -0.9])), np.array([5.0, 6.0, 7.0])), scene)
    brighter = np.where(np.arange(len(scene.landmarks)) < 288 - 24, 1.05, 1.0)
    other = replace(other, landmarks=replace(other.landmarks, albedo=other.landmarks.albedo * brighter))
    (tmp_path / "run").mkdir()
    write_scene(tmp_path / "run" / "scene.h5", other)
    for path in (tmp_path / "run", tmp_path / "run" / "scene.h5"):
        metrics = evaluate(scene, reference=path).metrics
        assert metrics["surface_distance_rms_gsd"] < 1e-4
        assert metrics["camera_position_error_rms_m"] < 1e-6
        assert metrics["albedo_error_absolute_p90_percent"] == pytest.approx(100 * 0.05 / 1.05)
        assert metrics["albedo_error_absolute_median_percent"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_files_that_are_no_map_are_refused(tmp_path):
    (tmp_path / "map.obj").write_text("v 0 0 0")
    with pytest.raises(InputError, match="is no map to compare with"):
        read_reference(tmp_path / "map.obj")
    (tmp_path / "map.tif").write_text("no picture")
    with pytest.raises(InputError, match="cannot be read as a GeoTIFF"):
        read_reference(tmp_path / "map.tif")
    with pytest.raises(InputError, match="cannot be read as a GeoTIFF"):
        read_reference(tmp_path / "none.tif")
    with pytest.raises(InputError, match="no pixel has a height"):
        read_reference(write_dtm(tmp_path / "empty.tif", np.full((3, 3), np.nan), 0.0, 0.0, 1.0))
    with pytest.raises(InputError, match="there is no such file"):
        read_reference(tmp_path)


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(InputError, match=r"pip install 'photoclinometry\[geo\]'"):
        read_dtm_mesh(tmp_path / "dtm.tif")
