"""The faults that `benchmarks/faults.py` puts into sites are those that they are named after."""

from pathlib import Path

import numpy as np
import pytest

from image_faults import FAULTS, Images, read_images, write_images
from photoclinometry.io.site import read_site
from photoclinometry.model.geometry import angle_between
from sites import write_small_site

SIZE = 64


@pytest.fixture
def clean(tmp_path) -> Images:
    return read_images(read_site(write_small_site(tmp_path / "clean")))


def spoiled(name: str, clean: Images, seed: int = 0) -> Images:
    return FAULTS[name](clean, np.random.default_rng(seed))


def ratio(name: str, clean: Images) -> np.ndarray:
    """(K, height, width) of brightness after over before."""
    return np.array(spoiled(name, clean).pixels) / np.array(clean.pixels)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_changes_the_site_and_keeps_its_shape(name, clean):
    found = spoiled(name, clean)
    assert [each.shape for each in found.pixels] == [each.shape for each in clean.pixels]
    same_pixels = all(np.array_equal(a, b) for a, b in zip(found.pixels, clean.pixels, strict=True))
    same_suns = np.array_equal(found.site.sun_in_cam, clean.site.sun_in_cam)
    same_cameras = found.site.views[0].camera == clean.site.views[0].camera
    assert (same_pixels, same_suns, same_cameras).count(False) == 1
    assert max(each.max() for each in found.pixels) <= 1.06 * clean.top


def test_corners_lose_what_vignetting_takes(clean):
    found = ratio("vignetting", clean)
    assert found[:, SIZE // 2, SIZE // 2] == pytest.approx(1.0, abs=1e-3)
    assert found[:, 0, 0] == pytest.approx(0.95, abs=3e-3)


def test_distortion_moves_pixels_by_the_cube_of_their_radius_and_corners_by_two(clean):
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    ramp = Images(site=clean.site, pixels=(x, y), top=SIZE)
    shift = np.hypot(*(np.array(spoiled("distortion", ramp).pixels) - np.array(ramp.pixels)))
    radius = np.hypot(x + 0.5 - SIZE / 2, y + 0.5 - SIZE / 2) / np.hypot(SIZE / 2, SIZE / 2)
    inside = np.maximum(abs(x - SIZE / 2), abs(y - SIZE / 2)) < SIZE / 2 - 4
    assert shift[inside] == pytest.approx(2.0 * radius[inside] ** 3, abs=0.1)  # remapping rounds to 1/32 px


def test_one_image_is_blurred_and_one_has_a_gradient(clean):
    for name in ("blur", "gradient"):
        changed = [not np.array_equal(a, b) for a, b in zip(spoiled(name, clean).pixels, clean.pixels, strict=True)]
        assert sum(changed) == 1
    found = ratio("gradient", clean)
    assert np.ptp(found, axis=(1, 2)).max() == pytest.approx(0.1, abs=0.05)  # 5 % to either side, more across corners


def test_suns_are_off_by_three_degrees(clean):
    true = clean.site.sun_in_cam
    assert np.degrees(angle_between(spoiled("one-sun", clean).site.sun_in_cam, true)).max() == pytest.approx(3.0)
    off = np.degrees(angle_between(spoiled("all-suns", clean).site.sun_in_cam, true))
    assert (off > 0).all()
    assert (off <= 3.0 + 1e-9).all()


def test_gamma_keeps_black_and_the_brightest(clean):
    found = spoiled("gamma", Images(site=clean.site, pixels=(np.array([[0.0, 0.5, 1.0]]),), top=1.0)).pixels[0]
    assert found[0] == pytest.approx([0.0, 0.5 ** (1 / 1.1), 1.0])


def test_what_was_not_measured_stays_so_and_spoils_no_neighbours(clean):
    hole = clean.pixels[0].copy()
    hole[10, 10] = np.nan
    with_hole = Images(site=clean.site, pixels=(hole,) * 4, top=clean.top)
    for name in FAULTS:
        for each in spoiled(name, with_hole).pixels:
            assert np.isnan(each).sum() == 1


def test_spoiled_images_are_read_back(clean, tmp_path):
    found = spoiled("stray-light", clean)
    write_images(found, clean.site, tmp_path)
    for view, pixels in zip(clean.site.views, found.pixels, strict=True):
        from astropy.io import fits

        with fits.open(Path(tmp_path / view.name)) as content:
            assert np.array(content[0].data) == pytest.approx(pixels, rel=1e-6)
