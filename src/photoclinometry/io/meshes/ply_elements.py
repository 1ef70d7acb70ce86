"""The elements of a PLY file as columns, read from ascii or binary rows, with or without lists."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from photoclinometry.io.reading import read_bytes
from photoclinometry.model.errors import InputError

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}
_MAX_HEADER = 65536
"""Bytes in which the header must end; real ones have a few hundred."""
_COUNT_DIGITS = 15
"""Digits of an element's count; longer numbers are damage."""

Lists = tuple[np.ndarray, np.ndarray]
"""A list property: (n,) lengths, and the values of all lists in one array."""
Columns = dict[str, np.ndarray | Lists]


@dataclass
class _Property:
    name: str
    type: str
    count_type: str | None = None
    """The type of a list's length; None if the property is not a list."""


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        return any(p.count_type for p in self.properties)


def read_elements(path: Path) -> dict[str, Columns]:
    """Every element's properties by name. Raises InputError for anything but a whole, well-formed PLY file."""
    data = read_bytes(path)
    try:
        form, elements, at = _parse_header(data)
        if form == "ascii":
            return _read_ascii(data[at:], elements)
        return _read_binary(data, at, elements, _ORDERS[form])
    except _Malformed as error:
        raise InputError(f"{path}: is not a complete PLY file ({error}); export it again") from error


def read_comments(path: Path) -> list[str]:
    """The comments of the header, without the word `comment`; none of a file without a header."""
    head = read_bytes(path)[:_MAX_HEADER].split(b"end_header")[0].decode("latin-1")
    return [line.removeprefix("comment ").strip() for line in head.splitlines() if line.startswith("comment ")]


class _Malformed(Exception):
    """The fault of a file; the caller adds the file's name."""


def _parse_header(data: bytes) -> tuple[str, list[_Element], int]:
    """Format, elements, and the offset of the body [bytes]."""
    end = re.search(rb"end_header[ \t]*(\r\n|\n|\r)", data[:_MAX_HEADER])
    if not data.startswith(b"ply") or end is None:
        raise _Malformed("it does not begin with a header from `ply` to `end_header`")
    form, elements = None, []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        match words:
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case ["format", kind, "1.0"] if kind in _ORDERS:
                form = kind
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) <= _COUNT_DIGITS:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count, kind, name] if (
                elements and _TYPES.get(count, "f")[0] in "iu" and kind in _TYPES
            ):
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case _:
                raise _Malformed(f"header line not understood: {line[:60]!r}")
    if form is None:
        raise _Malformed("the header names no known format")
    for element in elements:
        names = [p.name for p in element.properties]
        if not names or len(set(names)) < len(names):
            raise _Malformed(f"element {element.name} has no properties, or two of the same name")
    return form, elements, end.end()


def _read_ascii(body: bytes, elements: list[_Element]) -> dict[str, Columns]:
    lines = body.split(b"\n")
    at, out = 0, {}
    for element in elements:
        rows = lines[at : at + element.count]
        if len(rows) < element.count or (rows and not rows[-1].strip()):
            raise _Malformed(f"{element.count} {element.name} rows are announced, there are fewer")
        try:
            out[element.name] = _ascii_columns(rows, element)
        except (ValueError, IndexError, OverflowError) as error:
            raise _Malformed(f"a {element.name} row does not agree with the header: {error}") from error
        at += element.count
    return out


def _ascii_columns(rows: list[bytes], element: _Element) -> Columns:
    if not element.has_lists:
        table = np.array([row.split() for row in rows], np.float64).reshape(len(rows), -1)
        return {p.name: table[:, i] for i, p in enumerate(element.properties)}
    values: dict[str, list[float]] = {p.name: [] for p in element.properties}
    lengths: dict[str, list[int]] = {p.name: [] for p in element.properties}
    for row in rows:
        words = row.split()
        at = 0
        for p in element.properties:
            length = 1
            if p.count_type:
                length = int(words[at])
                at += 1
            if not 0 <= length <= len(words) - at:
                raise ValueError(f"a list of {length} in a row of {len(words)} words")
            values[p.name] += map(float, words[at : at + length])
            lengths[p.name].append(length)
            at += length
    return {p.name: _column(p, lengths[p.name], values[p.name]) for p in element.properties}


def _column(p: _Property, lengths: list[int], values: list[float]) -> np.ndarray | Lists:
    with np.errstate(invalid="ignore"):
        column = np.array(values, np.float64).astype(p.type)
    return (np.array(lengths, np.int64), column) if p.count_type else column


def _read_binary(data: bytes, at: int, elements: list[_Element], order: str) -> dict[str, Columns]:
    out = {}
    for element in elements:
        if element.has_lists:
            columns = _equal_rows(data, at, element, order)
            columns, at = columns if columns else _ragged_rows(data, at, element, order)
        else:
            row = np.dtype([(p.name, order + p.type) for p in element.properties])
            table = _take(data, at, row, element.count, element.name)
            columns = {p.name: table[p.name] for p in element.properties}
            at += table.nbytes
        out[element.name] = columns
    return out


def _take(data: bytes, at: int, dtype: np.dtype, count: int, name: str) -> np.ndarray:
    if count * dtype.itemsize > len(data) - at:
        raise _Malformed(f"it ends after {len(data)} bytes, within the {count} {name} rows announced")
    return np.frombuffer(data, dtype, count, at)


def _equal_rows(data: bytes, at: int, element: _Element, order: str) -> tuple[Columns, int] | None:
    """All rows at once if every list is as long as in the first row (as in a mesh of triangles); otherwise None."""
    fields, lengths, probe = [], {}, at
    for p in element.properties:
        item = np.dtype(order + p.type)
        if p.count_type is None:
            fields.append((p.name, item))
            probe += item.itemsize
            continue
        counter = np.dtype(order + p.count_type)
        if element.count == 0 or probe + counter.itemsize > len(data):
            return None
        length = int(np.frombuffer(data, counter, 1, probe)[0])
        if not 0 <= length <= len(data) // item.itemsize:
            return None
        fields += [("count of " + p.name, counter), (p.name, item, (length,))]
        lengths[p.name] = length
        probe += counter.itemsize + length * item.itemsize
    row = np.dtype(fields)
    if element.count * row.itemsize > len(data) - at:
        return None
    table = np.frombuffer(data, row, element.count, at)
    if any((table["count of " + name] != length).any() for name, length in lengths.items()):
        return None
    columns: Columns = {p.name: table[p.name] for p in element.properties if p.count_type is None}
    columns |= {name: (np.full(element.count, length), table[name].ravel()) for name, length in lengths.items()}
    return columns, at + table.nbytes


def _ragged_rows(data: bytes, at: int, element: _Element, order: str) -> tuple[Columns, int]:
    values: dict[str, list[float]] = {p.name: [] for p in element.properties}
    lengths: dict[str, list[int]] = {p.name: [] for p in element.properties}
    for _ in range(element.count):
        for p in element.properties:
            length = 1
            if p.count_type:
                counter = np.dtype(order + p.count_type)
                length = int(_take(data, at, counter, 1, element.name)[0])
                at += counter.itemsize
                if length < 0:
                    raise _Malformed(f"a list of {length} in {element.name}")
            items = _take(data, at, np.dtype(order + p.type), length, element.name)
            at += items.nbytes
            values[p.name] += items.tolist()
            lengths[p.name].append(length)
    return {p.name: _column(p, lengths[p.name], values[p.name]) for p in element.properties}, at
