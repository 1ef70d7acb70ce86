"""A relighting iteration: the map is rendered under each view's Sun and matched again, and the change is measured.

Brightness is taken where the map projects, normals and albedos are sharpened by it (`shading`), every view is matched
with the reference relit for it (`matching.relight`), and the matches are triangulated. The joint estimate of the result
is the next map.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from photoclinometry.adjust.estimate import FEWEST_LANDMARKS
from photoclinometry.evaluate.evaluate import keypoint_residual_px, landmark_photometric_error
from photoclinometry.matching.dense import match_views, triangulated
from photoclinometry.matching.densify import DenseTracks, DensifyOptions
from photoclinometry.matching.hole_filling import fill_holes
from photoclinometry.matching.interface import Matcher, MatchSetup
from photoclinometry.matching.relight import RelightMatcher, map_depth
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.image import Image
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.reflectance import GRAZING
from photoclinometry.model.scene import Scene, Tracks
from photoclinometry.model.suns import SUN_CONVENTION
from photoclinometry.model.warning import warn
from photoclinometry.photometry.predict import brightness_residuals
from photoclinometry.photometry.shading import brightness_on_surface, normals_from_shading

log = logging.getLogger(__name__)

INCONSISTENT_SHARE, INCONSISTENT_TIMES = 0.03, 3.0
"""A view's brightness is inconsistent with the map if it is off by more than this share of its brightness under a Sun
overhead, and by more than this multiple of the median view's deviation."""

WRONG_LIGHT = 0.15
"""Share by which the first map's brightness is off where most Suns are wrong. On a small simulated site it is 0.006
with the right Suns, and 0.22 to 0.67 with eight sets of wrong ones."""

MIN_ITERATIONS = 2
"""Iterations that are made in any case, where the options allow them: one in which brightness moves the map, one in
which it settles."""


@dataclass(frozen=True, kw_only=True)
class IterationFigures:
    """How well the map of an iteration explains its measurements, and how far it moved from the one before."""

    iteration: int
    """0 for the first map."""
    landmarks: int
    observations: int
    keypoint_residual_median_px: float
    photometric_error_mean_percent: float | None = None
    """None of geometry alone."""
    keypoints_moved_median_px: float | None = None
    """None of the first map."""
    normals_turned_median_deg: float | None = None
    """None of the first map."""

    def as_row(self) -> dict[str, float]:
        """By name; figures that do not exist are left out."""
        return {name: value for name, value in asdict(self).items() if value is not None}


def rematch(
    scene: Scene,
    images: Sequence[Image],
    matcher: Matcher,
    options: DensifyOptions,
    progress: Progress = no_progress,
    what: str = "relight",
) -> Scene:
    """The scene with landmarks and tracks from new matches against the relit reference, ready to be estimated.

    images: of the scene's views. matcher: matches them with the relit reference. what: first word of the progress.
    Raises ReconstructionError where fewer than FEWEST_LANDMARKS are found again.
    """
    sharp = fill_holes(normals_from_shading(brightness_on_surface(scene, images)))
    setup = MatchSetup(
        images=images,
        cameras=scene.views.cameras,
        body_from_cam=scene.views.body_from_cam,
        reference=scene.reference,
        region=scene.region,
    )
    targets = [k for k in range(len(scene.views)) if k != scene.reference]
    relit, depth = RelightMatcher(sharp, matcher), map_depth(sharp, setup.padded)
    matches = match_views(setup, targets, relit, depth, progress, what)
    try:
        found = triangulated(setup, matches, options)
    except ReconstructionError as error:
        raise _lost(scene, 0, options) from error
    if len(found.position) < FEWEST_LANDMARKS:
        raise _lost(scene, len(found.position), options)
    return brightness_on_surface(with_dense(sharp, found), images)


def _lost(scene: Scene, left: int, options: DensifyOptions) -> ReconstructionError:
    """Why the landmarks of a map were not found again. A map under wrong Suns relights the reference wrongly."""
    off, needed = _brightness_off(scene), options.views_needed(len(scene.views))
    told = (
        f"{left} of the {len(scene.landmarks)} landmarks of the map are found again in {needed} views where "
        "the reference image, relit for each view's Sun by the map, is matched with the view"
    )
    if off > WRONG_LIGHT:
        return ReconstructionError(
            f"{told}; the map's brightness is {100 * off:.0f} % off the images', so the Sun directions are most likely "
            f"wrong: check `sun` of several views in site.toml; {SUN_CONVENTION}"
        )
    return ReconstructionError(
        f"{told}; lower --densify.min-views, map without relighting (--relight.iterations 0), or use images whose "
        "light differs less"
    )


def _brightness_off(scene: Scene) -> float:
    """How far predicted brightness is from the measured one, as a share of it; NaN where nothing is lit."""
    error = landmark_photometric_error(scene, remove_scale_and_bias=True)
    return float(np.mean(error[np.isfinite(error)])) if np.isfinite(error).any() else math.nan


