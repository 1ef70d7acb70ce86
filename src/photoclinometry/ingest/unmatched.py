"""Whether images and what is given for them belong together, one by one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from photoclinometry.ingest.exposure import Exposure
from photoclinometry.model.errors import InputError


def check_sumfiles(exposures: Sequence[Exposure]) -> None:
    """Raises InputError for a SUMFILE that two images have: it describes one."""
    first: dict[Path, Exposure] = {}
    for exposure in exposures:
        if exposure.sumfile is None:
            continue
        other = first.setdefault(exposure.sumfile, exposure)
        if other is not exposure:
            raise InputError(
                f"{exposure.path}: has the SUMFILE {exposure.sumfile.name} by its name or time, and so has "
                f"{other.path.name}. A SUMFILE describes one image; pass that of each, or leave one of the two out"
            )
