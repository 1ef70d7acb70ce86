"""body.ply: a shape model is read back with all that it holds."""

import numpy as np
import pytest

from photoclinometry.io.meshes.ply import read_ply
from photoclinometry.io.meshes.shape_ply import read_shape_ply, write_shape_ply
from photoclinometry.model.errors import InputError
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.surface.closed_mesh import icosahedron


@pytest.fixture
def shape():
    vertices, faces = icosahedron()
    count, rng = len(vertices), np.random.default_rng(0)
    albedo = rng.uniform(0.02, 0.06, count)
    albedo[3] = np.nan
    return ShapeModel(
        vertices=245.0 * vertices + 1e-9 * rng.normal(size=vertices.shape),
        faces=faces,
        normals=vertices,
        albedo=albedo,
        sigma={
            "height": np.full(count, 0.1),
            "normal": np.full(count, np.radians(2.0)),
            "albedo": np.full(count, 0.03),
        },
        views=np.arange(count),
        tile=np.arange(count) - 1,
        unit="m",
    )


def test_a_model_is_read_back_vertices_in_double_the_rest_in_single(tmp_path, shape):
    write_shape_ply(tmp_path / "body.ply", shape)
    read = read_shape_ply(tmp_path / "body.ply")
    np.testing.assert_array_equal(read.vertices, shape.vertices)
    for name in ("faces", "views", "tile"):
        np.testing.assert_array_equal(getattr(read, name), getattr(shape, name))
    np.testing.assert_array_equal(read.normals, shape.normals.astype(np.float32))
    np.testing.assert_array_equal(read.albedo, shape.albedo.astype(np.float32))
    assert read.sigma.keys() == shape.sigma.keys()
    for name, sigma in shape.sigma.items():
        np.testing.assert_allclose(read.sigma[name], sigma, rtol=1e-7)
    assert read.unit == "m"


def test_columns_are_in_degrees_and_per_cent(tmp_path, shape):
    write_shape_ply(tmp_path / "body.ply", shape)
    header = (tmp_path / "body.ply").read_bytes().split(b"end_header\n")[0].decode().splitlines()
    assert "comment unit of length: m" in header
    names = [line.split()[-1] for line in header if line.startswith("property") and "list" not in line]
    assert names == [*"xyz", "nx", "ny", "nz", "albedo"] + [
        *("sigma_height", "sigma_normal_deg", "sigma_albedo_percent", "views", "tile")
    ]
    read = read_ply(tmp_path / "body.ply")
    np.testing.assert_array_equal(read.faces, shape.faces)


def test_what_a_model_does_not_hold_is_not_written(tmp_path, shape):
    bare = ShapeModel(shape.vertices, shape.faces)
    write_shape_ply(tmp_path / "bare.ply", bare)
    read = read_shape_ply(tmp_path / "bare.ply")
    assert (read.normals, read.albedo, read.views, read.tile, read.unit) == (None,) * 5
    assert read.sigma == {}


def test_points_without_faces_are_refused(tmp_path, shape):
    write_shape_ply(tmp_path / "points.ply", ShapeModel(shape.vertices, shape.faces[:0]))
    with pytest.raises(InputError, match="points without faces"):
        read_shape_ply(tmp_path / "points.ply")


@pytest.mark.parametrize(("before", "after", "says"), [("int views", "float views", "no counts")])
def test_counts_that_are_none_are_refused(tmp_path, shape, before, after, says):
    views = np.full(len(shape.vertices), np.float32(np.inf).view(np.int32))
    write_shape_ply(tmp_path / "a.ply", ShapeModel(shape.vertices, shape.faces, views=views))
    data = (tmp_path / "a.ply").read_bytes().replace(f"property {before}".encode(), f"property {after}".encode())
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(InputError, match=says):
        read_shape_ply(tmp_path / "a.ply")


def test_negative_standard_deviations_are_refused(tmp_path, shape):
    sigma = {"height": np.full(len(shape.vertices), -1.0)}
    write_shape_ply(tmp_path / "a.ply", ShapeModel(shape.vertices, shape.faces, sigma=sigma))
    with pytest.raises(InputError, match="negative"):
        read_shape_ply(tmp_path / "a.ply")
