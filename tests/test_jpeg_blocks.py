"""Images that went through JPEG are told from others by its blocks, whatever file they are in."""

import cv2
import numpy as np
import pytest

from archives import SHARED
from photoclinometry.io.images import read_image, write_fits
from photoclinometry.io.jpeg_blocks import shows_jpeg_blocks
from photoclinometry.io.site import read_site
from photoclinometry.model.image import Image
from photoclinometry.model.warning import collected_warnings
from photoclinometry.pipeline.folder.run_folder import open_run
from photoclinometry.pipeline.sparse_stages import read_inputs
from sites import picture, write_small_site

VESTA = SHARED / "vesta-opnav022" / "images"


def ground(seed=0, size=200, noise=0.5):
    """Shading of smooth ground, as bytes [0 to 255], with the noise of a detector."""
    rng = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(rng.normal(size=(size, size)), (0, 0), 3.0)
    return 120.0 + 40.0 * rough / rough.std() + noise * rng.normal(size=rough.shape)


def through_jpeg(pixels, quality):
    file = cv2.imencode(".jpg", np.clip(pixels, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return cv2.imdecode(file, cv2.IMREAD_UNCHANGED).astype(float)


def image(pixels, valid=None):
    return Image("a", pixels.astype(np.float32), np.ones(pixels.shape, bool) if valid is None else valid)


@pytest.mark.parametrize("seed", range(4))
def test_blocks_are_seen_after_jpeg_and_not_before(seed):
    pixels = ground(seed)
    assert not shows_jpeg_blocks(image(pixels))
    assert not shows_jpeg_blocks(image(np.round(pixels))), "eight bits"
    assert shows_jpeg_blocks(image(through_jpeg(pixels, 75)))


def test_blocks_are_seen_in_crops_and_beside_masked_ground_and_shadows():
    pixels = through_jpeg(ground(), 75)
    pixels[:, 150:] = 0.0
    valid = np.ones(pixels.shape, bool)
    valid[60:90] = False
    assert shows_jpeg_blocks(image(pixels[3:, 5:], valid[3:, 5:]))


def test_steps_along_one_axis_alone_are_no_blocks():
    """Detectors with a gain of their own for every eighth column, and images resampled along their rows."""
    pixels = ground()
    pixels[:, ::8] *= 1.02
    assert not shows_jpeg_blocks(image(pixels))


def test_small_and_flat_images_say_nothing():
    assert not shows_jpeg_blocks(image(through_jpeg(ground(size=60), 75)))
    assert not shows_jpeg_blocks(image(np.zeros((100, 100))))
    assert not shows_jpeg_blocks(image(ground(), np.zeros((200, 200), bool)))


@pytest.mark.skipif(not VESTA.exists(), reason="the real images are not there")
def test_real_images_have_none_until_they_are_compressed():
    files = sorted(VESTA.glob("*.png"))
    assert len(files) == 4
    for file in files:
        real = read_image(file)
        assert not shows_jpeg_blocks(real), file
        assert shows_jpeg_blocks(image(through_jpeg(real.brightness, 90), real.valid)), file


def test_a_site_names_compressed_images(tmp_path):
    path = write_small_site(tmp_path, 6)
    with collected_warnings() as warned:
        read_inputs(open_run(tmp_path / "clean"), read_site(path))
    assert "image-compressed" not in {each.code for each in warned}
    for number in (1, 4):
        pixels = picture(number)
        top = pixels.max()
        lost = through_jpeg(255.0 * pixels / top, 60) * top / 255.0
        write_fits(tmp_path / "images" / f"{number}.fits", lost.astype(np.float32))
    with collected_warnings() as warned:
        read_inputs(open_run(tmp_path / "lost"), read_site(path))
    words = [each.words for each in warned if each.code == "image-compressed"]
    assert len(words) == 1
    assert "2 of 6 images" in words[0]
    assert "1.fits, images/4.fits" in words[0]
