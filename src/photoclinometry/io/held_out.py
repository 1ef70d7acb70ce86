"""`held_out.json`: the views held out of a run, with poses in the frame of its map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.json_file import read_json, write_json
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.scene import VIEW_ARRAYS, Views


def write_held_out(path: Path, views: Views) -> None:
    """The views, exact to the last bit. Raises RunFolderError."""
    content = {
        "name": list(views.name),
        "cameras": [[c.model, c.width, c.height, list(c.params)] for c in views.cameras],
        "rotation": views.body_from_cam.rotation.tolist(),
        "translation": views.body_from_cam.translation.tolist(),
        **{key: getattr(views, key).tolist() for key in VIEW_ARRAYS},
    }
    write_json(path, content)


def read_held_out(path: Path) -> Views | None:
    """The views that `write_held_out` wrote; None if the run held none out. Raises RunFolderError."""
    if not path.is_file():
        return None
    content = read_json(path)
    try:
        if not all(isinstance(name, str) for name in content["name"]):
            raise ValueError("the names of the views are not text")
        content.setdefault("arc", [0] * len(content["name"]))  # missing in files from before Suns were of arcs
        views = Views(
            name=tuple(content["name"]),
            cameras=tuple(Camera(m, w, h, tuple(p)) for m, w, h, p in content["cameras"]),
            body_from_cam=Rigid(np.array(content["rotation"], float), np.array(content["translation"], float)),
            **{key: np.array(content[key], int if key == "arc" else float) for key in VIEW_ARRAYS},
        )
        _check(views)
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise RunFolderError(f"{path}: is damaged ({error}); run the site again") from error
    return views


def _check(views: Views) -> None:
    """Raises ValueError where the arrays do not agree."""
    count = len(views.name)
    vectors = {"sun": (3,), "sun_measured": (3,)}
    expected = {key: (count, *vectors.get(key, ())) for key in VIEW_ARRAYS}
    found = {key: getattr(views, key) for key in VIEW_ARRAYS}
    expected |= {"rotation": (count, 3, 3), "translation": (count, 3)}
    found |= {"rotation": views.body_from_cam.rotation, "translation": views.body_from_cam.translation}
    for key, values in found.items():
        if values.shape != expected[key]:
            raise ValueError(f"{key} is of shape {values.shape}, {count} views need {expected[key]}")
    if len(views.cameras) != count:
        raise ValueError(f"there are {len(views.cameras)} cameras and {count} names")
