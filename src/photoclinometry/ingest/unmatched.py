"""Whether the SUMFILEs and the rows of the table of Suns match the images one by one."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from pathlib import Path

from photoclinometry.ingest.exposure import SUNS_GIVEN, Exposure
from photoclinometry.ingest.sumfiles import NamedSum
from photoclinometry.model.errors import InputError
from photoclinometry.model.first_few import first_names
from photoclinometry.model.warning import warn

log = logging.getLogger(__name__)

_LISTED = 4
"""Number of names in an error or a warning; the others are counted."""


def check_suns(exposures: Sequence[Exposure], table: Path, rows: Collection[str], refused: Sequence[Path]) -> None:
    """Raises InputError for rows of a table of Suns that name no file, where a file has no row: it would get another
    Sun than the one given.

    A table may have rows of further images, and files may be without a row. rows: the images that they name.
    refused: files that are left out, which may have been named.
    """
    without = [exposure.path.name for exposure in exposures if exposure.sources["sun"] != SUNS_GIVEN]
    known = {name for exposure in exposures for name in (exposure.path.name, exposure.data.name)}
    left_out = {path.stem for path in refused}
    unused = [name for name in rows if name not in known and Path(name).stem not in left_out]
    if without and unused:
        named = first_names([repr(name) for name in unused], _LISTED)
        raise InputError(
            f"{table}: no file is named {named}, and there is no row for {first_names(without, _LISTED)}; write "
            "names of files, without their folders, or remove the rows"
        )


def check_sumfiles(exposures: Sequence[Exposure], given: Sequence[NamedSum]) -> None:
    """Warns of images without a SUMFILE where one given describes no image: their names may have been meant to match.

    Raises InputError for a SUMFILE that two images have: it describes one.
    """
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
    without = [exposure.path.name for exposure in exposures if exposure.sumfile is None]
    unused = [sumfile.path.name for sumfile in given if sumfile.path not in first]
    if without and unused:
        warn(
            log, "sumfile-missing",
            "no SUMFILE has the name or the time of %s (%d of %d images), whose camera, Sun and pose are of other "
            "sources, and no image has those of %s (%d of %d SUMFILEs)",
            first_names(without, _LISTED), len(without), len(exposures),
            first_names(unused, _LISTED), len(unused), len(given),
        )  # fmt: skip
