"""Times, positions, rotations and keywords from SPICE kernels. Needs the extra `geo` (spiceypy).

SPICE runs in a separate process (`io/spice_worker.py`). A damaged kernel that makes it crash or hang is then an error
here, and its kernel pool is not shared with the program that uses this package.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.child import Child, NoAnswerError
from photoclinometry.io.reading import read_bytes
from photoclinometry.model.errors import InputError

_TEXT = (".tls", ".tsc", ".tpc", ".tf", ".ti")
_BINARY = (".bsp", ".bc", ".bpc", ".bds")
_META = (".tm", ".mk")
_NOT_COVERED = ("SPKINSUFFDATA", "NOFRAMECONNECT", "CKINSUFFDATA")
"""SPICE's errors for times, or bodies and frames, that no kernel covers."""
_COVERS = 2
"""Kernels whose times an error names; the others are counted."""
_LISTED = 4
"""Kernels that an error names; the others are counted."""
_KNOWN_HEADS = (b"KPL/", b"DAF/", b"NAIF/DAF", b"DAS/", b"\\begin")
_FARTHEST_KM = 1e12
"""Positions farther away than this are of no body of the solar system: a kernel is damaged [km]."""
_TIMEOUT_S = 120.0
"""Longest wait for one answer [s]; the slowest, loading a large text kernel, takes seconds."""
_HEAD_BYTES = 1024
"""A kernel's type stands in its first bytes; text kernels may begin with comments."""


class TimeNotCoveredError(InputError):
    """No loaded kernel covers a time."""

    def __init__(self, time: str, rest: str):
        super().__init__(f"the time {time} is {rest}")
        self.time = time
        """As UTC, or in seconds where no leap seconds are loaded."""


class Kernels:
    """Loaded kernels. All methods raise InputError with SPICE's reason if it has no answer."""

    def __init__(self, files: Sequence[Path]):
        self.files = list(files)
        self._child = Child("spice_worker.py")

    def close(self) -> None:
        """Ends the process."""
        self._child.close()

    def load(self, file: Path) -> None:
        """Loads one more kernel, which overrides earlier ones.

        Relative paths in a meta-kernel that lead nowhere from the working folder are taken from the meta-kernel's own.
        """
        _check_head(file)
        try:
            named = self._ask("", "listed", str(file)) if file.suffix.lower() in _META else []
            if all(Path(kernel).exists() for kernel in named):
                self._ask("", "load", str(file))
                return
        except InputError as error:
            raise InputError(f"{file}: SPICE cannot load this kernel: {error}") from error
        for kernel in _beside_meta_kernel(file, named):
            self.load(kernel)

    def unload(self) -> None:
        """Unloads every kernel."""
        self._ask("", "unload")

    def time_of_clock(self, spacecraft: int, clock: str) -> float:
        """Ephemeris time [s TDB past J2000] of a spacecraft clock's reading."""
        return self._ask(f"the time of clock {clock!r} (spacecraft {spacecraft})", "clock", spacecraft, clock)

    def time_of_utc(self, utc: str) -> float:
        """Ephemeris time [s TDB past J2000]."""
        return self._ask(f"the time of {utc!r}", "utc", utc.removesuffix("Z"))

    def position(self, target: str, time: float, frame: str, correction: str, observer: str) -> np.ndarray:
        """(3,) [km] of `target` as seen from `observer`."""
        what = f"the position of {target} seen from {observer}"
        place = np.array(self._ask_at(time, what, "position", target, time, frame, correction, observer))
        if not (np.abs(place) < _FARTHEST_KM).all():
            raise InputError(
                f"SPICE gives {place.tolist()} km as {what} at {time:.3f} s; one of the position kernels (*.bsp) is "
                "damaged"
            )
        return place

    def rotation(self, source: str, target: str, time: float) -> np.ndarray:
        """(3, 3) target_from_source."""
        what = f"the rotation from {source} to {target}"
        return np.array(self._ask_at(time, what, "rotation", source, target, time))

    def keyword(self, name: str) -> tuple[Any, ...] | None:
        """The values of a keyword of the text kernels, numbers or text; None if there is no such keyword."""
        values = self._ask(f"the keyword {name}", "keyword", name)
        return None if values is None else tuple(values)

    def keywords_of(self, instrument: int) -> dict[str, tuple[Any, ...]]:
        """The values of all keywords INSnnn_... of an instrument, by name."""
        found = self._ask(f"the keywords of instrument {instrument}", "keywords", f"INS{instrument}_*")
        return {name: tuple(values) for name, values in found.items()}

    def body_code(self, name: str) -> int:
        """The NAIF identifier of a body."""
        code = self._ask(f"the NAIF identifier of {name}", "body", name)
        if code is None:
            raise InputError(f"SPICE knows no body {name!r}; load its kernels, or pass --body with NAIF's name")
        return code

    def body_frame(self, body: int) -> str:
        """The name of a body's fixed frame."""
        name = self._ask(f"the frame fixed to body {body}", "body frame", body)
        if name is None:
            raise InputError(f"SPICE knows no frame fixed to body {body}; load its frame and constants kernels")
        return name

    def frame_name(self, code: int) -> str | None:
        """The name of a frame; None if the kernels do not define it."""
        return self._ask(f"the name of frame {code}", "frame name", code)

    def _ask_at(self, time: float, what: str, question: str, *arguments: Any) -> Any:
        """As `_ask`, of a time [s TDB past J2000]; the error names the kernels that do not cover it."""
        try:
            return self._ask(f"{what} at {time:.3f} s", question, *arguments)
        except InputError as error:
            if not any(code in str(error) for code in _NOT_COVERED):
                raise
            lacking = self._ask("the times of the kernels", "uncovered", time)
            if not lacking:
                raise
            # Attitudes are in *.bc, positions in *.bsp: those that were asked for come first.
            lacking.sort(key=lambda each: (Path(each[0]).suffix.lower() == ".bc") != (question == "rotation"))
            listed = ", ".join(
                f"{Path(file).name} ({self._date(begin)} to {self._date(end)})"
                for file, begin, end in lacking[:_COVERS]
            )
            more = f" and {len(lacking) - _COVERS} more" if len(lacking) > _COVERS else ""
            code = next(code for code in _NOT_COVERED if code in str(error))
            raise TimeNotCoveredError(
                self._date(time),
                f"outside of what the kernels cover: load kernels of that time. Loaded are {listed}{more}, and SPICE "
                f"does not give {what} ({code})",
            ) from error

    def _date(self, time: float) -> str:
        """A time [s TDB past J2000] as UTC, or as it is where no leap seconds are loaded."""
        try:
            return self._ask("", "date", time)
        except InputError:
            return f"{time:.0f} s TDB"

    def _ask(self, what: str, question: str, *arguments: Any) -> Any:
        try:
            answer = self._child.ask([question, *arguments], _TIMEOUT_S)
        except NoAnswerError as error:
            named = ", ".join(file.name for file in self.files if file.suffix.lower() in _BINARY) or "the kernels"
            asked = f" when asked for {what}" if what else ""
            raise InputError(f"SPICE broke down{asked}: one of {named} is damaged; fetch it again") from error
        if "error" in answer:
            raise InputError(f"SPICE does not give {what}: {answer['error']}" if what else answer["error"])
        return answer["value"]


