"""One SUMFILE per view: camera, pose and Sun for stereophotoclinometry (SPC)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from photoclinometry.io.models.sumfile import SumFile, sumfile_of_view, write_sumfile
from photoclinometry.model.geometry import KM_PER_M, Rigid
from photoclinometry.model.scene import Scene
from photoclinometry.model.sigma import sigma_along
from photoclinometry.output.export.frame import Framed

UNKNOWN_TIME = "UNKNOWN"
"""Written in place of the time of exposure, which a scene does not hold."""


def write_sumfiles(folder: Path, framed: Framed) -> dict[str, str]:
    """Writes `folder`/NAME.SUM of every view of a body-fixed scene [m]; returns a description.

    SIGMA_VSO (axes of B) and SIGMA_PTG (axes of C) are those that the scene states for its poses.
    """
    views = framed.scene.views
    for k, name in enumerate(sumfile_names(views.name)):
        pose = views.body_from_cam[k]
        in_km = Rigid(pose.rotation, KM_PER_M * pose.translation)
        summary = sumfile_of_view(name, views.cameras[k], in_km, views.sun[k], utc=UNKNOWN_TIME)
        write_sumfile(folder / f"{name}.SUM", with_sigmas(summary, framed.scene, k))
    stated = {"center", "rotation"} <= set(framed.scene.uncertainty)
    sigmas = "sigmas as the run states them" if stated else "sigmas of 1 km and 1 mrad where the run states none"
    return {folder.name: f"a SUMFILE per view, in km; {sigmas}; without times of exposure and landmarks"}


def with_sigmas(summary: SumFile, scene: Scene, view: int) -> SumFile:
    """The SUMFILE with the sigmas that a scene [m] states for a view's pose; its own where the scene states none."""
    moved, turned = _per_axis(scene, "center", view), _per_axis(scene, "rotation", view)
    if moved is not None:
        x, y, z = moved
        summary = replace(summary, position_sigma=(KM_PER_M * x, KM_PER_M * y, KM_PER_M * z))
    return summary if turned is None else replace(summary, pointing_sigma=turned)


def _per_axis(scene: Scene, name: str, view: int) -> tuple[float, float, float] | None:
    """Standard deviations along the three axes; None where the scene states none, or no finite ones."""
    if name not in scene.uncertainty:
        return None
    stated = np.asarray(scene.uncertainty[name], float)[view : view + 1]
    x, y, z = (float(sigma_along(stated, axis[None])[0]) for axis in np.eye(3))
    return (x, y, z) if np.isfinite((x, y, z)).all() else None


def sumfile_names(names: Sequence[str]) -> list[str]:
    """The images' names without folder and suffix; with these, or a number besides, if they would not differ."""
    paths = [PurePosixPath(name) for name in names]
    for short in ([path.stem for path in paths], [str(path.with_suffix("")).replace("/", "_") for path in paths]):
        if len(set(short)) == len(short):
            return short
    return [f"{str(path).replace('/', '_').replace('.', '_')}_{number:03d}" for number, path in enumerate(paths)]
