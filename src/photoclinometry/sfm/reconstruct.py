"""Images and intrinsics -> poses and sparse points.

SIFT keypoints are matched between images that look alike, verified by two-view geometry and mapped with the intrinsics
held fixed. Where light differs too much for that, keypoints of the relief are added, and matching is guided by the
affine map that most matches of two views share.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.image import Image
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.sparse import SparseModel, connected_groups, normalised
from photoclinometry.model.warning import warn
from photoclinometry.photometry.relief_shading import ReliefShading, relief_shading
from photoclinometry.sfm.completion import complete_model
from photoclinometry.sfm.database import (
    add_relief_keypoints,
    disk_errors,
    numbers_of_matches,
    read_keypoints,
    read_matches,
    write_views,
)
from photoclinometry.sfm.joining import joined_models
from photoclinometry.sfm.mapping import from_colmap, map_views, quiet_pycolmap
from photoclinometry.sfm.matching import match_guided, match_views
from photoclinometry.sfm.options import SfmOptions
from photoclinometry.sfm.pairs import all_pairs, pair_similarities, pairs_between, select_pairs

log = logging.getLogger(__name__)


MIN_VIEWS = 3
"""Fewest views: no further view checks the points of two."""

THIN_SHARE = 0.5
"""If a smaller share of the pairs matches, light differs much, and keypoints of the relief are tried."""


WELL_BEGUN = 0.5
"""Least share of the views in a model that is completed by guided matches: a model of three views of nine, with 25
points, was the reverse of the ground."""

NAMED = 5
"""Number of views of another place that the message about one of them names."""


class _Given(NamedTuple):
    """The inputs of the reconstruction."""

    images: list[Image]
    cameras: list[Camera]
    sun_in_cam: np.ndarray | None
    """(K, 3) unit vectors towards the Sun in C, where they are known."""
    work_dir: Path
    options: SfmOptions
    progress: Progress

    def shading_of(self, model: SparseModel) -> ReliefShading:
        assert self.sun_in_cam is not None
        return relief_shading(model, self.images, self.cameras, self.sun_in_cam)


class _Doubts(NamedTuple):
    """Whether a model may be the reverse of the ground."""

    undecided: tuple[float, float] | None
    """As of `Oriented`."""
    overruled: tuple[float, float] | None
    """As of `Oriented`."""


class _Attempt(NamedTuple):
    """The outcome of matching and mapping with one kind of keypoints, or with both."""

    pairs: list[tuple[int, int]]
    """Pairs of views that were matched."""
    inliers: np.ndarray
    """(K, K) numbers of verified matches between views."""
    models: list[SparseModel]
    """Of all K views, in a frame of its own each, one for each set of views that matches connect; the largest first."""
    doubts: list[_Doubts]
    """Doubts of each model, or of the largest part of a joined one: the other parts must agree with it to be joined."""

    @property
    def largest_doubts(self) -> _Doubts:
        """Of the largest model; none where there is no model."""
        return self.doubts[0] if self.doubts else _Doubts(None, None)

    @property
    def is_sound(self) -> bool:
        """Whether keypoints and shading agree that the largest model is no reverse."""
        return self.largest_doubts == _Doubts(None, None)

    @property
    def registered(self) -> set[int]:
        """Views of the largest model."""
        return set(np.flatnonzero(self.models[0].registered).tolist()) if self.models else set()


def reconstruct_sparse(
    images: list[Image],
    cameras: list[Camera],
    work_dir: Path,
    options: SfmOptions | None = None,
    progress: Progress = no_progress,
    sun_in_cam: np.ndarray | None = None,
) -> SparseModel:
    """Poses and sparse points of the views, from their images alone; intrinsics are known and held fixed.

    images, cameras: one per view. work_dir receives 8-bit copies and COLMAP's database (overwritten).
    sun_in_cam: (K, 3) unit vectors towards the Sun in C. With them, if views do not register or fewer than half of the
    pairs match, all are matched again with keypoints of the relief (`relief_picture`) as well. If views still do not
    register, pairs that are in no common model are matched by guidance (`guided_matches`). Views that do not register
    are logged by name and False in `registered`, with the `reason`. `brought_in` describes the matches of views that
    registered only with the relief.
    Raises InputError for fewer than MIN_VIEWS images, ReconstructionError where fewer views register,
    OutputError where work_dir cannot be written.
    """
    options = options or SfmOptions()
    if len(images) < MIN_VIEWS:
        raise InputError(f"{len(images)} images given; a reconstruction needs at least {MIN_VIEWS} views")
    work_dir = Path(work_dir)
    names = [image.name for image in images]
    with disk_errors(work_dir), quiet_pycolmap(options.seed):
        work_dir.mkdir(parents=True, exist_ok=True)
        given = _Given(images, cameras, sun_in_cam, work_dir, options, progress)
        plain = _by_brightness(given)
        found = plain
        if sun_in_cam is not None and options.relief_keypoints and _matches_little(plain, options):
            found = _by_relief_too(given, sun_in_cam, plain)
            if len(found.registered) < len(images):
                found = _guided_too(given, found)
    if len(found.registered) < MIN_VIEWS:
        raise ReconstructionError(_explain_failure(names, found, options))
    sparse = found.models[0]
    log.info(
        "%d of %d views registered, %d points, %.3f px mean reprojection error",
        sparse.registered.sum(), len(names), len(sparse.points), sparse.mean_reprojection_px,
    )  # fmt: skip
    places = [np.flatnonzero(model.registered).tolist() for model in found.models]
    reason = _reasons(names, sparse.registered, places, found.inliers, options)
    for view in np.flatnonzero(~sparse.registered):
        warn(log, "view-unregistered", "%s is left out: %s", names[view], reason[view], view=names[view])
    _warn_if_undecided(found.largest_doubts.undecided)
    _warn_if_overruled(found.largest_doubts.overruled)
    if sun_in_cam is not None:
        warn_if_inside_out(given.shading_of(sparse))
    brought_in = _brought_in(plain, found, options)
    for view in np.flatnonzero(brought_in != ""):
        log.info("%s registers by %s", names[view], brought_in[view])
    return replace(sparse, reason=reason, brought_in=brought_in)


def _by_brightness(given: _Given) -> _Attempt:
    write_views(given.images, given.cameras, given.work_dir, given.options, given.progress)
    return _matched_and_mapped(given, "matches")


def _matched_and_mapped(given: _Given, stage: str) -> _Attempt:
    """Each view is matched with the most similar ones, and all are mapped.

    If several models result, or views are in none, more pairs are matched: views without a model with all others, and
    each view of a model with the most similar ones of the other models. All are mapped once more, and models of the
    same ground are joined. stage: name for progress reports.
    """
    count, options = len(given.cameras), given.options
    pairs, similarity = all_pairs(count), None
    if count - 1 > options.partners:
        similarity = pair_similarities(read_keypoints(given.cameras, given.work_dir), options.max_ratio)
        pairs = select_pairs(similarity, options.partners)
    found = _mapped(given, pairs, pairs, stage)
    if similarity is not None:
        places = [np.flatnonzero(model.registered) for model in found.models]
        more = sorted({*pairs_between(places, similarity, options.partners)} - {*pairs})
        if more:
            log.info("%d models; %d more pairs of views are matched", len(places), len(more))
            found = _mapped(given, pairs + more, more, stage)
    return _with_joined(found, given)


def _with_joined(found: _Attempt, given: _Given) -> _Attempt:
    """The attempt with models of the same ground joined."""
    models = _joined(found.models, given)
    return found._replace(models=models, doubts=[found.doubts[_largest_part(model, found.models)] for model in models])


def _largest_part(model: SparseModel, before: list[SparseModel]) -> int:
    """The index of the model `before` with most views in common with a model that was joined from some of them."""
    return int(np.argmax([np.count_nonzero(model.registered & each.registered) for each in before]))


def _joined(models: list[SparseModel], given: _Given) -> list[SparseModel]:
    """The models, joined where they show the same ground, the largest first. The largest is completed where this brings
    in views."""
    if not models or models[0].registered.all():
        return models
    matches = read_matches(given.cameras, given.work_dir)
    first, *others = joined_models(models, matches, given.cameras, given.options.seed)
    whole = complete_model(first, matches, given.cameras, given.work_dir, given.options)
    was_joined = len(others) + 1 < len(models)
    if was_joined or whole.registered.sum() > first.registered.sum():
        first = normalised(whole, given.cameras)
    return [first, *others]


def _mapped(given: _Given, pairs: list[tuple[int, int]], new: list[tuple[int, int]], stage: str) -> _Attempt:
    """All views mapped after matching. new: those of the pairs that are not matched yet."""
    inliers = match_views(len(given.cameras), new, given.work_dir, given.options, stage, given.progress)
    return _mapped_by(given, pairs, inliers, stage)


def _mapped_by(
    given: _Given, pairs: list[tuple[int, int]], inliers: np.ndarray, stage: str, *, all_trials: bool = False
) -> _Attempt:
    """All views mapped by the verified matches in the database, of which inliers (K, K) are the numbers.

    all_trials: as of `map_views`.
    """
    cameras, work_dir, options, progress = given.cameras, given.work_dir, given.options, given.progress
    log.info("%d of %d pairs match (%s)", np.count_nonzero(inliers) // 2, len(pairs), stage)
    shading_of = None if given.sun_in_cam is None else given.shading_of
    found = map_views(cameras, work_dir, options, progress, shading_of, all_trials=all_trials)
    models = [normalised(from_colmap(each.model, cameras), cameras) for each in found]
    return _Attempt(pairs, inliers, models, [_Doubts(each.undecided, each.overruled) for each in found])


def _matching(inliers: np.ndarray, options: SfmOptions) -> np.ndarray:
    """(K, K) bool: pairs of views with enough verified matches."""
    return inliers >= options.min_pair_matches


def _matches_little(found: _Attempt, options: SfmOptions) -> bool:
    """Views did not register, or fewer than THIN_SHARE of the pairs match."""
    matching = np.count_nonzero(_matching(found.inliers, options)) // 2
    return bool(len(found.registered) < len(found.inliers) or matching < THIN_SHARE * len(found.pairs))


def _by_relief_too(given: _Given, sun_in_cam: np.ndarray, plain: _Attempt) -> _Attempt:
    """All views matched again by both kinds of keypoints; of the two models the one with more views is kept.

    All views are matched, not only those that did not register: a view is located by points that others have in common
    with it, and others that are matched by brightness alone lack the points found in the relief.
    """
    add_relief_keypoints(given.images, given.cameras, sun_in_cam, given.work_dir, given.options)
    found = _matched_and_mapped(given, "relief matches")
    return found if len(found.registered) >= len(plain.registered) else plain


def _guided_too(given: _Given, before: _Attempt) -> _Attempt:
    """Guided matching of pairs of views that are in no common model; kept if it brings in views.

    Where there are many views, each is paired with the `partners` others that have most matches with it, most of them
    wrong. All are mapped anew, by all trials: few points are then seen by many views, and the mapper gave several views
    of a site the reversed pose with five seeds of six. In addition, models of at least half of the views are joined and
    completed by these matches, which keeps poses that were right; with equally many views these are preferred.
    """
    together = np.zeros(before.inliers.shape, bool)
    for model in before.models:
        together |= np.outer(model.registered, model.registered)
    options, work_dir = given.options, given.work_dir
    similarity = np.where(together, -1, numbers_of_matches(len(together), work_dir))
    pairs = [pair for pair in select_pairs(similarity, options.partners) if not together[pair]]
    inliers = match_guided(given.cameras, pairs, work_dir, options, "guided matches", given.progress)
    if not (_matching(inliers, options) & ~_matching(before.inliers, options)).any():
        return before
    mapped = _mapped_by(given, before.pairs, inliers, "guided matches", all_trials=True)
    attempts = [before, _with_joined(mapped, given)]
    if before.is_sound and len(before.registered) >= WELL_BEGUN * len(inliers):
        attempts.insert(1, _with_joined(before._replace(inliers=inliers), given))
    return max(attempts, key=lambda attempt: len(attempt.registered))


def _warn_if_undecided(errors_px: tuple[float, float] | None) -> None:
    if errors_px is not None:
        warn(
            log, "reversal-undecided",
            "rays are so nearly parallel that the relief may be reversed, hills for hollows: keypoints are "
            "explained to %.3f px, and to %.3f px the other way round, and shading does not decide. Add images "
            "from other directions or under other light, or pose priors",
            *errors_px,
        )  # fmt: skip


def _warn_if_overruled(errors_px: tuple[float, float] | None) -> None:
    if errors_px is not None:
        warn(
            log, "relief-by-shading",
            "rays are nearly parallel, and the images' brightness shows hills where keypoints show hollows: the relief "
            "is taken from brightness, which explains keypoints to %.3f px, and to %.3f px the other way round. "
            "Check whether `sun` points the opposite way across the images, or add images from other directions, or "
            "pose priors",
            *errors_px,
        )  # fmt: skip


def warn_if_inside_out(shading: ReliefShading) -> None:
    """Warns where images show the reverse of a sparse model."""
    if shading.shows == "reverse":
        warn(
            log, "relief-inverted",
            "the images' brightness contradicts the slopes of the sparse model (correlation %.2f), and agrees with "
            "these inverted, hills for hollows (%.2f): either the Sun directions are wrong, or the poses. Check "
            "`sun`, or add images from other directions, or pose priors",
            shading.correlation, shading.reverse,
        )  # fmt: skip


def _brought_in(plain: _Attempt, found: _Attempt, options: SfmOptions) -> np.ndarray:
    """(K,) str: the matches of views that register only with the relief; empty for the others."""
    how = np.full(len(plain.inliers), "", object)
    gained = _matching(found.inliers, options) & ~_matching(plain.inliers, options)
    for view in found.registered - plain.registered:
        number = gained[view].sum()
        with_others = f"which match it with {number} more views" if number else "few in each of many views"
        how[view] = f"keypoints of the relief, {with_others}"
    return how.astype(str)


def _explain_failure(names: list[str], found: _Attempt, options: SfmOptions) -> str:
    matching = np.count_nonzero(_matching(found.inliers, options)) // 2
    other = "global" if options.mapper == "incremental" else "incremental"
    message = (
        f"{len(found.registered)} of {len(names)} views registered, at least {MIN_VIEWS} are needed "
        f"({matching} of {len(found.pairs)} pairs of images matched, {int(found.inliers.max())} matches in the best)."
    )
    groups = [group for group in connected_groups(found.inliers, options.min_pair_matches) if len(group) > 1]
    if len(groups) > 1:
        message += " The views fall into groups that share no matches: " + _listing(names, groups) + "."
    return message + (
        " Use images that overlap more and whose light differs less (Sun within about 30 degrees), views 3 "
        f"to 30 degrees apart, more features (--sfm.max-features {2 * options.max_features}; now "
        f"{options.max_features}), or the {other} mapper (--sfm.mapper {other})."
    )


def _listing(names: list[str], groups: list[list[int]]) -> str:
    return "; ".join("[" + ", ".join(names[view] for view in group) + "]" for group in groups)


def _shortened(names: list[str]) -> str:
    """The first NAMED of them, and the number of further ones."""
    more = len(names) - NAMED
    return ", ".join(names[:NAMED]) + (f" and {more} more" if more > 0 else "")


def _reasons(
    names: list[str], registered: np.ndarray, places: list[list[int]], inliers: np.ndarray, options: SfmOptions
) -> np.ndarray:
    """(K,) str: why views are not registered. places: the views of each model that was found."""
    reason = np.full(len(names), "", object)
    for view in np.flatnonzero(~registered):
        partners = np.count_nonzero(inliers[view][registered] >= options.min_pair_matches)
        text = f"not registered, it matched {partners} of the {registered.sum()} registered views"
        place = next((p for p in places if view in p and not registered[p].any()), None)
        if place is not None:
            others = _shortened([names[k] for k in place if k != view])
            text += f"; it shows another place, with {others}: the place of more views is mapped, make the other a site"
        reason[view] = text
    return reason.astype(str)
