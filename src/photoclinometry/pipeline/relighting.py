"""Adjust, render under each view's Sun, match again, adjust again: until the matches stay where they are.

Each round begins with the map of the one before. Brightness is taken where its surface projects, normals and
albedos are sharpened by it (`shading`), every view is matched with the reference relit for it (`matching.relight`),
and the matches are triangulated and adjusted like the first ones.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from photoclinometry.adjust import Adjustment
from photoclinometry.evaluate.evaluate import keypoint_residual_px, landmark_photometric_error
from photoclinometry.matching.densify import DenseTracks, DensifyOptions, densify
from photoclinometry.matching.flow import FlowMatcher, FlowOptions
from photoclinometry.matching.hole_filling import fill_holes
from photoclinometry.matching.interface import MARGIN_PX, padded_region, request_match
from photoclinometry.matching.relight import RelightMatcher, map_depth
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.scene import Image, Scene, Tracks
from photoclinometry.photometry.predict import brightness_residuals
from photoclinometry.photometry.shading import brightness_on_surface, normals_from_shading
from photoclinometry.pipeline.direct_refinement import adjust_directly
from photoclinometry.pipeline.products import Kept, Progress, has_scene, kept_or_made
from photoclinometry.pipeline.run_folder import RunFolder, digest

log = logging.getLogger(__name__)

ODD_SHARE, ODD_TIMES = 0.03, 3.0
"""A view is odd whose brightness is off by more than this share, and by so many times what is usual."""

FEWEST = 2
"""Rounds that are made in any case, where so many are allowed: one in which brightness moves the map, one that settles
it."""


@dataclass(frozen=True, kw_only=True)
class RelightOptions:
    """Rounds of matching against the reference as it would look under each view's Sun."""

    rounds: int = 3
    """Rounds at most, after the first map. Geometry alone has none."""
    settled_px: float = 0.03
    """No further round once half of all matches moved by less [px]; from the second on, as the first is loose."""
    slack: float = 5.0
    """Keypoints that were found with a map are held this many times looser in the next one, but for the last. Where it
    is finer than the windows of matching, a match confirms the very map that it was made with: held tightly, that
    map hardly moves."""
    direct: bool = True
    """The last estimate takes each image where the map projects, and its slope there, instead of the matches."""


def adjust_in_rounds(
    folder: RunFolder,
    key: str,
    scene: Scene,
    images: Sequence[Image],
    adjusted: Callable[..., Adjustment],
    rounds: RelightOptions,
    flow: FlowOptions,
    dense: DensifyOptions,
    progress: Progress,
) -> tuple[Adjustment, list[dict[str, float]]]:
    """The adjusted scene after all rounds, and an entry for each (`round_entry`). A killed run goes on in its round.

    images: of the scene's views. adjusted: the joint estimate, from where to start, the slack of
    keypoints, whether it is the last one, and `direct.ImageSlopes` where there are.
    """
    count = rounds.rounds if scene.reflectance is not None else 0
    keys = [key, *(digest("relight", key, n) for n in range(1, count + 1))]
    whole = has_scene(folder)
    first = max((n for n in range(1, count + 1) if whole and folder.holds("adjust", keys[n], Kept)), default=0)

    def start() -> tuple[Adjustment, dict[str, Any]]:
        found = adjusted(scene, 1.0, count == 0)
        for name, misfit in odd_views(found.scene):
            log.warning(
                "%s: its brightness is %.0f %% off what the map predicts, far more than other views': "
                "check its `sun`, its exposure, and what it shows",
                name,
                100.0 * misfit,
            )
        return found, {"rounds": [round_entry(0, found.scene)], "last": count == 0}

    adjustment, more = kept_or_made(folder, keys[first], start)
    if first == count and not more["last"]:
        # It was made as one of more rounds, without what only the last one finds.
        folder.forget("adjust")
        first = 0
        adjustment, more = kept_or_made(folder, keys[first], start)
    for number in range(first + 1, count + 1):
        if is_settled(more["rounds"], rounds):
            break
        with folder.timed(f"relight {number}"):
            matched = rematch(adjustment.scene, images, flow, dense, progress, f"relight {number}")

        def again(matched=matched, before=adjustment.scene, entries=more["rounds"], number=number):
            moved = keypoints_moved(before, matched)
            last = number == count or _settles(number, moved, rounds)
            if last and rounds.direct:
                found = adjust_directly(matched, images, adjusted)
            else:
                found = adjusted(matched, 1.0 if last else rounds.slack, last)
            return found, {"rounds": [*entries, round_entry(number, found.scene, before, moved)], "last": last}

        adjustment, more = kept_or_made(folder, keys[number], again)
    return adjustment, more["rounds"]


