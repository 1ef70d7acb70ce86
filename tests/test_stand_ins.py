"""Files of the archives' formats with kernels: camera, pose, Sun and pixels are those that SPICE gives."""

from dataclasses import replace

import numpy as np
import pytest

from archives import SHARED, needs_formats, needs_spice
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.model.geometry import unit
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.simulate.bodies.surface import BodyRaycaster
from photoclinometry.simulate.camera_model import pixel_average
from photoclinometry.simulate.observe import radiance
from photoclinometry.simulate.photometry import named_photometry, radiance_factor

spice = pytest.importorskip("spiceypy")
pytest.importorskip("embreex")

SIZE = 128
SPACING_M = 10.0
PHOTOMETRY = named_photometry("mcewen", "bennu")
"""That of the stand-ins."""


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Three images of the whole body, of 8 x 8 pixels of the detector each."""
    from stand_ins import Campaign, write_archive

    folder = tmp_path_factory.mktemp("ocams")
    campaign = Campaign(size=SIZE, close_ups=3, others=0, distance_m=10_000.0)
    write_archive(folder, "mapcam", SHARED, campaign, SPACING_M)
    return folder


def ingested(archive, tmp_path, pattern, **more):
    options = IngestOptions(kernels=(archive / "kernels",), **more)
    return ingest(sorted(archive.glob(pattern)), tmp_path / "site", options)


@pytest.mark.data
@needs_spice
def test_labels_and_bare_fits_files_give_the_same_site(archive, tmp_path):
    labels = ingested(archive, tmp_path / "a", "pds4/*.xml")
    alone = ingested(archive, tmp_path / "b", "images/*.fits")
    assert labels.site.read_text() == alone.site.read_text()
    for exposure, other in zip(labels.exposures, alone.exposures, strict=True):
        assert (exposure.body, exposure.brightness) == (other.body, other.brightness) == ("bennu", "iof")
        np.testing.assert_array_equal(exposure.image.brightness, other.image.brightness)


@pytest.mark.data
@needs_spice
def test_the_pose_is_that_of_the_middle_of_the_exposure(archive, tmp_path):
    """By the time in the file's name and half of 5 ms; the camera's x axis lies along FITS samples as NAIF has them."""
    from stand_in_kernels import furnished

    exposure = ingested(archive, tmp_path, "pds4/*.xml").exposures[0]
    with furnished(sorted((archive / "kernels").iterdir())):
        name = exposure.path.name
        utc = f"{name[:4]}-{name[4:6]}-{name[6:11]}:{name[11:13]}:{name[13:15]}.{name[16:19]}"
        time = spice.str2et(utc) + 0.5 * 0.005285275
        turn = spice.pxform("IAU_BENNU", "ORX_OCAMS_MAPCAM", time)
        place = spice.spkpos("ORX", time, "IAU_BENNU", "NONE", "BENNU")[0]
        sun = unit(spice.spkpos("SUN", time, "IAU_BENNU", "LT+S", "BENNU")[0])
        samples = spice.gdpool("INS-64361_SPOC_FITS_NAXIS1", 0, 3)
    pose = exposure.prior.cam_from_body
    np.testing.assert_allclose(pose.rotation[0], samples @ turn, atol=1e-6)
    np.testing.assert_allclose(pose.rotation[2], turn[2], atol=1e-6)
    # Light takes 33 us from here; seen from a spacecraft at 33 km/s the body is off by 1.1 m at 10 km.
    assert np.linalg.norm(pose.inverse().translation - 1000.0 * place) < 1.5
    np.testing.assert_allclose(pose.rotation.T @ exposure.sun, sun, atol=1e-6)


@pytest.mark.data
@needs_spice
def test_lit_ground_lies_in_the_file_where_naif_s_axes_of_fits_files_put_it(archive):
    from astropy.io import fits

    from stand_in_files import MAPCAM
    from stand_in_kernels import furnished, instrument_from_body, sun_from_body
    from stand_ins import bennu_like

    surface = bennu_like(SPACING_M)
    path = sorted(archive.glob("images/*.fits"))[0]
    with fits.open(path) as hdus:
        image, clock = hdus[0].data, hdus[0].header["SCLK_STR"]
    with furnished(sorted((archive / "kernels").iterdir())):
        time = spice.scs2e(-64, clock)
        pose, sun = instrument_from_body(MAPCAM, time), sun_from_body(MAPCAM, time)
        axes = np.array([spice.gdpool(f"INS-64361_SPOC_FITS_NAXIS{k}", 0, 3) for k in (1, 2)])
        focal_px = spice.gdpool("INS-64361_FOCAL_LENGTH", 0, 1)[0] / 0.0085 * SIZE / 1024
    center = pose.inverse().translation
    facing = np.sum(surface.normals * unit(center - surface.vertices), -1)
    shown = (facing > 0.2) & (surface.normals @ sun > 0.2)
    angles = photometric_angles(sun, center, surface.vertices[shown], surface.normals[shown])
    expected = radiance_factor(PHOTOMETRY, surface.albedo[shown], *angles)
    points = pose(surface.vertices[shown])
    col, row = np.floor(SIZE / 2 + focal_px * (points @ axes.T) / points[:, 2:]).astype(int).T
    assert np.ptp(col) > 60
    assert np.ptp(row) > 60

    def likeness(picture):
        return np.corrcoef(picture[row, col], expected)[0, 1]

    assert likeness(image) > 0.8
    for other in (image[::-1], image[:, ::-1], image[::-1, ::-1], image.T):
        assert likeness(other) < 0.6


def assert_seen_by_a_pinhole(exposures, surface, gain=1.0):
    """Upright and without distortion: simulated through the site's camera instead of the detector's, within 2 %."""
    tracer = BodyRaycaster(surface)
    for exposure in exposures:
        pose = exposure.prior.cam_from_body.inverse()
        sun = unit(pose.rotation @ exposure.sun)
        fine, _ = radiance(tracer, exposure.camera, pose, sun, PHOTOMETRY, 3, 2)
        expected = gain * pixel_average(fine, 3, 2, 0.5)
        shown, valid = exposure.image.brightness, exposure.image.valid & (expected > 0.4 * np.median(expected))
        assert valid.sum() > 2000
        assert np.corrcoef(shown[valid], expected[valid])[0, 1] > 0.99
        assert np.median(np.abs(shown[valid] / expected[valid] - 1.0)) < 0.02


@pytest.mark.data
@needs_spice
def test_the_ingested_image_is_what_a_pinhole_at_that_pose_sees(archive, tmp_path):
    from stand_ins import bennu_like

    assert_seen_by_a_pinhole(ingested(archive, tmp_path, "images/*.fits").exposures, bennu_like(SPACING_M))


@pytest.mark.data
@needs_spice
def test_a_label_of_dawn_with_its_fits_file_is_read_in_the_same_way(tmp_path):
    """Of radiance, whose lines run upwards; the clock counts from 0.193 s before the exposure."""
    from stand_ins import SURVEY, ceres_like, write_archive

    spacing = 20_000.0
    write_archive(tmp_path, "fc2", SHARED, replace(SURVEY, size=SIZE, close_ups=3), spacing)
    exposures = ingested(tmp_path, tmp_path, "images/*.LBL").exposures
    assert {(e.body, e.brightness) for e in exposures} == {("ceres", "dn")}
    assert_seen_by_a_pinhole(exposures, ceres_like(spacing), gain=0.05)


OTHERS = {
    "amica": ("images/*.lbl", {}, 4000.0, "itokawa"),
    "onc-t": ("images/*.fit", {"undistorted": True}, 1.0, "ryugu"),
    "nac": ("images/N*.IMG", {"body": "67P/C-G", "undistorted": True}, 1.0, "67p/c-g"),
    "msi": ("images/*_iof.lbl", {}, 1.0, "eros"),
}
"""The files of an archive, options, the number for I/F 1, and the body."""


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """A function that makes three images of a small, coarse campaign of each archive, once."""
    from stand_ins import ARCHIVES, write_archive

    made = {}

    def of(name):
        if name not in made:
            made[name] = tmp_path_factory.mktemp(name)
            archive = ARCHIVES[name]
            campaign = replace(archive.campaign, close_ups=3, others=0)
            write_archive(made[name], name, SHARED, campaign, 8 * archive.spacing_m)
        return made[name]

    return of


@pytest.mark.data
@needs_spice
@needs_formats
@pytest.mark.parametrize("name", OTHERS)
def test_files_of_other_archives_come_out_as_a_pinhole_sees_the_body(others, tmp_path, name):
    """AMICA: the clock in the header, mirrored; ONC: an extension, free of distortion; NAC: turned by a quarter,
    displayed upwards; MSI: tall pixels, another axis, a clock in milliseconds."""
    from stand_ins import ARCHIVES

    pattern, options, gain, body = OTHERS[name]
    exposures = ingested(others(name), tmp_path, pattern, **options).exposures
    assert len(exposures) == 3
    assert {e.body for e in exposures} == {body}
    assert {e.brightness for e in exposures} == {"dn" if name == "amica" else "iof"}
    assert_seen_by_a_pinhole(exposures, ARCHIVES[name].surface(8 * ARCHIVES[name].spacing_m), gain)


@pytest.mark.data
@needs_spice
def test_a_cube_of_amica_is_the_same_exposure_as_its_label(others, tmp_path):
    """But for the boresight: ISIS counts the kernel's 511.5 from 1: a pixel of the detector, an eighth of one here."""
    label = ingested(others("amica"), tmp_path / "a", "images/*.lbl").exposures[0]
    cubes = sorted(others("amica").glob("cubes/*.cub"))
    cube = ingest(cubes, tmp_path / "b", IngestOptions()).exposures[0]
    assert cube.sources == {"camera": "ISIS keywords", "sun": "ISIS tables", "pose": "ISIS tables"}
    np.testing.assert_allclose(np.subtract(cube.camera.principal_px, label.camera.principal_px), [-0.125, 0.125])
    np.testing.assert_allclose(cube.sun, label.sun, atol=1e-6)
    places = [e.prior.cam_from_body.inverse().translation for e in (cube, label)]
    # The label counts 1/32 s, in which the ground below the camera turns by 0.2 m.
    assert np.linalg.norm(places[0] - places[1]) < 0.3


