"""The outcome of a method: its prediction of every view, its map where it has one, and its cost."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.scene import Landmarks, Scene, join_views
from photoclinometry.photometry.render import render_view
from photoclinometry.rivals.integrate import surface_normals
from photoclinometry.rivals.problem import Problem

COVERED = 0.5
"""Pixels of a cloud or a field are covered where less light than this passes through."""
_RESET_PEAK = "5"
"""Written to `clear_refs`, Linux begins the peak of the resident size anew (proc(5))."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A method's result on a `Problem` of K + H views."""

    name: str
    rendered: Sequence[np.ndarray]
    """(K + H,) of (height, width): predicted brightness; defined where `covered`."""
    covered: Sequence[np.ndarray]
    """(K + H,) of (height, width) bool."""
    knows_light: bool
    """Whether the brightness of a view is predicted from its Sun. Otherwise a gain and an offset are fitted to each
    image before it is compared, also to those held out."""
    scene: Scene | None = None
    """The method's map; without a reflectance model where it has no albedos."""
    resumed: bool = False
    """Whether an earlier call had made a part of it, so that what it took is not known."""
    history: Sequence[float] = ()
    """The residual or loss after every iteration."""
    cpu_s: float = float("nan")
    peak_memory_gb: float | None = None
    """Largest resident size of the process during the method; None where the system does not report it."""


def rendered_map(problem: Problem, scene: Scene) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """A map drawn in all views of the problem, with cast shadows: brightness and masks (K + H,) of (height, width).

    scene: with the K views of the problem, perhaps at other poses; held-out views are as the problem has them.
    """
    views = scene.views if problem.held_out is None else join_views(scene.views, problem.held_out)
    joined, faces = scene.with_estimate(views, scene.landmarks), landmark_faces(scene)
    drawn = [render_view(joined, k, faces=faces, cast_shadows=True) for k in range(len(views))]
    return [image for image, _ in drawn], [mask for _, mask in drawn]


def surface_map(scene: Scene, position: np.ndarray) -> Scene:
    """A map of geometry alone, by the positions (J, 3) of the scene's landmarks, NaN where there is none.

    Its normals are those of this surface.
    """
    normal = surface_normals(scene.grid(position), scene.views.body_from_cam.translation[scene.reference])[scene.cells]
    kept = np.flatnonzero(np.isfinite(position).all(-1) & np.isfinite(normal).all(-1))
    pixel = scene.landmarks.pixel
    found = Landmarks(position=position, normal=normal, albedo=np.ones(len(position)), pixel=pixel)[kept]
    tracks = scene.tracks.of_landmarks(kept)[0]
    return replace(scene, landmarks=found, tracks=tracks, uncertainty={}, reflectance=None)


def costed(method: Callable[[], Outcome]) -> Outcome:
    """The outcome of a method, with the CPU seconds and the peak of the memory that it took; of one that was resumed,
    without."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(_RESET_PEAK)
    before = time.process_time()
    outcome = method()
    if outcome.resumed:
        return outcome
    return replace(outcome, cpu_s=time.process_time() - before, peak_memory_gb=_peak_gb())


def _peak_gb() -> float | None:
    """Largest resident size since it was last begun anew [GiB]; None where the system does not report it (not
    Linux)."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 2**20
    return None
