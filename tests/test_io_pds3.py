"""PDS3 images, attached and detached: stored values, invalid ones, prefixes; real files read another way; damage."""

import numpy as np
import pytest
from astropy.io import fits

from archives import FORMATS, needs_formats, texture, write_pds3
from photoclinometry.io.archives.archive import read_product
from photoclinometry.io.archives.pds3 import read_pds3
from photoclinometry.model.errors import ImageError, InputError

STORED = [
    ("MSB_UNSIGNED_INTEGER", ">u2"),
    ("LSB_UNSIGNED_INTEGER", "<u2"),
    ("MSB_INTEGER", ">i2"),
    ("LSB_INTEGER", "<i4"),
    ("IEEE_REAL", ">f4"),
    ("PC_REAL", "<f4"),
    ("IEEE_REAL", ">f8"),
    ("UNSIGNED_INTEGER", "u1"),
]


@pytest.mark.parametrize("detached", [False, True])
@pytest.mark.parametrize(("name", "dtype"), STORED, ids=[f"{n}-{d}" for n, d in STORED])
def test_pixels_are_those_that_were_stored(tmp_path, name, dtype, detached):
    pixels = np.arange(6 * 8).reshape(6, 8).astype(dtype)
    data = tmp_path / "DATA.IMG" if detached else None
    extra = "  SCALING_FACTOR = 0.5\r\n  OFFSET = -3\r\n"
    product = read_pds3(write_pds3(tmp_path / "a.lbl", pixels, sample_type=name, extra=extra, detached=data))
    assert product.image.valid.all()
    np.testing.assert_array_equal(product.image.brightness, pixels.astype(float) * 0.5 - 3)


def test_the_image_is_found_whatever_the_case_of_its_name(tmp_path):
    path = write_pds3(tmp_path / "a.lbl", texture(), sample_type="PC_REAL", detached=tmp_path / "B.IMG")
    (tmp_path / "B.IMG").rename(tmp_path / "b.img")
    np.testing.assert_array_equal(read_pds3(path).image.brightness, texture())
    (tmp_path / "b.img").unlink()
    with pytest.raises(ImageError, match=r"a\.lbl: its pixels are in B\.IMG, which is not beside it"):
        read_pds3(path)


def test_prefixes_and_suffixes_of_lines_are_passed_over(tmp_path):
    rows = np.arange(4 * 20, dtype=np.uint8).reshape(4, 20)
    extra = "  LINE_PREFIX_BYTES = 4\r\n  LINE_SUFFIX_BYTES = 6\r\n"
    path = write_pds3(tmp_path / "a.img", rows, sample_type="UNSIGNED_INTEGER", extra=extra)
    path.write_bytes(path.read_bytes().replace(b"LINE_SAMPLES = 20", b"LINE_SAMPLES = 10"))
    np.testing.assert_array_equal(read_pds3(path).image.brightness, rows[:, 4:14])


def test_constants_that_mean_nothing_are_masked(tmp_path):
    pixels = np.array([[1, -20000, 5], [-21000, 32767, 900], [-9, 3, 4]], ">i2")
    extra = "  INVALID_VALUE = (-20000, -21000)\r\n  MISSING_CONSTANT = -9\r\n  PIXEL_SATURATION_VALUE = 900\r\n"
    path = write_pds3(tmp_path / "a.img", pixels, sample_type="MSB_INTEGER", extra=extra)
    np.testing.assert_array_equal(read_pds3(path).image.valid, [[1, 0, 1], [0, 0, 0], [0, 1, 1]])


def test_constants_written_in_bits_are_masked(tmp_path):
    pixels = np.array([[1.0, 0.5], [2.0, 0.25]], ">f4")
    pixels.view(">u4")[0, 1] = 0xFF7FFFFB
    path = write_pds3(
        tmp_path / "a.img", pixels, sample_type="IEEE_REAL", extra="  MISSING_CONSTANT = 16#FF7FFFFB#\r\n"
    )
    np.testing.assert_array_equal(read_pds3(path).image.valid, [[1, 0], [1, 1]])


