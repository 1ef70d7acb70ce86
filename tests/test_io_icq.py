"""Gaskell's shape models: the order of their vertices is that of published ones, and they are read back."""

import numpy as np
import pytest

from archives import FORMATS
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.io.models.icq import icq_directions, icq_faces, read_icq, write_icq
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.surface.closed_mesh import is_watertight, signed_volume

BENNU = FORMATS / "spc" / "Bennu49k.obj"


def welded(vertices, faces):
    """The mesh with equal vertices made one."""
    points, index = np.unique(np.round(vertices.reshape(-1, 3), 12), axis=0, return_inverse=True)
    return points, index.ravel()[faces]


def seams(v):
    """The twelve edges that sides share, as pairs of rows of vertices; v: (6, Q + 1, Q + 1, 3) by side, J, I."""
    first, last, back = 0, -1, slice(None, None, -1)
    one, two, three, four, five, six = v
    return [
        (six[last], four[last, back]),
        (six[first], two[last]),
        (five[first], one[back, last]),
        (four[first], one[first, back]),
        (three[first], one[:, first]),
        (two[first], one[last]),
        (six[:, last], five[last]),
        (five[:, last], four[:, first]),
        (four[:, last], three[:, first]),
        (three[:, last], two[:, first]),
        (six[:, first], three[last, back]),
        (five[:, first], two[:, last]),
    ]


def test_sides_share_their_edges():
    for a, b in seams(icq_directions(8)):
        np.testing.assert_allclose(a, b, atol=1e-15)


def test_a_wrapped_cube_is_a_closed_sphere_that_looks_outwards():
    vertices, faces = welded(icq_directions(16), icq_faces(16))
    assert len(faces) == 12 * 16**2
    assert is_watertight(faces)
    assert signed_volume(vertices, faces) == pytest.approx(4.0 / 3.0 * np.pi, rel=0.01)


@pytest.mark.skipif(not BENNU.is_file(), reason="no ../shared/data/formats beside the repository")
def test_the_order_is_that_of_a_published_model():
    """Bennu with 49,152 facets: the vertices of an ICQ model with Q = 64, in SPC's order."""
    published, facets = read_obj(BENNU)
    sides = published.reshape(6, 65, 65, 3)
    for a, b in seams(sides):
        np.testing.assert_array_equal(a, b)
    # SPC spreads vertices evenly over the body, so that they are near these directions, not in them.
    cosine = np.sum(unit(sides) * icq_directions(64), -1)
    assert np.degrees(np.arccos(cosine.min())) < 10.0
    # Each facet is half of a quadrilateral, cut along either diagonal; at seams its vertices are those of other sides.
    side, row, column = np.unravel_index(facets, (6, 65, 65))
    inside = np.ptp(side, axis=1) == 0
    assert inside.mean() > 0.95
    assert (np.ptp(row[inside], axis=1) == 1).all()
    assert (np.ptp(column[inside], axis=1) == 1).all()
    assert signed_volume(published, icq_faces(64)) == pytest.approx(signed_volume(published, facets), rel=1e-3)


def test_a_model_is_read_back(tmp_path):
    vertices = 0.2456789123 * icq_directions(8)
    write_icq(tmp_path / "SHAPE.TXT", vertices)
    lines = (tmp_path / "SHAPE.TXT").read_text().splitlines()
    assert int(lines[0]) == 8
    assert len(lines) == 1 + 6 * 81
    assert {len(line) for line in lines[1:]} == {36}
    np.testing.assert_allclose(read_icq(tmp_path / "SHAPE.TXT"), vertices, atol=0.6e-8)


def test_large_bodies_keep_their_columns(tmp_path):
    write_icq(tmp_path / "SHAPE.TXT", 1737.4 * icq_directions(2))
    assert {len(line) for line in (tmp_path / "SHAPE.TXT").read_text().splitlines()[1:]} == {36}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("v 1 2 3\n", "first line is not a whole number"),
        ("100000\n1 2 3\n", "Q = 100000"),
        ("1\n1 2 3\n", "has 3 coordinates, Q = 1 takes 72"),
        ("1\n" + 23 * "1 2 3\n" + "1 2 nan\n", "finite"),
        ("1\n1 2 x\n", "not a complete ICQ"),
        ("4", "has 0 coordinates"),
    ],
)
def test_damaged_files_are_refused(tmp_path, text, says):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(InputError, match=says):
        read_icq(tmp_path / "a.txt")
