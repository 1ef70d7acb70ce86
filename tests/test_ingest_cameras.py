"""Known cameras: the table agrees with kernels and cubes, digit for digit; sizes, filters and names."""

import numpy as np
import pytest

from archives import FORMATS, SPICE, needs_formats, needs_spice
from photoclinometry.ingest.cameras import CAMERAS, camera_named, known_camera
from photoclinometry.ingest.detector import fitted, seen_pixels, upright
from photoclinometry.ingest.facts import Facts, read_facts
from photoclinometry.ingest.keywords import detector_from_keywords, keywords_of_label
from photoclinometry.io.archives.archive import read_product
from photoclinometry.io.spice import kernel_files, loaded_kernels
from photoclinometry.model.errors import InputError
from photoclinometry.model.warning import collected_warnings

GRID = np.stack(np.meshgrid(np.linspace(5, 1015, 9), np.linspace(5, 1015, 9)), -1)


def assert_same(one, other):
    assert (one.width, one.height, one.focal_mm) == pytest.approx((other.width, other.height, other.focal_mm))
    np.testing.assert_allclose(seen_pixels(one, GRID), seen_pixels(other, GRID), atol=1e-9)
    np.testing.assert_allclose(upright(one)[0].params, upright(other)[0].params, rtol=1e-12)
    np.testing.assert_allclose(upright(one)[1], upright(other)[1], atol=1e-12)


@pytest.mark.data
@needs_spice
@pytest.mark.parametrize(
    ("folder", "name", "filters"),
    [
        ("dawn_fc_ceres", "dawn-fc1", "12345678"),
        ("dawn_fc_ceres", "dawn-fc2", "12345678"),
        ("hayabusa_amica_itokawa", "hayabusa-amica", ("V",)),
        ("osiris_rex_mapcam_bennu", "orex-mapcam", ("PAN",)),
        ("osiris_rex_mapcam_bennu", "orex-samcam", ("PAN1",)),
    ],
)
def test_the_table_says_what_the_kernels_say(folder, name, filters):
    camera = CAMERAS[name]
    with loaded_kernels([SPICE / folder]) as kernels:
        for filter_name in filters:
            found = detector_from_keywords(
                kernels.keywords_of(camera.code_with_filter(filter_name)),
                camera.code_with_filter(filter_name),
                filter_name,
                (1024, 1024),
            )
            assert_same(camera.in_cube_order(filter_name), found)


@pytest.mark.data
@needs_spice
@pytest.mark.parametrize(
    ("folder", "name", "filter_name"),
    [
        ("dawn_fc_ceres", "dawn-fc2", "6"),
        ("hayabusa_amica_itokawa", "hayabusa-amica", "V"),
        ("osiris_rex_mapcam_bennu", "orex-mapcam", "PAN"),
    ],
)
def test_instrument_kernels_without_isis_s_addendum_mean_the_same_camera(folder, name, filter_name):
    """NAIF's kernels tell neither how the detector is turned nor OCAMS's distortion: MapCam came out mirrored and
    turned by a quarter, AMICA mirrored, without a word."""
    camera = CAMERAS[name]
    files = [file for file in kernel_files([SPICE / folder]) if "addendum" not in file.name.lower()]
    with loaded_kernels(files) as kernels:
        found = detector_from_keywords(
            kernels.keywords_of(camera.code_with_filter(filter_name)),
            camera.code_with_filter(filter_name),
            filter_name,
            (1024, 1024),
            camera.in_cube_order(filter_name),
        )
    assert_same(camera.in_cube_order(filter_name), found)


@pytest.mark.data
@needs_formats
@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("osirisRexImages/20200303T213031S138_ncm_L0-reduced.cub", "orex-navcam"),
        ("osirisRexImages/20201020T214241S004_nft_L0-reduced.cub", "orex-nftcam"),
        ("phocube/20190425T211232S312_map_iofL2pan-crop.cub", "orex-mapcam"),
    ],
)
def test_the_table_says_what_cubes_say(path, name):
    product = read_product(FORMATS / path)
    facts = read_facts(product)
    camera = known_camera(facts)
    assert camera.name == name
    assert camera.code == facts.frame_code
    found = detector_from_keywords(keywords_of_label(product.label), camera.code, facts.filter, (2592, 1944))
    assert_same(camera.in_cube_order(facts.filter), found)


