"""Files to a site: every real file ingested or refused for the right reason, made-up ones followed digit by digit."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from scipy.spatial.transform import Rotation

from archives import FORMATS, SPICE, geometry_tables, needs_formats, needs_spice, texture, write_cube, write_pds3
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.images import write_fits, write_png
from photoclinometry.io.models.sumfile import sumfile_of_view, write_sumfile
from photoclinometry.io.site import read_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import Rigid, so3_exp, unit
from photoclinometry.model.scene import Camera

INGESTED = {
    "near/msi2isis/m0126865998f4_2p_iof.lbl": (244, 537, "iof", "label"),
    "near/msi2isis/m0126865998f4_2p_iof.fit": (244, 537, "iof", "label"),
    "near/msi2isis/m0157063318f4_2p_iof_gbl.lbl": (412, 537, "iof", "label"),
    "near/msi2isis/m0157063318f4_2p_iof_gbl.fit": (412, 537, "iof", "label"),
    "near/msi2isis/image.fit": (244, 537, "iof", "label"),
    "near/msi2isis/label7.lbl": (244, 537, "iof", "label"),
    "pds4/m0154651923f6_2p_cif_gbl.xml": (412, 537, "iof", "label"),
    "pds4/m0154651923f6_2p_cif_gbl.lbl": (412, 537, "iof", "label"),
    "pds4/m0154651923f6_2p_cif_gbl.fit": (412, 537, "iof", "label"),
    "osirisRexImages/20200303T213031S138_ncm_L0-reduced.cub": (194, 259, "dn", "ISIS tables"),
    "osirisRexImages/20201020T214241S004_nft_L0-reduced.cub": (194, 259, "dn", "ISIS tables"),
    "phocube/20190425T211232S312_map_iofL2pan-crop.cub": (100, 100, "iof", "ISIS tables"),
}
REFUSED = {
    "near/msi2isis/label1.lbl": r"instrument 'InvalidInstrumentId'.*--camera",
    "near/msi2isis/label2.lbl": "says 1 lines of 537 samples, but .* holds 244 of 537",
    "near/msi2isis/label3.lbl": "says 244 lines of 1 samples, but .* holds 244 of 537",
    "near/msi2isis/label5.lbl": "first line on top.*unlike all files of near-msi.*--lines up",
    "near/msi2isis/label6.lbl": "projected onto a map",
    "osirisRexImages/20200303T213031S138_ncm_L0.pvl": "ends after 4904 bytes",
    "osirisRexImages/20201020T214241S004_nft_L0.pvl": "ends after 4904 bytes",
    "lronacpho/M143947267L.cal.echo.crop.cub": r"line scanner's image \(NACL\)",
    "lronacpho/NAC_PHO_LROC_Empirical.0001.pvl": "is no PDS3 or PDS4 label, ISIS cube",
    "lronacpho/NAC_PHO_LROC_Empirical.0002.pvl": "is no PDS3 or PDS4 label, ISIS cube",
    "lronacpho/NAC_PHO_LROC_Empirical.0003.pvl": "is no PDS3 or PDS4 label, ISIS cube",
    "pds3/TC1S2B0_01_00811N526E0443_mini.img": r"line scanner's image \(TC1\)",
    "pds3/TC1S2B0_01_00811N526E0443_mini.lbl": r"line scanner's image \(TC1\)",
    "pds3/TC1S2B0_01_05186N225E0040_mini.img": r"line scanner's image \(TC1\)",
    "pds3/TC1S2B0_01_05186N225E0040_mini.lbl": r"line scanner's image \(TC1\)",
    "pds3/h7926_0009_s22_cropped.img": r"line scanner's image \(HRSC\)",
    "pds3/nacl.img": r"line scanner's image \(LROC\)",
    "pds3/nacr.img": r"line scanner's image \(LROC\)",
    "spc/Bennu49k.obj": "is no PDS3 or PDS4 label, ISIS cube",
    "spc/M605862153F5.SUM": "is no PDS3 or PDS4 label, ISIS cube",
    "spc/N2395699394.SUM": "is no PDS3 or PDS4 label, ISIS cube",
    "spc/ocams20190314t190123s972_map_iofl2pan_77236.png": "names none.*--pinhole.*; nothing tells where the Sun",
}
ODD = {"near/msi2isis/label4.lbl"}
"""Its samples are said to run from right to left, as the same camera's PDS4 labels say of the same order of bytes."""


