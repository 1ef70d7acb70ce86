"""The keywords of a FITS file."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from photoclinometry.io.archives.pvl import Block
from photoclinometry.model.errors import ImageError


def read_fits_header(path: Path) -> Block:
    """The keywords of all header-data units, in their order. Raises ImageError."""
    from astropy.io import fits

    block = Block("")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with fits.open(path) as hdus:
                hdu: Any
                for hdu in hdus:
                    header = hdu.header
                    cards = [(key, header[key]) for key in header if key and key not in ("COMMENT", "HISTORY")]
                    block.statements.extend((key.upper(), value) for key, value in cards)
    # A damaged file makes astropy raise nearly every built-in exception.
    except Exception as error:
        raise ImageError(f"{path}: its FITS header is damaged ({error}); fetch or export it again") from error
    return block
