"""The joint estimates of a run: in the map's own frame, or in that of its pose priors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust import Adjustment, AdjustOptions, Anchors, ImageSlopes, PosePriors
from photoclinometry.matching.densify import triangulate_tracks
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import OWN, Scene, Views
from photoclinometry.pipeline.pose_priors import adjust_with_priors, place_by_priors
from photoclinometry.pipeline.products import Progress, adjusted
from photoclinometry.registration.alignment import align_views


@dataclass(frozen=True, kw_only=True)
class Estimator:
    """Makes one estimate after another of the same views (`rounds.adjust_in_rounds`)."""

    options: AdjustOptions
    anchors: Anchors
    """Sparse landmarks, in the frame of `views`."""
    views: Views
    """As the sparse stage left them."""
    reflectance: Reflectance | None
    """As it is known beforehand; None of geometry alone."""
    priors: Mapping[str, PosePrior]
    """By name of view; none, or enough to determine a frame."""
    progress: Progress

    def __call__(self, start: Scene, slack: float, last: bool, slopes: ImageSlopes | None = None) -> Adjustment:
        """The scene adjusted from `start`, keypoints held `slack` times looser; uncertainties if it is the last.

        slopes: of the images where the brightness of `start` was taken, which then follows the landmarks.

        Estimates before the last end early: what they leave is matched again, and what they have not settled are the
        slow motions of the whole map. The first one is free of priors: it places the scene in their frame, in which
        later ones use them.
        """
        options = replace(self.options, keypoint_slack=slack * self.options.keypoint_slack)
        if not last:
            options = replace(options, uncertainty=False, solver=options.solver.roughly())

        def adjust(scene: Scene, known: PosePriors | None = None) -> Adjustment:
            anchors = self._anchors_for(scene)
            return adjusted(scene, options, self.progress, anchors, known, self.reflectance, slopes)

        if not self.priors:
            return adjust(start)
        if start.frame != OWN:
            return adjust_with_priors(start, self.priors, adjust) or adjust(start)
        alone = adjust(start)
        if last:
            return adjust_with_priors(alone.scene, self.priors, adjust) or alone
        placed = place_by_priors(alone.scene, self.priors)
        return alone if placed is None else replace(alone, scene=placed.scene)

    def _anchors_for(self, scene: Scene) -> Anchors:
        """The anchors in the scene's frame, where its own poses see them."""
        if scene.frame == OWN:
            return self.anchors
        found = triangulate_tracks(self.anchors.tracks, scene.views)
        roughly = align_views(self.views, scene)(self.anchors.position)
        return replace(self.anchors, position=np.where(np.isfinite(found), found, roughly))