@pytest.mark.data
@needs_formats
def test_every_real_file_has_its_place_in_the_two_tables():
    found = {str(p.relative_to(FORMATS)) for p in FORMATS.rglob("*") if p.is_file()}
    assert found == set(INGESTED) | set(REFUSED) | ODD


@pytest.mark.data
@needs_formats
@pytest.mark.parametrize("name", INGESTED)
def test_real_files_are_ingested(tmp_path, name):
    """Size, unit and source of the Sun; and the pixels: those of the file, less what is resampled away."""
    result = ingest([FORMATS / name], tmp_path / "site")
    (exposure,) = result.exposures
    lines, samples, unit_name, sun = INGESTED[name]
    assert exposure.image.brightness.shape == (lines, samples)
    assert (exposure.brightness, exposure.sources["sun"]) == (unit_name, sun)
    assert np.linalg.norm(exposure.sun) == pytest.approx(1.0)
    assert (exposure.prior is None) == (sun == "label")


@pytest.mark.data
@needs_formats
@pytest.mark.parametrize("name", REFUSED)
def test_real_files_are_refused_for_the_right_reason(tmp_path, name):
    with pytest.raises(InputError, match=f"{Path(name).name}: .*{REFUSED[name]}"):
        ingest([FORMATS / name], tmp_path / "site")
    assert not (tmp_path / "site").exists()


@pytest.mark.data
@needs_formats
def test_the_written_images_have_the_pixels_of_the_files(tmp_path):
    """NEAR's images are neither turned nor resampled; FITS headers' pixels by astropy are the independent reading."""
    names = [
        "near/msi2isis/m0126865998f4_2p_iof",
        "near/msi2isis/m0157063318f4_2p_iof_gbl",
        "pds4/m0154651923f6_2p_cif_gbl",
    ]
    result = ingest([FORMATS / f"{n}.lbl" for n in names], tmp_path / "site")
    site = read_site(result.site)
    assert (site.body, site.brightness, len(site.views)) == ("eros", "iof", 3)
    for image, name in zip(load_images(site), names, strict=True):
        with fits.open(FORMATS / f"{name}.fit", ignore_missing_end=True) as hdus:
            np.testing.assert_array_equal(image.brightness[image.valid], hdus[0].data[image.valid])


@pytest.mark.data
@needs_formats
def test_saturated_pixels_of_a_real_cube_are_masked_around(tmp_path):
    """TAGCAMS digitises 12 bits: 4095 is the top. Undistorted, more pixels draw on the saturated ones."""
    from photoclinometry.io.archives.archive import read_product

    path = FORMATS / "osirisRexImages/20200303T213031S138_ncm_L0-reduced.cub"
    saturated = (read_product(path).image.brightness >= 4095).mean()
    (exposure,) = ingest([path], tmp_path / "site").exposures
    assert saturated > 0
    assert saturated < 1 - exposure.image.valid.mean() < 0.1


def with_pixels(label, path):
    """A real label with made-up pixels behind it, where it says that they are."""
    text = label.read_bytes()
    start, dtype = (25 * 512, "<u2") if b"PDS_VERSION_ID" in text else (65536, "<f4")
    pixels = (1000 * (1 + texture((1024, 1024)))).astype(dtype)
    path.write_bytes(text.ljust(start, b"\0") + pixels.tobytes() + bytes(200_000))
    return path


