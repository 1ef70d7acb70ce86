"""One SUMFILE per view: camera, pose and Sun for stereophotoclinometry (SPC)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from photoclinometry.io.models.sumfile import sumfile_of_view, write_sumfile
from photoclinometry.model.geometry import Rigid
from photoclinometry.output.export.frame import Framed

UNKNOWN_TIME = "UNKNOWN"
"""Written in place of the time of exposure, which a scene does not hold."""
_KM_PER_M = 1e-3


def write_sumfiles(folder: Path, framed: Framed) -> dict[str, str]:
    """Writes `folder`/NAME.SUM of every view of a body-fixed scene [m]; returns a description."""
    views = framed.scene.views
    for k, name in enumerate(sumfile_names(views.name)):
        pose = views.body_from_cam[k]
        in_km = Rigid(pose.rotation, _KM_PER_M * pose.translation)
        summary = sumfile_of_view(name, views.cameras[k], in_km, views.sun[k], utc=UNKNOWN_TIME)
        write_sumfile(folder / f"{name}.SUM", summary)
    return {folder.name: "a SUMFILE per view, in km; without times of exposure and landmarks"}


def sumfile_names(names: Sequence[str]) -> list[str]:
    """The images' names without folder and suffix; with the folder if they would not differ otherwise."""
    stems = [PurePosixPath(name).stem for name in names]
    if len(set(stems)) == len(stems):
        return stems
    return [str(PurePosixPath(name).with_suffix("")).replace("/", "_") for name in names]
