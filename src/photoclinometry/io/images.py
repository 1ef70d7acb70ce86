"""Images from files: FITS, PNG and TIFF as linear brightness with a mask of valid pixels.

Row 0 of the array is the first row in the file, for FITS too: its "bottom" row is row 0 here. Nothing is
rescaled: FITS values are physical (BSCALE, BZERO applied), PNG and TIFF values are the numbers in the file.
"""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.atomic import write_bytes
from photoclinometry.io.reading import read_image_bytes
from photoclinometry.model.errors import ImageError
from photoclinometry.model.image import Image

MAX_PIXELS = 2**28
"""Files that declare more pixels (16k x 16k) are refused before anything is decoded."""

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_PROFILES = {b"sRGB": "sRGB", b"iCCP": "a colour profile"}
"""Chunks that declare an encoding for display."""
_PNG_UNITY = 100_000
"""gAMA counts in parts of this."""
_CICP_LINEAR = 8
"""Transfer characteristics of a cICP chunk, its second byte, that declare linear numbers (ITU-T H.273, table 3)."""
_JPEG = b"\xff\xd8\xff"
_TIFF = {b"II*\0": "<", b"MM\0*": ">"}
_CUT_SHORT = ("buffer is too small", "may have been truncated", "Empty or corrupt FITS", "Header missing END card")
"""Words of astropy's for a FITS file that ends early."""
_GAMMA_TOLERANCE = 0.02
"""A gAMA chunk this near to 1 declares linear numbers."""
_BIG_TIFF = (b"II+\0", b"MM\0+")


def read_image(path: Path | str, *, linear: bool = False, remedy: str = "") -> Image:
    """One image: brightness (h, w) float32, and `valid` where it is a measurement.

    Not valid: NaN and infinite values, FITS BLANK, integers at the top of their container's range
    (saturated), values at or above a FITS header's SATURATE or above its DATAMAX. Brightness is 0 there.
    A detector with fewer bits than its container (12 in 16) saturates at a lower number: give it as SATURATE.
    The format is recognised by content, not by name. Colour images are accepted if all channels are equal
    and every pixel is opaque. A PNG that declares an encoding for the eye (gAMA other than 1, sRGB, iCCP, cICP) is
    refused unless `linear` states that its numbers are linear nevertheless; remedy: how to state so, for the message.
    Raises ImageError.
    """
    path = Path(path)
    data = read_image_bytes(path, "image")
    if data.startswith(b"SIMPLE"):
        values, valid = _read_fits(path, data)
    elif data.startswith(_PNG):
        encoding = _check_png(path, data)
        if encoding and not linear:
            raise ImageError(
                f"{path}: declares that its numbers are not linear in radiance ({encoding}); export it again from "
                f"linear data{remedy and f', or {remedy} if its numbers are linear all the same'}"
            )
        values, valid = _read_raster(path, data)
    elif data[:4] in _TIFF:
        _check_tiff(path, data)
        values, valid = _read_raster(path, data)
    elif data[:4] in _BIG_TIFF:
        raise ImageError(f"{path}: is a BigTIFF; convert it to plain TIFF or FITS")
    elif data.startswith(_JPEG):
        raise ImageError(f"{path}: is a JPEG, whose numbers are not linear in radiance; get the image as FITS or PNG")
    else:
        raise ImageError(f"{path}: is not a FITS, PNG or TIFF image (it begins with {data[:8]!r}); convert it")
    if values.size == 0:
        raise ImageError(f"{path}: has no pixels (shape {values.shape})")
    with np.errstate(over="ignore"):
        brightness = np.ascontiguousarray(values, dtype=np.float32)
    valid = valid & np.isfinite(brightness)
    return Image(str(path), np.where(valid, brightness, np.float32(0)), valid)


def read_mask(path: Path | str) -> np.ndarray:
    """(h, w) bool: where a PNG or TIFF is not 0. Raises ImageError."""
    path = Path(path)
    data = read_image_bytes(path, "mask")
    if data.startswith(_PNG):
        _check_png(path, data)
    elif data[:4] in _TIFF:
        _check_tiff(path, data)
    else:
        raise ImageError(f"{path}: is not a PNG or TIFF image; save the mask as PNG, 0 where pixels are not to be used")
    return _read_raster(path, data)[0] > 0