UPRIGHT = {
    "dawn_fc_ceres": (512.0, 0.014004, 0.013995, lambda s, l: (s, l)),
    "osiris_rex_mapcam_bennu": (512.0, 0.0085, 0.0085, lambda s, l: (s, 1024 - l)),
    "hayabusa_amica_itokawa": (511.0, 0.012, 0.012, lambda s, l: (s, 1024 - l)),
}
"""Boresight (that of AMICA counts from 1 in ISIS, and from 0 in the instrument kernel), pitch of samples and lines, and
the pixel of the upright image at a (sample, line) of ISIS's cube: MapCam's and AMICA's cubes are mirror images."""


@pytest.mark.data
@needs_spice
@pytest.mark.parametrize("mission", UPRIGHT)
def test_points_of_the_body_are_seen_where_the_published_camera_model_sees_them(tmp_path, mission):
    """The whole way from label and kernels to site.toml, against the expected pose, axes and boresight, by hand."""
    folder = SPICE / mission
    expected = json.loads((folder / "expected.json").read_text())
    boresight, pitch_x, pitch_y, upright = UPRIGHT[mission]
    label = folder / expected["labels"][0]
    ingest([with_pixels(label, tmp_path / "a.img")], tmp_path / "site", IngestOptions(kernels=(folder,)))
    view = tomllib.loads((tmp_path / "site" / "site.toml").read_text())
    prior = view["views"][0]["cam_from_body"]
    camera = Camera("PINHOLE", 1024, 1024, tuple(view["camera"]["params"]))
    cam_from_body = Rigid(
        Rotation.from_quat(prior["rotation_wxyz"], scalar_first=True).as_matrix(), np.array(prior["translation"])
    )

    position_km = np.array(expected["camera_position"]["value"])
    turn = np.array(expected["camera_from_body_matrix"]["value"])
    in_camera = np.array([[0.0, 0.0, 1.0], [0.02, -0.01, 1.0], [-0.015, -0.012, 1.0]]) * np.linalg.norm(position_km)
    body_km = position_km + in_camera @ turn
    focal = expected["focal_length"]["value"]
    x, y = (focal * in_camera[:, k] / in_camera[:, 2] for k in (0, 1))
    to_sample, to_line = (np.array(expected[f"focal2pixel_{k}"]["value"]) for k in ("samples", "lines"))
    sample = boresight + (np.sign(to_sample[1]) * x + np.sign(to_sample[2]) * y) / pitch_x
    line = boresight + (np.sign(to_line[1]) * x + np.sign(to_line[2]) * y) / pitch_y
    seen = camera.pixel_from_cam(cam_from_body(1000.0 * body_km))
    np.testing.assert_allclose(seen, np.stack(upright(sample, line), -1), atol=1e-4)

    sun = turn @ np.array(expected["sun_direction"]["value"])
    in_body = cam_from_body.rotation.T @ np.array(view["views"][0]["sun"])
    np.testing.assert_allclose(in_body, turn.T @ sun, atol=5e-6)


CAMERA = Camera("PINHOLE", 60, 40, (3000.0, 3000.0, 30.5, 19.5))
POSE = Rigid(so3_exp(np.array([0.2, -0.1, 0.4])), np.array([1.0, -2.0, -8.0]))
SUN = unit(np.array([1.0, -0.5, 0.3]))


def plain_images(folder, count=3):
    folder.mkdir(exist_ok=True)
    paths = []
    for k in range(count):
        paths.append(folder / f"2019030{k + 1}T101500.png")
        write_png(paths[-1], (texture(seed=k) * 1e6).astype(np.uint16))
    return paths


def suns_of(folder, paths, sigma=""):
    table = folder / "suns.csv"
    rows = "".join(f"{p.name},{0.6},{0.0},{-0.8},{sigma}\n" for p in paths)
    table.write_text("image,sun_x,sun_y,sun_z,sun_sigma_deg\n" + rows)
    return table


