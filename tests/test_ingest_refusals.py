"""What is missing or contradictory is refused: the error names the file and the option to pass."""

from dataclasses import replace

import numpy as np
import pytest

from archives import (
    CAMERA,
    MAPCAM,
    POSE,
    SUN,
    geometry_tables,
    mapcam_cube,
    plain_images,
    suns_of,
    texture,
    write_pds3,
)
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.images import write_fits
from photoclinometry.io.models.sumfile import sumfile_of_view, write_sumfile
from photoclinometry.model.errors import InputError, RunFolderError


def refusal(paths, folder, **options):
    with pytest.raises(InputError) as error:
        ingest(paths, folder / "site", IngestOptions(**options))
    return str(error.value)


def test_a_missing_camera_and_sun_are_both_named(tmp_path):
    (path,) = plain_images(tmp_path / "in", 1)
    message = refusal([path], tmp_path)
    assert message.startswith(str(path))
    for word in ("--camera", "--pinhole", "--sumfiles", "--kernels", "--suns"):
        assert word in message


UNKNOWN = MAPCAM.replace("MapCam", "NewCam").replace("-64361", "-64999")


def test_the_keywords_that_a_cube_and_kernels_lack_are_named(tmp_path):
    pytest.importorskip("spiceypy")
    (tmp_path / "new.ti").write_text("KPL/IK\n\\begindata\nINS-64999_FOCAL_LENGTH = 100.0\n\\begintext\n")
    path = mapcam_cube(tmp_path / "a.cub", groups=UNKNOWN, keywords="INS-64999_PIXEL_PITCH = 0.0085\n")
    message = refusal([path], tmp_path, kernels=(tmp_path / "new.ti",))
    center = "INS-64999_CCD_CENTER or CENTER or FOV_CENTER_PIXEL or BORESIGHT_SAMPLE and BORESIGHT_LINE"
    assert f"(instrument 'NewCam'; the cube lacks INS-64999_FOCAL_LENGTH, {center}; the kernels lack " in message
    assert f"the kernels lack INS-64999_PIXEL_SIZE or PIXEL_PITCH or ITRANSS and ITRANSL, {center}): pass" in message


def test_the_code_that_a_cube_lacks_is_named(tmp_path):
    path = mapcam_cube(tmp_path / "a.cub", groups=UNKNOWN.replace("NaifFrameCode", "Other"))
    assert "(instrument 'NewCam'; the label has no NaifFrameCode of ISIS): pass" in refusal([path], tmp_path)


def test_a_missing_sun_alone_is_named(tmp_path):
    message = refusal(plain_images(tmp_path / "in", 1), tmp_path, pinhole=(500.0, 500.0, 30.0, 20.0))
    assert "the Sun's direction is unknown" in message
    assert "camera is not known" not in message


def test_kernels_that_were_passed_are_not_asked_for_again(tmp_path):
    pytest.importorskip("spiceypy")
    (tmp_path / "a.tpc").write_text("KPL/PCK\n\\begindata\nBODY2101955_RADII = ( 1 2 3 )\n\\begintext\n")
    (path,) = plain_images(tmp_path / "in", 1)
    message = refusal([path], tmp_path, pinhole=(500.0, 500.0, 30.0, 20.0), kernels=(tmp_path / "a.tpc",))
    assert (
        "which SPICE needs: pass --camera; so the Sun's direction is unknown: correct that, or pass --sumfiles"
        in message
    )
    assert "--kernels" not in message


def test_an_unknown_part_of_a_detector_is_refused(tmp_path):
    path = mapcam_cube(tmp_path / "a.cub", pixels=texture())
    message = refusal([path], tmp_path)
    assert "is 60 x 40 pixels, but its camera has 1024 x 1024" in message


UNREAD = (
    "INS-64361_FOCAL_LENGTH = 125.2\nINS-64361_PIXEL_SIZE = 8.5\nINS-64361_CCD_CENTER = (511.5, 511.5)\n"
    "INS-64361_DISTORTION_COEF_X = (0.0, 1.002, 0.0)\n"
)


def test_a_cube_with_a_distortion_that_is_not_understood_is_refused(tmp_path):
    path = mapcam_cube(tmp_path / "a.cub", keywords=UNREAD)
    message = refusal([path], tmp_path)
    assert message.startswith(f"{path}: INS-64361_DISTORTION_COEF_X: a distortion of this kind is not known here")
    assert ingest([path], tmp_path / "site", IngestOptions(undistorted=True)).exposures


def test_a_kernel_with_a_distortion_that_is_not_understood_is_named(tmp_path):
    pytest.importorskip("spiceypy")
    (tmp_path / "mapcam.ti").write_text(f"KPL/IK\n\\begindata\n{UNREAD}\\begintext\n")
    path = mapcam_cube(tmp_path / "a.cub")
    message = refusal([path], tmp_path, kernels=(tmp_path / "mapcam.ti",))
    assert message.startswith(f"{path}: INS-64361_DISTORTION_COEF_X: a distortion of this kind")
    assert message.endswith("(in mapcam.ti)")


