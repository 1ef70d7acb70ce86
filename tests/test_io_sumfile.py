"""SUMFILEs: written and read back identically, real ones too; what they say of a view; what breaks them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photoclinometry.io.models.sumfile import format_sumfile, read_sumfile, sumfile_of_view, write_sumfile
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, so3_exp, unit

SPC = Path(__file__).parents[2] / "shared" / "data" / "formats" / "spc"
CAMERA = Camera("PINHOLE", 640, 480, (5000.0, 5100.0, 321.25, 239.0))


@pytest.fixture
def view():
    rng = np.random.default_rng(1)
    pose = Rigid(so3_exp(rng.normal(size=3)), rng.normal(size=3) * 20)
    return sumfile_of_view("A0001", CAMERA, pose, rng.normal(size=3), utc="2020 JAN 01 00:00:00.000"), pose


def with_points(summary):
    return replace(summary, landmarks=(("AA0001", 12.25, -3.5),), limbs=(("BB0001", 571.13, 533.56, 0.03),))


def test_what_was_read_is_written_and_read_back_identically(tmp_path, view):
    """Also after a first writing has rounded the numbers to the columns."""
    write_sumfile(tmp_path / "a.SUM", with_points(view[0]))
    first = read_sumfile(tmp_path / "a.SUM")
    write_sumfile(tmp_path / "b.SUM", first)
    assert read_sumfile(tmp_path / "b.SUM") == first
    assert (tmp_path / "b.SUM").read_bytes() == (tmp_path / "a.SUM").read_bytes()
    assert first.landmarks == (("AA0001", 12.25, -3.5),)
    assert first.limbs == (("BB0001", 571.13, 533.56, 0.03),)


@pytest.mark.data
@pytest.mark.skipif(not SPC.is_dir(), reason="no ../shared/data/formats/spc beside the repository")
@pytest.mark.parametrize("name", ["M605862153F5.SUM", "N2395699394.SUM"])
def test_real_sumfiles_are_written_and_read_back_identically(tmp_path, name):
    summary = read_sumfile(SPC / name)
    write_sumfile(tmp_path / "again.SUM", summary)
    assert read_sumfile(tmp_path / "again.SUM") == summary


@pytest.mark.data
@pytest.mark.skipif(not SPC.is_dir(), reason="no ../shared/data/formats/spc beside the repository")
def test_a_real_sumfile_says_what_its_text_says():
    summary = read_sumfile(SPC / "N2395699394.SUM")
    assert (summary.name, summary.utc) == ("N2395699394", "2005 SEP 21 10:44:07.352")
    assert (summary.width, summary.height, summary.threshold) == (1024, 1024, (10, 255))
    assert summary.focal_mm == 120.4711641
    assert summary.camera_to_body == (-13.70861202, 12.34494052, -0.4173827993)
    assert summary.axes[1] == (0.6665803354, 0.7416468927, 0.07503694420)
    assert summary.k_matrix == (83.33333, 0, 0, 0, 83.33333, 0)
    assert summary.pointing_sigma[2] == 0.8337949617e-3
    lines = (SPC / "N2395699394.SUM").read_text().splitlines()
    assert len(summary.landmarks) + len(summary.limbs) + 16 == len(lines)
    assert summary.limbs[-1] == ("AC0001", 575.12, 519.37, 0.03)


def test_a_point_is_seen_where_the_view_sees_it(tmp_path, view):
    """SPC's own equations, written out, against the package's camera: half a pixel apart, by the two conventions."""
    summary, pose = view
    write_sumfile(tmp_path / "a.SUM", summary)
    s = read_sumfile(tmp_path / "a.SUM")
    point = pose(np.array([[0.3, -0.2, 20.0], [-1.0, 0.4, 18.0]]))
    from_camera = point + s.camera_to_body  # V - SCOBJ of SPC points from the body's centre; here from the camera
    x, y, z = (from_camera @ np.array(axis) for axis in s.axes)
    u, v = s.focal_mm * x / z, s.focal_mm * y / z
    sample = s.center[0] + s.k_matrix[0] * u + s.k_matrix[1] * v
    line = s.center[1] + s.k_matrix[3] * u + s.k_matrix[4] * v
    ours = CAMERA.pixel_from_cam(pose.inverse()(point))
    np.testing.assert_allclose(np.stack([sample, line], -1), ours + 0.5, atol=1e-5)


def test_pose_and_sun_keep_ten_digits(tmp_path, view):
    summary, pose = view
    write_sumfile(tmp_path / "a.SUM", summary)
    back = read_sumfile(tmp_path / "a.SUM")
    np.testing.assert_allclose(back.body_from_axes.rotation, pose.rotation, atol=1e-10)
    np.testing.assert_allclose(back.body_from_axes.translation, pose.translation, rtol=1e-10)
    np.testing.assert_allclose(unit(np.array(back.sun)), summary.sun, atol=1e-10)


def spoilt(summary, old, new):
    text = format_sumfile(summary)
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("END FILE", "", "without END FILE"),
        ("   640", "   0.5", "whole numbers of pixels"),
        ("   640", "     0", "whole numbers of pixels"),
        ("   640", "   nan", r"line 3: expected 4 numbers \(NPX"),
        ("5.0000000000E+01", "-5.000000000E+01", "focal length MMFL is -50 mm"),
        ("100.00000", "  0.00000", "puts the focal plane on a line"),
        ("LANDMARKS", "LANDMARK", "line 14: expected LANDMARKS"),
        ("571.13", "57l.13", r"line 17: expected 3 numbers \(LIMB FITS of BB0001\)"),
        ("A0001", "Ä0001", "not ASCII"),
        ("A0001", "     ", "line 1: expected the name of the image, found an empty line"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, view, old, new, message):
    (tmp_path / "bad.SUM").write_text(spoilt(with_points(view[0]), old, new))
    with pytest.raises(InputError, match=rf"bad\.SUM.*{message}"):
        read_sumfile(tmp_path / "bad.SUM")


def test_axes_and_suns_must_be_unit_vectors(tmp_path, view):
    summary = view[0]
    mirrored = replace(summary, axes=(summary.axes[1], summary.axes[0], summary.axes[2]))
    (tmp_path / "bad.SUM").write_text(format_sumfile(mirrored))
    with pytest.raises(InputError, match="right-handed unit vectors"):
        read_sumfile(tmp_path / "bad.SUM")
    (tmp_path / "bad.SUM").write_text(format_sumfile(replace(summary, sun=(0.0, 0.0, 1.1))))
    with pytest.raises(InputError, match=r"SZ has length 1\.1"):
        read_sumfile(tmp_path / "bad.SUM")


def test_every_truncation_is_refused(tmp_path, view):
    data = format_sumfile(with_points(view[0])).rstrip().encode()
    for length in range(0, len(data), 7):
        (tmp_path / "cut.SUM").write_bytes(data[:length])
        with pytest.raises(InputError, match=r"cut\.SUM"):
            read_sumfile(tmp_path / "cut.SUM")