@pytest.mark.parametrize("name", CAMERAS)
def test_every_camera_is_a_camera(name):
    """Upright, with its principal point near the middle, a distortion that moves pixels by less than a tenth of the
    image, and a source."""
    camera = CAMERAS[name]
    assert camera.source
    for detector in (camera.detector, *camera.filters.values()):
        pinhole, turn, _ = upright(detector)
        assert np.linalg.det(turn) == pytest.approx(1.0)
        assert np.abs(np.array(pinhole.principal_px) - [pinhole.width / 2, pinhole.height / 2]).max() < 60
        size = np.array([detector.width, detector.height])
        corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * size
        assert np.linalg.norm(seen_pixels(detector, corners) - corners, axis=-1).max() < 0.1 * np.hypot(*size)


FIELDS_DEG = {
    "dawn-fc1": 5.47,
    "dawn-fc2": 5.47,
    "orex-polycam": 0.79,
    "orex-mapcam": 3.98,
    "orex-samcam": 20.45,
    "near-msi": 2.93,
    "hayabusa-amica": 5.83,
    "hayabusa2-onc-t": 6.27,
    "hayabusa2-onc-w1": 65.24,
    "hayabusa2-onc-w2": 65.24,
    "rosetta-nac": 2.2,
    "rosetta-wac": 11.9,
    "rosetta-navcam": 5.0,
}
"""Width of the field of view as instrument descriptions print it."""


@pytest.mark.parametrize("name", FIELDS_DEG)
def test_fields_of_view_are_those_that_the_missions_print(name):
    """Of the pinhole, to 2 %, which tells a wrong focal length or pitch, not a fine one."""
    detector = CAMERAS[name].detector
    edges = np.array([[0.0, detector.height / 2], [detector.width, detector.height / 2]])
    rays = upright(detector)[0].ray_in_cam(edges)
    cosine = rays[0] @ rays[1] / np.linalg.norm(rays[0]) / np.linalg.norm(rays[1])
    assert np.degrees(np.arccos(cosine)) == pytest.approx(FIELDS_DEG[name], rel=0.02)


def test_binned_images_see_as_wide_as_whole_ones():
    whole = CAMERAS["orex-mapcam"].with_filter("PAN")
    half = fitted(whole, 512, 512)
    np.testing.assert_allclose(seen_pixels(half, GRID / 2) * 2, seen_pixels(whole, GRID), atol=1e-9)


def test_near_s_tall_pixels_see_as_high_as_square_ones():
    camera = CAMERAS["near-msi"]
    tall = upright(fitted(camera.detector, 537, 244, camera.raw_lines))[0]
    assert tall.params[1] / 244 == pytest.approx(upright(camera.detector)[0].params[1] / 412)
    assert 0.027 * tall.params[1] == pytest.approx(167.35)


@pytest.mark.parametrize("size", [(100, 100), (512, 500), (2048, 2048), (1024, 512)])
def test_parts_of_a_detector_are_refused(size):
    with pytest.raises(InputError, match=f"is {size[0]} x {size[1]} pixels, but its camera has 1024 x 1024"):
        fitted(CAMERAS["dawn-fc2"].detector, *size)


def test_cameras_are_known_by_what_labels_call_them():
    assert known_camera(Facts(instrument="FC2", spacecraft="DAWN")).name == "dawn-fc2"
    assert known_camera(Facts(instrument="NAVCam", spacecraft="OSIRIS-REX")).name == "orex-navcam"
    assert known_camera(Facts(instrument="NAVCAM", spacecraft="ROSETTA-ORBITER")).name == "rosetta-navcam"
    assert known_camera(Facts(instrument="FC2", spacecraft="VOYAGER")) is None
    assert known_camera(Facts()) is None
    with pytest.raises(InputError, match=r"no camera 'dawn-fc3'.*dawn-fc2.*rosetta-navcam"):
        camera_named("dawn-fc3")


