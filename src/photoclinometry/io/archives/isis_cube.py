"""ISIS cubes: pixels with their special values, and the tables of pointing, position, body rotation and Sun.

https://isis.astrogeology.usgs.gov/documents/FileFormats and ISIS's SpecialPixel.h.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.archives.product import Product, Window
from photoclinometry.io.archives.pvl import MAX_LABEL_BYTES, Block, number, parse_pvl, whole
from photoclinometry.io.archives.raw_raster import Layout, physical_image, read_pixels
from photoclinometry.io.reading import read_image_bytes
from photoclinometry.model.errors import ImageError

_TYPES = {
    "UNSIGNEDBYTE": "u1",
    "SIGNEDWORD": "i2",
    "UNSIGNEDWORD": "u2",
    "SIGNEDINTEGER": "i4",
    "UNSIGNEDINTEGER": "u4",
    "REAL": "f4",
    "DOUBLE": "f8",
}
_VALID = {
    "u1": (1, 254),
    "i2": (-32752, 32767),
    "u2": (3, 65522),
    "i4": (-2147483632, 2147483647),
    "u4": (3, 4294967282),
    "f4": (np.uint32(0xFF7FFFFA).view(np.float32), np.finfo(np.float32).max),
    "f8": (np.uint64(0xFFEFFFFFFFFFFFFA).view(np.float64), np.finfo(np.float64).max),
}
"""Lowest and highest valid value by type; beyond them are NULL and the marks of saturation."""
_FIELD_TYPES = {"DOUBLE": "f8", "REAL": "f4", "INTEGER": "i4"}
_MAX_TABLE_BYTES = 1 << 26
"""64 MiB: tables of frame cameras hold a few records; larger sizes are damage."""
_MAX_FIELD_SIZE = 4096
"""Values or characters in one field of a table; larger sizes are damage."""


def read_isis_cube(path: Path) -> Product:
    """A cube of one band with its tables. Raises ImageError, InputError."""
    label = parse_pvl(read_image_bytes(path, limit=MAX_LABEL_BYTES + 1), str(path))
    core = label.block("ISISCUBE", "CORE")
    if core is None:
        raise ImageError(f"{path}: is an ISIS label without pixels (no Core); give the cube itself")
    data = _data_file(path, core)
    raw = read_pixels(path, data, _layout(path, core))
    kind = raw.dtype.newbyteorder("=").str[1:]
    low, high = _VALID[kind]
    with np.errstate(invalid="ignore"):
        valid = (raw >= low) & (raw <= high)
    pixels = core.block("PIXELS") or Block("")
    base, multiplier = number(path, pixels, "BASE", 0.0), number(path, pixels, "MULTIPLIER", 1.0)
    return Product(
        path=path,
        data=data,
        kind="ISIS",
        image=physical_image(path, raw, valid, multiplier, base),
        label=label,
        lines_up=False,
        samples_left=False,
        window=_window(path, label),
        tables={str(b.get("NAME")): _table(path, b) for b in label.blocks if b.name == "TABLE"},
    )


def _data_file(path: Path, core: Block) -> Path:
    detached = core.get("^CORE")
    if detached is None:
        return path
    found = path.parent / Path(str(detached)).name
    if not found.is_file():
        raise ImageError(f"{path}: its pixels are in {detached}, which is not beside it; put it there")
    return found


def _layout(path: Path, core: Block) -> Layout:
    size, pixels = core.block("DIMENSIONS"), core.block("PIXELS")
    if size is None or pixels is None:
        raise ImageError(f"{path}: the label's Core has no Dimensions or Pixels; fetch or export it again")
    bands = whole(path, size, "BANDS", 1)
    if bands != 1:
        raise ImageError(f"{path}: has {bands} bands; export one of them (ISIS: {path.name}+1)")
    kind = _TYPES.get(str(pixels.get("TYPE")).upper())
    if kind is None:
        raise ImageError(f"{path}: pixels of type {pixels.get('TYPE')!r} are not known (known: {', '.join(_TYPES)})")
    order = ">" if str(pixels.get("BYTEORDER")).upper() == "MSB" else "<"
    tiled = str(core.get("FORMAT", "BandSequential")).upper() == "TILE"
    return Layout(
        offset=whole(path, core, "STARTBYTE") - 1,
        lines=whole(path, size, "LINES"),
        samples=whole(path, size, "SAMPLES"),
        dtype=np.dtype(order + kind),
        tile=(whole(path, core, "TILELINES"), whole(path, core, "TILESAMPLES")) if tiled else None,
    )


def _window(path: Path, label: Block) -> Window | None:
    """The window of a cropped or reduced cube. ISIS's AlphaCube counts pixels of the cube that it was cut from,
    of AlphaSamples and AlphaLines, from 0.5 at the outer edge."""
    alpha = label.block("ISISCUBE", "ALPHACUBE")
    if alpha is None:
        return None
    start, step = [], []
    sizes = [whole(path, alpha, f"ALPHA{axis}S", 0) for axis in ("SAMPLE", "LINE")]
    for axis in ("SAMPLE", "LINE"):
        first = number(path, alpha, f"ALPHASTARTING{axis}", 0.5)
        last = number(path, alpha, f"ALPHAENDING{axis}", 0.5)
        count = whole(path, alpha, f"BETA{axis}S")
        if count < 1 or not last > first:
            raise ImageError(f"{path}: the label's AlphaCube spans no pixels; fetch or export it again")
        start.append(first - 0.5)
        step.append((last - first) / count)
    parent = (sizes[0], sizes[1]) if min(sizes) > 0 else None
    return Window((start[0], start[1]), (step[0], step[1]), parent)


def _table(path: Path, block: Block) -> dict[str, np.ndarray]:
    """The numeric columns of one table."""
    name, records = block.get("NAME"), whole(path, block, "RECORDS")
    start, size = whole(path, block, "STARTBYTE"), whole(path, block, "BYTES")
    order = ">" if str(block.get("BYTEORDER")).upper() == "MSB" else "<"
    fields = [_field(path, b, order) for b in block.blocks if b.name == "FIELD"]
    row = sum(dtype.itemsize for _, dtype in fields)
    if start < 1 or records < 0 or not 0 <= size <= _MAX_TABLE_BYTES or records * row > size:
        raise ImageError(f"{path}: table {name} of {records} records does not fit its {size} bytes; export it again")
    if path.stat().st_size < start - 1 + records * row:
        raise ImageError(f"{path}: ends inside table {name}: it was cut short; fetch or export it again")
    if len({n for n, _ in fields}) < len(fields):
        raise ImageError(f"{path}: table {name} has two fields of one name; fetch or export it again")
    if not fields or records == 0:
        return {}
    with open(path, "rb") as file:
        file.seek(start - 1)
        data = file.read(records * row)
    rows = np.frombuffer(data, np.dtype({"names": [n for n, _ in fields], "formats": [d for _, d in fields]}))
    return {n: rows[n].astype(float) for n, dtype in fields if dtype.base.kind != "S"}


def _field(path: Path, block: Block, order: str) -> tuple[str, np.dtype]:
    kind, size = str(block.get("TYPE")).upper(), whole(path, block, "SIZE", 1)
    if not 1 <= size <= _MAX_FIELD_SIZE:
        raise ImageError(f"{path}: a table field of size {size} is not understood; fetch or export it again")
    if kind == "TEXT":
        return str(block.get("NAME")), np.dtype(f"S{size}")
    if kind not in _FIELD_TYPES:
        raise ImageError(f"{path}: a table field of type {kind!r} is not known; fetch or export it again")
    return str(block.get("NAME")), np.dtype((order + _FIELD_TYPES[kind], (size,) if size > 1 else ()))
