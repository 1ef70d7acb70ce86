"""The process that runs SPICE: reads questions, one line of JSON each, and answers them until its input ends.

CSPICE does not check binary kernels, and a damaged one can crash the process that reads it. `io/spice.py` therefore
runs this file as a script in a separate process. It imports spiceypy and nothing of this package.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any, TextIO

import spiceypy as spice
from spiceypy.utils.exceptions import NotFoundError, SpiceyError

_MAX_VALUES = 100
"""Values of a keyword that are read; the longest of a camera has a dozen."""
_MAX_NAMES = 1000
"""Keywords of one instrument that are read; OCAMS has sixty."""
_MAX_KERNELS = 10_000
"""Kernels of a meta-kernel that are read; those of whole missions name some hundreds."""
_MAX_REASON = 300
"""Characters of SPICE's explanation that an error shows."""


def keyword(name: str) -> list[Any] | None:
    """The values of a keyword of the text kernels, numbers or text; None if there is no such keyword."""
    try:
        count, kind = spice.dtpool(name)[:2]
        values = (spice.gdpool if kind == "N" else spice.gcpool)(name, 0, min(count, _MAX_VALUES))
    except NotFoundError:
        return None
    return [float(v) if kind == "N" else str(v) for v in values]


def keywords(pattern: str) -> dict[str, list[Any]]:
    """The values of all keywords whose names match a pattern of SPICE, such as INS-203120_*, by name."""
    try:
        names = spice.gnpool(pattern, 0, _MAX_NAMES)
    except NotFoundError:
        return {}
    return {name: values for name in names if (values := keyword(name)) is not None}


def or_none(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, returning None where SPICE raises NotFoundError."""

    def asked(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except NotFoundError:
            return None

    return asked


def listed(meta: str) -> list[str]:
    """The kernels that a meta-kernel names, with its path symbols replaced; the pool is left without its variables."""
    spice.ldpool(meta)
    try:
        values, symbols = keyword("PATH_VALUES") or [], keyword("PATH_SYMBOLS") or []
        files: list[str] = []
        try:
            while len(files) < _MAX_KERNELS:
                files.append(spice.stpool("KERNELS_TO_LOAD", len(files), "+")[0])
        except NotFoundError:  # the end of the list
            pass
    finally:
        for name in ("KERNELS_TO_LOAD", "PATH_VALUES", "PATH_SYMBOLS"):
            spice.dvpool(name)
    # A longer symbol may begin with a shorter one.
    for symbol, value in sorted(zip(symbols, values, strict=False), key=lambda pair: -len(str(pair[0]))):
        files = [file.replace(f"${symbol}", str(value)) for file in files]
    return files


def uncovered(time: float) -> list[tuple[str, float, float]]:
    """Kernels of positions or attitudes of what no loaded kernel covers at a time [s TDB past J2000].

    Each with the begin and the end of what it covers.
    """
    windows: dict[tuple[str, int, str], list[tuple[float, float]]] = {}
    for kind in ("SPK", "CK"):
        for n in range(spice.ktotal(kind)):
            file = spice.kdata(n, kind)[0]
            for body in spice.spkobj(file) if kind == "SPK" else spice.ckobj(file):
                try:
                    cover = (
                        spice.spkcov(file, body)
                        if kind == "SPK"
                        else spice.ckcov(file, body, False, "INTERVAL", 0.0, "TDB")
                    )
                except SpiceyError:  # the clock of an attitude is not loaded
                    continue
                windows[kind, int(body), file] = [spice.wnfetd(cover, k) for k in range(spice.wncard(cover))]
    known = {key[:2] for key, spans in windows.items() if any(begin <= time <= end for begin, end in spans)}
    lacking: dict[str, list[tuple[float, float]]] = {}
    for (kind, body, file), spans in windows.items():
        if (kind, body) not in known and spans:
            lacking.setdefault(file, []).extend(spans)
    return [(file, min(s[0] for s in spans), max(s[1] for s in spans)) for file, spans in lacking.items()]


QUESTIONS: dict[str, Callable[..., Any]] = {
    "load": spice.furnsh,
    "unload": spice.kclear,
    "listed": listed,
    "uncovered": uncovered,
    "date": lambda time: str(spice.et2utc(time, "ISOC", 0)),
    "clock": spice.scs2e,
    "utc": spice.str2et,
    "position": lambda *a: spice.spkpos(*a)[0].tolist(),
    "rotation": lambda *a: spice.pxform(*a).tolist(),
    "keyword": keyword,
    "keywords": keywords,
    "body": or_none(spice.bods2c),
    "body frame": or_none(lambda body: str(spice.cidfrm(body)[1])),
    "frame name": lambda code: str(spice.frmnam(code)) or None,
}


def answer(line: str) -> dict[str, Any]:
    """The answer to one question: {"value": ...} or {"error": ...}."""
    question, *arguments = json.loads(line)
    try:
        value = QUESTIONS[question](*arguments)
    except (SpiceyError, NotFoundError) as error:
        long = " ".join(str(getattr(error, "long", "") or error).split())
        return {"error": f"{getattr(error, 'short', '')} {long}".strip()[:_MAX_REASON]}
    return {"value": float(value) if isinstance(value, float) else value}


def serve(questions: TextIO, answers: TextIO) -> None:
    """Answers until the questions end."""
    for line in questions:
        answers.write(json.dumps(answer(line)) + "\n")
        answers.flush()


if __name__ == "__main__":
    # Messages that the toolkit prints must not mix with the answers: standard output is redirected.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    serve(sys.stdin, answers)