def with_dense(scene: Scene, dense: DenseTracks) -> Scene:
    """The scene with the positions and tracks of `dense`, whose pixels must all have had a landmark."""
    index = scene.grid(np.arange(len(scene.landmarks), dtype=float), fill=-1.0).astype(int)
    return replace(
        scene,
        landmarks=replace(scene.landmarks[index[scene.region.cells(dense.pixel)]], position=dense.position),
        tracks=Tracks.of_keypoints(dense.start, dense.view, dense.keypoint, dense.keypoint_sigma),
    )


def first_map_figures(scene: Scene) -> IterationFigures:
    """Of the map before any iteration; views that it explains badly are named in the log."""
    _warn_of_inconsistent_views(scene)
    return _figures(0, scene)


def iteration_figures(number: int, scene: Scene, before: Scene, moved_px: float) -> IterationFigures:
    """Of the map of an iteration. before: the map that it was relit from; moved_px: `keypoints_moved`."""
    turned = math.degrees(normals_turned(before, scene))
    found = replace(_figures(number, scene), keypoints_moved_median_px=moved_px, normals_turned_median_deg=turned)
    log.info("relighting iteration %d: %s", number, found.as_row())
    return found


def _figures(number: int, scene: Scene) -> IterationFigures:
    error = None
    if scene.reflectance is not None:
        error = 100.0 * _brightness_off(scene)
    return IterationFigures(
        iteration=number,
        landmarks=len(scene.landmarks),
        observations=len(scene.tracks),
        keypoint_residual_median_px=float(np.median(keypoint_residual_px(scene))),
        photometric_error_mean_percent=error,
    )


def keypoints_moved(before: Scene, after: Scene) -> float:
    """Median movement [px] of the keypoints that both scenes have, but for the reference view's."""
    old, new = _observation_number(before), _observation_number(after)
    _, i, j = np.intersect1d(old, new, assume_unique=True, return_indices=True)
    other = before.tracks.view[i] != before.reference
    return float(np.median(np.linalg.norm(after.tracks.keypoint[j[other]] - before.tracks.keypoint[i[other]], axis=-1)))


def normals_turned(before: Scene, after: Scene) -> float:
    """Median turn [rad] of the normals that both scenes have."""
    return float(np.nanmedian(angle_between(before.grid(before.landmarks.normal), after.grid(after.landmarks.normal))))


def is_settled(number: int, moved_px: float, settled_px: float) -> bool:
    """Whether iteration `number`, in which half of the matches moved by less than `moved_px`, is the last needed."""
    return number >= MIN_ITERATIONS and moved_px < settled_px


def inconsistent_brightness(scene: Scene) -> list[tuple[str, float]]:
    """Names of views that the map explains much worse than the others, and how far off their brightness is.

    The deviation is the median size of lit residuals over the median brightness, measured or predicted, whichever is
    brighter: it is 1 for ground that is dark where light was predicted. A view is inconsistent if its deviation times
    the median cosine of incidence is more than INCONSISTENT_SHARE, and more than INCONSISTENT_TIMES that of the median
    view, as with a Sun that is wrong by tens of degrees. Errors of slopes change brightness as much under a low Sun as
    under a high one, but are a larger share of it.
    """
    if scene.reflectance is None:
        return []
    tracks = scene.tracks
    residual = brightness_residuals(scene)
    misfit, cosine = np.zeros(len(scene.views)), np.ones(len(scene.views))
    for k in range(len(misfit)):
        lit = np.flatnonzero(tracks.lit & (tracks.view == k))
        if len(lit):
            measured = tracks.brightness[lit]
            brightness = max(np.median(measured), np.median(measured + residual[lit]))
            misfit[k] = np.median(np.abs(residual[lit])) / brightness
            cosine[k] = np.median(scene.landmarks.normal[tracks.landmark[lit]] @ scene.views.sun[k])
    under_high_sun = misfit * np.maximum(cosine, GRAZING)  # a wrong Sun may stand below the ground
    found = under_high_sun > max(INCONSISTENT_SHARE, INCONSISTENT_TIMES * float(np.median(under_high_sun)))
    return [(scene.views.name[k], float(misfit[k])) for k in np.flatnonzero(found)]


def _warn_of_inconsistent_views(scene: Scene) -> None:
    for name, misfit in inconsistent_brightness(scene):
        warn(
            log,
            "view-brightness",
            "%s: its brightness is %.0f %% off what the map predicts, far more than other views': "
            "check its `sun`, its exposure, and what it shows",
            name,
            100.0 * misfit,
            view=name,
        )


def _observation_number(scene: Scene) -> np.ndarray:
    """(N,) a number for each observation that identifies its reference pixel and its view."""
    row, col = scene.cells
    cell = (row * scene.region.grid_shape[1] + col).astype(np.int64)
    return cell[scene.tracks.landmark] * len(scene.views) + scene.tracks.view
