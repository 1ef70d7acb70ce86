"""The forms of archives' files: FITS, and the text of labels of PDS3 and ISIS; times as labels write them."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import spiceypy as spice

FITS_BLOCK = 2880
"""FITS headers are padded to multiples of this [bytes]."""


def write_fits(path: Path, pixels: np.ndarray, keywords: Mapping[str, Any], extension: bool = False) -> int:
    """The file, in single precision; returns the length of its header [bytes].

    extension: the image is the first extension, after a header without one.
    """
    from astropy.io import fits

    hdu = (fits.ImageHDU if extension else fits.PrimaryHDU)(pixels.astype(np.float32))
    hdu.header.update(keywords)
    stream = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), hdu] if extension else [hdu]).writeto(stream)
    path.write_bytes(stream.getvalue())
    return -(-len(hdu.header.tostring()) // FITS_BLOCK) * FITS_BLOCK


def with_values(label: str, values: Mapping[str, Any]) -> str:
    """A label of PDS3 or ISIS with other values, each of which stands on one line, once."""
    for key, value in values.items():
        label, count = re.subn(rf"(?m)^( *){re.escape(key)}( *)=.*$", rf"\g<1>{key}\g<2>= {value}", label)
        assert count == 1, key
    return label


def statements(values: Mapping[str, Any]) -> str:
    """Lines of a PDS3 label; a value that is itself a mapping is an object of that name, or a group ("GROUP name")."""
    lines = []
    for key, value in values.items():
        if isinstance(value, Mapping):
            kind, _, name = key.rpartition(" ")
            kind = kind or "OBJECT"
            lines.append(f"{kind} = {name}\r\n{statements(value)}END_{kind} = {name}\r\n")
        else:
            lines.append(f"{key} = {value}\r\n")
    return "".join(lines)


def image_object(pixels: np.ndarray, sample_type: str, **more: Any) -> dict[str, Any]:
    """The statements of a PDS3 label about an image of these pixels."""
    height, width = pixels.shape
    bits = 8 * pixels.dtype.itemsize
    return {"LINES": height, "LINE_SAMPLES": width, "SAMPLE_TYPE": sample_type, "SAMPLE_BITS": bits, **more}


def utc_of(time: float) -> str:
    """UTC to milliseconds of a time [s TDB past J2000]; leap seconds are loaded."""
    return spice.et2utc(time, "ISOC", 3)


def compact(utc: str) -> str:
    """Date and time in a file's name: "20140922T044458"."""
    return re.sub("[-:]", "", utc).partition(".")[0]