def test_a_camera_that_looks_away_from_the_body_is_refused(tmp_path):
    """As when the boresight is along another axis than thought; Sun and shadows would be wrong, too."""
    tables = geometry_tables([1, 0, 0, 0], [5.0, 0.0, 0.1], [1, 0, 0, 0], [0.6e8, 0.0, -0.8e8])
    message = refusal([mapcam_cube(tmp_path / "a.cub", tables=tables)], tmp_path, undistorted=True)
    assert "would look 91 degrees past the body's centre" in message


def test_mixed_units_are_refused_unless_all_count_as_uncalibrated(tmp_path):
    write_fits(tmp_path / "a_iof.fits", texture((1024, 1024)))
    write_fits(tmp_path / "b.fits", texture((1024, 1024), 1))
    paths = [tmp_path / "a_iof.fits", tmp_path / "b.fits"]
    options = {"suns": suns_of(tmp_path, paths), "camera": "dawn-fc2", "undistorted": True}
    message = refusal(paths, tmp_path, **options)
    assert message.startswith(f"{paths[1]}: is not known to be I/F")
    result = ingest(paths, tmp_path / "site", IngestOptions(uncalibrated=True, **options))
    assert {e.brightness for e in result.exposures} == {"dn"}


def test_radiance_without_distance_is_refused(tmp_path):
    path = write_pds3(tmp_path / "a.img", texture(), sample_type="PC_REAL", extra="  UNIT = 'W/(m**2 sr micron)'\r\n")
    options = {"suns": suns_of(tmp_path, [path]), "pinhole": (500.0, 500.0, 30.0, 20.0), "solar_flux": 1500.0}
    assert "without the distance from the Sun" in refusal([path], tmp_path, **options)


def test_two_bodies_are_refused(tmp_path):
    paths = [
        mapcam_cube(tmp_path / "a.cub"),
        mapcam_cube(tmp_path / "b.cub", groups=MAPCAM.replace("Bennu", "Ryugu")),
    ]
    assert "the images show bennu, ryugu" in refusal(paths, tmp_path, undistorted=True)


def test_a_sumfile_that_counts_lines_upwards_needs_the_order_of_lines(tmp_path):
    """Such an image would be a mirror image, or its lines run up: only a person can know."""
    (path,) = plain_images(tmp_path / "in", 1)
    summary = sumfile_of_view("20190301T101500", CAMERA, POSE, SUN, utc="2019 MAR 01 10:15:00.5")
    up = replace(summary, k_matrix=(*summary.k_matrix[:4], -summary.k_matrix[4], 0.0))
    write_sumfile(tmp_path / "A.SUM", up)
    message = refusal([path], tmp_path, sumfiles=(tmp_path / "A.SUM",))
    assert "--lines down" in message
    options = IngestOptions(sumfiles=(tmp_path / "A.SUM",), lines="down")
    (exposure,) = ingest([path], tmp_path / "site", options).exposures
    np.testing.assert_array_equal(exposure.image.brightness[::-1], (texture() * 1e6).astype(np.uint16))
    np.testing.assert_allclose(exposure.prior.cam_from_body.rotation, POSE.rotation.T, atol=1e-9)


def test_two_sumfiles_for_one_image_are_refused(tmp_path):
    (path,) = plain_images(tmp_path / "in", 1)
    for name in ("A", "B"):
        summary = sumfile_of_view(name + "XX", CAMERA, POSE, SUN, utc="2019 MAR 01 10:15:00.5")
        write_sumfile(tmp_path / f"{name}.SUM", summary)
    message = refusal([path], tmp_path, sumfiles=(tmp_path / "A.SUM", tmp_path / "B.SUM"))
    assert "matches both A.SUM and B.SUM" in message


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("image,sun_x,sun_y\n", "no column 'sun_z'"),
        ("image,sun_x,sun_y,sun_z\na.png,1,0,x\n", "line 2: sun_z is 'x'"),
        ("image,sun_x,sun_y,sun_z\na.png,1,1,0\n", "line 2: the Sun has length 1.41421"),
        ("image,sun_x,sun_y,sun_z\na.png,1,0\n", "line 2: sun_z is empty, expected a number"),
        ("image,sun_x,sun_y,sun_z\na.png,1,0,0\na.png,1,0,0\n", "line 3: 'a.png' occurs twice"),
        ("image,sun_x,sun_y,sun_z,sun_sigma_deg\na.png,1,0,0,-1\n", "sun_sigma_deg is -1"),
        ("\xff\xfe", "not UTF-8"),
    ],
)
def test_faults_of_tables_of_suns_are_named(tmp_path, text, expected):
    (tmp_path / "suns.csv").write_bytes(text.encode("latin-1"))
    message = refusal(plain_images(tmp_path / "in", 1), tmp_path, suns=tmp_path / "suns.csv")
    assert message.startswith(str(tmp_path / "suns.csv"))
    assert expected in message


def test_a_folder_in_use_is_left_alone(tmp_path):
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "mine.txt").touch()
    with pytest.raises(RunFolderError, match="not empty"):
        ingest(plain_images(tmp_path / "in"), tmp_path / "site")
    assert [p.name for p in (tmp_path / "site").iterdir()] == ["mine.txt"]
