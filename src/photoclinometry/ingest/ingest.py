"""From archived images to a site: `site.toml` with upright, undistorted images."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.ingest.arcs import arcs_of
from photoclinometry.ingest.exposure import SUNS_GIVEN, AuxiliaryData, Exposure, read_exposure
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.ingest.refusals import Refusal, counted, message, sentences
from photoclinometry.ingest.sumfiles import read_sumfiles
from photoclinometry.ingest.unmatched import check_sumfiles, check_suns
from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.images import write_fits
from photoclinometry.io.json_file import write_json
from photoclinometry.io.output_folder import check_output_folder
from photoclinometry.io.site import MIN_VIEWS, Site, SiteView, write_site
from photoclinometry.io.site_cameras import misplaced_principal_point
from photoclinometry.io.spice import loaded_kernels
from photoclinometry.io.suns_csv import read_suns
from photoclinometry.model.bodies import is_known
from photoclinometry.model.errors import InputError
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.warning import warn

logger = logging.getLogger(__name__)

SITE_FILE = "site.toml"
SOURCES_FILE = "sources.json"
"""Beside site.toml: the file of each image, and the sources of its camera, Sun and pose."""
ALIGNMENT_SIGMA_DEG = 0.05
"""Typical error of the alignment of a camera with the spacecraft's star trackers: the pointing that mission teams find
from images differs from kernels by some hundredths of a degree, by the same amount in all images of a phase. Poses of
SUMFILEs share the errors of their shape model's frame, for which no figure is given: the same value is used."""


@dataclass(frozen=True)
class IngestResult:
    """The site that was written, and the files that were left out of it."""

    site: Path
    exposures: tuple[Exposure, ...]
    refused: tuple[str, ...]
    """The reasons for files left out (`keep_going`), one sentence for all files with the same."""


def ingest(
    files: Sequence[Path],
    out: Path,
    options: IngestOptions = IngestOptions(),  # noqa: B008
    progress: Progress = no_progress,
) -> IngestResult:
    """Make a site of image files (PDS3, PDS4, ISIS, FITS, PNG, TIFF) in the folder `out`, new or empty.

    progress: called with the name, files read, files in all. Lengths in site.toml are in metres, poses in the
    body-fixed frame. Raises InputError that lists the faults of each file.
    """
    check_output_folder(out, "site")
    if not files:
        raise InputError("no files to ingest; name images, labels or cubes")
    sumfiles, suns = read_sumfiles(options.sumfiles), read_suns(options.suns) if options.suns else None
    with loaded_kernels(options.kernels) if options.kernels else nullcontext() as kernels:
        auxiliary = AuxiliaryData(kernels, sumfiles, suns)
        exposures, refused = _read_all(files, options, auxiliary, progress)
    if refused and not (options.keep_going and exposures):
        raise InputError(message(refused, counted(files)))
    exposures = _one_unit(exposures)
    check_sumfiles(exposures, sumfiles)
    if options.suns and suns is not None:
        check_suns(exposures, options.suns, suns, [each.path for each in refused])
    with atomic_path(out) as folder:
        _write(folder, out, exposures, options)
    if len(exposures) < MIN_VIEWS:
        warn(logger, "few-views", "the site has %d views; phomo run needs at least %d", len(exposures), MIN_VIEWS)
    return IngestResult(out / SITE_FILE, tuple(exposures), tuple(sentences(refused)))


def _read_all(
    files: Sequence[Path], options: IngestOptions, auxiliary: AuxiliaryData, progress: Progress
) -> tuple[list[Exposure], list[Refusal]]:
    """The exposures, each once, and the faults of the files that cannot be used."""
    exposures: list[Exposure] = []
    refused: list[Refusal] = []
    seen: set[Path] = set()
    for number, path in enumerate(files, start=1):
        try:
            exposure = _read_one(Path(path), options, auxiliary)
        except InputError as error:
            refused.append(Refusal.of(Path(path), error))
        else:
            if exposure.data.resolve() not in seen:
                exposures.append(exposure)
            seen.add(exposure.data.resolve())
        progress(Path(path).name, number, len(files))
    return exposures, refused