def write_fits(path: Path | str, array: np.ndarray) -> None:
    """A 2-D array as a FITS file with checksums; floats are stored as float32. Same array, same bytes.

    Raises RunFolderError.
    """
    from astropy.io import fits

    array = np.asarray(array)
    if array.ndim != 2:
        raise ValueError(f"an image has 2 axes, got shape {array.shape}")
    if array.dtype.kind == "f":
        array = array.astype(np.float32)
    stream = io.BytesIO()
    hdu = fits.PrimaryHDU(array)
    # By default astropy adds the time of writing to the checksum's comment.
    hdu.add_checksum(when="checksum")
    hdu.writeto(stream)
    write_bytes(path, stream.getvalue())


def write_png(path: Path | str, array: np.ndarray) -> None:
    """A uint8 or uint16 array (h, w), or (h, w, 3) in RGB order, as a PNG file. Raises RunFolderError."""
    write_bytes(path, png_bytes(array))


def png_bytes(array: np.ndarray) -> bytes:
    """The content of the file that `write_png` writes."""
    import cv2

    array = np.asarray(array)
    if array.dtype not in (np.uint8, np.uint16) or array.ndim not in (2, 3):
        raise ValueError(f"PNG holds uint8 or uint16 images, got {array.dtype} of shape {array.shape}")
    done, encoded = cv2.imencode(".png", array if array.ndim == 2 else array[..., ::-1])
    if not done:
        raise ValueError(f"an array of shape {array.shape} cannot be encoded as PNG")
    return encoded.tobytes()


def _damaged(path: Path, what: str) -> ImageError:
    return ImageError(f"{path}: is damaged ({' '.join(str(what).split())}); fetch or export it again")


