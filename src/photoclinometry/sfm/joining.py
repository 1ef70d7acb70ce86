"""Joining of models of the same body that the mapper left apart.

The mapper adds a view to a model where it sees enough of the model's points. Keypoints that match between two models
are seldom such points. Here each keypoint has a depth, interpolated between its model's points in the same image. Three
matches between two images then give the similarity between their models, and the matches of all other pairs of images
show whether it is right.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, count
from typing import Any

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.geometry import Rigid, Similarity, similarities_of, so3_exp, so3_log
from photoclinometry.model.projection import pixel_from_cam
from photoclinometry.model.sparse import SparseModel, transformed, without_views
from photoclinometry.sfm.database import DescriptorMatches

log = logging.getLogger(__name__)

AGREE_PX = 4.0
"""Largest distance of each keypoint from the projection of the other's ground at which matches agree with a similarity
[px]: depths between sparse points are off by a few pixels, and lines of sight differ by up to half a radian."""
FEWEST_AGREEING = 8
"""Fewest matches that agree. Three always agree, and among a hundred wrong ones a fourth or fifth by chance; among
more, as many agree as with other similarities."""
CLEARLY_BETTER = 2.0
"""Least ratio of the matches that agree with an accepted similarity to those that agree with the second best one."""
TURN_SIGMA_RAD = np.radians(2.0)
"""Standard deviation of the rotation between two models up to which they are joined. Eight matches on a small patch of
a body of 256 px gave it to 3 degrees, and left it off by 10: a bent model. Right ones had 0.2 to 1."""
APART_RAD = np.radians(10.0)
"""Similarities whose rotations differ by less count as the same one."""
TRIALS = 2000
"""Triples of matches that are tried for two models. Where a tenth of the matches belong to correctly matched pairs of
images, and half of these are right, 25 right triples are among them."""
REFINED = 30
"""Number of the best triples that are fitted to all matches that agree with them: three matches from a small part of an
image give the rotation to tens of degrees only."""
FEWEST_OF_VIEW = 15
"""Fewest points of a view between which depths are interpolated: on simulated bodies poses of views with fewer were off
by 1 to 15 degrees."""
BEHIND_PX = 1e3
"""Distance that is assumed between a keypoint and a point behind its camera [px]."""
AT_A_TIME = 64
"""Similarities that are compared with all matches at a time: of thousands of matches they take some megabytes."""
DIFFERENCE = 1e-7
"""Steps of forward differences [rad, and shares of the scale and of the matches' extent]: half of the digits."""
SCALES = 0.05, 20.0
"""Bounds of the scale between two models in the gauge of `normalised`, whose units are ground sample distances."""


@dataclass(frozen=True, kw_only=True)
class LocatedKeypoints:
    """A model, and the keypoints of its views in three dimensions."""

    model: SparseModel
    points: dict[int, np.ndarray]
    """By registered view, (n, 3) in B of the model; NaN where the depth is not known."""


@dataclass(frozen=True, kw_only=True)
class Join:
    """The similarity from one model to another, by the matches between them."""

    first_from_second: Similarity
    agreeing: int
    """Matches that agree."""
    runner_up: int
    """Matches that agree with the second best similarity."""
    turn_sigma_rad: float
    """Standard deviation of the rotation about the axis that the matches determine least."""

    @property
    def is_certain(self) -> bool:
        """Whether more matches agree than would by chance, and determine the rotation of the second model."""
        are_enough = self.agreeing >= max(FEWEST_AGREEING, CLEARLY_BETTER * self.runner_up)
        return are_enough and self.turn_sigma_rad <= TURN_SIGMA_RAD


def joined_models(
    models: Sequence[SparseModel], matches: DescriptorMatches, cameras: Sequence[Camera], seed: int
) -> list[SparseModel]:
    """Models of the same K views, joined where matches show that two are one; the largest first.

    A joined model has the poses and the points of both. A view in both has the pose and the observations of the model
    with more of its points.
    """
    rng = np.random.default_rng(seed)
    numbers = count()
    parts = {next(numbers): locate_keypoints(model, matches, cameras) for model in models}
    tried: dict[tuple[int, int], Join | None] = {}
    while True:
        pairs = list(combinations(sorted(parts), 2))
        tried |= {
            (a, b): ransac_similarity(parts[a], parts[b], matches, cameras, rng)
            for a, b in pairs
            if (a, b) not in tried
        }
        certain = {pair: join for pair in pairs if (join := tried[pair]) is not None and join.is_certain}
        if not certain:
            found = [part.model for part in parts.values()]
            return sorted(found, key=lambda model: (model.registered.sum(), len(model.points)), reverse=True)
        (a, b), best = max(certain.items(), key=lambda item: item[1].agreeing)
        first, second = parts.pop(a).model, parts.pop(b).model
        log.info(
            "models of %d and %d views are one: %d matches agree, %d with the second best similarity; they give the "
            "rotation to %.2g degrees",
            first.registered.sum(), second.registered.sum(), best.agreeing, best.runner_up,
            np.degrees(best.turn_sigma_rad),
        )  # fmt: skip
        both = merged_model(first, transformed(second, best.first_from_second))
        parts[next(numbers)] = locate_keypoints(both, matches, cameras)


def merged_model(first: SparseModel, second: SparseModel) -> SparseModel:
    """Two models of the same K views in one frame as one, as of `joined_models`."""
    views = len(first.registered)
    number = [np.bincount(each.point_view, minlength=views) for each in (first, second)]
    by_first = first.registered & (~second.registered | (number[0] >= number[1]))
    one, other = without_views(first, ~by_first), without_views(second, by_first)
    rotation = np.where(by_first[:, None, None], first.body_from_cam.rotation, second.body_from_cam.rotation)
    center = np.where(by_first[:, None], first.body_from_cam.translation, second.body_from_cam.translation)
    observations = [len(each.point_view) for each in (one, other)]
    return replace(
        first,
        registered=first.registered | second.registered,
        body_from_cam=Rigid(rotation, center),
        points=np.concatenate([one.points, other.points]),
        point_start=row_starts(np.concatenate([np.diff(one.point_start), np.diff(other.point_start)])),
        point_view=np.concatenate([one.point_view, other.point_view]),
        point_xy=np.concatenate([one.point_xy, other.point_xy]),
        mean_reprojection_px=float(
            np.average([first.mean_reprojection_px, second.mean_reprojection_px], weights=observations)
        ),
    )


def locate_keypoints(model: SparseModel, matches: DescriptorMatches, cameras: Sequence[Camera]) -> LocatedKeypoints:
    """The keypoints of a model's views, at depths between those of its points."""
    views = [int(k) for k in np.flatnonzero(model.registered)]
    return LocatedKeypoints(model=model, points={k: _lifted(model, k, matches.keypoints[k], cameras[k]) for k in views})


def _lifted(model: SparseModel, view: int, keypoints: np.ndarray, camera: Camera) -> np.ndarray:
    """(n, 3) in B: keypoints (n, 2) of a view."""
    from scipy.interpolate import LinearNDInterpolator

    index, xy = model.seen_by(view)
    if len(index) < FEWEST_OF_VIEW:
        return np.full((len(keypoints), 3), np.nan)
    pose = model.body_from_cam[view]
    depth = LinearNDInterpolator(xy, pose.inverse()(model.points[index])[:, 2])(keypoints)
    return pose(camera.ray_in_cam(keypoints) * depth[:, None])


@dataclass(frozen=True, kw_only=True)
class _Side:
    """Keypoints (n,) of one model that match keypoints of another."""

    cam_from_body: Rigid
    """(n,) of the view of each."""
    intrinsics: np.ndarray
    """(n, 4) as of `pixel_from_cam`."""
    point: np.ndarray
    """(n, 3) in B of this model."""
    xy: np.ndarray
    """(n, 2)."""

    def off_px(self, points: np.ndarray) -> np.ndarray:
        """(..., n, 2) from the keypoints to the projections of points (..., n, 3) [px]; large behind the camera."""
        local = self.cam_from_body(points)
        behind = local[..., 2:] <= 0
        off = pixel_from_cam(np.where(behind, [0.0, 0.0, 1.0], local), self.intrinsics) - self.xy
        return np.where(behind, BEHIND_PX, off)

    def __getitem__(self, rows: np.ndarray) -> _Side:
        return _Side(
            cam_from_body=self.cam_from_body[rows],
            intrinsics=self.intrinsics[rows],
            point=self.point[rows],
            xy=self.xy[rows],
        )


@dataclass(frozen=True, kw_only=True)
class _Similarities:
    """m similarities `first_from_second`, as `Similarity` is one."""

    scale: np.ndarray
    """(m,)."""
    rotation: np.ndarray
    """(m, 3, 3)."""
    translation: np.ndarray
    """(m, 3)."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(m, n, 3) of points (n, 3)."""
        turned = points @ np.swapaxes(self.rotation, -1, -2)
        return self.scale[:, None, None] * turned + self.translation[:, None]

    def inverse(self) -> _Similarities:
        back = np.swapaxes(self.rotation, -1, -2)
        moved = -np.einsum("mij,mj->mi", back, self.translation) / self.scale[:, None]
        return _Similarities(scale=1.0 / self.scale, rotation=back, translation=moved)

    def __getitem__(self, rows: np.ndarray | slice) -> _Similarities:
        return _Similarities(scale=self.scale[rows], rotation=self.rotation[rows], translation=self.translation[rows])

    def __len__(self) -> int:
        return len(self.scale)

    def one(self, row: int) -> Similarity:
        return Similarity(float(self.scale[row]), self.rotation[row], self.translation[row])


@dataclass(frozen=True, kw_only=True)
class _Between:
    """The matches between two models."""

    first: _Side
    second: _Side

    def off_px(self, similarities: _Similarities) -> np.ndarray:
        """(m, n, 4) residuals of each match under `first_from_second`, in both images [px]."""
        there, back = similarities(self.second.point), similarities.inverse()(self.first.point)
        return np.concatenate([self.first.off_px(there), self.second.off_px(back)], axis=-1)

    def agreeing(self, similarities: _Similarities) -> np.ndarray:
        """(m, n) bool."""
        found = []
        for first in range(0, len(similarities), AT_A_TIME):
            off = self.off_px(similarities[first : first + AT_A_TIME])
            found.append(np.hypot(off[..., ::2], off[..., 1::2]).max(axis=-1) <= AGREE_PX)
        return np.concatenate(found)

    def agreeing_number(self, similarity: Similarity) -> int:
        return int(self.agreeing(_only(similarity)).sum())

    def of_threes(self, rows: np.ndarray) -> _Similarities:
        """The similarities of triples of matches (m, 3) int; without those of one point, or of absurdly different
        sizes."""
        one, other = self.second.point[rows], self.first.point[rows]
        apart = np.minimum(*(np.ptp(each, axis=1).max(axis=-1) for each in (one, other))) > 0.0
        scale, rotation, translation = similarities_of(one, other)
        found = _Similarities(scale=scale, rotation=rotation, translation=translation)
        return found[np.flatnonzero(apart & (found.scale > SCALES[0]) & (found.scale < SCALES[1]))]

    def fitted(self, start: Similarity) -> tuple[Similarity, float]:
        """The similarity of robust least squares of the pixels of matches that agree with `start`, and the standard
        deviation of its rotation about the axis that these determine least [rad]."""
        from scipy.optimize import least_squares

        rows = np.flatnonzero(self.agreeing(_only(start))[0])
        chosen = _Between(first=self.first[rows], second=self.second[rows])
        middle = start(chosen.second.point.mean(axis=0))
        size = float(np.linalg.norm(chosen.first.point.std(axis=0)))

        def moved(steps: np.ndarray) -> _Similarities:
            """About the middle, by steps (m, 7)."""
            turn, stretch = so3_exp(steps[:, :3]), np.exp(steps[:, 3])
            from_middle = turn @ (start.translation - middle)
            return _Similarities(
                scale=stretch * start.scale,
                rotation=turn @ start.rotation,
                translation=middle + stretch[:, None] * from_middle + size * steps[:, 4:],
            )

        def residuals(step: np.ndarray) -> np.ndarray:
            return chosen.off_px(moved(step[None])).ravel()

        def jacobian(step: np.ndarray) -> np.ndarray:
            """By forward differences, all at a time."""
            off = chosen.off_px(moved(step + np.concatenate([np.zeros((1, 7)), DIFFERENCE * np.eye(7)]))).reshape(8, -1)
            return (off[1:] - off[0]).T / DIFFERENCE

        given: dict[str, Any] = {"jac": jacobian}  # SciPy has no types, but for that of the default, a string
        found = least_squares(residuals, np.zeros(7), **given, loss="soft_l1", f_scale=AGREE_PX / 2.0)
        # A wrong depth shows in both images, so that the four numbers of a match count as two.
        spare = max(2 * len(rows) - len(found.x), 1)
        information, axes = np.linalg.eigh(found.jac.T @ found.jac)
        known = np.maximum(information, np.finfo(float).eps * information[-1])  # what matches leave open is uncertain
        covariance = (axes[:3] / known) @ axes[:3].T * 2.0 * found.cost / spare
        return moved(found.x[None]).one(0), float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


def _only(similarity: Similarity) -> _Similarities:
    return _Similarities(
        scale=np.array([similarity.scale]),
        rotation=similarity.rotation[None],
        translation=similarity.translation[None],
    )


def ransac_similarity(
    first: LocatedKeypoints,
    second: LocatedKeypoints,
    matches: DescriptorMatches,
    cameras: Sequence[Camera],
    rng: np.random.Generator,
) -> Join | None:
    """The similarity between two models with which most matches agree; None where no three agree with one."""
    matching = _between(first, second, matches, cameras)
    if matching is None:
        return None
    between, blocks = matching
    share = np.array([len(block) for block in blocks], float)
    drawn = rng.choice(len(blocks), TRIALS, p=share / share.sum())
    tried = between.of_threes(np.array([rng.choice(blocks[block], 3, replace=False) for block in drawn]))
    if len(tried) == 0:
        return None
    number = between.agreeing(tried).sum(axis=-1)
    most = np.argsort(-number, kind="stable")[:REFINED]
    refined = [between.fitted(tried.one(row))[0] for row in most[number[most] >= 3]]
    agreeing = [between.agreeing_number(similarity) for similarity in refined]
    if max(agreeing, default=0) < 3:
        return None
    best = refined[int(np.argmax(agreeing))]
    others = [number for number, each in zip(agreeing, refined, strict=True) if _apart(each, best)]
    again, turn_sigma_rad = between.fitted(best)  # by all that agree now, which may be more than it was fitted to
    return Join(
        first_from_second=again,
        agreeing=between.agreeing_number(again),
        runner_up=max(others, default=0),
        turn_sigma_rad=turn_sigma_rad,
    )


def _apart(one: Similarity, other: Similarity) -> bool:
    return bool(np.linalg.norm(so3_log(one.rotation @ other.rotation.T)) > APART_RAD)


def _between(
    first: LocatedKeypoints, second: LocatedKeypoints, matches: DescriptorMatches, cameras: Sequence[Camera]
) -> tuple[_Between, list[np.ndarray]] | None:
    """The matches between two models whose depths are known, and the rows of each pair of views with three or more.

    Views in both models do not count: the pose that one of the two has for them may be wrong.
    """
    alone = [part.points.keys() - other.points.keys() for part, other in ((first, second), (second, first))]
    found: list[tuple[int, int, np.ndarray]] = []
    for one, other, index in matches.both_ways():
        if one in alone[0] and other in alone[1]:
            known = np.isfinite(first.points[one][index[:, 0], 0] + second.points[other][index[:, 1], 0])
            found.append((one, other, index[known]))
    found = [each for each in found if len(each[2]) >= 3]
    if not found:
        return None
    ends = np.cumsum([len(index) for *_, index in found])
    sides = [
        _side(first, cameras, matches, [(one, index[:, 0]) for one, _, index in found]),
        _side(second, cameras, matches, [(other, index[:, 1]) for _, other, index in found]),
    ]
    return _Between(first=sides[0], second=sides[1]), np.split(np.arange(ends[-1]), ends[:-1])


def _side(
    part: LocatedKeypoints,
    cameras: Sequence[Camera],
    matches: DescriptorMatches,
    chosen: Sequence[tuple[int, np.ndarray]],
) -> _Side:
    """chosen: views, each with the indices of keypoints."""
    view = np.concatenate([np.full(len(index), k) for k, index in chosen])
    return _Side(
        cam_from_body=part.model.body_from_cam.inverse()[view],
        intrinsics=np.array([camera.intrinsics for camera in cameras])[view],
        point=np.concatenate([part.points[k][index] for k, index in chosen]),
        xy=np.concatenate([matches.keypoints[k][index] for k, index in chosen]),
    )