def test_plain_images_with_a_table_of_suns(tmp_path):
    paths = plain_images(tmp_path / "in")
    options = IngestOptions(suns=suns_of(tmp_path, paths, "0.2"), pinhole=(500.0, 510.0, 31.0, 20.0), body="Itokawa")
    result = ingest(paths, tmp_path / "site", options)
    site = read_site(result.site)
    assert (site.name, site.body, site.brightness) == ("site", "itokawa", "dn")
    for path, view, image in zip(paths, site.views, load_images(site), strict=True):
        assert view.camera.params == pytest.approx((500.0, 510.0, 31.0, 20.0))
        np.testing.assert_allclose(view.sun, [0.6, 0.0, -0.8], atol=1e-15)
        assert np.degrees(view.sun_sigma_rad) == pytest.approx(0.2)
        assert view.pose_prior is None
        seed = paths.index(path)
        np.testing.assert_array_equal(image.brightness, (texture(seed=seed) * 1e6).astype(np.uint16))
    sources = json.loads((tmp_path / "site" / "sources.json").read_text())
    assert [s["file"] for s in sources] == [p.name for p in paths]
    assert {s["sun"] for s in sources} == {"table of Suns"}


def test_lines_that_run_up_are_turned(tmp_path):
    paths = plain_images(tmp_path / "in", 1)
    options = IngestOptions(suns=suns_of(tmp_path, paths), pinhole=(500.0, 500.0, 30.0, 20.0), lines="up")
    (exposure,) = ingest(paths, tmp_path / "site", options).exposures
    np.testing.assert_array_equal(exposure.image.brightness, (texture() * 1e6).astype(np.uint16)[::-1])


@pytest.mark.parametrize(
    ("said", "lines", "turned"), [("UP", "label", False), ("UP", "up", True), ("DOWN", "label", False)]
)
def test_the_table_knows_the_lines_of_known_cameras_and_labels_those_of_others(tmp_path, said, lines, turned):
    """AMICA's files are described in the order of their bytes; of an unknown camera, the label has the say."""
    top = f"INSTRUMENT_ID = AMICA\r\nINSTRUMENT_HOST_NAME = HAYABUSA\r\nLINE_DISPLAY_DIRECTION = {said}\r\n"
    pixels = texture((1024, 1024))
    path = write_pds3(tmp_path / "a.img", pixels, sample_type="PC_REAL", top=top)
    options = IngestOptions(suns=suns_of(tmp_path, [path]), undistorted=True, lines=lines)
    (exposure,) = ingest([path], tmp_path / "known", options).exposures
    np.testing.assert_array_equal(exposure.image.brightness, pixels[::-1] if turned else pixels)
    path.write_bytes(path.read_bytes().replace(b"AMICA", b"OTHER"))
    options = IngestOptions(suns=options.suns, pinhole=(9000.0, 9000.0, 512.0, 512.0), lines=lines)
    (exposure,) = ingest([path], tmp_path / "other", options).exposures
    np.testing.assert_array_equal(exposure.image.brightness, pixels[::-1] if said == "UP" else pixels)


@pytest.mark.parametrize("by", ["name", "time"])
def test_a_sumfile_gives_camera_pose_and_sun(tmp_path, by):
    (path,) = plain_images(tmp_path / "in", 1)
    name, utc = ("20190301T101500", "2000 JAN 01 00:00:00") if by == "name" else ("M0001", "2019 MAR 01 10:15:01.500")
    summary = sumfile_of_view(name, CAMERA, POSE, SUN, utc=utc)
    (tmp_path / "sums").mkdir()
    write_sumfile(tmp_path / "sums" / f"{name}.SUM", summary)
    options = IngestOptions(sumfiles=(tmp_path / "sums",), body="bennu")
    (exposure,) = ingest([path], tmp_path / "site", options).exposures
    np.testing.assert_allclose(exposure.camera.params, CAMERA.params, rtol=1e-6)
    np.testing.assert_allclose(exposure.sun, POSE.rotation.T @ SUN, atol=1e-9)
    body_from_cam = exposure.prior.cam_from_body.inverse()
    np.testing.assert_allclose(body_from_cam.rotation, POSE.rotation, atol=1e-9)
    np.testing.assert_allclose(body_from_cam.translation, 1000.0 * POSE.translation, rtol=1e-9)
    assert exposure.prior.translation_sigma == pytest.approx(1000.0)
    assert exposure.prior.rotation_sigma_rad == pytest.approx(1e-3)