def test_filters_go_by_any_of_their_names():
    camera = CAMERAS["dawn-fc2"]
    assert camera.code_with_filter("6") == camera.code_with_filter("NIR_F6") == -203126
    assert camera.with_filter("F8").focal_mm == 150.38


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"FOCAL_LENGTH": ("x",)}, "INS-1_FOCAL_LENGTH is"),
        ({"CCD_CENTER": (5.0,)}, "INS-1_CCD_CENTER is .* expected 2"),
        ({"ITRANSS": (0.0, 10.0, 5.0)}, "not at right angles"),
    ],
)
def test_keywords_that_are_no_camera_s_are_refused(keywords, message):
    good = {
        "FOCAL_LENGTH": (100.0,),
        "CCD_CENTER": (511.5, 511.5),
        "ITRANSS": (0.0, 100.0, 0.0),
        "ITRANSL": (0.0, 0.0, 100.0),
    }
    held = {f"INS-1_{key}": value for key, value in (good | keywords).items()}
    with pytest.raises(InputError, match=message):
        detector_from_keywords(held, -1, None, (1024, 1024))


PLAIN = {
    "INS-1_FOCAL_LENGTH": (100.0,),
    "INS-1_CCD_CENTER": (511.5, 511.5),
    "INS-1_ITRANSS": (0.0, 100.0, 0.0),
    "INS-1_ITRANSL": (0.0, 0.0, 100.0),
}


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"DIST_X": (0.0, 1.002, 0.0), "DIST_Y": (0.0, 0.0, 1.0)}, r"^INS-1_DIST_X, INS-1_DIST_Y: .* not known here"),
        ({"OD_T_X": (0.0, 1.002, *[0.0] * 8)}, r"^INS-1_OD_T_X: is a distortion that lacks INS-1_OD_T_Y"),
        ({"DISTORTION_COEF_X": (0.0, 1e-5)}, r"^INS-1_DISTORTION_COEF_X: .*--undistorted"),
        ({"K1": (-2.5e-5,)}, r"^INS-1_K1: .* not known here"),
        ({"OD_K": (0.0, 1e-5, 0.0), "DECENTER": (1e-7, 0.0, 2.9)}, r"^INS-1_DECENTER: .* lacks INS-1_PP"),
        ({"DISTORTION_MODEL": ("KAGUYALISM",)}, r"^INS-1_DISTORTION_MODEL is KAGUYALISM, and its coeff.*missing"),
        (
            {"OPENCV_OD_K": (0.1, 0, 0, 0, 0, 0), "OPENCV_OD_P": (0.0, 0.0)},
            r"INS-1_OPENCV_OD_F, INS-1_OPENCV_OD_C;",
        ),
        ({"OD_K_RED": (0.0, 1e-5, 0.0)}, r"^INS-1_OD_K_RED: is the distortion of other filters .*\(BLUE\)"),
    ],
)
def test_a_distortion_that_is_not_understood_is_refused(keywords, message):
    held = PLAIN | {f"INS-1_{key}": value for key, value in keywords.items()}
    with pytest.raises(InputError, match=message):
        detector_from_keywords(held, -1, "BLUE", (1024, 1024))
    found = detector_from_keywords(held, -1, "BLUE", (1024, 1024), undistorted=True)
    assert upright(found)[0].params == (10000.0, 10000.0, 512.0, 512.0)


OPENCV = {
    "INS-1_DISTORTION_MODEL": ("OCAMS",),
    "INS-1_OPENCV_OD_K": (20.0, -5e4, 0.0, 0.0, 0.0, 0.0),
    "INS-1_OPENCV_OD_P": (-3e-3, -1e-3),
    "INS-1_OPENCV_OD_F": (73866.0, 72873.0),
    "INS-1_OPENCV_OD_C": (513.0, 513.0),
}


