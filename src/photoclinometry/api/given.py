"""A map as callers give it: a result, a scene, or a path."""

from __future__ import annotations

import difflib
from pathlib import Path

from photoclinometry.io import run_files, scene_file
from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import Scene
from photoclinometry.pipeline.products import RunResult


def given_scene(scene: RunResult | Scene | str | Path) -> Scene:
    """The map of a result, of a run folder, or of a scene.h5; a scene itself. Raises InputError."""
    if isinstance(scene, RunResult):
        return scene.scene
    return scene if isinstance(scene, Scene) else scene_at(Path(scene))


def scene_at(path: Path) -> Scene:
    """The map of a run folder, or of a scene.h5. Raises InputError."""
    return scene_file.read_scene(path) if path.suffix in (".h5", ".hdf5") else run_files.read_run(path)


def given_folder(scene: RunResult | Scene | str | Path) -> Path | None:
    """The run folder of a map; None of a scene by itself."""
    if isinstance(scene, Scene):
        return None
    path = scene.folder if isinstance(scene, RunResult) else Path(scene)
    return path.parent if path.is_file() else path


def view_index(scene: Scene, name: str | None) -> int:
    """Index of a view by its name, its file name, or its file name without suffix; None is the reference.

    Raises InputError that names the nearest.
    """
    if name is None:
        return scene.reference
    names = scene.views.name
    for candidates in (names, [Path(n).name for n in names], [Path(n).stem for n in names]):
        if list(candidates).count(name) == 1:
            return list(candidates).index(name)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.0)
    raise InputError(f"no view {name!r} in scene {scene.name!r}; nearest: {', '.join(near)}")
