"""OBJ files: every way to write a corner, polygons, and what is wrong with broken ones."""

import numpy as np
import pytest

from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.model.errors import InputError

SQUARE = "# a square\no patch\nv 0 0 0\nv 1 0 0.5\nv 1 1 0 1.0\nv 0 1 0\nvn 0 0 1\nvt 0 0\ns off\n"


@pytest.mark.parametrize("face", ["f 1 2 3 4", "f 1/1 2/1 3/1 4/1", "f 1//1 2//1 3//1 4//1", "f -4 -3 -2 -1"])
def test_corners_are_read_in_every_notation_and_polygons_become_fans(tmp_path, face):
    (tmp_path / "a.obj").write_text(SQUARE + face + "\n")
    vertices, faces = read_obj(tmp_path / "a.obj")
    np.testing.assert_array_equal(vertices, [[0, 0, 0], [1, 0, 0.5], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(faces, [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SQUARE, "4 vertices, 0 faces"),
        ("f 1 2 3\n", "0 vertices"),
        (SQUARE + "f 1 2 5\n", "vertices that do not exist"),
        (SQUARE + "f 0 1 2\n", "count from 1"),
        (SQUARE + "f 1 2 x\n", "not a complete OBJ"),
        (SQUARE + "v 1 2\nf 1 2 3\n", "not a complete OBJ"),
        (SQUARE + "v nan 0 0\nf 1 2 3\n", "not finite"),
        ("\x00\x01 something else", "is not an OBJ mesh"),
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path, text, message):
    (tmp_path / "bad.obj").write_text(text)
    with pytest.raises(InputError, match=message):
        read_obj(tmp_path / "bad.obj")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_obj(tmp_path / "none.obj")


def test_corners_counted_backwards_begin_at_the_last_vertex_before_the_face(tmp_path):
    """As programs write parts one after another."""
    parts = [f"v 0 0 {z}\nv 1 0 {z}\nv 0 1 {z}\nf -3 -2 -1\n" for z in (0, 1)]
    (tmp_path / "a.obj").write_text("".join(parts))
    np.testing.assert_array_equal(read_obj(tmp_path / "a.obj")[1], [[0, 1, 2], [3, 4, 5]])