def rematch(
    scene: Scene,
    images: Sequence[Image],
    flow: FlowOptions,
    dense: DensifyOptions,
    progress: Progress = lambda what, done, total: None,
    name: str = "relight",
) -> Scene:
    """The scene with landmarks and tracks from new matches against the relit reference, ready to be adjusted.

    images: of the scene's views. Progress is reported under `name`. Raises ReconstructionError where nothing matches.
    """
    sharp = fill_holes(normals_from_shading(brightness_on_surface(scene, images)))
    matcher = RelightMatcher(sharp, FlowMatcher(flow))
    cameras, poses, own = list(scene.views.cameras), scene.views.body_from_cam, scene.reference
    padded = padded_region(scene.region, MARGIN_PX, cameras[own])
    depth = map_depth(sharp, padded)
    targets = [k for k in range(len(scene.views)) if k != own]
    matches = {}
    for done, target in enumerate(targets):
        progress(name, done, len(targets))
        matches[target] = matcher.match(
            request_match(list(images), cameras, poses, own, target, scene.region, padded, depth)
        )
    progress(name, len(targets), len(targets))
    found = densify(scene.region, own, matches, cameras, poses, dense)
    return brightness_on_surface(with_dense(sharp, found), images)


def with_dense(scene: Scene, dense: DenseTracks) -> Scene:
    """The scene with the positions and tracks of `dense`, whose pixels must all have had a landmark."""
    index = scene.grid(np.arange(len(scene.landmarks), dtype=float), fill=-1.0).astype(int)
    count = len(dense.view)
    return replace(
        scene,
        landmarks=replace(scene.landmarks[index[scene.region.cells(dense.pixel)]], position=dense.position),
        tracks=Tracks(
            start=dense.start,
            view=dense.view,
            keypoint=dense.keypoint,
            keypoint_sigma=dense.keypoint_sigma,
            brightness=np.zeros(count),
            lit=np.zeros(count, bool),
        ),
    )


def round_entry(
    number: int, scene: Scene, before: Scene | None = None, moved_px: float = float("nan")
) -> dict[str, float]:
    """What a round brought: how well the map explains its measurements, and how far it moved from `before`.

    moved_px: `keypoints_moved` of the two, which decided whether this is the last round.
    """
    residual = keypoint_residual_px(scene)
    entry = {
        "round": number,
        "landmarks": len(scene.landmarks),
        "observations": len(scene.tracks),
        "keypoint_residual_median_px": float(np.median(residual)),
    }
    if scene.reflectance is not None:
        error = landmark_photometric_error(scene, remove_scale_and_bias=True)
        entry["photometric_error_mean_percent"] = 100.0 * float(np.nanmean(error))
    if before is not None:
        entry["keypoints_moved_median_px"] = moved_px
        entry["normals_turned_median_deg"] = math.degrees(normals_turned(before, scene))
    log.info("round %d: %s", number, entry)
    return entry


def keypoints_moved(before: Scene, after: Scene) -> float:
    """Median movement [px] of the keypoints that both scenes have, but for the reference view's."""
    old, new = _observation_number(before), _observation_number(after)
    _, i, j = np.intersect1d(old, new, assume_unique=True, return_indices=True)
    other = before.tracks.view[i] != before.reference
    return float(np.median(np.linalg.norm(after.tracks.keypoint[j[other]] - before.tracks.keypoint[i[other]], axis=-1)))


def normals_turned(before: Scene, after: Scene) -> float:
    """Median turn [rad] of the normals that both scenes have."""
    return float(np.nanmedian(angle_between(before.grid(before.landmarks.normal), after.grid(after.landmarks.normal))))


def odd_views(scene: Scene) -> list[tuple[str, float]]:
    """Names of views that the map explains much worse than the others, and how far off their brightness is.

    That is the median size of lit residuals over the median brightness; odd is more than ODD_SHARE, and ODD_TIMES as
    much as the median view. A Sun wrong by tens of degrees shows so.
    """
    if scene.reflectance is None:
        return []
    tracks = scene.tracks
    residual, misfit = np.abs(brightness_residuals(scene)), np.zeros(len(scene.views))
    for k in range(len(misfit)):
        lit = tracks.lit & (tracks.view == k)
        if lit.any():
            misfit[k] = np.median(residual[lit]) / np.median(tracks.brightness[lit])
    odd = misfit > max(ODD_SHARE, ODD_TIMES * float(np.median(misfit)))
    return [(scene.views.name[k], float(misfit[k])) for k in np.flatnonzero(odd)]


def is_settled(entries: Sequence[dict[str, float]], options: RelightOptions) -> bool:
    """Whether the last of these rounds was the last that is needed."""
    last = entries[-1]
    return _settles(last["round"], last.get("keypoints_moved_median_px", np.inf), options)


def _settles(number: float, moved_px: float, options: RelightOptions) -> bool:
    return number >= FEWEST and moved_px < options.settled_px


def _observation_number(scene: Scene) -> np.ndarray:
    """(N,) a number for each observation that tells its reference pixel and its view."""
    row, col = scene.cells
    cell = (row * scene.region.grid_shape[1] + col).astype(np.int64)
    return cell[scene.tracks.landmark] * len(scene.views) + scene.tracks.view
