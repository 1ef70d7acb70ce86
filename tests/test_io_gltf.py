"""Meshes with texture, glTF and OBJ, read back with trimesh, which knows nothing of this package."""

import json
import struct

import numpy as np
import pytest

from photoclinometry.io.meshes.gltf import write_glb
from photoclinometry.io.meshes.obj import read_obj, write_obj
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.geometry import unit

trimesh = pytest.importorskip("trimesh")

Z_TO_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def patch(n=6, far=(2.5e5, -1e5, 4e4)):
    """Vertices of bumpy ground far from the origin, faces, normals, albedos, and a picture with its coordinates."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(float(n)), np.arange(float(n)))
    position = np.stack([x, y, rng.normal(size=x.shape)], -1).reshape(-1, 3) + far
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n], -1), np.stack([a + 1, a + n + 1, a + n], -1)])
    normal = unit(rng.normal(size=position.shape) + (0, 0, 5))
    picture = rng.integers(0, 256, (n, n), dtype=np.uint8)
    uv = np.stack([x + 0.5, y + 0.5], -1).reshape(-1, 2) / n
    return position, faces, normal, rng.uniform(0.1, 0.4, len(position)), (picture, uv)


def load(path):
    return trimesh.load(path, process=False, maintain_order=True)


def test_a_glb_comes_back_in_its_place_with_z_turned_to_y(tmp_path):
    position, faces, normal, albedo, (picture, uv) = patch()
    write_glb(tmp_path / "a.glb", position, faces, normal=normal, albedo=albedo, texture=(picture, uv))
    scene = load(tmp_path / "a.glb")
    place, name = scene.graph[scene.graph.nodes_geometry[0]]
    mesh = scene.geometry[name]
    moved = trimesh.transform_points(mesh.vertices, place)
    np.testing.assert_allclose(moved, position @ Z_TO_Y.T, rtol=0, atol=1e-6)  # single precision alone: 0.03
    np.testing.assert_array_equal(mesh.faces, faces)
    np.testing.assert_allclose(mesh.vertex_normals, normal, atol=1e-6)
    np.testing.assert_allclose(mesh.vertex_attributes["_ALBEDO"].ravel(), albedo, rtol=1e-6)
    image = np.array(mesh.visual.material.baseColorTexture.convert("L"))
    np.testing.assert_array_equal(image, picture)
    at = np.floor(np.stack([mesh.visual.uv[:, 0], 1.0 - mesh.visual.uv[:, 1]], -1) * len(picture)).astype(int)
    np.testing.assert_array_equal(image[at[:, 1], at[:, 0]], picture.ravel())


def test_a_glb_without_texture_is_a_plain_mesh(tmp_path):
    position, faces, normal, *_ = patch()
    write_glb(tmp_path / "a.glb", position, faces, normal=normal)
    mesh = load(tmp_path / "a.glb").to_geometry()
    np.testing.assert_allclose(mesh.vertices, position @ Z_TO_Y.T, rtol=0, atol=1e-6)


def test_a_glb_keeps_the_rules_of_its_format(tmp_path):
    """Lengths announced, views within the buffer and aligned to four bytes, indices within the vertices."""
    position, faces, normal, albedo, texture = patch(n=7)
    write_glb(tmp_path / "a.glb", position, faces, normal=normal, albedo=albedo, texture=texture)
    data = (tmp_path / "a.glb").read_bytes()
    magic, version, length, json_length, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20 : 20 + json_length])
    size, kind = struct.unpack("<I4s", data[20 + json_length : 28 + json_length])
    assert (kind, size) == (b"BIN\0", len(data) - 28 - json_length)
    assert document["buffers"] == [{"byteLength": size}]
    assert all(view["byteOffset"] % 4 == 0 for view in document["bufferViews"])
    assert max(view["byteOffset"] + view["byteLength"] for view in document["bufferViews"]) <= size
    bounds = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    half = 0.5 * np.ptp(position, axis=0)
    np.testing.assert_allclose([bounds["min"], bounds["max"]], [-half, half], rtol=1e-6)


def test_an_obj_comes_back_with_normals_and_texture(tmp_path):
    position, faces, normal, _, (picture, uv) = patch()
    write_obj(tmp_path / "a.obj", position, faces, normal=normal, texture=(picture, uv))
    mesh = load(tmp_path / "a.obj")
    np.testing.assert_array_equal(mesh.vertices, position)
    np.testing.assert_array_equal(mesh.faces, faces)
    np.testing.assert_allclose(mesh.vertex_normals, normal, atol=1e-6)
    image = np.array(mesh.visual.material.image.convert("L"))
    np.testing.assert_array_equal(image, picture)
    at = np.floor(np.stack([mesh.visual.uv[:, 0], 1.0 - mesh.visual.uv[:, 1]], -1) * len(picture)).astype(int)
    np.testing.assert_array_equal(image[at[:, 1], at[:, 0]], picture.ravel())


@pytest.mark.parametrize("textured", [True, False])
def test_an_obj_is_read_by_our_own_reader_bit_by_bit(tmp_path, textured):
    position, faces, normal, _, texture = patch()
    write_obj(tmp_path / "a.obj", position, faces, normal=normal, texture=texture if textured else None)
    vertices, triangles = read_obj(tmp_path / "a.obj")
    np.testing.assert_array_equal(vertices, position)
    np.testing.assert_array_equal(triangles, faces)
    names = {"a.obj", "a.mtl", "a.png"} if textured else {"a.obj"}
    assert {path.name for path in tmp_path.iterdir()} == names


@pytest.mark.parametrize("write", [write_obj, write_glb])
def test_what_cannot_be_written_leaves_nothing(tmp_path, write):
    position, faces, normal, *_ = patch()
    (tmp_path / "file").write_text("")
    with pytest.raises(RunFolderError, match="cannot be written"):
        write(tmp_path / "file" / "mesh", position, faces, normal=normal)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
