"""The stages from poses to dense landmarks, and to the scene at which the joint estimate starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust import TiePoints
from photoclinometry.matching.dense import match_views, triangulated
from photoclinometry.matching.densify import DenseTracks, DensifyOptions
from photoclinometry.matching.interface import Matcher, MatchSetup
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.region import Region
from photoclinometry.model.sampling import filled_from_nearest
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views
from photoclinometry.photometry.albedo import with_model
from photoclinometry.photometry.sampled_brightness import landmark_spacing_px, sample_brightness
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.sparse_stages import Place, PosedImages
from photoclinometry.surface.depth_fit import landmark_depth, sparse_depth
from photoclinometry.surface.neighbours import normals_from_neighbours
from photoclinometry.surface.surroundings import surroundings_of

PLANE_PX, MIN_PLANE_LANDMARKS = 32, 9
"""Side of the window [px] whose landmarks define the plane of a first normal; at least 3 x 3 landmarks are used."""

MIN_TIE_POINT_SIGMA_PX = 0.1
"""Smallest sigma assumed for keypoints of tie points [px]; SIFT keypoints are not more precise."""


@dataclass(frozen=True, kw_only=True)
class MatchDensely(Stage[DenseTracks]):
    """Landmarks and their tracks: every registered view matched with the reference, in several passes.

    Each pass predicts positions from the surface of the one before, so that the remaining displacements are small and
    without distortion.
    """

    name = "dense"
    result = DenseTracks
    posed: PosedImages
    place: Keyed[Place]
    matcher: Keyed[Matcher]
    passes: int
    densify: DensifyOptions
    depth: Keyed[np.ndarray] | None = None
    """(h, w) along the optical axis of the reference, at each of its pixels, NaN where not known; None: from the sparse
    points."""

    def make(self, tools: Tools) -> DenseTracks:
        inputs, sparse, place = self.posed.inputs.value, self.posed.sparse.value, self.place.value
        cameras, poses, reference = inputs.cameras, sparse.body_from_cam, place.reference
        setup = MatchSetup(
            images=inputs.images, cameras=cameras, body_from_cam=poses, reference=reference, region=place.region
        )
        targets = [int(k) for k in np.flatnonzero(sparse.registered) if k != reference]
        depth = self._first_depth(setup.padded)
        dense = None
        for number in range(1, max(1, self.passes) + 1):
            what = f"match {number}"
            matches = match_views(setup, targets, self.matcher.value, depth, tools.progress, what)
            dense = triangulated(setup, matches, self.densify)
            depth = landmark_depth(dense.position, dense.pixel, poses[reference], setup.padded, cameras[reference])
        assert dense is not None
        landmarks, pixels = len(dense.position), place.region.height * place.region.width / place.region.stride**2
        say_found(
            f"{landmarks:,} landmarks ({100 * landmarks / pixels:.0f} %), {len(dense.view) / landmarks:.1f} views each"
        )
        return dense

    def _first_depth(self, region: Region) -> np.ndarray:
        """(region.height, region.width) depths in the reference camera, with which the first matches are predicted."""
        sparse, reference = self.posed.sparse.value, self.place.value.reference
        if self.depth is None:
            return sparse_depth(sparse, reference, region, self.posed.inputs.value.cameras[reference])
        depth = self.depth.value[region.slices]
        return filled_from_nearest(depth, np.isfinite(depth))


@dataclass(frozen=True, kw_only=True)
class InitialScene(Stage[Scene]):
    """The scene at which the joint estimate starts: registered views only, first normals, albedos and scales."""

    name = "initialise"
    result = Scene
    kept = False
    posed: PosedImages
    place: Keyed[Place]
    dense: Keyed[DenseTracks]
    reflectance: Reflectance | None

    def make(self, tools: Tools) -> Scene:
        site, sparse, dense = self.posed.inputs.value.site, self.posed.sparse.value, self.dense.value
        reference, region = self.place.value.reference, self.place.value.region
        views = self.posed.views[np.flatnonzero(sparse.registered)]
        own = int(self.posed.index[reference])
        tracks = self._tracks(views, own)
        count = max(MIN_PLANE_LANDMARKS, PLANE_PX // region.stride**2)
        normal = normals_from_neighbours(dense.position, views.body_from_cam.translation.mean(0), count)
        camera = site.views[reference].camera
        scene = Scene(
            name=site.name,
            body=site.body,
            brightness=site.brightness,
            reflectance=None,
            views=views,
            landmarks=Landmarks(position=dense.position, normal=normal, albedo=np.ones(len(normal)), pixel=dense.pixel),
            tracks=tracks,
            reference=own,
            region=region,
            surroundings=surroundings_of(sparse, reference, region, dense.position, dense.pixel, camera),
            frame=self.posed.frame,
        )
        return scene if self.reflectance is None else with_model(scene, self.reflectance)

    def _tracks(self, views: Views, own: int) -> Tracks:
        """The dense tracks, of registered views, with the brightness at their keypoints."""
        dense, view = self.dense.value, self.posed.index[self.dense.value.view]
        spacing = landmark_spacing_px(views, dense.position, own)
        images = self.posed.registered_images
        brightness, lit = sample_brightness(images, view, dense.keypoint, spacing_px=spacing)
        return Tracks(
            start=dense.start,
            view=view.astype(np.int32),
            keypoint=dense.keypoint,
            keypoint_sigma=dense.keypoint_sigma,
            brightness=brightness,
            lit=lit,
        )


def tie_points_from(posed: PosedImages) -> TiePoints:
    """The sparse points of the whole images as tie points, with their views counted among the registered ones.

    Their keypoints' sigma is the mean reprojection error.
    """
    sparse = posed.sparse.value
    sigma_px = max(MIN_TIE_POINT_SIGMA_PX, sparse.mean_reprojection_px)
    view = posed.index[sparse.point_view].astype(np.int32)
    tracks = Tracks.of_keypoints(sparse.point_start, view, sparse.point_xy, sigma_px)
    return TiePoints(position=sparse.points, tracks=tracks)
