"""Geometry alone: the run's own pipeline without a reflectance model, textured with the mean brightness of its images.

It is what dense structure from motion gives (the paper's comparison with SfM, Table 4): positions by matches and
triangulation, normals by the neighbours of each point, and no albedo, since the light stays in the texture. Poses are
its own, estimated together with the positions.
"""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io import run_files
from photoclinometry.io.held_out import read_held_out
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.option_fields import changed
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.projection import projected_keypoints
from photoclinometry.model.scene import Scene, join_views
from photoclinometry.photometry.render import draw_smoothly
from photoclinometry.photometry.sampled_brightness import sample_brightness
from photoclinometry.pipeline.folder.run_folder import adopt_stages
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.run import run
from photoclinometry.rivals.outcome import Outcome
from photoclinometry.rivals.problem import Problem

NO_MODEL = "none"
"""The reflectance model of geometry alone."""
ADOPTED = ("sparse",)
"""Stages of the run that are taken over."""


def run_mvs(
    problem: Problem, run_folder: Path, out: Path, site: Path | None = None, progress: Progress = no_progress
) -> Outcome:
    """The map and the predictions of geometry alone.

    run_folder: the finished run, whose options and sparse stage are taken; out: a folder for the map without a
    reflectance model, gone on with where it is there. Raises ReconstructionError where it finds fewer of the views.
    """
    options = options_from(RunOptions, run_files.read_config(run_folder))
    adopt_stages(run_folder, out, ADOPTED)
    run(run_files.site_path(run_folder, site), out, replace(options, reflectance=NO_MODEL), progress)
    scene, held_out = run_files.read_run(out), read_held_out(out / run_files.HELD_OUT_FILE)
    names = scene.views.name + (() if held_out is None else held_out.name)
    missing = sorted(set(problem.views.name) - set(names))
    if missing:
        raise ReconstructionError(f"geometry alone has no pose of {', '.join(missing)}; leave out --methods mvs")
    views = scene.views if held_out is None else join_views(scene.views, held_out)
    order = [names.index(name) for name in problem.views.name]
    joined, faces = scene.with_estimate(views[order], scene.landmarks), landmark_faces(scene)
    texture = mean_brightness(problem, scene)
    drawn = [draw_smoothly(joined, k, texture, faces) for k in range(len(order))]
    rendered, covered = [image for image, _ in drawn], [mask for _, mask in drawn]
    stages = run_files.read_metrics(out).get("stages", ())
    resumed = any(stage["resumed"] for stage in stages if stage["stage"] not in ADOPTED)
    return Outcome(name="mvs", rendered=rendered, covered=covered, knows_light=False, scene=scene, resumed=resumed)


def mean_brightness(problem: Problem, scene: Scene) -> np.ndarray:
    """(J,) mean over the views that see a landmark of its brightness over the view's median; 1 where none lights it."""
    by_name = {image.name: image for image in problem.images}
    tracks = scene.tracks
    value, lit = sample_brightness(
        [by_name[name] for name in scene.views.name], tracks.view, projected_keypoints(scene)
    )
    for k in range(len(scene.views)):
        own = tracks.view == k
        if lit[own].any():
            value[own] /= np.median(value[own][lit[own]])
    count = np.bincount(tracks.landmark[lit], minlength=len(scene.landmarks))
    total = np.bincount(tracks.landmark[lit], value[lit], minlength=len(scene.landmarks))
    return np.where(count > 0, total / np.maximum(count, 1), 1.0)


def options_from(kind: type[Any], content: Mapping[str, Any]) -> Any:
    """Options of a class from what `write_options` wrote of them; what is not there is as by default."""
    hints, found = typing.get_type_hints(kind), {}
    for field in fields(kind):
        if field.name in content:
            value, hint = content[field.name], hints[field.name]
            if isinstance(value, Mapping):
                value = options_from(typing.cast(type, hint), value)
            elif isinstance(value, list):
                value = tuple(value)
            elif Path in (hint, *typing.get_args(hint)):
                value = Path(str(value))
            found[field.name] = value
    return changed(kind(), found)
