"""Made-up files become a site: pixels, cameras, Suns and poses are followed digit by digit."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from archives import (
    CAMERA,
    MAPCAM,
    POSE,
    SUN,
    mapcam_cube,
    plain_images,
    suns_of,
    texture,
    write_pds3,
)
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.models.sumfile import sumfile_of_view, write_sumfile
from photoclinometry.io.site import read_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.errors import InputError


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


@pytest.mark.parametrize("out", [".", "link"])
def test_a_site_may_be_made_in_the_working_folder_or_where_a_link_leads(tmp_path, monkeypatch, out):
    paths = plain_images(tmp_path / "in")
    options = IngestOptions(suns=suns_of(tmp_path, paths), pinhole=(500.0, 500.0, 30.0, 20.0))
    (tmp_path / "working" / "there").mkdir(parents=True)
    (tmp_path / "working" / "link").symlink_to("there")
    folder = tmp_path / "working" / "there"
    monkeypatch.chdir(folder if out == "." else folder.parent)
    site = ingest(paths, Path(out), options).site
    assert site == Path(out) / "site.toml"
    assert len(load_images(read_site(site))) == 3
    assert sorted(path.name for path in folder.iterdir()) == ["images", "site.toml", "sources.json"]
    assert sorted(path.name for path in folder.parent.iterdir()) == ["link", "there"]


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


@pytest.mark.parametrize(("up", "left"), [(False, False), (True, False), (False, True), (True, True)])
def test_images_of_osiris_are_taken_as_their_labels_display_them(tmp_path, up, left):
    """The WAC's files are mirrored left to right against the NAC's, and their labels say so."""
    top = (
        "INSTRUMENT_ID = OSIWAC\r\nINSTRUMENT_HOST_NAME = ROSETTA-ORBITER\r\n"
        f"LINE_DISPLAY_DIRECTION = {'UP' if up else 'DOWN'}\r\n"
        f"SAMPLE_DISPLAY_DIRECTION = {'LEFT' if left else 'RIGHT'}\r\n"
    )
    shown = texture((64, 64))
    stored = np.ascontiguousarray(shown[:: -1 if up else 1, :: -1 if left else 1])
    path = write_pds3(tmp_path / "a.img", stored, sample_type="PC_REAL", top=top)
    options = IngestOptions(suns=suns_of(tmp_path, [path]))
    (exposure,) = ingest([path], tmp_path / "site", options).exposures
    np.testing.assert_array_equal(exposure.image.brightness, shown)


def test_a_comet_is_known_by_its_designation(tmp_path):
    """SPICE calls it 67P/C-G, sites call it 67p."""
    paths = plain_images(tmp_path / "in")
    options = IngestOptions(suns=suns_of(tmp_path, paths), pinhole=(500.0, 500.0, 30.0, 20.0), body="67P/C-G")
    ingest(paths, tmp_path / "site", options)
    assert read_site(tmp_path / "site" / "site.toml").body == "67p"


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


@pytest.mark.parametrize(
    ("given", "stated", "expected"),
    [(0, None, 0.05), (1, None, 0.05), (2, None, None), (2, 0.3, 0.3), (0, 0.0, 0.0)],
)
def test_the_common_error_of_suns_is_stated_unless_a_table_gives_all(tmp_path, given, stated, expected):
    """Two cubes with ISIS's tables, of which --suns covers so many."""
    paths = [mapcam_cube(tmp_path / f"{name}.cub") for name in "ab"]
    options = IngestOptions(
        undistorted=True,
        suns=suns_of(tmp_path, paths[:given]) if given else None,
        sun_common_sigma_deg=stated,
    )
    site = tomllib.loads(ingest(paths, tmp_path / "site", options).site.read_text())
    assert site.get("sun_common_sigma_deg") == (None if expected is None else pytest.approx(expected))


def test_a_sumfile_s_sun_has_the_common_error_of_kernels(tmp_path):
    (path,) = plain_images(tmp_path / "in", 1)
    write_sumfile(tmp_path / "a.SUM", sumfile_of_view(path.stem, CAMERA, POSE, SUN, utc="2000 JAN 01 00:00:00"))
    options = IngestOptions(sumfiles=(tmp_path / "a.SUM",), body="bennu")
    site = tomllib.loads(ingest([path], tmp_path / "site", options).site.read_text())
    assert site["sun_common_sigma_deg"] == pytest.approx(0.05)


def test_a_cube_of_a_turned_and_mirrored_detector_comes_out_upright(tmp_path):
    """MapCam: samples along +Y, lines along +X. The lines are turned; so C is x = Y, y = -X of the instrument."""
    path = mapcam_cube(tmp_path / "a.cub")
    (exposure,) = ingest([path], tmp_path / "site", IngestOptions(undistorted=True)).exposures
    np.testing.assert_array_equal(exposure.image.brightness, texture((1024, 1024))[::-1])
    np.testing.assert_allclose(exposure.sun, [0.0, -0.6, -0.8], atol=1e-12)
    np.testing.assert_allclose(exposure.prior.cam_from_body.translation, [0.0, 0.0, 5000.0], atol=1e-9)
    assert exposure.prior.translation_sigma == pytest.approx(5.0)
    np.testing.assert_allclose(exposure.camera.params, [125.2 / 0.0085] * 2 + [512.0, 512.0])


def test_images_days_apart_are_of_arcs_of_their_own(tmp_path):
    """Two of one evening, one two days later, one without a time; and of the evening alone one arc without a name."""
    times = ("2019-04-25T21:12:32.312", "2019-04-27T22:00:00.0", "2019-04-25T23:00:00", None)
    groups = [MAPCAM if t is None else MAPCAM.replace("Target", f"StartTime = {t}\n  Target", 1) for t in times]
    paths = [mapcam_cube(tmp_path / f"{k}.cub", groups=group) for k, group in enumerate(groups)]
    result = ingest(paths, tmp_path / "site", IngestOptions(undistorted=True))
    evening, later = "orex-mapcam, ISIS tables, 2019-04-25", "orex-mapcam, ISIS tables, 2019-04-27"
    assert [view.arc for view in read_site(result.site).views] == [evening, later, evening, None]
    result = ingest(paths[::2], tmp_path / "one", IngestOptions(undistorted=True))
    assert "arc" not in result.site.read_text()
    table = suns_of(tmp_path, paths)
    result = ingest(paths, tmp_path / "of-table", IngestOptions(undistorted=True, suns=table))
    assert "arc" not in result.site.read_text(), "Suns of a table are of one solution"


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
