"""A data file is read through the label beside it, and a file there that is no label is an error that names it."""

import numpy as np
import pytest

from archives import texture, write_pds3, write_pds4
from photoclinometry.io.archives.archive import read_product
from photoclinometry.io.images import write_fits
from photoclinometry.model.errors import ImageError

PAGE = "<!DOCTYPE html>\n<html><body>404 Not Found</body></html>\n"
"""What a server sends in the place of a file that it does not have."""


@pytest.mark.parametrize("data", ["a.img", "a.fits"])
@pytest.mark.parametrize("named", ["a.img", "a.lbl"])
def test_labels_that_are_none_do_not_call_each_other(tmp_path, data, named):
    if data == "a.fits":
        write_fits(tmp_path / data, texture())
    else:
        (tmp_path / data).write_bytes(bytes(4800))
    for label in ("a.lbl", "a.xml"):
        (tmp_path / label).write_text(PAGE)
    given = tmp_path / named.replace("a.img", data)
    found = "a.xml" if named == "a.lbl" else "a.lbl"
    with pytest.raises(ImageError) as raised:
        read_product(given)
    assert str(raised.value) == (
        f"{given}: {found} beside it is not a PDS3 or PDS4 label (it begins with b'<!DOCTYP'); "
        "fetch it again, or move it"
    )


def test_the_label_beside_a_data_file_is_read(tmp_path):
    data = tmp_path / "a.img"
    write_pds3(tmp_path / "a.LBL", texture(), sample_type="PC_REAL", detached=data)
    product = read_product(data)
    assert (product.kind, product.path, product.data) == ("PDS3", tmp_path / "a.LBL", data)
    np.testing.assert_array_equal(product.image.brightness, texture())
    stored = np.arange(2400, dtype=">u2").reshape(40, 60)
    write_pds4(tmp_path / "b.xml", stored, data_type="UnsignedMSB2", data=tmp_path / "b.dat")
    assert read_product(tmp_path / "b.dat").kind == "PDS4"
