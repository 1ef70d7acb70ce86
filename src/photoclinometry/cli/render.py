"""`phomo render`: an image of the map, under the Sun of a view or any other."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.image import Image

PNG_PEAK = 65534.0
"""Number of the greatest brightness in a 16-bit PNG; 65535 marks saturated pixels."""


def render(
    run: Path,
    /,
    out: Path,
    overwrite: bool = False,
    view: str | None = None,
    sun: tuple[float, float, float] | None = None,
    sun_azimuth_deg: float | None = None,
    sun_elevation_deg: float | None = None,
    geometry: Literal["camera", "reference"] = "camera",
    cast_shadows: bool = False,
) -> Path:
    """Render a map: one of its views, or the same ground under another Sun.

    Args:
        run: Folder of a finished run.
        out: Image to write. FITS keeps the brightness, NaN outside the map. PNG has 16 bits, linear from 0
            to the greatest brightness at 65534 (65535 means saturated), 0 outside the map.
        overwrite: Replace a file that is there; without it, such a file is refused.
        view: Name of the view whose camera, Sun, scale and bias to use. Default: the reference view.
        sun: Direction towards the Sun in the body-fixed frame, of any length. Range: any finite numbers, not all 0.
        sun_azimuth_deg: Sun's azimuth, clockwise from up in the reference image, along the map's mean plane. Range: any
            finite number.
        sun_elevation_deg: Sun's elevation above the map's mean plane; goes with the azimuth. Range: above 0, up to 90.
        geometry: "camera" draws the view's whole image; "reference" the map's own grid of reference pixels.
        cast_shadows: Also draw the shadows that the map's ground casts.
    """
    from rich.console import Console

    import photoclinometry as pcm

    check_suffix(out)
    check_new_file(out, overwrite)
    scene = pcm.read_scene(run)
    image = pcm.render(
        scene,
        view=view,
        sun=sun,
        sun_azimuth_deg=sun_azimuth_deg,
        sun_elevation_deg=sun_elevation_deg,
        geometry=geometry,
        cast_shadows=cast_shadows,
    )
    peak = write_rendering(out, image)
    height, width = image.valid.shape
    unit = "I/F" if scene.brightness == "iof" else "DN"
    console = Console(stderr=True)
    console.print(f"{out}: {width} x {height} pixels, {image.valid.sum()} of the map", highlight=False, markup=False)
    console.print(f"greatest brightness: {peak:.6g} {unit}", highlight=False)
    return out


def check_suffix(out: Path) -> None:
    """Raises InputError unless the suffix is that of PNG or FITS."""
    if out.suffix.lower() not in (".png", ".fits", ".fit"):
        raise InputError(f"{out}: cannot write {out.suffix or 'a file without suffix'}; use .fits or .png")


def check_new_file(out: Path, overwrite: bool) -> None:
    """Raises RunFolderError for a file that is there, such as an image of the site, unless it may be replaced."""
    if out.is_file() and not overwrite:
        raise RunFolderError(f"{out}: exists; choose another --out, or give --overwrite to replace it")


def write_rendering(out: Path, image: Image) -> float:
    """Writes FITS or PNG by suffix (see `render`); returns the greatest brightness."""
    from photoclinometry.io.images import write_fits, write_png

    brightness, there = image.brightness.astype(float), image.valid
    peak = float(brightness[there].max()) if there.any() else 0.0
    if out.suffix.lower() == ".png":
        levels = PNG_PEAK * np.clip(brightness / peak, 0.0, 1.0) if peak > 0 else np.zeros_like(brightness)
        write_png(out, np.where(there, np.round(levels), 0).astype(np.uint16))
    else:
        write_fits(out, np.where(there, brightness, np.nan).astype(np.float32))
    return peak
