"""`held_out.json`: views that a run was not made from, placed in the frame of its map."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import write_text
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.scene import VIEW_ARRAYS, Camera, Views

NAME = "held_out.json"


def write_held_out(path: Path, views: Views) -> None:
    """The views, exact to the last bit. Raises RunFolderError."""
    content = {
        "name": list(views.name),
        "cameras": [[c.model, c.width, c.height, list(c.params)] for c in views.cameras],
        "rotation": views.body_from_cam.rotation.tolist(),
        "translation": views.body_from_cam.translation.tolist(),
        **{key: getattr(views, key).tolist() for key in VIEW_ARRAYS},
    }
    write_text(path, json.dumps(content, indent=1) + "\n")


def read_held_out(path: Path) -> Views | None:
    """What `write_held_out` wrote; None where a run has held nothing out. Raises RunFolderError."""
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return Views(
            name=tuple(content["name"]),
            cameras=tuple(Camera(m, w, h, tuple(p)) for m, w, h, p in content["cameras"]),
            body_from_cam=Rigid(np.array(content["rotation"], float), np.array(content["translation"], float)),
            **{key: np.array(content[key], float) for key in VIEW_ARRAYS},
        )
    except (ValueError, KeyError, TypeError) as error:
        raise RunFolderError(f"{path}: damaged ({error}); run the site again") from error