@contextmanager
def loaded_kernels(given: Sequence[Path]) -> Iterator[Kernels]:
    """Kernels, meta-kernels and folders of kernels, loaded in the order of `kernel_files` while the block runs.

    Raises InputError for files that are missing, damaged, or not kernels.
    """
    if importlib.util.find_spec("spiceypy") is None:
        raise InputError(
            f"{given[0]}: SPICE kernels need spiceypy: pip install 'photoclinometry[geo]', or leave --kernels out"
        )
    files = kernel_files(given)
    kernels = Kernels(files)
    try:
        for file in files:
            kernels.load(file)
        yield kernels
    finally:
        kernels.close()


def kernel_files(given: Sequence[Path]) -> list[Path]:
    """Files in loading order: as given; those of a folder in `loading_order`. A later kernel overrides an earlier.

    Of a folder that holds a meta-kernel, this alone is loaded. Raises InputError for two.
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
    """By name, but generic constants (pck00009.tpc) first and ISIS's addenda, made to override others, last."""

    def rank(path: Path) -> tuple[int, str]:
        name = path.name.lower()
        generic, addendum = re.fullmatch(r"pck\d+\.tpc", name), "addendum" in name
        return (0 if generic else 2 if addendum else 1, path.name)

    return sorted(files, key=rank)


def _beside_meta_kernel(meta: Path, named: Sequence[str]) -> list[Path]:
    """The kernels that a meta-kernel names, from its own folder where they are not in the working folder.

    Raises InputError that names those in neither.
    """
    files = [Path(k) if Path(k).exists() else meta.parent / k for k in named]
    missing = [str(k) for k, file in zip(named, files, strict=True) if not file.exists()]
    if missing:
        listed = ", ".join(missing[:_LISTED]) + (", ..." if len(missing) > _LISTED else "")
        raise InputError(
            f"{meta}: {len(missing)} of the {len(named)} kernels that it names are neither in the working folder nor "
            f"relative to its own: {listed}; fetch them, or correct PATH_VALUES in it"
        )
    if meta.resolve() in [file.resolve() for file in files]:
        raise InputError(f"{meta}: SPICE cannot load this kernel: it names itself; remove it from KERNELS_TO_LOAD")
    return files


def _check_head(file: Path) -> None:
    """Raises InputError if a file is not a SPICE kernel."""
    head = read_bytes(file, "kernel", limit=_HEAD_BYTES)
    if not head.lstrip().startswith(_KNOWN_HEADS) and b"\\begindata" not in head:
        raise InputError(f"{file}: is not a SPICE kernel (it begins with {head[:8]!r}); check the path")
