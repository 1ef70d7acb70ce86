"""A site whose camera distortion and image response are determined from its own images."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np

from photoclinometry.io.relative_path import relative_path
from photoclinometry.io.site import Site, read_site, write_site
from photoclinometry.io.site_cameras import SiteCamera
from photoclinometry.model.errors import ReconstructionError, RunFolderError
from photoclinometry.model.gamma import LINEAR
from photoclinometry.model.lens import Lens
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.pipeline.folder.run_folder import open_run
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.response_check import CODE, METRIC
from photoclinometry.pipeline.sparse_stages import SparseReconstruction, read_inputs
from photoclinometry.sfm import SfmOptions
from photoclinometry.sfm.self_calibration import LensEstimate, estimate_lenses

NAME = "calibrated.toml"
"""Of the new site, beside the old one."""
SETTLED_PX, SETTLED_RESPONSE = 0.1, 0.03
"""Passes end once the images show no more distortion than this, and an exponent no farther from 1 than this."""


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions(Ranged):
    """How the distortion of a site's cameras is found."""

    passes: Annotated[int, Range(least=1, most=20)] = 3
    """Passes at most. Each takes the distortion found so far out of the images and makes a sparse model of them, so
    that keypoints which a strong distortion kept from matching take part."""
    response: bool = False
    """Also find the exponent of the images' response (`gamma`), by a map in each pass: as long as `phomo run`, several
    times."""
    sfm: SfmOptions = field(default_factory=SfmOptions)


@dataclass(frozen=True, kw_only=True)
class CameraCalibration:
    """The calibration of one camera."""

    views: tuple[str, ...]
    """Names of its views."""
    camera: SiteCamera
    """As the new site has it."""
    shown: LensEstimate
    """The distortion that the images show beyond the old site's lens."""
    left: LensEstimate
    """The distortion that they show beyond the lens found, before the last pass that changed it."""
    changed: bool
    """Whether the lens is another than in the old site."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The site that was written, and its cameras."""

    site: Path
    cameras: tuple[CameraCalibration, ...]
    gamma: float = LINEAR
    """The factor by which the exponents of all cameras were multiplied."""


def calibrate(
    site_file: Path,
    out: Path | None = None,
    options: CalibrationOptions = CalibrationOptions(),
    progress: Progress = no_progress,
) -> Calibration:
    """Writes a copy of the site whose cameras have the distortion and the response that the images show.

    A camera keeps its lens where the images show no more than `LensEstimate.is_clear` asks for. out: a TOML file, new;
    by default NAME beside the site. The images are those of the old site; they are undistorted when they are read.
    Exponents stay as they are where the images do not clearly show others (`response_check.is_clear`).
    Raises InputError for wrong sites and images, RunFolderError if `out` exists or cannot be written, and
    ReconstructionError where the images give no sparse model, or one of too few keypoints.
    """
    site = read_site(site_file)
    out = Path(site_file).parent / NAME if out is None else Path(out)
    if out.exists():
        raise RunFolderError(f"{out}: exists; choose another --out, or remove it")
    old, of_view = site.cameras
    new, shown, left = old, [], []
    for _ in range(options.passes):
        left = _estimates(site, new, of_view, options.sfm, progress)
        shown = shown or left
        change = [e.is_clear or c != o for e, c, o in zip(left, new, old, strict=True)]
        if not any(changes and e.shift_px > SETTLED_PX for changes, e in zip(change, left, strict=True)):
            break
        new = [_with_added(c, e) if changes else c for changes, c, e in zip(change, new, left, strict=True)]
    calibrated = _with_cameras(site, new, of_view)
    gamma = _response(calibrated, options, progress) if options.response else LINEAR
    write_site(out, _moved(_with_response(calibrated, gamma), out))
    return Calibration(
        site=out,
        cameras=tuple(
            CameraCalibration(
                views=tuple(view.name for view, number in zip(site.views, of_view, strict=True) if number == n),
                camera=new[n],
                shown=shown[n],
                left=left[n],
                changed=new[n] != old[n],
            )
            for n in range(len(old))
        ),
        gamma=gamma,
    )


def _estimates(
    site: Site, cameras: list[SiteCamera], of_view: np.ndarray, options: SfmOptions, progress: Progress
) -> list[LensEstimate]:
    """The distortion of each camera (C,) beyond its lens, from a sparse model of the images. Raises
    ReconstructionError."""
    with TemporaryDirectory() as scratch:
        folder = open_run(Path(scratch) / "run", progress)
        inputs = read_inputs(folder, _with_cameras(site, cameras, of_view))
        sparse = folder.result_of(SparseReconstruction(inputs=inputs, options=options)).value
    estimates = estimate_lenses(sparse, [camera.camera for camera in cameras], of_view)
    if not estimates:
        raise ReconstructionError(
            f"{site.path}: {len(sparse.point_view)} keypoints of {sparse.registered.sum()} views do not suffice to "
            "determine the distortion; add images, or raise --sfm.max-features"
        )
    return estimates


def _response(site: Site, options: CalibrationOptions, progress: Progress) -> float:
    """The exponent that the images show beyond those of their cameras; LINEAR where it is not clear."""
    from photoclinometry.pipeline.run import run

    gamma = LINEAR
    for number in range(options.passes):
        with TemporaryDirectory() as scratch:
            file = Path(scratch) / "site.toml"
            write_site(file, _moved(_with_response(site, gamma), file))
            result = run(file, Path(scratch) / "run", RunOptions(sfm=options.sfm), progress)
        clear = any(warned.code == CODE for warned in result.warnings)
        found = result.metrics.get(METRIC, LINEAR)
        if (number == 0 and not clear) or abs(math.log(found)) < SETTLED_RESPONSE:
            break
        gamma *= found
    return gamma


def _with_response(site: Site, gamma: float) -> Site:
    """The site with all exponents multiplied."""
    return replace(site, views=tuple(replace(view, gamma=gamma * view.gamma) for view in site.views))


def _with_added(camera: SiteCamera, estimate: LensEstimate) -> SiteCamera:
    """The camera with the distortion that its undistorted images still show."""
    coefficients = camera.lens.corner_px(camera.camera) + estimate.corner_px
    return replace(camera, lens=Lens.of_corner_px(coefficients, camera.camera))


def _with_cameras(site: Site, cameras: list[SiteCamera], of_view: np.ndarray) -> Site:
    """The site with the lenses of other cameras (C,)."""
    views = tuple(replace(view, lens=cameras[n].lens) for view, n in zip(site.views, of_view, strict=True))
    return replace(site, views=views)


def _moved(site: Site, path: Path) -> Site:
    """The site as a file at `path` has it, with the same images."""
    names = {view.name: relative_path(view.image, path.parent) for view in site.views}
    region = site.region
    if region is not None and region.reference is not None:
        region = replace(region, reference=names[region.reference])
    views = tuple(replace(view, name=names[view.name]) for view in site.views)
    return replace(site, views=views, region=region, path=path)
