"""PLY files: what is written is read back, in every encoding, and meshes face outwards."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photoclinometry.io.meshes.ply import read_ply, write_ply
from photoclinometry.io.meshes.ply_elements import read_elements
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.scene import Landmarks
from scenes import synthetic_scene

PUBLISHED = Path(__file__).parents[2] / "shared" / "data" / "vesta-opnav022" / "published" / "vesta_5002.ply"


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=8, views=3)


def keep(scene, chosen):
    marks = scene.landmarks
    return replace(
        scene,
        landmarks=Landmarks(
            position=marks.position[chosen],
            normal=marks.normal[chosen],
            albedo=marks.albedo[chosen],
            pixel=marks.pixel[chosen],
        ),
    )


def test_points_come_back_positions_in_double_the_rest_in_single(tmp_path, scene):
    write_ply(tmp_path / "a.ply", scene)
    read = read_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(read.position, scene.landmarks.position)
    np.testing.assert_array_equal(read.normal, scene.landmarks.normal.astype(np.float32))
    np.testing.assert_array_equal(read.albedo, scene.landmarks.albedo.astype(np.float32))
    assert read.faces is None


def test_header_is_the_documented_one(tmp_path, scene):
    count = len(scene.landmarks)
    sigma = {"position": np.ones((count, 3)), "albedo": np.ones(count), "normal": np.ones(count)}
    sigma["sun"] = np.ones((3, 2))
    write_ply(tmp_path / "a.ply", replace(scene, uncertainty=sigma))
    header = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")[0].decode().splitlines()
    assert header[:2] == ["ply", "format binary_little_endian 1.0"]
    assert [line for line in header if line.startswith("property")] == [
        *(f"property double {name}" for name in "xyz"),
        *(f"property float {name}" for name in ("nx", "ny", "nz", "albedo")),
        *(f"property float sigma_{name}" for name in ("x", "y", "z", "albedo", "normal")),
    ]


def test_covariances_are_written_as_sigmas_along_the_axes(tmp_path, scene):
    """Positions with variances 1, 4, 9: sigmas 1, 2, 3; normals with 0.0009 and 0.0025 rad^2: the root of their sum."""
    count = len(scene.landmarks)
    stated = {
        "position": np.tile(np.diag([1.0, 4.0, 9.0]), (count, 1, 1)),
        "normal": np.tile(np.diag([0.0009, 0.0025]), (count, 1, 1)),
    }
    write_ply(tmp_path / "a.ply", replace(scene, uncertainty=stated))
    vertex = read_elements(tmp_path / "a.ply")["vertex"]
    for name, expected in (("x", 1.0), ("y", 2.0), ("z", 3.0), ("normal_deg", np.degrees(np.sqrt(0.0034)))):
        np.testing.assert_allclose(vertex[f"sigma_{name}"], expected, rtol=1e-6)


def test_faces_of_the_grid_look_along_the_outward_normals(tmp_path, scene):
    write_ply(tmp_path / "a.ply", scene, mesh=True)
    read = read_ply(tmp_path / "a.ply")
    assert read.faces.shape == (2 * 7 * 7, 3)
    a, b, c = read.position[read.faces].swapaxes(0, 1)
    cosine = np.sum(unit(np.cross(b - a, c - a)) * read.normal[read.faces].mean(1), -1)
    assert cosine.min() > 0.9


def test_cells_with_a_missing_corner_have_one_triangle(scene):
    inner = 3 * 8 + 3
    holed = keep(scene, np.delete(np.arange(64), inner))
    assert len(landmark_faces(holed)) == 2 * (49 - 4) + 4
    assert len(landmark_faces(keep(scene, [0, 1]))) == 0


ASCII = """ply
format ascii 1.0
comment by hand
element vertex 5
property float x
property float y
property float z
property uchar red
element face 2
property list uchar int vertex_indices
end_header
0 0 0 255
1 0 0 255
1 1 0 255
0 1 0 255
0.5 0.5 1 255
4 0 1 2 3
3 0 1 4
"""
POSITION = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]]


def binary(order, polygons):
    """The same surface in binary, with the given polygons."""
    form = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    header = ASCII.split("end_header")[0].replace("format ascii", f"format {form}")
    header = header.replace("face 2", f"face {len(polygons)}") + "end_header\n"
    vertices = np.zeros(5, [("xyz", order + "f4", 3), ("red", "u1")])
    vertices["xyz"] = POSITION
    faces = [np.uint8(len(p)).tobytes() + np.array(p, order + "i4").tobytes() for p in polygons]
    return header.encode() + vertices.tobytes() + b"".join(faces)


def test_ascii_with_triangles_and_quads_is_read(tmp_path):
    (tmp_path / "a.ply").write_text(ASCII)
    read = read_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(read.position, POSITION)
    assert read.normal is None
    assert read.albedo is None
    assert sorted(map(tuple, read.faces)) == [(0, 1, 2), (0, 1, 4), (0, 2, 3)]


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(
    ("polygons", "triangles"),
    [
        ([[0, 1, 2, 3], [0, 1, 4]], [(0, 1, 2), (0, 1, 4), (0, 2, 3)]),
        ([[0, 1, 4], [1, 2, 4]], [(0, 1, 4), (1, 2, 4)]),
        ([[0, 1, 2, 3, 4]], [(0, 1, 2), (0, 2, 3), (0, 3, 4)]),
        ([], []),
    ],
)
def test_both_binary_forms_are_read(tmp_path, order, polygons, triangles):
    (tmp_path / "a.ply").write_bytes(binary(order, polygons))
    read = read_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(read.position, POSITION)
    assert sorted(map(tuple, read.faces)) == triangles


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("ply\n", "plx\n", "does not begin with a header"),
        ("end_header", "end_heade", "does not begin with a header"),
        ("format ascii 1.0", "format ascii 2.0", "header line not understood: 'format ascii 2.0'"),
        ("format ascii 1.0\n", "", "no known format"),
        ("vertex 5", "vertex five", "header line not understood"),
        ("vertex 5", "vertex 50", "there are fewer|does not hold"),
        ("float y", "float x", "two of the same name"),
        ("float y", "half y", "header line not understood: 'property half y'"),
        ("float z", "float w", "no vertices with x, y, z"),
        ("0.5 0.5 1 255", "0.5 0.5 255", "a vertex row does not agree"),
        ("0.5 0.5 1 255", "0.5 nan 1 255", "not finite"),
        ("3 0 1 4", "3 0 1 5", "faces refer to vertices that do not exist"),
        ("3 0 1 4", "9 0 1 4", "a face row does not agree"),
        ("3 0 1 4", "3 0 x 4", "a face row does not agree"),
    ],
)
def test_malformed_files_are_refused_in_words(tmp_path, old, new, found):
    assert old in ASCII
    (tmp_path / "a.ply").write_text(ASCII.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"a\.ply: .*({found})"):
        read_ply(tmp_path / "a.ply")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.ply: there is no such file"):
        read_ply(tmp_path / "none.ply")


@pytest.mark.parametrize("polygons", [[[0, 1, 2, 3], [0, 1, 4]], [[0, 1, 4], [1, 2, 4]]])
def test_binary_cut_short_anywhere_is_refused(tmp_path, polygons):
    whole = binary("<", polygons)
    for size in range(len(whole)):
        (tmp_path / "a.ply").write_bytes(whole[:size])
        with pytest.raises(InputError, match=r"a\.ply: is not a complete PLY"):
            read_ply(tmp_path / "a.ply")


@pytest.mark.data
def test_the_published_vesta_shape_is_a_closed_surface():
    if not PUBLISHED.exists():
        pytest.skip(f"the published Vesta shape is not at {PUBLISHED}")
    read = read_ply(PUBLISHED)
    assert read.position.shape == (5002, 3)
    assert read.faces.shape == (10000, 3)
    edges = np.sort(read.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), 1)
    assert len(np.unique(edges, axis=0)) == 15000
    radius = np.linalg.norm(read.position, axis=1)
    assert 200 < radius.min() < radius.max() < 300  # km
