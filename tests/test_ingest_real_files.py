"""Every real file at hand is ingested, or refused for the right reason; a real label gives the published geometry."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from scipy.spatial.transform import Rotation

from archives import (
    FORMATS,
    SPICE,
    needs_formats,
    needs_spice,
    texture,
)
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.site import read_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid

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
    "near/msi2isis/label2.lbl": "gives 1 lines of 537 samples, but .* holds 244 of 537",
    "near/msi2isis/label3.lbl": "gives 244 lines of 1 samples, but .* holds 244 of 537",
    "near/msi2isis/label5.lbl": "first line on top.*unlike all files of near-msi.*--lines up",
    "near/msi2isis/label6.lbl": "projected onto a map",
    "osirisRexImages/20200303T213031S138_ncm_L0.pvl": "ends after 4904 bytes",
    "osirisRexImages/20201020T214241S004_nft_L0.pvl": "ends after 4904 bytes",
    "lronacpho/M143947267L.cal.echo.crop.cub": r"line scanner's image \(NACL\)",
    "lronacpho/NAC_PHO_LROC_Empirical.0001.pvl": "is not a PDS3 or PDS4 label, ISIS cube",
    "lronacpho/NAC_PHO_LROC_Empirical.0002.pvl": "is not a PDS3 or PDS4 label, ISIS cube",
    "lronacpho/NAC_PHO_LROC_Empirical.0003.pvl": "is not a PDS3 or PDS4 label, ISIS cube",
    "pds3/TC1S2B0_01_00811N526E0443_mini.img": r"line scanner's image \(TC1\)",
    "pds3/TC1S2B0_01_00811N526E0443_mini.lbl": r"line scanner's image \(TC1\)",
    "pds3/TC1S2B0_01_05186N225E0040_mini.img": r"line scanner's image \(TC1\)",
    "pds3/TC1S2B0_01_05186N225E0040_mini.lbl": r"line scanner's image \(TC1\)",
    "pds3/h7926_0009_s22_cropped.img": r"line scanner's image \(HRSC\)",
    "pds3/nacl.img": r"line scanner's image \(LROC\)",
    "pds3/nacr.img": r"line scanner's image \(LROC\)",
    "spc/Bennu49k.obj": "is not a PDS3 or PDS4 label, ISIS cube",
    "spc/M605862153F5.SUM": "is not a PDS3 or PDS4 label, ISIS cube",
    "spc/N2395699394.SUM": "is not a PDS3 or PDS4 label, ISIS cube",
    "spc/ocams20190314t190123s972_map_iofl2pan_77236.png": "names none.*--pinhole.*; the Sun's direction is unknown",
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