@pytest.mark.data
@needs_formats
class TestRealFiles:
    """Statistics against readings by other means: astropy for FITS, bytes at offsets taken by hand from the labels."""

    @pytest.mark.parametrize("name", ["near/msi2isis/m0126865998f4_2p_iof", "near/msi2isis/m0157063318f4_2p_iof_gbl"])
    def test_near(self, name):
        product = read_product(FORMATS / f"{name}.lbl")
        with fits.open(FORMATS / f"{name}.fit", ignore_missing_end=True) as hdus:
            np.testing.assert_array_equal(product.image.brightness, hdus[0].data)
        assert (product.lines_up, product.samples_left) == (True, False)

    def test_near_has_the_label_s_own_statistics(self):
        product = read_product(FORMATS / "near/msi2isis/m0126865998f4_2p_iof.lbl")
        image = product.label.block("IMAGE")
        assert product.image.brightness.min() == pytest.approx(image.get("MINIMUM"), rel=1e-5)
        assert product.image.brightness.max() == pytest.approx(image.get("MAXIMUM"), rel=1e-5)
        assert product.image.brightness.mean(dtype=float) == pytest.approx(image.get("MEAN"), rel=1e-3)

    @pytest.mark.parametrize(
        ("name", "dtype", "offset", "row", "prefix", "shape", "factor"),
        [
            ("nacl.img", "u1", 3637, 5064, 0, (10, 5064), 1.0),
            ("nacr.img", "u1", 3639, 5064, 0, (10, 5064), 1.0),
            ("TC1S2B0_01_00811N526E0443_mini.lbl", ">i2", 0, 3488, 0, (3, 1744), 0.013),
            ("TC1S2B0_01_05186N225E0040_mini.lbl", ">i2", 0, 6416, 0, (3, 3208), 0.013),
            ("h7926_0009_s22_cropped.img", ">i2", 4300, 10436, 68, (5, 5184), 1.0),
        ],
    )
    def test_scanners_pixels(self, name, dtype, offset, row, prefix, shape, factor):
        product = read_product(FORMATS / "pds3" / name)
        data = product.data.read_bytes()
        lines = [np.frombuffer(data, dtype, shape[1], offset + k * row + prefix) for k in range(shape[0])]
        expected = np.stack(lines).astype(float) * factor
        np.testing.assert_array_equal(product.image.brightness, np.float32(expected))
        assert product.image.valid.all()

    @pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
    def test_gdal_reads_the_same(self):
        rasterio = pytest.importorskip("rasterio")
        product = read_product(FORMATS / "pds3" / "TC1S2B0_01_05186N225E0040_mini.lbl")
        with rasterio.open(FORMATS / "pds3" / "TC1S2B0_01_05186N225E0040_mini.lbl") as file:
            other = file.read(1).astype(float) * 0.013
        np.testing.assert_array_equal(product.image.brightness, np.float32(other))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"LINES = 40", b"LINES = 4000", "ends after"),
        (b"LINES = 40", b"LINES = 0", "0 lines of 60 samples"),
        (b"LINE_SAMPLES = 60", b"LINE_SAMPLES = 1000000000", "more than"),
        (b"SAMPLE_BITS = 32", b"SAMPLE_BITS = 12", "12 bits"),
        (b"PC_REAL", b"ODD_REAL", "ODD_REAL"),
        (b"OBJECT = IMAGE", b"OBJECT = TABLE", "describes no IMAGE"),
        (b"^IMAGE = 9", b"^IMAGE = Q", "Q, which is not beside it"),
        (b"^IMAGE = 9", b"^IMAGE = 0", "before the file's beginning"),
        (b"^IMAGE", b"IMAGES", r"no \^IMAGE"),
        (b"RECORD_BYTES = 512", b"RECORD_BYTES = ...", "RECORD_BYTES"),
    ],
)
def test_lying_labels_are_refused(tmp_path, old, new, message):
    path = write_pds3(tmp_path / "bad.img", texture(), sample_type="PC_REAL")
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"bad\.img: .*({message})"):
        read_pds3(path)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ("  BANDS = 3\r\n", "3 bands"),
        ("  ENCODING_TYPE = HUFFMAN_FIRST_DIFFERENCE\r\n", "compressed"),
        ("  LINE_PREFIX_BYTES = 99999\r\n", "ends after"),
        ("  SCALING_FACTOR = soon\r\n", "SCALING_FACTOR"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path, extra, message):
    path = write_pds3(tmp_path / "bad.img", texture(), sample_type="PC_REAL", extra=extra)
    with pytest.raises(ImageError, match=rf"bad\.img: .*{message}"):
        read_pds3(path)


def test_a_label_must_agree_with_the_fits_file_that_it_describes(tmp_path):
    fits.writeto(tmp_path / "a.fit", texture().astype(">f4"))
    lines = b'PDS_VERSION_ID = PDS3\n^IMAGE = ("A.FIT", 2881 <BYTES>)\nOBJECT = IMAGE\nLINES = 40\nLINE_SAMPLES = 60\n'
    rest = b"SAMPLE_BITS = 32\nSAMPLE_TYPE = IEEE_REAL\nEND_OBJECT = IMAGE\nEND\n"
    (tmp_path / "a.lbl").write_bytes(lines + rest)
    np.testing.assert_array_equal(read_pds3(tmp_path / "a.lbl").image.brightness, texture())
    (tmp_path / "a.lbl").write_bytes(lines.replace(b"LINES = 40", b"LINES = 30") + rest)
    with pytest.raises(ImageError, match=r"gives 30 lines of 60 samples, but a\.fit holds 40 of 60"):
        read_pds3(tmp_path / "a.lbl")


def test_a_label_that_names_itself_is_read_as_pixels_and_refused(tmp_path):
    """No label is ever read because another one says so: there is nothing to go round in circles."""
    (tmp_path / "a.lbl").write_bytes(
        b'PDS_VERSION_ID = PDS3\n^STRUCTURE = "A.LBL"\n^IMAGE = "A.LBL"\nOBJECT = IMAGE\nLINES = 400\n'
        b"LINE_SAMPLES = 600\nSAMPLE_BITS = 8\nSAMPLE_TYPE = UNSIGNED_INTEGER\nEND_OBJECT = IMAGE\nEND\n"
    )
    with pytest.raises(ImageError, match="ends after"):
        read_product(tmp_path / "a.lbl")
