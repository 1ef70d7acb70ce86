"""Run folders: the names of their files, and the content of a finished one.

The mark and the lock, which only `pipeline/folder/` reads and writes, are named there (`run_mark`, `run_lock`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from photoclinometry.model.errors import ImageError, RunFolderError
from photoclinometry.model.image import Image
from photoclinometry.model.scene import Scene

SCENE_FILE = "scene.h5"
"""The map of a place."""
BODY_FILE = "body.ply"
"""The surface of a whole body."""
METRICS_FILE = "metrics.json"
"""Verdict, warnings and figures."""
CONFIG_FILE = "config.toml"
"""What was mapped, and every option."""
LANDMARKS_FILE = "landmarks.ply"
"""The map as a mesh."""
ALTIMETRY_FILE = "altimetry.csv"
"""All shots of a laser altimeter on the map: the residual of each, and whether it was used."""
HELD_OUT_FILE = "held_out.json"
"""Views that were held out, placed in the map's frame."""
LOG_FILE = "log"
POSES_FOLDER = "sparse"
"""The poses, with some points, as a COLMAP model."""
REPORT_FOLDER = "report"
MODEL_FOLDER = "model"
"""The text model that `phomo refine` leaves."""
TILES_FOLDER = "tiles"
"""Run folders of a body's tiles, by their numbers."""
STAGES_FOLDER = "stages"
"""Results of finished stages."""
EVALUATION_FOLDER, PHOTOMETRY_FOLDER, RIVALS_FOLDER = "evaluation", "photometry", "rivals"
"""Of the commands of these names."""

PRODUCTS = frozenset(
    (
        *(SCENE_FILE, BODY_FILE, METRICS_FILE, CONFIG_FILE, LANDMARKS_FILE, ALTIMETRY_FILE, HELD_OUT_FILE, LOG_FILE),
        *(POSES_FOLDER, REPORT_FOLDER, MODEL_FOLDER, TILES_FOLDER, STAGES_FOLDER),
        *(EVALUATION_FOLDER, PHOTOMETRY_FOLDER, RIVALS_FOLDER),
    )
)
"""Everything that `phomo run`, `body`, `refine`, `evaluate`, `photometry` and `rivals` write into their folder, beside
the mark and the lock."""

_LARGEST_COUNT = 10**15
"""Greater whole numbers in metrics.json are damage: they may be too large for a float."""
_LEAVE_OUT = "leave the images out (--no-images, images=False)"
_GIVE_SITE = f"give the site.toml of the run's images (--site, site=), or {_LEAVE_OUT}"
"""Advice where the images of a run are not at hand."""


def is_map(folder: Path) -> bool:
    """Whether a folder holds the map of a place."""
    return (Path(folder) / SCENE_FILE).is_file()


def is_body(folder: Path) -> bool:
    """Whether a folder holds the surface of a whole body, and no map of a place."""
    return (Path(folder) / BODY_FILE).is_file() and not is_map(folder)


def read_run(run: Path) -> Scene:
    """The scene of a finished run. Raises RunFolderError."""
    from photoclinometry.io.scene_file import read_scene

    path = run / SCENE_FILE
    if not path.is_file():
        found = "no such folder" if not run.is_dir() else f"the folder holds no {SCENE_FILE}"
        raise RunFolderError(f"{run}: {found}; give a folder that `phomo run` has finished")
    return read_scene(path)


def read_config(run: Path) -> dict[str, Any]:
    """The options that the run recorded; empty if it has no config.toml. Raises RunFolderError."""
    from photoclinometry.io.toml_file import read_toml

    path = run / CONFIG_FILE
    if not path.is_file():
        return {}
    return read_toml(path, f"{CONFIG_FILE} of a run", RunFolderError).content


def read_metrics(run: Path) -> dict[str, Any]:
    """The figures and warnings that the run recorded; empty if it has no metrics.json. Raises RunFolderError."""
    from photoclinometry.io.json_file import read_json

    path = run / METRICS_FILE
    if not path.is_file():
        return {}
    content = read_json(path)
    tables = ("warnings", "pose_priors", "control_points")
    parts = {"metrics": dict, "not_trusted_because": list, "care": list, "verdict": str, **dict.fromkeys(tables, list)}
    sound = isinstance(content, dict) and all(isinstance(content.get(k, kind()), kind) for k, kind in parts.items())
    sound = sound and all(isinstance(row, dict) for table in tables for row in content.get(table, ()))
    sound = sound and all({"code", "words"} <= row.keys() for row in content.get("warnings", ()))
    if not sound or any(isinstance(v, int) and abs(v) > _LARGEST_COUNT for v in content.get("metrics", {}).values()):
        raise RunFolderError(f"{path}: is damaged (it holds no figures of a run); run the site again")
    return content


def site_path(run: Path, given: Path | None = None) -> Path:
    """The site.toml of a run: as given, or as the run recorded it. Raises RunFolderError."""
    path = given or read_config(run).get("site")
    if path is None:
        raise RunFolderError(f"{run}: {CONFIG_FILE} does not name the site; {_GIVE_SITE}")
    if not isinstance(path, (str, Path)):
        raise RunFolderError(f"{run / CONFIG_FILE}: site: expected a path in quotes, found {path!r}; {_GIVE_SITE}")
    path = Path(path)
    if not path.is_file():
        raise RunFolderError(f"{path}: the site of the run is not there (any more); {_GIVE_SITE}")
    return path


def run_images(site: Path, names: Sequence[str]) -> list[Image]:
    """The images of a run's views. Raises SiteError, RunFolderError for another site, and ImageError for images that
    cannot be read, show nothing, or have a brightness that is impossible for ground."""
    from photoclinometry.io.site import read_site
    from photoclinometry.io.site_images import load_plausible_images

    found = load_plausible_images(read_site(site))
    images, unusable = {image.name: image for image in found.images}, found.empty | found.impossible
    missing = [name for name in names if name not in images]
    if missing:
        raise RunFolderError(f"{site}: has no view {missing[0]!r}, which the run used; {_GIVE_SITE}")
    for name in names:
        if name in unusable:
            raise ImageError(
                f"{site}: {name}: {unusable[name]}; the run used this view: give the images that it was made of, or "
                f"{_LEAVE_OUT}"
            )
    return [images[name] for name in names]
