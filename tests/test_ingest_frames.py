"""Cameras that look along -z of their frame, or whose distortion is stated along its axes: Apollo's Metric, MDIS."""

from dataclasses import replace

import numpy as np
import pytest

from archives import MAPCAM, geometry_tables, mapcam_cube, texture, write_cube
from photoclinometry.ingest.detector import seen_pixels, upright
from photoclinometry.ingest.distortion import Decentred, OnAxes, Taylor
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.keywords import detector_from_keywords
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.model.errors import InputError

PLAIN = {
    "INS-1_FOCAL_LENGTH": (100.0,),
    "INS-1_CCD_CENTER": (511.5, 511.5),
    "INS-1_ITRANSS": (0.0, 100.0, 0.0),
    "INS-1_ITRANSL": (0.0, 0.0, 100.0),
}
POINT = np.array([[3.0, -2.0, 40.0]])
"""In front of a camera that looks along z, in its instrument's frame."""


def file_pixel(detector, point):
    """Pixel of the file at which a detector sees a point (1, 3) of its instrument's frame."""
    camera, turn, flip = upright(detector)
    pixel = camera.pixel_from_cam(point @ turn.T)
    return np.where([False, flip], detector.height - pixel, pixel)[0]


def test_a_boresight_along_minus_z_sees_what_lies_there():
    """ISIS: the direction of (x, y) on the focal plane is (x, y, -f). x = 100 * 3 / 40 = 7.5 mm, y = -5 mm."""
    for sign in (1.0, -1.0):
        held = PLAIN | {"INS-1_BORESIGHT": (0.0, 0.0, sign)}
        found = detector_from_keywords(held, -1, None, (1024, 1024))
        assert np.linalg.det(upright(found)[1]) == pytest.approx(1.0)
        np.testing.assert_allclose(file_pixel(found, POINT * [1, 1, sign]), [512 + 750.0, 512 - 500.0])


APOLLO = """INS-915240_FOCAL_LENGTH = 76.054
INS-915240_PIXEL_PITCH = 0.005
INS-915240_PIXEL_SAMPLES = 22900
INS-915240_PIXEL_LINES = 22900
INS-915240_CCD_CENTER = (11450.5, 11450.5)
INS-915240_ITRANSS = (0.0, -200.0, 0.0)
INS-915240_ITRANSL = (0.0, 0.0, 200.0)
INS-915240_BORESIGHT = (0.0, 0.0, 1.0)
INS-915240_PP = (-0.006, -0.002)
INS-915240_OD_K = (-1.3361854e-06, 5.2261757e-10, -5.0728336e-14)
INS-915240_DECENTER = (-5.4958195e-07, -4.608942e-11, 2.965907)
BODY_FRAME_CODE = 31001
"""
GROUPS = """Group = Instrument
  SpacecraftName = "APOLLO 15"
  InstrumentId = METRIC
  TargetName = MOON
  StartTime = 1971-08-01T14:58:03.78
End_Group
Group = Kernels
  NaifFrameCode = -915240
End_Group
Group = AlphaCube
  AlphaSamples = 25798
  AlphaLines = 25356
  AlphaStartingSample = 12000.5
  AlphaStartingLine = 12500.5
  AlphaEndingSample = 12240.5
  AlphaEndingLine = 12660.5
  BetaSamples = 60
  BetaLines = 40
End_Group
"""
POINTING = [-0.38473487234953957, -0.4919595763376691, -0.7804260592920413, -0.029833190002743898]
POSITION = [-1754.1260075053833, -8.536489940357743, -605.8016452642961]
SUN = [-95593128.35578895, 108408313.93764308, 47045061.66457185]
"""Pointing (J2000 -> camera), position from the Moon's centre [km] and Sun of a frame of Apollo 15 taken on
1971-08-01 at 14:58:03.78, and its keywords, as the tests of USGS's ALE have them (apollometric_isd.json)."""


def apollo_cube(path, **changes):
    tables = geometry_tables(POINTING, POSITION, [1, 0, 0, 0], SUN)
    return write_cube(path, **({"pixels": texture(), "groups": GROUPS, "keywords": APOLLO, "tables": tables} | changes))


def test_a_frame_of_apollo_15_looks_at_the_moon(tmp_path):
    """The cube is a crop, reduced by 4, of the scan of 25798 x 25356 pixels. A point straight ahead along -z is seen at
    the scan's middle and PP: 12898.5 + 1.2 and 12677.5 - 0.4 px."""
    (exposure,) = ingest([apollo_cube(tmp_path / "a.cub")], tmp_path / "site").exposures
    focal = 76.054 / 0.005 / 4
    expected = [focal, focal, (12899.7 - 12000.0) / 4, (12677.1 - 12500.0) / 4]
    np.testing.assert_allclose(exposure.camera.params, expected, rtol=1e-9)
    center = exposure.prior.cam_from_body.translation / 1e3
    # By the pointing the centre is at (2.18, 1190.49, -1423.64) km of the camera's frame; C is x = -X, y = Y, z = -Z.
    np.testing.assert_allclose(center, [-2.185, 1190.492, 1423.640], atol=1e-3)
    assert np.linalg.norm(center) == pytest.approx(np.linalg.norm(POSITION))
    np.testing.assert_allclose(exposure.sun, [-0.86454, -0.23340, -0.44507], atol=1e-4)


def test_keywords_of_apollo_before_x_was_reversed_look_along_z(tmp_path):
    """The same scan by the older kernel: x is not reversed, so that the camera looks along z, away from the body."""
    older = APOLLO.replace("-200.0", "200.0")
    with pytest.raises(InputError, match="would look 140 degrees past the body's centre"):
        ingest([apollo_cube(tmp_path / "a.cub", keywords=older)], tmp_path / "site")


