"""SPICE kernels: loaded for a while, and asked for times, positions, rotations and keywords. Needs the extra `geo`.

The only file that imports spiceypy. The kernel pool belongs to the whole process: what is loaded here is unloaded
again, in whatever way the block ends.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.errors import InputError

_TEXT = (".tls", ".tsc", ".tpc", ".tf", ".ti")
_BINARY = (".bsp", ".bc", ".bpc", ".bds")
_META = (".tm", ".mk")
_KNOWN_HEADS = (b"KPL/", b"DAF/", b"NAIF/DAF", b"DAS/", b"\\begin")
_MAX_VALUES = 100


@contextmanager
def loaded_kernels(given: Sequence[Path]) -> Iterator[list[Path]]:
    """Kernels, meta-kernels and folders of kernels, loaded in the order of `kernel_files`.

    Yields the files. Raises InputError for files that are missing, damaged, or no kernels.
    """
    spice = _spiceypy(given[0] if given else Path("kernels"))
    files = kernel_files(given)
    loaded: list[Path] = []
    try:
        for file in files:
            _check_head(file)
            try:
                spice.furnsh(str(file))
            except spice.utils.exceptions.SpiceyError as error:
                raise InputError(f"{file}: SPICE cannot load this kernel: {_reason(error)}") from error
            loaded.append(file)
        yield loaded
    finally:
        for file in reversed(loaded):
            spice.unload(str(file))


def kernel_files(given: Sequence[Path]) -> list[Path]:
    """Files in loading order: as given, and of a folder in `loading_order`; the last one loaded wins.

    A folder with meta-kernels in it must have just one, which is then taken alone. Raises InputError.
    """
    files: list[Path] = []
    for path in given:
        if not path.is_dir():
            files.append(path)
            continue
        inside = sorted(p for p in path.rglob("*") if p.suffix.lower() in _TEXT + _BINARY + _META and p.is_file())
        meta = [p for p in inside if p.suffix.lower() in _META]
        if len(meta) > 1:
            raise InputError(f"{path}: holds {len(meta)} meta-kernels; name the one to use")
        if not inside:
            raise InputError(f"{path}: holds no SPICE kernels (*{', *'.join(_TEXT + _BINARY)}); check the folder")
        files.extend(meta or loading_order(inside))
    return files


def loading_order(files: Sequence[Path]) -> list[Path]:
    """By name, but generic constants (pck00009.tpc) first and ISIS's addenda, which mean to overrule, last."""

    def rank(path: Path) -> tuple[int, str]:
        name = path.name.lower()
        generic, addendum = re.fullmatch(r"pck\d+\.tpc", name), "addendum" in name
        return (0 if generic else 2 if addendum else 1, path.name)

    return sorted(files, key=rank)


def ask(what: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """`function(*arguments)` of spiceypy. Raises InputError with `what` was wanted and which kernel it lacks."""
    spice = _spiceypy(Path("kernels"))
    try:
        return function(*arguments)
    except (spice.utils.exceptions.SpiceyError, spice.utils.exceptions.NotFoundError) as error:
        raise InputError(f"SPICE does not tell {what}: {_reason(error)}") from error


def time_of_clock(spacecraft: int, clock: str) -> float:
    """Ephemeris time [s TDB past J2000] of a spacecraft clock's reading. Raises InputError."""
    spice = _spiceypy(Path("kernels"))
    return float(ask(f"the time of clock {clock!r} (spacecraft {spacecraft})", spice.scs2e, spacecraft, clock))


def time_of_utc(utc: str) -> float:
    """Ephemeris time [s TDB past J2000]. Raises InputError."""
    spice = _spiceypy(Path("kernels"))
    return float(ask(f"the time of {utc!r}", spice.str2et, utc.removesuffix("Z")))


def position(target: str, time: float, frame: str, correction: str, observer: str) -> np.ndarray:
    """(3,) [km] of `target` as seen from `observer`. Raises InputError."""
    spice = _spiceypy(Path("kernels"))
    what = f"where {target} is, seen from {observer}, at {time:.3f} s"
    return np.array(ask(what, spice.spkpos, target, time, frame, correction, observer)[0])


def rotation(source: str, target: str, time: float) -> np.ndarray:
    """(3, 3) target_from_source. Raises InputError."""
    spice = _spiceypy(Path("kernels"))
    return np.array(ask(f"how {source} lies in {target} at {time:.3f} s", spice.pxform, source, target, time))


def keyword(name: str) -> tuple[Any, ...] | None:
    """The values of a keyword of the loaded text kernels: numbers or text; None where there is none."""
    spice = _spiceypy(Path("kernels"))
    try:
        found = spice.dtpool(name)
        values = (spice.gdpool if found[1] == "N" else spice.gcpool)(name, 0, min(found[0], _MAX_VALUES))
    except spice.utils.exceptions.NotFoundError:
        return None
    return tuple(float(v) for v in values) if found[1] == "N" else tuple(str(v) for v in values)


def body_code(name: str) -> int:
    """The NAIF number of a body. Raises InputError."""
    spice = _spiceypy(Path("kernels"))
    try:
        return int(spice.bods2c(name))
    except spice.utils.exceptions.NotFoundError:
        raise InputError(f"SPICE knows no body {name!r}; load its kernels, or pass --body with NAIF's name") from None


def body_frame(body: int) -> str:
    """The name of the frame that is fixed to a body. Raises InputError."""
    spice = _spiceypy(Path("kernels"))
    try:
        return str(spice.cidfrm(body)[1])
    except spice.utils.exceptions.NotFoundError:
        raise InputError(f"SPICE knows no frame fixed to body {body}; load its frame and constants kernels") from None


def frame_name(code: int) -> str | None:
    """The name of a frame; None where the loaded kernels do not have it."""
    return str(_spiceypy(Path("kernels")).frmnam(code)) or None


def _reason(error: Any) -> str:
    """The short message and its explanation, in one line."""
    long = " ".join(str(getattr(error, "long", "") or error).split())
    return f"{getattr(error, 'short', '')} {long}".strip()[:300]


def _check_head(file: Path) -> None:
    """Raises InputError for what SPICE would take for a kernel, and choke on."""
    try:
        with open(file, "rb") as stream:
            head = stream.read(1024)
    except FileNotFoundError:
        raise InputError(f"{file}: there is no such kernel; check the path") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from error
    if not head.lstrip().startswith(_KNOWN_HEADS) and b"\\begindata" not in head:
        raise InputError(f"{file}: is no SPICE kernel (it begins with {head[:8]!r}); check the path")


def _spiceypy(wanted: Path) -> Any:
    try:
        import spiceypy
    except ImportError as error:
        raise InputError(
            f"{wanted}: SPICE kernels need spiceypy: pip install 'photoclinometry[geo]', or leave --kernels out"
        ) from error
    return spiceypy
