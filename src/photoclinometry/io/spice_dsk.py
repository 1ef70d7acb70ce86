"""SPICE's shape kernels: a triangle mesh as a DSK of type 2. Needs the extra `geo` (spiceypy).

https://naif.jpl.nasa.gov/pub/naif/toolkit_docs/C/req/dsk.html. SPICE runs in a process of its own (`io/dsk_worker.py`).
"""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.arrays import write_arrays
from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.child import Child, NoAnswerError
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import KM_PER_M

LARGEST_PLATES = 32_000_000
"""SPICE's limit."""
_TIMEOUT_S = 120.0
"""Longest wait for an answer without a mesh [s]: to load a large text kernel takes seconds."""
_TIMEOUT_S_PER_PLATE = 1e-4
"""What each plate adds to it [s]: SPICE takes 4e-6 s, on a processor of its own and a fast disk."""


@dataclass(frozen=True, kw_only=True)
class DskPlace:
    """The body and the frame that a shape kernel is of, as SPICE knows them."""

    body: str | int
    """Name or NAIF code."""
    frame: str | None = None
    """Body-fixed frame; None: the one that SPICE has for the body."""
    surface: int = 1
    """NAIF code of the surface, which tells models of a body apart."""
    kernels: Sequence[Path] = ()
    """Text kernels that define the body or the frame."""


def write_dsk(
    path: Path | str,
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    place: DskPlace,
    single_valued: bool,
    comments: Sequence[str] = (),
) -> tuple[int, str]:
    """A closed mesh of vertices (V, 3) [m, body-fixed] and faces (F, 3) as a kernel in km, with its spatial index.

    single_valued: each direction from the origin meets the surface once; comments: lines for the kernel's comment area.
    Returns the body's NAIF code and the name of the frame. Raises InputError without spiceypy, for bodies and frames
    that SPICE does not know, with SPICE's reason for meshes that it refuses, and where it does not end; RunFolderError.
    """
    path = Path(path)
    if len(faces) > LARGEST_PLATES:
        raise InputError(f"{path.name}: {len(faces):,} plates, SPICE takes {LARGEST_PLATES:,}; write a coarser level")
    with atomic_path(path) as temporary, tempfile.TemporaryDirectory() as folder:
        arrays = Path(folder) / "mesh.npz"
        write_arrays(arrays, {"vertices": KM_PER_M * vertices, "faces": faces.astype(np.int32)})
        mesh = {
            "arrays": str(arrays),
            "out": str(temporary),
            "surface": place.surface,
            "single_valued": single_valued,
            "comments": list(comments),
        }
        return _answer(place, mesh, len(faces))


def known_to_spice(place: DskPlace) -> tuple[int, str]:
    """The body's NAIF code and the name of its frame. Raises InputError without spiceypy, and for what SPICE does not
    know."""
    return _answer(place, {}, 0)


def _answer(place: DskPlace, mesh: dict[str, Any], plates: int) -> tuple[int, str]:
    if importlib.util.find_spec("spiceypy") is None:
        raise InputError("SPICE's kernels need spiceypy: pip install 'photoclinometry[geo]', or leave the DSK out")
    kernels = [str(kernel) for kernel in place.kernels]
    request = {"body": place.body, "frame": place.frame, "kernels": kernels, **mesh}
    limit = _TIMEOUT_S + _TIMEOUT_S_PER_PLATE * plates
    child = Child("dsk_worker.py")
    try:
        answer = child.ask(request, limit)
    except NoAnswerError as error:
        if error.timed_out:
            raise InputError(f"SPICE had not written the kernel after {limit:.0f} s; leave the DSK out") from error
        raise InputError("SPICE broke down while it wrote the kernel; leave the DSK out") from error
    finally:
        child.close()
    if "error" in answer:
        raise InputError(f"no DSK can be written: {answer['error']}")
    return int(answer["value"]["body"]), str(answer["value"]["frame"])