MAPCAM = """Group = Instrument
  SpacecraftName = OSIRIS-REX
  InstrumentId = MapCam
  TargetName = Bennu
End_Group
Group = BandBin
  FilterName = PAN
End_Group
Group = Kernels
  NaifFrameCode = -64361
End_Group
"""


def mapcam_cube(path, **changes):
    tables = geometry_tables([1, 0, 0, 0], [0.0, 0.0, -5.0], [1, 0, 0, 0], [0.6e8, 0.0, -0.8e8])
    return write_cube(path, **({"pixels": texture((1024, 1024)), "groups": MAPCAM, "tables": tables} | changes))


def test_a_cube_of_a_turned_and_mirrored_detector_comes_out_upright(tmp_path):
    """MapCam: samples along +Y, lines along +X. The lines are turned; so C is x = Y, y = -X of the instrument."""
    path = mapcam_cube(tmp_path / "a.cub")
    (exposure,) = ingest([path], tmp_path / "site", IngestOptions(undistorted=True)).exposures
    np.testing.assert_array_equal(exposure.image.brightness, texture((1024, 1024))[::-1])
    np.testing.assert_allclose(exposure.sun, [0.0, -0.6, -0.8], atol=1e-12)
    np.testing.assert_allclose(exposure.prior.cam_from_body.translation, [0.0, 0.0, 5000.0], atol=1e-9)
    assert exposure.prior.translation_sigma == pytest.approx(5.0)
    np.testing.assert_allclose(exposure.camera.params, [125.2 / 0.0085] * 2 + [512.0, 512.0])


def test_an_alpha_cube_s_camera_is_that_of_its_window(tmp_path):
    alpha = (
        "Group = AlphaCube\nAlphaStartingSample = 100.5\nAlphaStartingLine = 200.5\nAlphaEndingSample = 160.5\n"
        "AlphaEndingLine = 240.5\nBetaSamples = 60\nBetaLines = 40\nEnd_Group\n"
    )
    path = mapcam_cube(tmp_path / "a.cub", pixels=texture(), groups=MAPCAM + alpha)
    (exposure,) = ingest([path], tmp_path / "site").exposures
    assert exposure.camera.principal_px == pytest.approx((412.0, 40 - 312.0))


def test_radiance_becomes_i_over_f(tmp_path):
    """I/F = pi I d^2 / F; 2 AU and F = 1500 by hand: a radiance of 10 is 0.0837758."""
    top = "INSTRUMENT_ID = FC2\r\nINSTRUMENT_HOST_ID = DAWN\r\nSPACECRAFT_SOLAR_DISTANCE = 299195741.4 <km>\r\n"
    path = write_pds3(
        tmp_path / "a.img",
        np.full((1024, 1024), 10.0, "<f4"),
        sample_type="PC_REAL",
        top=top,
        extra="  UNIT = 'W/(m**2 sr micron)'\r\n",
    )
    table = suns_of(tmp_path, [path])
    options = IngestOptions(suns=table, undistorted=True, solar_flux=1500.0)
    (exposure,) = ingest([path], tmp_path / "site", options).exposures
    assert exposure.brightness == "iof"
    np.testing.assert_allclose(exposure.image.brightness, np.pi * 10.0 * 4.0 / 1500.0, rtol=1e-6)
    (exposure,) = ingest([path], tmp_path / "dn", IngestOptions(suns=table, undistorted=True)).exposures
    assert exposure.brightness == "dn"


def test_a_label_and_its_image_count_once(tmp_path):
    (tmp_path / "in").mkdir()
    label, data = tmp_path / "in" / "a.lbl", tmp_path / "in" / "a.img"
    write_pds3(label, texture(), sample_type="PC_REAL", detached=data)
    options = IngestOptions(suns=suns_of(tmp_path, [label]), pinhole=(500.0, 500.0, 30.0, 20.0))
    assert len(ingest([data, label, label], tmp_path / "site", options).exposures) == 1


