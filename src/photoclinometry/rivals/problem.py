"""The input of every rival method: a run's images, poses, Suns and region, and the views to predict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from photoclinometry.io import run_files
from photoclinometry.io.held_out import read_held_out
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.scene import Scene, Views, join_views
from photoclinometry.photometry.predict import reflectance_of
from photoclinometry.photometry.render import draw_landmarks


@dataclass(frozen=True, kw_only=True)
class Problem:
    """K views to learn from and H views to predict, with the poses and Suns of a finished run."""

    scene: Scene
    """The run's map, with a reflectance model. Rivals take its views, region and reflectance parameters."""
    images: Sequence[Image]
    """(K + H,) in the order of `views`."""
    held_out: Views | None
    """(H,) in the frame of the map; None where there are none."""

    @cached_property
    def views(self) -> Views:
        """(K + H,) the views to learn from, then those to predict."""
        return self.scene.views if self.held_out is None else join_views(self.scene.views, self.held_out)

    @property
    def train(self) -> int:
        """K."""
        return len(self.scene.views)

    @cached_property
    def peak(self) -> float:
        """The greatest brightness of the views to learn from."""
        return max(float(image.brightness[image.valid].max()) for image in self.images[: self.train])

    @cached_property
    def footprint(self) -> list[np.ndarray]:
        """(K + H,) of (height, width) bool: valid pixels of each image that the run's map covers."""
        scene, faces = self.scene.with_estimate(self.views, self.scene.landmarks), landmark_faces(self.scene)
        ones = np.ones(len(scene.landmarks))
        return [draw_landmarks(scene, k, ones, faces)[1] & image.valid for k, image in enumerate(self.images)]


def read_problem(run: Path, site: Path | None = None, hold_out: Sequence[str] = ()) -> Problem:
    """The problem that a finished run has solved.

    site: the site.toml, if it has moved; hold_out: which of the views that the run held out are to be predicted; all by
    default. Raises InputError, also for a run without a reflectance model, and for views that the run has used.
    """
    scene = run_files.read_run(run)
    reflectance_of(scene)
    held_out = _chosen(scene, read_held_out(run / run_files.HELD_OUT_FILE), hold_out)
    names = scene.views.name + (() if held_out is None else held_out.name)
    return Problem(scene=scene, images=run_files.run_images(run_files.site_path(run, site), names), held_out=held_out)


def _chosen(scene: Scene, held_out: Views | None, names: Sequence[str]) -> Views | None:
    """The views held out that are named, or all. Raises InputError for others."""
    known = () if held_out is None else held_out.name
    for name in names:
        if name not in known:
            why = "the run was made from it" if name in scene.views.name else "there is no such view"
            held = f"{', '.join(known)}: name some of these, or" if known else "none:"
            raise InputError(
                f"--hold-out (predict=): {name}: {why}, so that it cannot be predicted; the run held out {held} "
                "run the site again with --hold-out"
            )
    return held_out if held_out is None or not names else held_out[[known.index(name) for name in names]]