def test_a_distortion_that_the_addendum_rules_out_is_warned_of_where_the_table_has_the_camera():
    """PolyCam's addendum gives OpenCV's coefficients, and says that its model is OCAMS's, which it does not give."""
    with pytest.raises(
        InputError, match=r"^INS-1_OPENCV_OD_K, INS-1_OPENCV_OD_P: is not of the DISTORTION_MODEL OCAMS"
    ):
        detector_from_keywords(PLAIN | OPENCV, -1, None, (1024, 1024))
    table = CAMERAS["orex-polycam"].detector
    with collected_warnings() as warnings:
        found = detector_from_keywords(PLAIN | OPENCV, -1, None, (1024, 1024), table)
    assert found.distortion is None
    assert [warned.code for warned in warnings] == ["distortion-unused"]


@pytest.mark.parametrize(
    "keywords",
    [
        {},
        {"DISTORTION_MODEL": ("NONE",)},
        {"OD_K": (0.0, 0.0, 0.0)},
        {"FOV_REF_VECTOR": (1.0, 0.0, 0.0), "K": (200.0,), "OD_K_UNITS": ("MM",), "SOLAR_DISTANCE": (1.5,)},
    ],
)
def test_where_no_distortion_is_stated_there_is_none(keywords):
    held = PLAIN | {f"INS-1_{key}": value for key, value in keywords.items()}
    assert detector_from_keywords(held, -1, None, (1024, 1024)).distortion is None


def test_keywords_in_metres_micrometres_and_millimetres_mean_the_same():
    base = {"INS-1_CCD_CENTER": (511.5, 511.5)}
    found = [
        detector_from_keywords(base | extra, -1, None, (1024, 1024))
        for extra in (
            {"INS-1_FOCAL_LENGTH": (120.0,), "INS-1_PIXEL_PITCH": (0.012,)},
            {"INS-1_FOCAL_LENGTH": (0.12,), "INS-1_PIXEL_SIZE": (1.2e-5,)},
            {"INS-1_FOCAL_LENGTH": (120.0,), "INS-1_PIXEL_SIZE": (12.0, 12.0)},
        )
    ]
    for other in found[1:]:
        assert_same(found[0], other)
    assert detector_from_keywords(base, -1, None, (1024, 1024)) is None


@pytest.mark.parametrize("written", [511.5, 512.5])
def test_the_middle_of_a_detector_is_the_same_counted_from_0_and_from_1(written):
    """Hayabusa2's kernel has 512.5 for the middle of 1024 pixels; taken as counted from 0 it was a pixel off."""
    keywords = {"FOCAL_LENGTH": (121.1,), "PIXEL_SIZE": (0.013, 0.013), "CCD_CENTER": (written, written)}
    found = detector_from_keywords({f"INS-1_{k}": v for k, v in keywords.items()}, -1, None, (1024, 1024))
    assert found is not None
    assert found.center == (512.0, 512.0)


def test_the_clock_of_near_s_labels_is_in_milliseconds_as_its_kernel_counts():
    assert CAMERAS["near-msi"].clock_of_kernel("126865998.830") == "126865998830"
    assert CAMERAS["near-msi"].clock_of_kernel(None) is None
    assert CAMERAS["dawn-fc2"].clock_of_kernel("488002615.193") == "488002615.193"


def test_osiris_sees_the_spacecraft_s_x_downwards_in_displayed_images():
    """FK: columns along x, lines along y. Archive: turned by 180 degrees, x is up and y is right."""
    for name in ("rosetta-nac", "rosetta-wac"):
        _, cam_from_instrument, turned = upright(CAMERAS[name].detector)
        assert not turned
        np.testing.assert_allclose(cam_from_instrument, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])


def test_a_binning_that_is_not_whole_is_no_binning():
    with pytest.raises(InputError, match="is 400 x 400"):
        fitted(CAMERAS["hayabusa-amica"].detector, 400, 400)
