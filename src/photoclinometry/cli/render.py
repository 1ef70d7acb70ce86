"""`phomo render`: the map as a camera sees it, under its own Sun or any other."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from photoclinometry.cli.folders import read_run, view_index
from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import Scene

PNG_PEAK = 65534.0
"""The greatest brightness in a 16-bit PNG; 65535 would read as saturated."""


def render(
    run: Path,
    /,
    out: Path,
    view: str | None = None,
    sun: tuple[float, float, float] | None = None,
    sun_azimuth_deg: float | None = None,
    sun_elevation_deg: float | None = None,
    geometry: Literal["camera", "reference"] = "camera",
    cast_shadows: bool = False,
) -> Path:
    """Render a map: any of its views, or the same ground under another Sun.

    Args:
        run: Folder of a finished run.
        out: Image to write. FITS keeps the brightness, NaN outside the map. PNG has 16 bits, linear from 0
            to the greatest brightness at 65534 (65535 means saturated), 0 outside the map.
        view: Name of the view whose camera, Sun, scale and bias to use. Default: the reference view.
        sun: Direction towards the Sun in the body-fixed frame, of any length.
        sun_azimuth_deg: Sun's azimuth, clockwise from up in the reference image, along the map's mean plane.
        sun_elevation_deg: Sun's elevation above the map's mean plane; goes with the azimuth.
        geometry: "camera" draws the view's whole image; "reference" the map's own grid of reference pixels.
        cast_shadows: Also darken what lies in the shadow of other ground of the map.
    """
    from rich.console import Console

    from photoclinometry.photometry.render import render_reference, render_view

    check_suffix(out)
    scene = read_run(run)
    index = view_index(scene, view)
    direction = sun_direction(scene, sun, sun_azimuth_deg, sun_elevation_deg)
    draw = render_view if geometry == "camera" else render_reference
    image, mask = draw(scene, index, direction, cast_shadows=cast_shadows)
    peak = write_rendering(out, image, mask)
    unit = "I/F" if scene.brightness == "iof" else "DN"
    console = Console(stderr=True)
    console.print(f"{out}: {image.shape[1]} x {image.shape[0]} pixels, {mask.sum()} of the map", highlight=False)
    console.print(f"greatest brightness: {peak:.6g} {unit}", highlight=False)
    return out


def check_suffix(out: Path) -> None:
    if out.suffix.lower() not in (".png", ".fits", ".fit"):
        raise InputError(f"{out}: cannot write {out.suffix or 'a file without suffix'}; use .fits or .png")


def sun_direction(
    scene: Scene, sun: tuple[float, float, float] | None, azimuth_deg: float | None, elevation_deg: float | None
) -> np.ndarray | None:
    """The Sun asked for as a vector (3,) in B; None for the view's own. Raises InputError."""
    from photoclinometry.surface.relief import local_frame, sun_from_angles

    if (azimuth_deg is None) != (elevation_deg is None):
        raise InputError("--sun-azimuth-deg and --sun-elevation-deg go together: give both or none")
    if sun is not None and azimuth_deg is not None:
        raise InputError("the Sun is given twice: use --sun, or azimuth and elevation")
    if sun is not None:
        if not np.isfinite(sun).all() or not np.any(sun):
            raise InputError(f"--sun {' '.join(map(str, sun))} is no direction")
        return np.array(sun, float)
    if azimuth_deg is None or elevation_deg is None:
        return None
    if not 0.0 < elevation_deg <= 90.0:
        raise InputError(f"--sun-elevation-deg {elevation_deg}: must be above 0 and at most 90 for light to fall")
    return sun_from_angles(local_frame(scene), np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg))


def write_rendering(out: Path, image: np.ndarray, mask: np.ndarray) -> float:
    """Writes FITS or PNG by suffix (see `render`); returns the greatest brightness."""
    from photoclinometry.io.images import write_fits, write_png

    peak = float(image[mask].max()) if mask.any() else 0.0
    if out.suffix.lower() == ".png":
        levels = PNG_PEAK * np.clip(image / peak, 0.0, 1.0) if peak > 0 else np.zeros_like(image)
        write_png(out, np.where(mask, np.round(levels), 0).astype(np.uint16))
    else:
        write_fits(out, np.where(mask, image, np.nan).astype(np.float32))
    return peak
