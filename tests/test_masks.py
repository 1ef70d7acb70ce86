"""Masks and borders that site.toml names: what of an image is not used."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.io.images import write_png
from photoclinometry.io.masks import Masking
from photoclinometry.io.site import read_site, write_site
from photoclinometry.io.site_images import input_fingerprint, load_images, read_view_image
from photoclinometry.model.errors import ImageError, SiteError
from sites import SIZE, write_small_site

CAMERA = "params = [640.0, 640.0, 32.0, 32.0]"
VIEW = 'image = "images/2.fits"'


@pytest.fixture
def site(tmp_path):
    """A small site whose camera has a border and a mask, and whose view 2 has a mask of its own."""
    file = write_small_site(tmp_path / "site")
    text = file.read_text().replace(CAMERA, f'{CAMERA}\nborder_px = [1, 2, 3, 4]\nmask = "camera.png"')
    file.write_text(text.replace(VIEW, f'{VIEW}\nmask = ["masks/2.png"]\nborder_px = [5, 0, 0, 0]'))
    write_mask(tmp_path / "site" / "camera.png", slice(10, 12), 255)
    write_mask(tmp_path / "site" / "masks" / "2.png", slice(20, 21), 1)
    return file


def write_mask(file, rows, top, size=SIZE):
    mask = np.full((size, size), top, np.uint8)
    mask[rows] = 0
    write_png(file, mask)


def expected(left):
    used = np.zeros((SIZE, SIZE), bool)
    used[2 : SIZE - 4, left : SIZE - 3] = True
    used[10:12] = False
    return used


def test_masks_and_borders_of_camera_and_view_are_not_used(site):
    images = load_images(read_site(site))
    np.testing.assert_array_equal(images[0].valid, expected(1))
    own = expected(5)
    own[20] = False
    np.testing.assert_array_equal(images[2].valid, own)
    assert (images[2].brightness[~own] == 0).all()
    assert (images[2].brightness[own] != 0).any()


def test_a_site_with_masks_is_written_and_read_back_wherever_it_lies(site, tmp_path):
    known = read_site(site)
    moved = tmp_path / "elsewhere" / "site.toml"
    write_site(moved, replace(known, path=moved))
    again = read_site(moved)
    for before, after in zip(known.views, again.views, strict=True):
        assert after.masking.border_px == before.masking.border_px
        assert [f.resolve() for f in after.masking.files] == [f.resolve() for f in before.masking.files]


def test_a_site_with_masks_is_written_where_a_link_leads(site, tmp_path):
    known = read_site(site)
    (tmp_path / "far" / "deep" / "er").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "far" / "deep" / "er")
    moved = tmp_path / "link" / "site.toml"
    write_site(moved, replace(known, path=moved))
    for before, after in zip(known.views, read_site(moved).views, strict=True):
        assert [f.resolve() for f in after.masking.files] == [f.resolve() for f in before.masking.files]
        assert all(f.is_file() for f in after.masking.files)


def test_a_changed_mask_is_a_changed_input(site):
    before = input_fingerprint(read_site(site))
    write_mask(site.parent / "masks" / "2.png", slice(20, 22), 1)
    assert input_fingerprint(read_site(site)) != before


def test_a_mask_of_another_size_is_named(site):
    write_mask(site.parent / "camera.png", slice(0, 1), 255, size=32)
    known = read_site(site)
    with pytest.raises(ImageError, match=r"camera\.png: the mask is 32 x 32 pixels, its image 64 x 64"):
        read_view_image(known, known.views[0])


def test_a_mask_that_is_no_picture_or_missing_is_named(site):
    known = read_site(site)
    (site.parent / "camera.png").write_bytes(b"nothing")
    with pytest.raises(ImageError, match=r"camera\.png: is not a PNG or TIFF"):
        read_view_image(known, known.views[0])
    (site.parent / "camera.png").unlink()
    with pytest.raises(ImageError, match=r"camera\.png: there is no such mask"):
        read_view_image(known, known.views[0])


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("border_px = [1, 2, 3]", "border_px: expected a list of 4 finite numbers"),
        ("border_px = [1, 2, 3, -4]", "border_px: expected a list of 4 whole numbers of 0 or more"),
        ("mask = 3", "mask: expected text in quotes, or a list of such"),
        ("mask = []", "mask: expected text in quotes, or a list of such"),
    ],
)
def test_what_is_no_mask_or_border_is_refused(tmp_path, line, says):
    file = write_small_site(tmp_path)
    file.write_text(file.read_text().replace(CAMERA, f"{CAMERA}\n{line}"))
    with pytest.raises(SiteError, match=says):
        read_site(file)


@pytest.mark.parametrize(
    "border",
    [(SIZE, 0, SIZE, 0), (0, 0, 0, SIZE + 10), (0, 0, SIZE + 10, 0), (0, SIZE + 10, 0, 0), (0, 0, 0, 3 * SIZE)],
)
def test_a_border_wider_than_the_image_leaves_nothing(border):
    assert not Masking(border_px=border).usable((SIZE, SIZE)).any()
