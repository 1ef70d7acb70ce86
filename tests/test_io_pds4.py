"""PDS4 images: stored values, constants, display directions; a real file as FITS holds it; damage named."""

import numpy as np
import pytest
from astropy.io import fits

from archives import FORMATS, needs_formats, texture, write_pds4
from photoclinometry.io.archives.pds4 import read_pds4
from photoclinometry.model.errors import ImageError, InputError


@pytest.mark.parametrize(
    ("name", "dtype"),
    [("IEEE754MSBSingle", ">f4"), ("IEEE754LSBDouble", "<f8"), ("UnsignedMSB2", ">u2"), ("SignedLSB4", "<i4")],
)
def test_pixels_are_those_that_were_stored(tmp_path, name, dtype):
    pixels = np.arange(6 * 8).reshape(6, 8).astype(dtype)
    special = "<Special_Constants><missing_constant>5</missing_constant></Special_Constants>"
    path = write_pds4(tmp_path / "a.xml", pixels, data_type=name, data=tmp_path / "a.dat", special=special)
    image = read_pds4(path).image
    np.testing.assert_array_equal(image.valid, pixels != 5)
    np.testing.assert_array_equal(image.brightness[image.valid], (pixels * 0.5 + 3)[pixels != 5])


def test_directions_of_display_are_read(tmp_path):
    display = (
        "<Display_Direction><horizontal_display_direction>Left to Right</horizontal_display_direction>"
        "<vertical_display_direction>Bottom to Top</vertical_display_direction></Display_Direction>"
    )
    label = write_pds4(tmp_path / "a.xml", texture(), data_type="IEEE754LSBSingle", data=tmp_path / "a", extra=display)
    product = read_pds4(label)
    assert (product.lines_up, product.samples_left) == (True, False)


@pytest.mark.data
@needs_formats
def test_a_real_file_is_read_as_its_fits_says():
    stem = FORMATS / "pds4" / "m0154651923f6_2p_cif_gbl"
    product = read_pds4(stem.with_suffix(".xml"))
    with fits.open(stem.with_suffix(".fit")) as hdus:
        np.testing.assert_array_equal(product.image.brightness, hdus[0].data)
    assert product.image.brightness.mean(dtype=float) == pytest.approx(0.064969, rel=1e-4)  # MEAN of its PDS3 label


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<elements>40", "<elements>4000", "ends after"),
        ("<elements>40", "<elements>1", "1 lines of 60"),
        ("<elements>60", "<elements>1000000000", "more than"),
        ("<elements>60", "<elements>-60", "ELEMENTS is -60"),
        ("LSBSingle", "LSBTriple", "IEEE754LSBTriple"),
        ("<axes>2", "<axes>3", "axes are not two"),
        ("<sequence_number>2", "<sequence_number>1", "no Axis_Array 1 and 2"),
        ("a.dat", "b.dat", r"b\.dat, which is not beside it"),
        ("a.dat", "../../etc/passwd", "passwd, which is not beside it"),
        ("Array_2D_Image", "Array_9D_Image", "describes no two-axis image"),
        ("</File_Area_Observational>", "", "not complete XML"),
        ('encoding="UTF-8"', 'encoding="klingon"', "not complete XML"),
        ("<Product", "<!DOCTYPE a><Product", "document type"),
    ],
)
def test_damaged_labels_are_refused(tmp_path, old, new, message):
    path = write_pds4(tmp_path / "bad.xml", texture(), data_type="IEEE754LSBSingle", data=tmp_path / "a.dat")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=rf"bad\.xml: .*{message}"):
        read_pds4(path)


def test_a_label_that_is_not_utf8_is_refused(tmp_path):
    path = write_pds4(tmp_path / "bad.xml", texture(), data_type="IEEE754LSBSingle", data=tmp_path / "a.dat")
    path.write_bytes(path.read_bytes().replace(b"<Observation_Area>", b"<Observation_Area>\xff\xfe"))
    with pytest.raises(ImageError, match=r"bad\.xml: the label is not complete XML"):
        read_pds4(path)


def test_deep_nesting_is_refused_not_followed(tmp_path):
    (tmp_path / "bad.xml").write_text("<?xml version='1.0'?>" + "<a>" * 5000 + "</a>" * 5000)
    with pytest.raises(ImageError, match="nested more than"):
        read_pds4(tmp_path / "bad.xml")
