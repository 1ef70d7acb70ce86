"""The SUMFILE of an image, by name or time, and the camera that it describes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from photoclinometry.ingest.detector import Detector, detector_of_matrix
from photoclinometry.ingest.facts import Facts, time_of
from photoclinometry.io.models.sumfile import PIXEL_OFFSET, SumFile, read_sumfile
from photoclinometry.model.errors import InputError

_SAME_TIME = timedelta(seconds=2.0)
"""SUMFILEs give the middle of an exposure, names its beginning, rounded to a second."""
_TIME_IN_NAME = re.compile(r"(20\d{6})[ts_]?(\d{6})(?:[s.](\d{1,3}))?", re.IGNORECASE)


@dataclass(frozen=True)
class NamedSum:
    """A SUMFILE with its path."""

    path: Path
    summary: SumFile


def read_sumfiles(given: Sequence[Path]) -> list[NamedSum]:
    """The SUMFILEs given, and those (*.SUM) in the folders given. Raises InputError."""
    files: list[Path] = []
    for path in given:
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() == ".sum") if path.is_dir() else [path]
        if not inside:
            raise InputError(f"{path}: holds no SUMFILEs (*.SUM); check the folder")
        files.extend(inside)
    return [NamedSum(file, read_sumfile(file)) for file in files]


def sumfile_of(path: Path, facts: Facts, known: Sequence[NamedSum]) -> NamedSum | None:
    """The SUMFILE with the image's name, else with its time; None if there is none. Raises InputError for two.

    The name of an image may have more before and after that of its SUMFILE. Of several names in it the longest counts.
    """
    stem = path.stem.lower()
    shared = [max(_shared(name.lower(), stem) for name in (s.summary.name, s.path.stem)) for s in known]
    named = [s for s, length in zip(known, shared, strict=True) if length == max(shared) > 0]
    time = time_of(facts.start) or _time_in(path.name)
    if not named and time is not None:
        named = [s for s in known if (other := time_of(s.summary.utc)) and abs(other - time) <= _SAME_TIME]
    if len(named) > 1:
        raise InputError(f"{path}: matches both {named[0].path.name} and {named[1].path.name}; pass one of them")
    return named[0] if named else None


def _shared(name: str, stem: str) -> int:
    """The length of a SUMFILE's name that is in an image's; 0 if it is not, or only within a longer number or word.

    So IMG1 is in IMG1_CAL, but not in IMG10.
    """
    if name not in stem:  # of thousands of SUMFILEs, most
        return 0
    places = (found.span() for found in re.finditer(re.escape(name), stem))
    whole = any(not (_continues(stem[max(a - 1, 0) : a + 1]) or _continues(stem[b - 1 : b + 1])) for a, b in places)
    return len(name) if whole else 0


def _continues(pair: str) -> bool:
    """Whether two neighbouring characters are of one number or of one word."""
    return len(pair) == 2 and (pair.isdigit() or pair.isalpha())


def detector_of_sumfile(named: NamedSum) -> Detector:
    """The camera of a SUMFILE, lines and samples in SPC's order. Raises InputError for a camera with distortion."""
    s = named.summary
    if any(s.distortion) or s.k_matrix[2] or s.k_matrix[5]:
        raise InputError(
            f"{named.path}: describes a distorted camera (DISTORTION, K-MATRIX 3 and 6), which is not supported; "
            "undistort the image in SPC, or pass --kernels instead"
        )
    k = np.array(s.k_matrix).reshape(2, 3)
    center = (s.center[0] - PIXEL_OFFSET, s.center[1] - PIXEL_OFFSET)
    return detector_of_matrix(k[:, :2], width=s.width, height=s.height, focal_mm=s.focal_mm, center=center)


def _time_in(name: str) -> datetime | None:
    """The time in a file's name, such as 20190314t190123s972; None if there is none."""
    found = _TIME_IN_NAME.search(name)
    try:
        return found and datetime.strptime(f"{found[1]}{found[2]}.{found[3] or '0'}", "%Y%m%d%H%M%S.%f")
    except ValueError:
        return None