def test_a_cube_of_apollo_without_keywords_is_refused_with_their_names(tmp_path):
    with pytest.raises(InputError, match=r"the cube lacks INS-915240_FOCAL_LENGTH, INS-915240_PIXEL_SIZE or"):
        ingest([apollo_cube(tmp_path / "a.cub", keywords="")], tmp_path / "site")


def test_decentring_is_that_of_isis():
    """By hand: r^2 = 5000 mm^2; radial -1.3361854e-6 * 5000 + 5.2261757e-10 * 2.5e7 - 5.0728336e-14 * 1.25e11."""
    lens = Decentred((-1.3361854e-06, 5.2261757e-10, -5.0728336e-14), (-5.4958195e-07, -4.608942e-11), 2.965907)
    radial = 1.0 - 6.680927e-3 + 1.306543925e-2 - 6.341042e-3
    across = -2.74790975e-3 - 1.1522355e-3
    expected = [50.0 * radial - across * np.sin(2.965907), 50.0 * radial + across * np.cos(2.965907)]
    np.testing.assert_allclose(lens.undistort(np.array([50.0, 50.0])), expected, rtol=1e-9)
    np.testing.assert_allclose(lens.distort(np.array(expected)), [50.0, 50.0], atol=1e-8)


MDIS = {
    "INS-236820_FOCAL_LENGTH": (549.11781953727,),
    "INS-236820_PIXEL_PITCH": (0.014,),
    "INS-236820_ITRANSS": (0.0, 71.42857143, 0.0),
    "INS-236820_ITRANSL": (0.0, 0.0, 71.42857143),
    "INS-236820_BORESIGHT_SAMPLE": (512.5,),
    "INS-236820_BORESIGHT_LINE": (512.5,),
    "INS-236820_OD_T_X": (0.0, 1.0018542696238, 0.0, 0.0, -5.09444047494111e-04, 0.0, 1.004e-05, 0.0, 1.004e-05, 0.0),
    "INS-236820_OD_T_Y": (0, 0, 1.0, 9.06001059499675e-04, 0, 3.57484262662076e-04, 0, 1.004e-05, 0, 1.004e-05),
}
"""Keywords of a cube of MDIS's narrow-angle camera."""


def test_mdis_s_narrow_camera_has_the_distortion_of_its_keywords():
    """An ideal point 5 mm along samples and 2 mm along lines: x' = 5.0092713 - 0.0050944 + 1.004e-5 * (125 + 20) and
    y' = 2 + 0.0226500 + 0.0014299 + 1.004e-5 * (50 + 8) mm."""
    found = detector_from_keywords(MDIS, -236820, None, (1024, 1024))
    ideal = np.array([512.0 + 5.0 / 0.014, 512.0 + 2.0 / 0.014])
    seen = (seen_pixels(found, ideal) - 512.0) * 0.014
    np.testing.assert_allclose(seen, [5.0056327, 2.0246623], atol=2e-6)


def test_a_distortion_along_the_frame_s_axes_is_turned_with_the_detector():
    """Samples along -y and lines along x: the same point of the focal plane moves alike."""
    inner = Taylor((0.0, 1.0, 0.0, 1e-3, *[0.0] * 6), (0.0, 0.0, 1.0, 0.0, 2e-3, *[0.0] * 5))
    x, y = inner.distort(np.array([3.0, 2.0]))
    turned = OnAxes(inner, ((0.0, -1.0), (1.0, 0.0))).distort(np.array([-2.0, 3.0]))
    np.testing.assert_allclose(turned, [-y, x])
    found = detector_from_keywords(MDIS | {"INS-236820_BORESIGHT": (0.0, 0.0, -1.0)}, -236820, None, (1024, 1024))
    straight = detector_from_keywords(MDIS, -236820, None, (1024, 1024))
    grid = np.random.default_rng(0).uniform(0, 1024, (20, 2))
    np.testing.assert_allclose(seen_pixels(found, grid), seen_pixels(straight, grid), atol=1e-9)
    assert replace(found, frame=straight.frame, axes=straight.axes) == straight


@pytest.mark.parametrize(
    ("instrument", "message"),
    [("MDIS-WAC", "each filter of MDIS-WAC"), ("MDIS-NAC\n  FpuBinningMode = 1", "FPUBINNINGMODE is 1")],
)
def test_what_is_not_known_of_mdis_is_refused(tmp_path, instrument, message):
    groups = GROUPS[: GROUPS.index("Group = Kernels")].replace("METRIC", instrument)
    with pytest.raises(InputError, match=message):
        ingest([apollo_cube(tmp_path / "a.cub", groups=groups)], tmp_path / "site", IngestOptions(pose_priors=False))


def test_a_crop_of_a_binned_image_is_placed_in_that_image(tmp_path):
    """AlphaCube counts pixels of the 512 x 512 image, two of the detector each; the principal point is at 256."""
    alpha = GROUPS[GROUPS.index("Group = AlphaCube") :]
    alpha = alpha.replace("25798", "512").replace("25356", "512")
    for old, new in (("12000.5", "100.5"), ("12500.5", "200.5"), ("12240.5", "160.5"), ("12660.5", "240.5")):
        alpha = alpha.replace(old, new)
    path = mapcam_cube(tmp_path / "a.cub", pixels=texture(), groups=MAPCAM + alpha)
    (exposure,) = ingest([path], tmp_path / "site").exposures
    np.testing.assert_allclose(exposure.camera.params, [125.2 / 0.017] * 2 + [156.0, 40 - 56.0])