@pytest.mark.data
@needs_spice
@needs_formats
def test_near_s_labels_and_kernels_give_the_same_sun(others, tmp_path):
    """By the label's attitude and place alone, without kernels; of PDS3 labels and deblurred files with PDS4 labels."""
    posed = ingested(others("msi"), tmp_path / "a", "images/*_iof.lbl").exposures[0]
    for pattern, height in (("images/*_iof.lbl", 244), ("images/*_cif_gbl.xml", 412)):
        bare = ingest(sorted(others("msi").glob(pattern)), tmp_path / pattern[-6:], IngestOptions()).exposures[0]
        assert bare.sources["sun"] == "label"
        assert bare.prior is None
        assert bare.image.brightness.shape == (height, 537)
        # From the Sun's centre to the spacecraft, without light time: a tenth of a milliradian.
        np.testing.assert_allclose(bare.sun, posed.sun, atol=2e-4)


@pytest.mark.data
@needs_spice
def test_the_navcam_counts_seconds_and_is_posed_by_the_same_attitudes(others, tmp_path):
    options = {"body": "67P/C-G"}
    nac = ingested(others("nac"), tmp_path / "a", "images/N*.IMG", **options).exposures[0]
    navcam = ingested(others("nac"), tmp_path / "b", "images/ROS_CAM1_*.LBL", **options).exposures[0]
    assert navcam.brightness == "dn"
    places = [e.prior.cam_from_body.inverse().translation for e in (nac, navcam)]
    np.testing.assert_allclose(places[0], places[1], atol=1.0)
