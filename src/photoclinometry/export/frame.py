"""The frame of what is exported: body-fixed in metres, or the scene's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.align import transform_scene
from photoclinometry.errors import InputError
from photoclinometry.export.options import ExportOptions
from photoclinometry.geometry import Similarity, unit
from photoclinometry.io.globe import Globe, find_globe
from photoclinometry.io.similarity import read_similarity
from photoclinometry.scene import Scene

_RADIUS_RANGE = (0.3, 3.0)
"""Landmarks are this near to the globe's radius, on the longest and on the shortest axis of bodies like Eros."""


@dataclass(frozen=True, kw_only=True)
class Framed:
    """A scene in the frame that it is exported in."""

    scene: Scene
    globe: Globe | None
    """The body's globe where the frame is body-fixed [m]; None in the scene's own frame."""
    metric: bool
    """Lengths are metres; else in the scene's own unit."""

    @property
    def unit(self) -> str:
        return "m" if self.metric else ""

    @property
    def words(self) -> str:
        """The frame and unit of positions, for people."""
        if self.globe is not None:
            return "body-fixed, origin in the body's centre, z to the north pole, x to longitude 0, in metres"
        return f"the scene's own, on no known place of a body, in {'metres' if self.metric else 'its own unit'}"


def framed(scene: Scene, options: ExportOptions) -> Framed:
    """The scene in its body-fixed frame where the options tell it, else in its own.

    Raises InputError where they contradict themselves, or the landmarks cannot be ground of the body.
    """
    marks = scene.landmarks
    if not len(marks) or not (np.isfinite(marks.position).all() and np.isfinite(marks.normal).all()):
        raise InputError(f"scene {scene.name!r}: it has no landmarks, or some are not finite; run the site again")
    if options.transform is None and not options.body_fixed:
        return _in_own_frame(scene, options)
    if options.transform is not None and (options.body_fixed or options.unit_m is not None):
        raise InputError("--transform already says frame and unit: leave out --body-fixed and --unit-m")
    if options.transform is not None:
        body_from_scene = read_similarity(options.transform)
    elif options.unit_m is None:
        raise InputError("--body-fixed needs the scene's unit of length: give --unit-m (1, or 1000 for km)")
    else:
        body_from_scene = _scaling(options.unit_m)
    globe = find_globe(options.body or scene.body, options.radii_m)
    moved = transform_scene(body_from_scene, scene)
    _check_on_body(moved, globe)
    return Framed(scene=moved, globe=globe, metric=True)


def _in_own_frame(scene: Scene, options: ExportOptions) -> Framed:
    for name in ("radii_m", "projection", "center_deg"):
        if getattr(options, name) is not None:
            flag = "--" + name.replace("_", "-")
            raise InputError(
                f"{flag} is for maps of a body, and the scene is in a frame of its own; say where on the body it lies: "
                "--transform FILE, or --body-fixed with --unit-m if it is in the body-fixed frame"
            )
    if options.unit_m is None:
        return Framed(scene=scene, globe=None, metric=False)
    return Framed(scene=transform_scene(_scaling(options.unit_m), scene), globe=None, metric=True)


def _scaling(unit_m: float) -> Similarity:
    if not (np.isfinite(unit_m) and unit_m > 0):
        raise InputError(f"--unit-m {unit_m}: give a positive number of metres")
    return Similarity(float(unit_m), np.eye(3), np.zeros(3))


def _check_on_body(scene: Scene, globe: Globe) -> None:
    """Raises InputError unless the landmarks lie about a radius from the centre and their normals look away from it."""
    position, normal = scene.landmarks.position, scene.landmarks.normal
    distance = float(np.median(np.linalg.norm(position, axis=-1)))
    low, high = _RADIUS_RANGE[0] * globe.radii_m[1], _RADIUS_RANGE[1] * globe.radii_m[0]
    if not low <= distance <= high:
        raise InputError(
            f"the landmarks of scene {scene.name!r} would be {distance:.4g} m from the centre of {globe.name}, whose "
            f"radius is {globe.radii_m[0]:.4g} m: this is not the body-fixed frame, or the unit is wrong; check "
            "--transform, --unit-m and the body"
        )
    if np.median(np.sum(unit(position) * normal, axis=-1)) <= 0:
        raise InputError(
            f"the normals of scene {scene.name!r} would look into {globe.name}: this is not the body-fixed frame; "
            "check --transform"
        )