def test_all_faults_are_told_at_once_or_left_out(tmp_path):
    good = plain_images(tmp_path / "in", 2)
    bad = [tmp_path / "in" / "no.fits", tmp_path / "in" / "empty.cub"]
    bad[1].touch()
    options = IngestOptions(suns=suns_of(tmp_path, good), pinhole=(500.0, 500.0, 30.0, 20.0))
    with pytest.raises(
        InputError, match=r"2 of 4 files cannot be used.*\n.*no\.fits: there is no such.*\n.*empty\.cub"
    ):
        ingest(good + bad, tmp_path / "site", options)
    assert not (tmp_path / "site").exists()
    options = IngestOptions(suns=options.suns, pinhole=options.pinhole, keep_going=True)
    result = ingest(good + bad, tmp_path / "site", options)
    assert len(result.exposures) == 2
    assert [Path(r.split(":")[0]).name for r in result.refused] == ["no.fits", "empty.cub"]


def test_images_of_the_same_name_get_names_of_their_own(tmp_path):
    first, second = plain_images(tmp_path / "a", 1)[0], plain_images(tmp_path / "b", 1)[0]
    options = IngestOptions(suns=suns_of(tmp_path, [first]), pinhole=(500.0, 500.0, 30.0, 20.0))
    site = read_site_of(ingest([first, second], tmp_path / "site", options))
    assert [v["image"] for v in site] == ["images/20190301T101500.fits", "images/20190301T101500-2.fits"]


def read_site_of(result):
    return tomllib.loads(result.site.read_text())["views"]


