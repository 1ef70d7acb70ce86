"""The process that writes SPICE's shape kernels (DSK, type 2): one request, a line of JSON, and one answer.

CSPICE keeps the state of open files and of errors for its process, and may end it. `io/spice_dsk.py` therefore runs
this file as a script in a process of its own. It imports spiceypy and nothing of this package.
"""

from __future__ import annotations

import json
import math
import os
import sys
from typing import Any

import numpy as np
import spiceypy as spice
from spiceypy.utils.exceptions import NotFoundError, SpiceyError

_FINE = 2.0
"""Edge of a fine voxel over the mean extent of a plate: rays then meet few plates in a voxel, and few voxels."""
_FINE_PER_AXIS = 400
"""Fine voxels along the longest axis at most; the type allows 1e8 in all, and coarse voxels round their number up."""
_COARSE_PER_AXIS = 40
"""Coarse voxels along the longest axis; the type allows 100,000 in all."""
_INDEX_SIZE = 12
"""Entries of the spatial index for each plate at first; they are doubled as long as they do not suffice."""
_MOST_DOUBLINGS = 4
_SINGLE_VALUED, _GENERAL = 1, 2
"""Classes of data: a single value for each latitude and longitude, or any surface."""
_LATITUDINAL = 1
"""The system of coordinates of the stated coverage."""
_YEARS = 100.0
"""The kernel is valid so long before and after J2000: a shape does not change [Julian years]."""
_LINE = 80
"""Longest line of comments."""


def write(request: dict[str, Any]) -> dict[str, Any]:
    """Writes the kernel that a request describes, if it names a mesh; returns the body's code and the frame's name."""
    for kernel in request["kernels"]:
        spice.furnsh(kernel)
    body = request["body"] if isinstance(request["body"], int) else _code(request["body"])
    frame = request["frame"] or _frame(body)
    if not spice.namfrm(frame):
        raise ValueError(f"SPICE knows no frame {frame!r}; load its frame kernel with --kernels")
    if "arrays" not in request:
        return {"body": body, "frame": frame}
    with np.load(request["arrays"], allow_pickle=False) as arrays:
        vertices = np.ascontiguousarray(arrays["vertices"], np.float64)
        plates = np.ascontiguousarray(arrays["faces"], np.int32) + 1
    kind = _SINGLE_VALUED if request["single_valued"] else _GENERAL
    doubles, integers = _index(vertices, plates)
    low, high = spice.dskrb2(vertices, plates, _LATITUDINAL, np.zeros(10))
    handle = spice.dskopn(request["out"], "shape model", 0)
    end = _YEARS * spice.jyear()
    spice.dskw02(
        handle, body, request["surface"], kind, frame, _LATITUDINAL, np.zeros(10),
        -math.pi, math.pi, -0.5 * math.pi, 0.5 * math.pi, low, high, -end, end, vertices, plates, doubles, integers,
    )  # fmt: skip
    if request["comments"]:
        spice.dasac(handle, [line[:_LINE] for line in request["comments"]])
    spice.dskcls(handle, True)
    return {"body": body, "frame": frame}


def _code(name: str) -> int:
    try:
        return int(spice.bods2c(name))
    except NotFoundError as error:
        raise ValueError(f"SPICE knows no body {name!r}; give its code with --naif-id") from error


def _frame(body: int) -> str:
    try:
        return str(spice.cidfrm(body)[1])
    except NotFoundError as error:
        raise ValueError(f"SPICE knows no frame fixed to body {body}; name one with --frame") from error


def _index(vertices: np.ndarray, plates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The spatial index, with room as it needs."""
    corner = vertices[plates - 1]
    extent = float(np.ptp(corner, axis=1).mean())
    extents = float(np.ptp(vertices, axis=0).max()) / extent
    fine = max(_FINE, extents / _FINE_PER_AXIS)
    coarse = max(1, math.ceil(extents / fine / _COARSE_PER_AXIS))
    room = _INDEX_SIZE * len(plates) + (coarse * _COARSE_PER_AXIS) ** 2
    for doubling in range(_MOST_DOUBLINGS + 1):
        size = room << doubling
        try:
            return spice.dskmi2(vertices, plates, fine, coarse, size, size, size, True, 4 * size)
        except SpiceyError:
            spice.reset()
            if doubling == _MOST_DOUBLINGS:
                raise
    raise AssertionError


def answer(line: str) -> dict[str, Any]:
    """The answer to a request: {"value": ...} or {"error": ...}."""
    try:
        return {"value": write(json.loads(line))}
    except (SpiceyError, NotFoundError) as error:
        long = " ".join(str(getattr(error, "long", "") or error).split())
        return {"error": f"{getattr(error, 'short', '')} {long}".strip()}
    except ValueError as error:
        return {"error": str(error)}


if __name__ == "__main__":
    # Messages that the toolkit prints must not mix with the answer: standard output is redirected.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    answers.write(json.dumps(answer(sys.stdin.readline())) + "\n")
    answers.flush()
