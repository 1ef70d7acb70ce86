"""Images that share no points with others are placed by the finished surface.

The surface is rendered with the image's Sun from its pose prior. Rendering and image differ by little more than a
shift, so that their keypoints match, unlike those of two images under different light. The pose follows from the
matched points of the surface, and from the prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust.bundle import resected
from photoclinometry.body.cameras import SharedCameras
from photoclinometry.body.finished_surface import FinishedSurface
from photoclinometry.body.sparse import FEWEST_POINTS, first_gate
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Views
from photoclinometry.photometry.shape_rendering import ShadedSurface, rendered_shape
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.frame.pose_priors import priors_of_views
from photoclinometry.pipeline.sparse_stages import PosedImages
from photoclinometry.sfm.keypoints import mutual_matches, sift_keypoints
from photoclinometry.sfm.pictures import brightness_picture, shows_something
from photoclinometry.surface.mesh_rays import MeshRays

NEXT_GATE_PX = 4.0
"""Distance within which matches are sought once a pose was found [px]; before that the possible error of the pose prior
is used."""
ALIKE_PX = 3.0
"""Matches whose shift differs from the median by more than this [px], or by a quarter of the gate, are wrong ones."""
KEYPOINTS = 2000
"""Of the rendering and of the image, at most."""
MAX_RATIO = 0.8
"""Of the distance of the nearest descriptor to that of the second nearest."""
SURFACE_SIGMA_GSD, KEYPOINT_SIGMA_PX = 0.5, 0.5
"""Standard deviations of the surface [GSD] and of keypoints of a rendering [px]."""
MAX_OFF_PX = 1.0
"""Largest median error of the matches of a view that is placed [px]."""


@dataclass(frozen=True, kw_only=True)
class PlacedViews:
    """Poses by the surface of views that had no others."""

    body_from_cam: Rigid
    """(K,) of all views: those that were placed, and the others as they were."""
    placed: np.ndarray
    """(K,) bool."""
    matches: np.ndarray
    """(K,) int."""
    off_px: np.ndarray
    """(K,) median distance of the matches from the projections of the surface's points [px]; NaN without matches."""


@dataclass(frozen=True, kw_only=True)
class PlaceLeftOut(Stage[PlacedViews]):
    """The poses of views that are in no tile, from renderings of the surface."""

    name = "placement"
    result = PlacedViews
    posed: PosedImages
    cameras: Keyed[SharedCameras]
    surface: FinishedSurface
    priors: Mapping[str, PosePrior]
    """By name of view."""

    def make(self, tools: Tools) -> PlacedViews:
        inputs, poses = self.posed.inputs.value, self.cameras.value.body_from_cam
        count = len(self.posed.views)
        rotation, center = poses.rotation.copy(), poses.translation.copy()
        placed, matches, off = np.zeros(count, bool), np.zeros(count, int), np.full(count, np.nan)
        left = [
            k for k, image in enumerate(inputs.images)
            if not self.posed.sparse.value.registered[k] and image.name not in inputs.unusable
            and image.name in self.priors
        ]  # fmt: skip
        shaded = self.surface.shaded if left else None
        if shaded is not None:
            for done, k in enumerate(left):
                image, view = inputs.images[k], self._view(k)
                found = place_view(shaded, self.surface.merged.value.gsd, image, view, self.priors[image.name])
                tools.progress("placement", done + 1, len(left))
                matches[k], off[k] = found.matches, found.off_px
                if found.is_placed:
                    placed[k], rotation[k], center[k] = True, found.pose.rotation[0], found.pose.translation[0]
        say_found(f"{placed.sum()} of {len(left)} left-out images placed by the surface")
        return PlacedViews(body_from_cam=Rigid(rotation, center), placed=placed, matches=matches, off_px=off)

    def _view(self, k: int) -> Views:
        """(1,) at its pose prior."""
        views = self.posed.views[[k]]
        pose = self.priors[views.name[0]].cam_from_body.inverse()
        return views.at_poses(Rigid(pose.rotation[None], pose.translation[None]))


@dataclass(frozen=True)
class Placement:
    """The pose of one image, by the surface."""

    pose: Rigid
    """(1,)."""
    matches: int
    off_px: float
    """As of `PlacedViews`."""

    @property
    def is_placed(self) -> bool:
        """Whether the matches are many and agree."""
        return self.matches >= FEWEST_POINTS and self.off_px <= MAX_OFF_PX


def place_view(surface: ShadedSurface, gsd: float, image: Image, view: Views, prior: PosePrior) -> Placement:
    """The pose of one view (1,) that starts at its prior. gsd: of the surface [units of B]."""
    priors = priors_of_views(view.name, view.body_from_cam, {view.name[0]: prior})
    camera, nothing = view.cameras[0], Placement(view.body_from_cam, 0, np.nan)
    for gate in (first_gate(view.cameras, priors), NEXT_GATE_PX, NEXT_GATE_PX):
        rendering = rendered_shape(surface, camera, view.body_from_cam[0], view.sun[0])
        there, seen = _matches(rendering, image, max(gate, NEXT_GATE_PX))
        points = _ground(surface.rays, view, there)
        there, seen, points = (each[np.isfinite(points[:, 0])] for each in (there, seen, points))
        if len(points) < FEWEST_POINTS:
            return replace(nothing, matches=len(points))
        pose = resected(points, SURFACE_SIGMA_GSD * gsd, seen, KEYPOINT_SIGMA_PX, view, priors)
        view = view.at_poses(pose)
    off = np.linalg.norm(view.project(0, points) - seen, axis=-1)
    return Placement(view.body_from_cam, len(points), float(np.median(off)))


def _matches(rendering: np.ndarray, image: Image, gate_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) in the rendering and (n, 2) in the image that show the same, at most `gate_px` apart.

    None where a prior is so wrong that the rendering shows sky or night alone.
    """
    drawn = Image("rendering", np.nan_to_num(rendering).astype(np.float32), np.isfinite(rendering))
    if not shows_something(drawn):
        return np.empty((0, 2)), np.empty((0, 2))
    of_rendering, of_image = (
        sift_keypoints(brightness_picture(each), each.valid, KEYPOINTS) for each in (drawn, image)
    )
    (a, by_a), (b, by_b) = of_rendering, of_image
    apart = np.linalg.norm(a[:, None, :2] - b[None, :, :2], axis=-1)
    by_a, by_b = by_a.astype(np.float32), by_b.astype(np.float32)
    square = np.sum(by_a**2, -1)[:, None] + np.sum(by_b**2, -1) - 2.0 * by_a @ by_b.T
    unlike = np.where(apart <= gate_px, np.maximum(square, 0.0), np.inf)
    of_a, of_b = mutual_matches(unlike, MAX_RATIO)
    there, seen = a[of_a, :2].astype(float), b[of_b, :2].astype(float)
    if not len(there):
        return there, seen
    shift = seen - there
    alike = np.linalg.norm(shift - np.median(shift, axis=0), axis=-1) <= max(ALIKE_PX, gate_px / 4.0)
    return there[alike], seen[alike]


def _ground(rays: MeshRays, view: Views, pixels: np.ndarray) -> np.ndarray:
    """(n, 3) points of the surface that a view (1,) sees at pixels (n, 2); NaN beside it."""
    pose = view.body_from_cam[0]
    direction = unit(view.cameras[0].ray_in_cam(pixels) @ pose.rotation.T)
    triangle, weight = rays.first_hit(np.broadcast_to(pose.translation, direction.shape), direction)
    point = rays.interpolated(rays.vertices, triangle, weight)
    return np.where((triangle >= 0)[:, None], point, np.nan)
