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


def or_none(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, returning None where SPICE raises NotFoundError."""

    def asked(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except NotFoundError:
            return None

    return asked


QUESTIONS: dict[str, Callable[..., Any]] = {
    "load": spice.furnsh,
    "clock": spice.scs2e,
    "utc": spice.str2et,
    "position": lambda *a: spice.spkpos(*a)[0].tolist(),
    "rotation": lambda *a: spice.pxform(*a).tolist(),
    "keyword": keyword,
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