class TestWhatIsMissingIsSaid:
    """Each complaint names the file and what to pass."""

    def complaint(self, paths, folder, **options):
        with pytest.raises(InputError) as error:
            ingest(paths, folder / "site", IngestOptions(**options))
        return str(error.value)

    def test_no_camera_and_no_sun(self, tmp_path):
        (path,) = plain_images(tmp_path / "in", 1)
        said = self.complaint([path], tmp_path)
        assert said.startswith(str(path))
        for word in ("--camera", "--pinhole", "--sumfiles", "--kernels", "--suns"):
            assert word in said

    def test_no_sun_alone(self, tmp_path):
        said = self.complaint(plain_images(tmp_path / "in", 1), tmp_path, pinhole=(500.0, 500.0, 30.0, 20.0))
        assert "nothing tells where the Sun stood" in said
        assert "camera is not known" not in said

    def test_part_of_a_detector(self, tmp_path):
        path = mapcam_cube(tmp_path / "a.cub", pixels=texture())
        said = self.complaint([path], tmp_path)
        assert "is 60 x 40 pixels, but its camera has 1024 x 1024" in said

    def test_a_camera_that_looks_away_from_the_body(self, tmp_path):
        """As when the boresight is along another axis than thought; Sun and shadows would be wrong, too."""
        tables = geometry_tables([1, 0, 0, 0], [5.0, 0.0, 0.1], [1, 0, 0, 0], [0.6e8, 0.0, -0.8e8])
        said = self.complaint([mapcam_cube(tmp_path / "a.cub", tables=tables)], tmp_path, undistorted=True)
        assert "would look 91 degrees past the body's centre" in said

    def test_mixed_units(self, tmp_path):
        write_fits(tmp_path / "a_iof.fits", texture((1024, 1024)))
        write_fits(tmp_path / "b.fits", texture((1024, 1024), 1))
        paths = [tmp_path / "a_iof.fits", tmp_path / "b.fits"]
        options = {"suns": suns_of(tmp_path, paths), "camera": "dawn-fc2", "undistorted": True}
        said = self.complaint(paths, tmp_path, **options)
        assert said.startswith(f"{paths[1]}: is not known to be I/F")
        result = ingest(paths, tmp_path / "site", IngestOptions(uncalibrated=True, **options))
        assert {e.brightness for e in result.exposures} == {"dn"}

    def test_radiance_without_distance(self, tmp_path):
        path = write_pds3(
            tmp_path / "a.img", texture(), sample_type="PC_REAL", extra="  UNIT = 'W/(m**2 sr micron)'\r\n"
        )
        options = {"suns": suns_of(tmp_path, [path]), "pinhole": (500.0, 500.0, 30.0, 20.0), "solar_flux": 1500.0}
        assert "without the distance from the Sun" in self.complaint([path], tmp_path, **options)

    def test_two_bodies(self, tmp_path):
        paths = [
            mapcam_cube(tmp_path / "a.cub"),
            mapcam_cube(tmp_path / "b.cub", groups=MAPCAM.replace("Bennu", "Ryugu")),
        ]
        assert "the images show bennu, ryugu" in self.complaint(paths, tmp_path, undistorted=True)

    def test_a_sumfile_that_counts_lines_upwards(self, tmp_path):
        """Such an image would be a mirror image, or its lines run up: only a person can know."""
        (path,) = plain_images(tmp_path / "in", 1)
        summary = sumfile_of_view("20190301T101500", CAMERA, POSE, SUN, utc="2019 MAR 01 10:15:00.5")
        up = replace(summary, k_matrix=(*summary.k_matrix[:4], -summary.k_matrix[4], 0.0))
        write_sumfile(tmp_path / "A.SUM", up)
        said = self.complaint([path], tmp_path, sumfiles=(tmp_path / "A.SUM",))
        assert "--lines down" in said
        options = IngestOptions(sumfiles=(tmp_path / "A.SUM",), lines="down")
        (exposure,) = ingest([path], tmp_path / "site", options).exposures
        np.testing.assert_array_equal(exposure.image.brightness[::-1], (texture() * 1e6).astype(np.uint16))
        np.testing.assert_allclose(exposure.prior.cam_from_body.rotation, POSE.rotation.T, atol=1e-9)

    def test_two_sumfiles_for_one_image(self, tmp_path):
        (path,) = plain_images(tmp_path / "in", 1)
        for name in ("A", "B"):
            summary = sumfile_of_view(name + "XX", CAMERA, POSE, SUN, utc="2019 MAR 01 10:15:00.5")
            write_sumfile(tmp_path / f"{name}.SUM", summary)
        said = self.complaint([path], tmp_path, sumfiles=(tmp_path / "A.SUM", tmp_path / "B.SUM"))
        assert "could belong to A.SUM or B.SUM" in said

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("image,sun_x,sun_y\n", "no column 'sun_z'"),
            ("image,sun_x,sun_y,sun_z\na.png,1,0,x\n", "line 2: sun_z is 'x'"),
            ("image,sun_x,sun_y,sun_z\na.png,1,1,0\n", "line 2: the Sun has length 1.41421"),
            ("image,sun_x,sun_y,sun_z\na.png,1,0\n", "line 2: sun_z is None"),
            ("image,sun_x,sun_y,sun_z\na.png,1,0,0\na.png,1,0,0\n", "line 3: 'a.png' stands there twice"),
            ("image,sun_x,sun_y,sun_z,sun_sigma_deg\na.png,1,0,0,-1\n", "sun_sigma_deg is -1"),
            ("\xff\xfe", "not UTF-8"),
        ],
    )
    def test_tables_of_suns(self, tmp_path, text, message):
        (tmp_path / "suns.csv").write_bytes(text.encode("latin-1"))
        said = self.complaint(plain_images(tmp_path / "in", 1), tmp_path, suns=tmp_path / "suns.csv")
        assert said.startswith(str(tmp_path / "suns.csv"))
        assert message in said

    def test_a_folder_in_use(self, tmp_path):
        (tmp_path / "site").mkdir()
        (tmp_path / "site" / "mine.txt").touch()
        with pytest.raises(RunFolderError, match="not empty"):
            ingest(plain_images(tmp_path / "in"), tmp_path / "site")
        assert [p.name for p in (tmp_path / "site").iterdir()] == ["mine.txt"]
