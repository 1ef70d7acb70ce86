"""Dark levels of uncalibrated images, from shadows and sky."""

import numpy as np
import pytest

from photoclinometry.io.dark_level import Darkest, dark_levels, darkest_pixels, without_dark_level
from photoclinometry.io.images import write_fits
from photoclinometry.io.site import read_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.camera import Camera
from photoclinometry.model.image import Image
from sites import SIZE, picture, write_small_site

A, B = Camera("PINHOLE", 64, 48, (500, 500, 32, 24)), Camera("PINHOLE", 64, 48, (900, 900, 32, 24))
RNG = np.random.default_rng(7)


def image(shadow: float, *, level: float = 200.0, noise: float = 2.0, valid: float = 1.0) -> Image:
    """Ground of brightness level + 200 to 800, a share of it in shadow; a share of the pixels is valid."""
    ground = level + 200.0 + 600.0 * RNG.beta(2, 2, 100 * 100)
    ground[: round(shadow * ground.size)] = level
    found = (ground + noise * RNG.normal(size=ground.size)).astype(np.float32).reshape(100, 100)
    seen = np.arange(ground.size).reshape(100, 100) < valid * ground.size
    return Image("a", np.where(seen, found, 0), seen)


@pytest.mark.parametrize("shadow", [0.02, 0.1, 0.4])
def test_shadows_tell_the_level(shadow):
    found = darkest_pixels(image(shadow))
    assert found.level == pytest.approx(200.0, abs=3 * 2.0)
    assert found.brightness == pytest.approx(found.level, abs=3 * 2.0)


@pytest.mark.parametrize("shadow", [0.0, 0.002])
def test_ground_without_shadows_does_not(shadow):
    assert np.isnan(darkest_pixels(image(shadow)).level)


def test_pixels_that_are_not_valid_do_not_count():
    """They hold zeros, and are half of the image."""
    assert darkest_pixels(image(0.1, valid=0.5)).level == pytest.approx(200.0, abs=6.0)


def test_a_few_dead_pixels_do_not_count():
    found = image(0.1)
    found.brightness[5, :5] = 0.0
    assert darkest_pixels(found).level == pytest.approx(200.0, abs=6.0)


def test_an_image_without_shadows_has_the_usual_level_of_its_camera_but_is_nowhere_darker_than_it():
    nan = np.nan
    darkest = [Darkest(180, 190), Darkest(240, 250), Darkest(195, 200), Darkest(400, nan), Darkest(150, nan)]
    found = dark_levels([*darkest, Darkest(90, nan)], [A] * 5 + [B])
    np.testing.assert_array_equal(found, [190, 250, 200, 200, 150, 0])


def test_what_was_taken_is_kept_and_invalid_pixels_stay_zero():
    raw = image(0.1, valid=0.5)
    found = without_dark_level(raw, 200.0)
    np.testing.assert_allclose(found.brightness[raw.valid], raw.brightness[raw.valid] - 200.0, rtol=1e-6)
    assert not found.brightness[~raw.valid].any()
    assert found.dark_level == 200.0


@pytest.mark.parametrize(("brightness", "taken"), [("dn", 0.05), ("iof", 0.0)])
def test_images_of_a_site_are_loaded_without_their_dark_level_unless_they_are_calibrated(tmp_path, brightness, taken):
    path = write_small_site(tmp_path, views=3)
    path.write_text(path.read_text().replace('brightness = "iof"', f'brightness = "{brightness}"'))
    ground = {f"images/{k}.fits": np.where(np.arange(SIZE) % 8 == 0, 0.0, picture(k)) for k in range(3)}
    for name, brightness_without in ground.items():
        write_fits(tmp_path / name, (brightness_without + 0.05).astype(np.float32))
    for found in load_images(read_site(path)):
        assert found.dark_level == pytest.approx(taken)
        expected = ground[found.name] + 0.05 - taken
        np.testing.assert_allclose(found.brightness[found.valid], expected[found.valid], atol=1e-6)
