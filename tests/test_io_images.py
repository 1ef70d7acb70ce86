"""Images come in as linear brightness, exactly as stored, with a mask of what is no measurement."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy.io import fits

from photoclinometry.io import images
from photoclinometry.io.exposure import off_body_mask, why_it_shows_nothing
from photoclinometry.io.images import read_image, write_fits, write_png
from photoclinometry.model.errors import ImageError
from photoclinometry.model.image import Image

DATA = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def integers(rng, dtype, shape=(20, 30)):
    """Values from the whole range but its top, which means saturated."""
    info = np.iinfo(dtype)
    return rng.integers(info.min, info.max, shape, dtype=dtype)


def encode(path, array):
    done, data = cv2.imencode(path.suffix, array)
    assert done
    path.write_bytes(data.tobytes())


def assert_reads(path, expected, valid=True):
    image = read_image(path)
    assert image.brightness.dtype == np.float32
    assert image.brightness.dtype.isnative
    assert image.valid.dtype == bool
    np.testing.assert_array_equal(image.valid, np.broadcast_to(valid, expected.shape))
    np.testing.assert_array_equal(image.brightness, np.where(valid, expected, 0).astype(np.float32))


@pytest.mark.parametrize("dtype", ["u1", "i2", "i4", "u2", "f4", "f8", ">f4", "<i2"])
def test_fits_values_come_back_in_native_single_precision(tmp_path, rng, dtype):
    array = (
        rng.normal(size=(20, 30)).astype(dtype) if "f" in dtype else integers(rng, np.dtype(dtype).newbyteorder("="))
    )
    fits.PrimaryHDU(array.astype(dtype)).writeto(tmp_path / "a.fits")
    assert_reads(tmp_path / "a.fits", array)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int16, np.float32, np.float64])
def test_fits_that_we_write_comes_back(tmp_path, rng, dtype):
    array = (100 * rng.random((20, 30))).astype(dtype)
    write_fits(tmp_path / "a.fits", array)
    assert_reads(tmp_path / "a.fits", array)


def test_row_0_is_the_first_row_of_the_file(tmp_path):
    array = np.arange(6.0).reshape(2, 3)
    write_fits(tmp_path / "a.fits", array)
    assert_reads(tmp_path / "a.fits", array)
    raw = (tmp_path / "a.fits").read_bytes()
    assert np.frombuffer(raw, ">f4", 3, raw.index(b"END" + b" " * 77) // 2880 * 2880 + 2880).tolist() == [0, 1, 2]


def test_fits_scaling_is_applied_and_blank_is_not_valid(tmp_path):
    hdu = fits.PrimaryHDU(np.array([[1, 2], [3, -999]], np.int16))
    hdu.header["BLANK"] = -999
    hdu.writeto(tmp_path / "plain.fits")
    assert_reads(tmp_path / "plain.fits", np.array([[1, 2], [3, 0]]), np.array([[True, True], [True, False]]))
    with fits.open(tmp_path / "plain.fits", mode="update", do_not_scale_image_data=True) as hdus:
        hdus[0].header["BSCALE"], hdus[0].header["BZERO"] = 0.5, 10.0
    assert_reads(tmp_path / "plain.fits", np.array([[10.5, 11], [11.5, 0]]), np.array([[True, True], [True, False]]))


def test_nan_and_infinity_are_not_valid(tmp_path):
    array = np.array([[0.1, np.nan], [np.inf, -np.inf]])
    write_fits(tmp_path / "a.fits", array)
    assert_reads(tmp_path / "a.fits", array, np.isfinite(array))


@pytest.mark.parametrize(("key", "limit"), [("SATURATE", 4.0), ("DATAMAX", 3.0)])
def test_fits_headers_say_where_floats_saturate(tmp_path, key, limit):
    array = np.arange(6, dtype=np.float32).reshape(2, 3)
    hdu = fits.PrimaryHDU(array)
    hdu.header[key] = limit
    hdu.writeto(tmp_path / "a.fits")
    assert_reads(tmp_path / "a.fits", array, array <= 3)


def test_the_first_image_of_two_axes_is_taken(tmp_path, rng):
    array = rng.random((20, 30)).astype(np.float32)
    table = fits.BinTableHDU.from_columns([fits.Column("x", "E", array=np.ones(3))])
    cube, plane, later = fits.ImageHDU(np.ones((2, 3, 4))), fits.ImageHDU(array[None]), fits.ImageHDU(array + 1)
    hdus = [fits.PrimaryHDU(), table, cube, plane, later]
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    assert_reads(tmp_path / "a.fits", array)


def test_compressed_fits_images_are_read(tmp_path, rng):
    array = integers(rng, np.int16, (64, 64))
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(array, compression_type="RICE_1")]).writeto(tmp_path / "a.fits")
    assert_reads(tmp_path / "a.fits", array)


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integer_images_keep_their_numbers_and_lose_their_top(tmp_path, rng, suffix, dtype):
    array = integers(rng, dtype)
    array[3, 4] = np.iinfo(dtype).max
    path = tmp_path / f"größe{suffix}"
    encode(tmp_path / f"a{suffix}", array)
    (tmp_path / f"a{suffix}").rename(path)
    assert_reads(path, array, array < np.iinfo(dtype).max)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_that_we_write_comes_back(tmp_path, rng, dtype):
    array = integers(rng, dtype)
    write_png(tmp_path / "a.png", array)
    assert_reads(tmp_path / "a.png", array)


def test_colour_png_is_written_in_rgb_order(tmp_path):
    array = np.zeros((2, 2, 3), np.uint8)
    array[..., 0] = 200
    write_png(tmp_path / "red.png", array)
    assert cv2.imread(str(tmp_path / "red.png"))[0, 0].tolist() == [0, 0, 200]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_float_tiff_is_read(tmp_path, rng, dtype):
    array = rng.normal(size=(20, 30)).astype(dtype)
    array[0, 0] = np.nan
    encode(tmp_path / "a.tiff", array)
    assert_reads(tmp_path / "a.tiff", array, np.isfinite(array))


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_stored_as_opaque_colour_is_read(tmp_path, rng, channels, dtype):
    array = integers(rng, dtype)
    stacked = np.stack([array] * 3 + [np.full_like(array, np.iinfo(dtype).max)] * (channels - 3), -1)
    encode(tmp_path / "a.png", stacked)
    assert_reads(tmp_path / "a.png", array)


def test_colour_and_transparency_are_refused_with_the_cure(tmp_path, rng):
    grey = integers(rng, np.uint8)
    encode(tmp_path / "colour.png", np.stack([grey, grey, grey // 2], -1))
    with pytest.raises(ImageError, match=r"colour\.png: is a colour image; export one band as grey"):
        read_image(tmp_path / "colour.png")
    encode(tmp_path / "clear.png", np.stack([grey, grey, grey, grey], -1))
    with pytest.raises(ImageError, match=r"clear\.png: has transparent pixels; export it as plain grey"):
        read_image(tmp_path / "clear.png")


def test_files_that_declare_too_much_are_refused_before_decoding(tmp_path, rng, monkeypatch):
    monkeypatch.setattr(images, "MAX_PIXELS", 599)
    encode(tmp_path / "a.png", integers(rng, np.uint8))
    encode(tmp_path / "a.tiff", integers(rng, np.uint8))
    write_fits(tmp_path / "a.fits", np.zeros((20, 30)))
    for name in ("a.png", "a.tiff", "a.fits"):
        with pytest.raises(ImageError, match=rf"{name}: declares 30 x 20 pixels, more than 599; crop it"):
            read_image(tmp_path / name)


def disk(size=200, radius=70, sky=0.0, noise=0.0, seed=0):
    """A body of brightness 100 with a black crater, and where it is, on a sky of the given brightness."""
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    body = np.hypot(x, y) < radius
    crater = np.hypot(x - 10, y) < 15
    image = np.where(body & ~crater, 100.0, sky) + noise * np.random.default_rng(seed).normal(size=(size, size))
    return Image("disk", image.astype(np.float32), np.ones(image.shape, bool)), body


@pytest.mark.parametrize(("sky", "noise"), [(0.0, 0.0), (5.0, 0.0), (0.0, 0.5), (5.0, 1.0)])
def test_sky_around_a_body_is_masked_and_shadows_on_it_are_not(sky, noise):
    image, body = disk(sky=sky, noise=noise)
    mask = off_body_mask(image)
    assert not (mask & body).any()
    assert (mask | body).mean() > 0.995


def test_dark_ground_at_the_edge_is_not_sky():
    y, x = np.mgrid[:200, :200]
    valleys = 100 + 60 * np.sin(x / 15) * np.cos(y / 20)
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.normal(size=(200, 200)), (0, 0), 1.5)
    mare = np.where(x < 80, 30.0, 100.0) * (1 + 0.1 * texture / texture.std())
    for ground in (valleys, valleys + rng.normal(size=valleys.shape), mare, mare + rng.normal(size=mare.shape)):
        assert not off_body_mask(Image("a", ground.astype(np.float32), np.ones(ground.shape, bool))).any()


def test_a_body_that_fills_the_image_has_no_sky():
    image, _ = disk(radius=1000, noise=1.0)
    assert not off_body_mask(image).any()
    constant = Image("c", np.full((50, 50), 3, np.float32), np.ones((50, 50), bool))
    assert not off_body_mask(constant).any()
    invalid = Image("i", np.zeros((50, 50), np.float32), np.zeros((50, 50), bool))
    assert not off_body_mask(invalid).any()


@pytest.mark.parametrize("quantised", [False, True])
def test_a_dark_frame_shows_nothing_and_a_faint_body_something(quantised):
    rng = np.random.default_rng(1)
    for level in (0.5, 100.0):
        dark = rng.normal(level, 2.0, (128, 128))
        faint = dark.copy()
        faint[30:90, 30:90] += 3.0
        for array, nothing in ((dark, True), (faint, False), (np.full((128, 128), level), True)):
            stored = (np.round(array) if quantised else array).astype(np.float32)
            found = why_it_shows_nothing(Image("a", stored, np.ones(stored.shape, bool)))
            assert (found is not None) == nothing
    hot = rng.normal(0.5, 2.0, (128, 128)).astype(np.float32)
    hot[50, 50] = 1e4
    assert why_it_shows_nothing(Image("hot pixel", hot, np.ones(hot.shape, bool)))


@pytest.mark.data
def test_real_images_keep_nearly_all_their_pixels():
    if not DATA.exists():
        pytest.skip(f"there are no real images at {DATA}")
    for k in (0, 1, 2, 4):
        image = read_image(DATA / "vesta-opnav022" / "images" / f"{k:08d}.png")
        assert image.valid.mean() > 0.9999
        sky = off_body_mask(image)
        assert 0.02 < sky.mean() < 0.08
        assert not sky[100:900, 100:900].any()
    eros = read_image(DATA / "formats" / "pds4" / "m0154651923f6_2p_cif_gbl.fit")
    assert eros.brightness.shape == (412, 537)
    assert 0.05 < np.median(eros.brightness) < 0.15  # I/F
    assert not off_body_mask(eros).any()
