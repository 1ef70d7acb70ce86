"""Damage to the bytes of a file, reproducible from a seed.

Damage that a checksum would find at once is also done behind it: in the chunks of a PNG, with checksums renewed, and in
the members of a zip archive, packed again.
"""

from __future__ import annotations

import io
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable

_PNG = b"\x89PNG\r\n\x1a\n"
_TOKEN = re.compile(rb"[+-]?\d+\.?\d*(?:[eEdD][+-]?\d+)?|[A-Za-z_^$][A-Za-z0-9_]*|[=(){},<>\"'\[\]]")
_HEAD = 65536
"""Bytes in which words and numbers of text are looked for; labels and headers end before."""
_GROWTH = 4096
"""Longest block that is added [bytes], so that files stay small."""

WORDS = (
    *(b"0", b"-1", b"1", b"2147483648", b"4294967295", b"9223372036854775808", b"99999999999999999999", b"1" * 400),
    *(b"nan", b"inf", b"-inf", b"1e308", b"1e400", b"-1e400", b"1e-320", b"0x7fffffff", b"16#FF#", b"1.5", b"1_000"),
    *(b"", b" ", b"\0", b"\n", b"\r", b'"', b"'", b"(", b")", b"{", b"}", b"[", b"]", b"=", b"<", b"/*", b"#", b"-\n"),
    *("²".encode(), "١٢٣".encode(), "é".encode(), "\ud800".encode("utf-8", "surrogatepass"), b"\xff\xfe", b"&lt;"),
    *(b"%n%s", b"../../etc/passwd", b"/dev/zero", b"A" * 5000, b"(" * 3000, b"[" * 3000, b"{" * 3000, b"true", b"null"),
)
"""Words that replace one of a text: extremes, other signs, brackets, letters that are not ASCII, places."""
NUMBERS = (0, 1, -1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 40, 1 << 62)
"""Numbers that replace lengths, counts, dimensions and offsets."""
FLOATS = (float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 5e-324, 1e30, -0.0)


def mutated(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    """`data` with one to three faults. others: files of the same kind, from which blocks are taken."""
    inner = _inside(data)
    if inner is not None and random_.random() < 0.5:
        return inner(lambda part: _faults(part, others, random_), random_)
    return _faults(data, others, random_)


def _faults(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    for _ in range(random_.choice((1, 1, 1, 2, 3))):
        data = random_.choice(_KINDS)(data, others, random_)
    return data


def _flip(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    spoilt = bytearray(data)
    for _ in range(random_.choice((1, 1, 2, 8, 64)) if data else 0):
        spoilt[_place(data, random_)] ^= 1 << random_.randrange(8)
    return bytes(spoilt)


def _cut(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    return data[: random_.randrange(len(data) + 1)]


def _delete(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    at = _place(data, random_)
    return data[:at] + data[at + _length(random_) :]


def _double(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    at = _place(data, random_)
    block = data[at : at + _length(random_)]
    return data[:at] + block * random_.choice((2, 2, 3)) + data[at + len(block) :]


def _splice(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    """A block of this file or of another over, or between, the bytes of this one."""
    source = random_.choice([data, *others])
    start, length, at = _place(source, random_), _length(random_), _place(data, random_)
    block = source[start : start + length]
    return data[:at] + block + data[at + (len(block) if random_.random() < 0.7 else 0) :]


def _overwrite(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    at = _place(data, random_)
    block = random_.randbytes(_length(random_))
    return data[:at] + block + data[at + len(block) :]


def _extreme(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    """A length, dimension or value overwritten, in either order of bytes, mostly at a whole multiple of its size."""
    order, size = random_.choice("<>"), random_.choice((1, 2, 4, 8))
    if size == 8 and random_.random() < 0.4:
        word = struct.pack(order + "d", random_.choice(FLOATS))
    elif size == 4 and random_.random() < 0.2:
        word = struct.pack(order + "f", random_.choice((float("nan"), float("inf"), 3e38, -3e38)))
    else:
        value = random_.choice(NUMBERS) % (1 << 8 * size)
        word = value.to_bytes(size, "little" if order == "<" else "big")
    at = _place(data, random_)
    at = at // size * size if random_.random() < 0.7 else at
    return data[:at] + word + data[at + size :]


def _token(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    """A word or number of the text replaced; elsewhere where there is no text."""
    start = random_.randrange(max(min(len(data), _HEAD), 1))
    found = _TOKEN.search(data, start) or _TOKEN.search(data)
    if found is None:
        return _overwrite(data, others, random_)
    return data[: found.start()] + random_.choice(WORDS) + data[found.end() :]


def _line(data: bytes, others: list[bytes], random_: random.Random) -> bytes:
    """A line removed, doubled, or moved."""
    lines = data.split(b"\n", 2000)
    at = random_.randrange(len(lines))
    kind = random_.randrange(3)
    lines[at : at + 1] = [[], [lines[at]] * 2, [lines[-1 - at]]][kind]
    return b"\n".join(lines)


_KINDS: tuple[Callable[[bytes, list[bytes], random.Random], bytes], ...] = (
    *(_flip, _cut, _delete, _double, _splice, _overwrite, _extreme, _extreme, _token, _token, _token, _line),
)


def _place(data: bytes, random_: random.Random) -> int:
    """An index; every second one in the first kilobytes, where headers are."""
    reach = len(data) if random_.random() < 0.5 else min(len(data), random_.choice((64, 512, 4096)))
    return random_.randrange(max(reach, 1)) if data else 0


def _length(random_: random.Random) -> int:
    return min(int(2 ** random_.uniform(0, 13)), _GROWTH)


_Inner = Callable[[Callable[[bytes], bytes], random.Random], bytes]


def _inside(data: bytes) -> _Inner | None:
    """What spoils one part of a file whose parts have checksums; None for other files."""
    if data.startswith(_PNG):
        return lambda spoil, random_: _spoilt_png(data, spoil, random_)
    if data.startswith(b"PK\x03\x04"):
        return lambda spoil, random_: _spoilt_zip(data, spoil, random_)
    return None


def _spoilt_png(data: bytes, spoil: Callable[[bytes], bytes], random_: random.Random) -> bytes:
    chunks, at = [], len(_PNG)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    chosen = random_.randrange(len(chunks))
    kind, body = chunks[chosen]
    if kind == b"IDAT" and [k for k, _ in chunks].count(kind) == 1 and random_.random() < 0.5:
        body = zlib.compress(spoil(zlib.decompress(body)), 1)
    else:
        body = spoil(body)
    chunks[chosen] = (kind, body)
    if random_.random() < 0.1:
        random_.shuffle(chunks)
    packed = (struct.pack(">I", len(b)) + k + b + struct.pack(">I", zlib.crc32(k + b)) for k, b in chunks)
    return _PNG + b"".join(packed)


def _spoilt_zip(data: bytes, spoil: Callable[[bytes], bytes], random_: random.Random) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    chosen = random_.choice(list(members))
    members[chosen] = spoil(members[chosen])
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return stream.getvalue()