def _read_one(path: Path, options: IngestOptions, auxiliary: AuxiliaryData) -> Exposure:
    """Raises InputError for folders, and for cameras that site.toml may not have, too."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the files in it, such as {path}/*")
    exposure = read_exposure(path, options, auxiliary)
    misplaced = misplaced_principal_point(exposure.camera)
    if misplaced:
        raise InputError(f"{path}: {misplaced}; correct --pinhole, or the camera in its label or kernels")
    return exposure


def _one_unit(exposures: list[Exposure]) -> list[Exposure]:
    """The exposures. Raises InputError unless all have one kind of brightness and show one body."""
    kinds = {e.brightness for e in exposures}
    if len(kinds) > 1:
        odd = next(e for e in exposures if e.brightness == "dn")
        raise InputError(
            f"{odd.path}: is not known to be I/F, while others are: calibrate it (--solar-flux for radiance), leave it "
            "out, or pass --uncalibrated to treat all as uncalibrated"
        )
    bodies = {e.body for e in exposures if e.body}
    if len(bodies) > 1:
        raise InputError(f"the images show {', '.join(sorted(bodies))}; ingest one body at a time, or pass --body")
    return exposures


def _write(folder: Path, out: Path, exposures: Sequence[Exposure], options: IngestOptions) -> None:
    names = _names(exposures)
    sources = [", ".join(filter(None, (e.instrument, e.sources["sun"]))) for e in exposures]
    arcs = arcs_of(sources, [e.time for e in exposures])
    views = []
    for name, exposure, arc in zip(names, exposures, arcs, strict=True):
        pixels = np.where(exposure.image.valid, exposure.image.brightness, np.float32(np.nan))
        write_fits(folder / name, pixels)
        view = SiteView(
            name, out / name, exposure.camera, exposure.sun, exposure.sun_sigma_rad, exposure.prior, arc=arc
        )
        views.append(view)
    called = next((e.body for e in exposures if e.body), None)
    body = _known_body(called)
    if called is not None and body is None:
        warn(logger, "body-unknown", "%s: the body %r is not known here; site.toml does not name it", out, called)
    site_name = options.name or out.resolve().name
    site = Site(
        name=site_name,
        body=body,
        brightness=exposures[0].brightness,
        views=tuple(views),
        region=None,
        path=out / SITE_FILE,
        sun_common_sigma_rad=_common_sigma(exposures, options),
    )
    write_site(folder / SITE_FILE, site)
    of_images = [{"image": name, "file": e.path.name, **e.sources} for name, e in zip(names, exposures, strict=True)]
    write_json(folder / SOURCES_FILE, of_images)


def _known_body(called: str | None) -> str | None:
    """The body's name as sites have it; of a comet "67p/c-g" by its designation. None if it is not known."""
    names = (called, called.partition("/")[0]) if called else ()
    return next((name for name in names if is_known(name)), None)


def _common_sigma(exposures: Sequence[Exposure], options: IngestOptions) -> float | None:
    """Standard deviation [rad] of the rotation that all Suns of an arc share; None where the table gives all Suns."""
    if options.sun_common_sigma_deg is not None:
        return math.radians(options.sun_common_sigma_deg)
    all_given = all(exposure.sources["sun"] == SUNS_GIVEN for exposure in exposures)
    return None if all_given else math.radians(ALIGNMENT_SIGMA_DEG)


def _names(exposures: Sequence[Exposure]) -> list[str]:
    """images/STEM.fits, numbered where stems repeat."""
    names: list[str] = []
    for exposure in exposures:
        stem, number = exposure.path.stem, 1
        name = f"images/{stem}.fits"
        while name in names:
            number += 1
            name = f"images/{stem}-{number}.fits"
        names.append(name)
    return names
