"""Tables of ground control points: read as written, and refused with the line that is wrong."""

import numpy as np
import pytest

from photoclinometry.io.control_points_csv import DEFAULT_SIGMA_PX, read_control_points
from photoclinometry.model.errors import InputError

HEADER = "point,view,x_px,y_px,x_m,y_m,z_m,sigma_m\n"


def table(tmp_path, text):
    file = tmp_path / "points.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_lines_of_one_point_are_its_pixels(tmp_path):
    text = (
        HEADER + "A,images/000.fits,10.5,20,1,2,3,5\nB,images/000.fits,7,8,4,5,6,2\nA,images/001.fits,11,21,1,2,3,5\n"
    )
    a, b = read_control_points(table(tmp_path, text))
    assert (a.name, b.name) == ("A", "B")
    np.testing.assert_array_equal(a.position, [1, 2, 3])
    np.testing.assert_array_equal(a.sigma, [5, 5, 5])
    assert [(p.view, p.x_px, p.y_px, p.sigma_px) for p in a.pixels] == [
        ("images/000.fits", 10.5, 20.0, DEFAULT_SIGMA_PX),
        ("images/001.fits", 11.0, 21.0, DEFAULT_SIGMA_PX),
    ]


def test_sigmas_by_axis_and_of_pixels(tmp_path):
    text = "point,view,x_px,y_px,sigma_px,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m\nA,v,1,2,0.3,1,2,3,4,5,6\n"
    (point,) = read_control_points(table(tmp_path, text))
    np.testing.assert_array_equal(point.sigma, [4, 5, 6])
    assert point.pixels[0].sigma_px == 0.3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("point,view,x_px,y_px,x_m,y_m,z_m\n", "no column 'sigma_m'"),
        ("view,x_px\n", "no column 'point'"),
        (HEADER, "has no control point"),
        (HEADER + "A,v,1,2,1,2,x,5\n", "line 2: z_m is 'x', expected a number"),
        (HEADER + "A,v,1,2,1,2,3,0\n", "line 2: sigma_m is 0, expected a positive number"),
        (HEADER + "A,,1,2,1,2,3,5\n", "line 2: view is empty"),
        (HEADER + "A,v,1,2,1,2,3,5\nA,w,1,2,1,2,4,5\n", "line 3: point 'A' has another position"),
        (HEADER + "A,v,1,2,1,2,3,5\nA,v,1,2,1,2,3,5\n", "line 3: point 'A' is in view 'v' twice"),
        (HEADER + "A,v,1,2,1,2,3,nan\n", "line 2: sigma_m is 'nan'"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_control_points(table(tmp_path, text))


def test_a_view_that_the_site_lacks_is_refused(tmp_path):
    file = table(tmp_path, HEADER + "A,v,1,2,1,2,3,5\nA,w,1,2,1,2,3,5\n")
    assert len(read_control_points(file, ["v", "w"])) == 1
    with pytest.raises(InputError, match=r"points\.csv, line 3: point 'A' is in view 'w'"):
        read_control_points(file, ["u", "v"])


def test_a_missing_table_and_bytes_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.csv"):
        read_control_points(tmp_path / "nowhere.csv")
    file = tmp_path / "binary.csv"
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        read_control_points(file)
