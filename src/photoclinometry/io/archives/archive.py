"""Images from archives; the format is recognised by content."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.io.archives.fits_header import read_fits_header
from photoclinometry.io.archives.isis_cube import read_isis_cube
from photoclinometry.io.archives.pds3 import read_pds3
from photoclinometry.io.archives.pds4 import read_pds4
from photoclinometry.io.archives.product import Product
from photoclinometry.io.images import read_image
from photoclinometry.io.reading import read_image_bytes
from photoclinometry.model.errors import ImageError

_HEAD_BYTES = 4096
"""Bytes in which a format is recognised; PDS3 labels may begin with comments."""


def read_product(path: Path | str, *, linear: bool = False) -> Product:
    """An ISIS cube, a PDS3 or PDS4 label with its image, a FITS file, a PNG or TIFF. Raises ImageError, InputError.

    A data file with a label of the same name beside it (.lbl, .xml) is read through that label. The keywords of a FITS
    file become the last block of its label. linear: the numbers of a PNG are linear whatever it declares.
    """
    product = _read(Path(path), linear)
    if product.kind in ("PDS3", "PDS4") and read_image_bytes(product.data, limit=6) == b"SIMPLE":
        product.label.blocks.append(read_fits_header(product.data))
    return product


def _read(path: Path, linear: bool) -> Product:
    head = read_image_bytes(path, limit=_HEAD_BYTES)
    labelled = _read_labelled(path, head)
    if labelled is not None:
        return labelled
    if head.startswith((b"\x89PNG", b"II*\0", b"MM\0*")):
        image = read_image(path, linear=linear, remedy="pass --linear")
        return Product(path=path, data=path, kind="plain", image=image)
    label = label_beside(path)
    if label is not None:
        return _read_label(label, path)
    if head.startswith(b"SIMPLE"):
        return _read_fits(path)
    raise ImageError(
        f"{path}: is not a PDS3 or PDS4 label, ISIS cube, FITS, PNG or TIFF image (it begins with {head[:8]!r}); "
        "if it has a label, give the label; otherwise convert it"
    )


def _read_labelled(path: Path, head: bytes) -> Product | None:
    """The product of a file with a label, which begins with `head`; None for files of other formats."""
    start = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if _is_isis(start):
        return read_isis_cube(path)
    if start.startswith(b"PDS_VERSION_ID") or b"\nPDS_VERSION_ID" in head:
        return read_pds3(path)
    if start.startswith(b"<?xml") or start.startswith(b"<Product_Observational"):
        return read_pds4(path)
    return None


def _read_label(label: Path, path: Path) -> Product:
    """The product that the label beside a data file describes. Raises ImageError for a file that is no label."""
    head = read_image_bytes(label, limit=_HEAD_BYTES)
    product = _read_labelled(label, head)
    if product is None:
        raise ImageError(
            f"{path}: {label.name} beside it is not a PDS3 or PDS4 label (it begins with {head[:8]!r}); "
            "fetch it again, or move it"
        )
    return product


def _is_isis(start: bytes) -> bool:
    words = start[:64].replace(b"=", b" = ").split()
    return len(words) > 2 and words[0].upper() == b"OBJECT" and words[2].upper() == b"ISISCUBE"


def label_beside(path: Path) -> Path | None:
    """The label of the same name beside a data file; None without one."""
    for suffix in (".lbl", ".LBL", ".xml", ".XML"):
        label = path.with_suffix(suffix)
        if label != path and label.is_file():
            return label
    return None


def _read_fits(path: Path) -> Product:
    return Product(path=path, data=path, kind="FITS", image=read_image(path), label=read_fits_header(path))
