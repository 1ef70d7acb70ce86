"""The frame of an export: body-fixed in metres, or that of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from photoclinometry.io.rasters.globe import Globe, find_globe
from photoclinometry.io.similarity import read_similarity
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity, unit
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.registration.georeference import georeferenced

if TYPE_CHECKING:
    from photoclinometry.output.export.options import ExportOptions

_RADIUS_RANGE = (0.3, 3.0)
"""Range of the landmarks' distance from the centre, in radii of the globe: bodies like Eros are that elongated."""

_NOT_BODY_FIXED = (
    "the pose priors of its site are not body-fixed, or the body is another; --unit-m 1 exports the map in metres, on "
    "no known place of a body"
)


@dataclass(frozen=True, kw_only=True)
class Framed:
    """A scene in the frame of the export."""

    scene: Scene
    globe: Globe | None
    """The body's globe if the frame is body-fixed [m]; None in the frame of the scene."""
    metric: bool
    """Whether lengths are in metres; otherwise they are in the unit of the scene."""
    how: str = ""
    """The source of the place on the body, in words."""

    @property
    def unit(self) -> str:
        return "m" if self.metric else ""

    @property
    def words(self) -> str:
        """The frame and unit of positions, in words."""
        if self.globe is not None:
            axes = "origin in the body's centre, z to the north pole, x to longitude 0"
            return f"body-fixed, {axes}, in metres; {self.how}"
        return f"the scene's own, on no known place of a body, in {'metres' if self.metric else 'its own unit'}"


def framed(scene: Scene, options: ExportOptions) -> Framed:
    """The scene in the body-fixed frame if the options or the run give it, else in its own frame.

    Raises InputError if options contradict each other, or if the landmarks cannot lie on the body.
    """
    landmarks = scene.landmarks
    if not len(landmarks) or not (np.isfinite(landmarks.position).all() and np.isfinite(landmarks.normal).all()):
        raise InputError(f"scene {scene.name!r}: it has no landmarks, or some are not finite; run the site again")
    found = _body_from_scene(scene, options)
    if found is None:
        return _in_own_frame(scene, options)
    body_from_scene, how = found
    globe = find_globe(options.body or scene.body, options.radii_m)
    moved = replace(transform_scene(body_from_scene, scene), frame=BODY_FIXED)
    by_run = scene.frame == BODY_FIXED and not (options.transform or options.site)
    _check_on_body(moved, globe, _NOT_BODY_FIXED if by_run else "check --transform, --unit-m and the body")
    return Framed(scene=moved, globe=globe, metric=True, how=how)


def _body_from_scene(scene: Scene, options: ExportOptions) -> tuple[Similarity, str] | None:
    """The transform to the body-fixed frame [m] and its source; None if neither options nor run give it."""
    ways = {"--transform": options.transform, "--site": options.site, "--body-fixed": options.body_fixed or None}
    given = [flag for flag, value in ways.items() if value is not None]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} both give the scene's place on the body: pass one of them")
    if (options.transform or options.site) is not None and options.unit_m is not None:
        raise InputError(f"{given[0]} already gives the unit: leave out --unit-m")
    if options.transform is not None:
        return read_similarity(options.transform), f"by {options.transform}"
    if options.site is not None:
        return _by_priors(scene, options.site)
    if scene.frame == BODY_FIXED and options.unit_m is None:
        return _scaling(1.0), "by the pose priors of its run"
    if not options.body_fixed:
        return None
    if options.unit_m is None:
        raise InputError("--body-fixed needs the scene's unit of length: give --unit-m (1, or 1000 for km)")
    return _scaling(options.unit_m), "by --body-fixed"


def _by_priors(scene: Scene, site: Path) -> tuple[Similarity, str]:
    _, fit = georeferenced(scene, read_site(site).pose_priors)
    angle = np.degrees(fit.rms_rotation)
    how = f"by the pose priors of {fit.used.sum()} views, off by {fit.rms_position:.3g} m and {angle:.2g} degrees (RMS)"
    return fit.similarity, how


def _in_own_frame(scene: Scene, options: ExportOptions) -> Framed:
    for name in ("radii_m", "projection", "center_deg"):
        if getattr(options, name) is not None:
            flag = "--" + name.replace("_", "-")
            raise InputError(
                f"{flag} is for maps of a body, and the scene is in a frame of its own; give its place on the body: "
                "--transform FILE, --site with pose priors, or --body-fixed with --unit-m if it is there already"
            )
    if options.unit_m is None:
        return Framed(scene=scene, globe=None, metric=False)
    return Framed(scene=transform_scene(_scaling(options.unit_m), scene), globe=None, metric=True)


def _scaling(unit_m: float) -> Similarity:
    if not (np.isfinite(unit_m) and unit_m > 0):
        raise InputError(f"--unit-m {unit_m}: give a positive number of metres")
    return Similarity(float(unit_m), np.eye(3), np.zeros(3))


def _check_on_body(scene: Scene, globe: Globe, cure: str) -> None:
    """Raises InputError unless the landmarks lie about a radius from the centre with normals that point outwards."""
    position, normal = scene.landmarks.position, scene.landmarks.normal
    distance = float(np.median(np.linalg.norm(position, axis=-1)))
    low, high = _RADIUS_RANGE[0] * globe.radii_m[1], _RADIUS_RANGE[1] * globe.radii_m[0]
    if not low <= distance <= high:
        raise InputError(
            f"the landmarks of scene {scene.name!r} would be {distance:.4g} m from the centre of {globe.name}, whose "
            f"radius is {globe.radii_m[0]:.4g} m: this is not the body-fixed frame, or the unit is wrong; {cure}"
        )
    if np.median(np.sum(unit(position) * normal, axis=-1)) <= 0:
        raise InputError(
            f"the normals of scene {scene.name!r} would point into {globe.name}: this is not the body-fixed frame; "
            f"{cure}"
        )