def _check_size(path: Path, width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        raise ImageError(f"{path}: declares {width} x {height} pixels, more than {MAX_PIXELS}; crop it first")


def _check_png(path: Path, data: bytes) -> str:
    """Checks every chunk and its checksum, since the decoder fills missing data with zeros. Raises ImageError.

    Returns the encoding for the eye that the file declares, in words; empty for none. W3C's PNG, 11.3.2.
    """
    at, kind, encoding = len(_PNG), b"", ""
    while kind != b"IEND":
        if at + 12 > len(data):
            raise _damaged(path, f"the PNG ends after {len(data)} bytes, before its end mark")
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 8 + length
        if end + 4 > len(data):
            raise _damaged(path, f"the PNG ends after {len(data)} bytes, before its end mark")
        if zlib.crc32(data[at + 4 : end]) != struct.unpack_from(">I", data, end)[0]:
            raise _damaged(path, f"PNG chunk {kind!r} fails its checksum")
        if at == len(_PNG):
            if kind != b"IHDR" or length != 13:
                raise _damaged(path, "the PNG has no header")
            _check_size(path, *struct.unpack_from(">II", data, at + 8))
        if kind == b"gAMA" and length == 4:
            gamma = struct.unpack_from(">I", data, at + 8)[0] / _PNG_UNITY
            encoding = encoding or (f"gamma {gamma:.4g}" if abs(gamma - 1.0) > _GAMMA_TOLERANCE else "")
        elif kind == b"cICP" and length == 4 and data[at + 9] != _CICP_LINEAR:
            encoding = f"code points for video, transfer {data[at + 9]}"
        elif kind in _PNG_PROFILES:
            encoding = _PNG_PROFILES[kind]
        at = end + 4
    return encoding


def _check_tiff(path: Path, data: bytes) -> None:
    """Checks width and height (tags 256, 257) of the first directory before decoding. Raises ImageError."""
    order = _TIFF[data[:4]]
    size = {}
    try:
        (at,) = struct.unpack_from(order + "I", data, 4)
        (count,) = struct.unpack_from(order + "H", data, at)
        for entry in range(at + 2, at + 2 + 12 * count, 12):
            tag, kind, _ = struct.unpack_from(order + "HHI", data, entry)
            if tag in (256, 257):
                (size[tag],) = struct.unpack_from(order + ("H" if kind == 3 else "I"), data, entry + 8)
    except struct.error:
        raise _damaged(path, "the TIFF directory points past the end of the file") from None
    if len(size) < 2:
        raise _damaged(path, "the TIFF gives no width and height")
    _check_size(path, size[256], size[257])


def _read_raster(path: Path, data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Grey values of a PNG or TIFF, and where they are not saturated."""
    import cv2

    try:
        values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise _damaged(path, str(error.err or "it cannot be decoded")) from error
    if values is None:
        raise _damaged(path, "it cannot be decoded")
    if values.ndim == 3:
        values = _grey(path, values)
    return values, _unsaturated(values)


def _grey(path: Path, values: np.ndarray) -> np.ndarray:
    """(h, w) the first channel of an image (h, w, 1..4), if its colour channels are equal. Raises ImageError."""
    channels = values.shape[2]
    if channels in (2, 4):
        opaque = np.iinfo(values.dtype).max if values.dtype.kind in "ui" else 1.0
        if (values[..., -1] != opaque).any():
            raise ImageError(f"{path}: has transparent pixels; export it as plain grey (mask in FITS: NaN)")
    grey = values[..., 0]
    if channels in (3, 4) and any((values[..., c] != grey).any() for c in (1, 2)):
        raise ImageError(f"{path}: is a colour image; export one band as grey, linear in radiance")
    return grey


def _unsaturated(values: np.ndarray) -> np.ndarray:
    """Integers below the top of their container's range; all True for floats."""
    if values.dtype.kind not in "ui":
        return np.ones(values.shape, bool)
    return values != np.iinfo(values.dtype).max


def _read_fits(path: Path, data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Physical values of the first image with two axes, and where they are not blank or saturated."""
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyWarning

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AstropyWarning)
            warnings.filterwarnings("error", "Datasum verification failed", AstropyWarning)
            warnings.filterwarnings("error", "File may have been truncated", AstropyWarning)
            with fits.open(io.BytesIO(data), do_not_scale_image_data=True, checksum=True) as hdus:
                shapes = []  # of images without two axes
                hdu: Any
                for hdu in hdus:
                    shape = tuple(getattr(hdu, "shape", ()))
                    if not hdu.is_image or not shape:
                        continue
                    shapes.append(shape)
                    if len(shape) >= 2 and set(shape[:-2]) <= {1}:
                        _check_size(path, shape[-1], shape[-2])
                        return _fits_values(hdu.data.reshape(shape[-2:]), hdu.header)
    except ImageError:
        raise
    # A damaged file makes astropy raise nearly every built-in exception, and its own warnings.
    except Exception as error:
        if any(words in str(error) for words in _CUT_SHORT):
            raise ImageError(
                f"{path}: was cut short: it ends after {len(data)} bytes, before the end of the header or of the "
                "pixels that it announces; fetch or export it again"
            ) from error
        raise _damaged(path, f"{type(error).__name__}: {error}") from error
    if not shapes:
        raise ImageError(
            f"{path}: is a FITS file without an image, such as one of tables alone; give the file of the image"
        )
    found = ", ".join(map(str, shapes))
    raise ImageError(f"{path}: has no image with two axes (found: {found}); extract one plane")


def _fits_values(raw: np.ndarray, header: Any) -> tuple[np.ndarray, np.ndarray]:
    valid = _unsaturated(raw)
    if raw.dtype.kind in "ui" and "BLANK" in header:
        valid &= raw != header["BLANK"]
    values = raw.astype(np.float64)
    values = values * float(header.get("BSCALE", 1.0)) + float(header.get("BZERO", 0.0))
    with np.errstate(invalid="ignore"):
        if "SATURATE" in header:
            valid &= values < float(header["SATURATE"])
        if "DATAMAX" in header:
            valid &= values <= float(header["DATAMAX"])
    return values, valid
