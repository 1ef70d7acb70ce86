"""Uncompressed pixels at an offset that a label gives; the label is checked against the file first."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.images import MAX_PIXELS
from photoclinometry.model.errors import ImageError
from photoclinometry.model.image import Image


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The place and form of one band of an image in a file."""

    offset: int
    """First byte of the first pixel, from 0 (before any prefix of its line)."""
    lines: int
    samples: int
    dtype: np.dtype
    """With byte order."""
    prefix: int = 0
    """Bytes before each line."""
    suffix: int = 0
    """Bytes after each line."""
    tile: tuple[int, int] | None = None
    """(lines, samples) of ISIS's tiles; None for line after line."""


def read_pixels(label: Path, path: Path, layout: Layout) -> np.ndarray:
    """(lines, samples) of `layout.dtype`, in the order of the file `path`.

    Raises ImageError that names the `label` if the file cannot hold these pixels, before anything large is read.
    """
    check_size(label, layout.lines, layout.samples)
    if min(layout.offset, layout.prefix, layout.suffix) < 0:
        raise ImageError(f"{label}: the label puts pixels before the file's beginning; fetch or export it again")
    size = _extent(label, layout)
    try:
        held = path.stat().st_size
        if held < layout.offset + size:
            raise ImageError(
                f"{label}: the label announces {layout.lines} x {layout.samples} pixels of {layout.dtype.itemsize} "
                f"bytes from byte {layout.offset} on, but {path.name} ends after {held} bytes: it was cut short, or "
                "the label is another file's; fetch it again"
            )
        with open(path, "rb") as file:
            file.seek(layout.offset)
            data = file.read(size)
    except OSError as error:
        raise ImageError(f"{label}: {path.name} cannot be read: {error.strerror or error}") from error
    return _from_tiles(data, layout) if layout.tile else _from_lines(data, layout)


def physical_image(name: Path, raw: np.ndarray, valid: np.ndarray, factor: float, offset: float) -> Image:
    """Values factor * raw + offset as an image; values beyond single precision become invalid."""
    with np.errstate(over="ignore", invalid="ignore"):
        values = (np.where(valid, raw, 0).astype(np.float64) * factor + offset).astype(np.float32)
    valid = valid & np.isfinite(values)
    return Image(str(name), np.where(valid, values, np.float32(0)), valid)


def check_size(path: Path, lines: int, samples: int) -> None:
    """Raises ImageError for an image of a single line or sample, or of more than MAX_PIXELS."""
    if lines < 2 or samples < 2:
        raise ImageError(
            f"{path}: the label gives {lines} lines of {samples} samples, which is not an image; correct the label"
        )
    if lines * samples > MAX_PIXELS:
        raise ImageError(f"{path}: declares {samples} x {lines} pixels, more than {MAX_PIXELS}; crop it first")


def _extent(path: Path, layout: Layout) -> int:
    size = layout.dtype.itemsize
    if layout.tile is None:
        return layout.lines * (layout.prefix + layout.samples * size + layout.suffix)
    height, width = layout.tile
    if not (0 < height <= layout.lines and 0 < width <= layout.samples):
        raise ImageError(f"{path}: tiles of {width} x {height} do not fit the image; fetch or export it again")
    return -(-layout.lines // height) * -(-layout.samples // width) * height * width * size


def _from_lines(data: bytes, layout: Layout) -> np.ndarray:
    size = layout.samples * layout.dtype.itemsize
    rows = np.frombuffer(data, np.uint8).reshape(layout.lines, layout.prefix + size + layout.suffix)
    return np.ascontiguousarray(rows[:, layout.prefix : layout.prefix + size]).view(layout.dtype)


def _from_tiles(data: bytes, layout: Layout) -> np.ndarray:
    assert layout.tile is not None
    height, width = layout.tile
    down, across = -(-layout.lines // height), -(-layout.samples // width)
    tiles = np.frombuffer(data, layout.dtype).reshape(down, across, height, width)
    whole = tiles.transpose(0, 2, 1, 3).reshape(down * height, across * width)
    return np.ascontiguousarray(whole[: layout.lines, : layout.samples])
