"""The cameras of `site.toml`: intrinsics, distortion, and the pixels of all their images that are not used."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.masks import ALL_USED, BORDER, MASK, Masking, read_masking
from photoclinometry.io.table import Table
from photoclinometry.model.camera import CAMERA_PARAMETERS, Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.gamma import LINEAR
from photoclinometry.model.lens import MODELS, NO_DISTORTION, Lens, folds

GAMMA = "gamma"
MOST_GAMMA = 5.0
"""Largest plausible exponent of a response; its inverse is the smallest."""
_FARTHEST_PRINCIPAL = 10.0
"""Principal points farther outside than this many image widths are parameters in the wrong order."""


@dataclass(frozen=True)
class SiteCamera:
    """A camera in `site.toml`."""

    camera: Camera
    """The pinhole that its images have once they are undistorted."""
    lens: Lens = NO_DISTORTION
    masking: Masking = ALL_USED
    """Of all its images."""
    gamma: float = LINEAR
    """The power to which the numbers of its images are raised, to be linear in radiance."""

    def entry(self) -> dict[str, Any]:
        """The table of `site.toml`, without masks."""
        c = self.camera
        model, params = c.model, [float(value) for value in c.params]
        if self.lens != NO_DISTORTION:
            model = "OPENCV"
            params = [*map(float, c.intrinsics), self.lens.k1, self.lens.k2, self.lens.p1, self.lens.p2]
        entry = {"model": model, "width": c.width, "height": c.height, "params": params}
        return entry if self.gamma == LINEAR else {**entry, GAMMA: self.gamma}


def read_cameras(table: Table, folder: Path) -> tuple[SiteCamera | None, dict[str, SiteCamera]]:
    """The camera of the views without the key `camera` (None if there are several), and the cameras by name.

    Masks are relative to the folder. Raises SiteError.
    """
    single = table.table("camera", None)
    several = table.table("cameras", None)
    if (single is None) == (several is None):
        raise table.error("camera", "write either one [camera] or one [cameras.NAME] for each camera")
    if single is not None:
        return _read_camera(single, folder), {}
    named = {name: _read_camera(several.table(name), folder) for name in several.content}
    if not named:
        raise table.error("cameras", "holds no camera; write [cameras.NAME] for each")
    return (next(iter(named.values())) if len(named) == 1 else None), named


def _read_camera(table: Table, folder: Path) -> SiteCamera:
    table.expect("model", "width", "height", "params", GAMMA, MASK, BORDER)
    model = table.choice("model", (*CAMERA_PARAMETERS, *MODELS), "undistort the images to a pinhole first")
    width, height = table.positive_integer("width"), table.positive_integer("height")
    pinhole, coefficients = MODELS.get(model, (model, ()))
    count = CAMERA_PARAMETERS[pinhole]
    params = table.numbers("params", count + len(coefficients)).tolist()
    masking = read_masking(table, folder)
    gamma = _read_gamma(table)
    table.finish()
    try:
        camera = Camera(pinhole, width, height, tuple(params[:count]))
    except InputError as error:
        raise table.error("params", str(error)) from error
    misplaced = misplaced_principal_point(camera)
    if misplaced:
        raise table.error("params", misplaced)
    lens = Lens(**dict(zip(coefficients, params[count:], strict=True)))
    if folds(camera, lens):
        order = ", ".join(("f, cx, cy" if pinhole == "SIMPLE_PINHOLE" else "fx, fy, cx, cy", *coefficients))
        raise table.error("params", f"the distortion folds the image over itself; the order is {order}")
    return SiteCamera(camera, lens, masking, gamma)


def _read_gamma(table: Table) -> float:
    gamma = float(table.positive_number(GAMMA, LINEAR))
    if not 1.0 / MOST_GAMMA <= gamma <= MOST_GAMMA:
        raise table.error(GAMMA, f"{gamma:g} is no exponent of a response; those of images for the eye are 1.8 to 2.6")
    return gamma


def misplaced_principal_point(camera: Camera) -> str | None:
    """The reason why the camera's principal point is impossible; None where it is possible."""
    center, width, height = np.array(camera.principal_px), camera.width, camera.height
    if (np.abs(center - (width / 2, height / 2)) <= _FARTHEST_PRINCIPAL * max(width, height)).all():
        return None
    order = "f, cx, cy" if camera.model == "SIMPLE_PINHOLE" else "fx, fy, cx, cy"
    return f"the principal point {center.tolist()} is far outside {width} x {height} pixels; the order is {order}"
