"""`phomo calibrate`: a site with the distortion of its cameras, and the response of its images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from photoclinometry.model.gamma import LINEAR
from photoclinometry.pipeline.calibrate import CalibrationOptions

if TYPE_CHECKING:
    from photoclinometry.pipeline.calibrate import CameraCalibration


def calibrate(
    site: Path,
    /,
    out: Path | None = None,
    options: Annotated[CalibrationOptions, tyro.conf.arg(name="")] = CalibrationOptions(),  # noqa: B008
) -> None:
    """Find the distortion of a site's cameras by its own images, and write a site that states it.

    Poses, points and the distortion of each camera are adjusted together. A camera stays as it is unless keypoints are
    displaced by more than half a pixel and by five standard deviations. The images are those of the old site.
    With --response, also the exponent that makes the images linear in radiance, where their brightness determines it.

    Args:
        site: A site.toml, or the folder with one.
        out: The new site, a TOML file. By default calibrated.toml beside the old one.
    """
    from rich.console import Console

    from photoclinometry.cli.bars import progress_bars
    from photoclinometry.cli.site_path import site_file
    from photoclinometry.pipeline.calibrate import calibrate as library

    console = Console(stderr=True)
    with progress_bars(console) as bars:
        found = library(site_file(site), out, options, bars)
    for camera in found.cameras:
        console.print(_line(camera), highlight=False, markup=False, soft_wrap=True)
    if options.response:
        said = "stays as it is" if found.gamma == LINEAR else f"gamma is multiplied by {found.gamma:.2f}"
        console.print(f"response of the images: {said}", highlight=False)
    print(found.site)


def _line(found: CameraCalibration) -> str:
    """One camera, in words."""
    lens, shown = found.camera.lens, found.shown
    size = f"{shown.shift_px:.2f} +- {shown.shift_sigma_px:.2f} px"
    line = f"{len(found.views)} views, keypoints displaced by up to {size}: "
    if not found.changed:
        return line + "the camera stays as it is"
    return line + (
        f"k1 {lens.k1:.4g}, k2 {lens.k2:.4g}, p1 {lens.p1:.3g}, p2 {lens.p2:.3g}; "
        f"{found.left.shift_px:.2f} +- {found.left.shift_sigma_px:.2f} px were left in the last pass"
    )
