"""Distortion determined from the keypoints: bundle adjustment with self-calibration.

Poses, points and the four coefficients of each camera's lens (`model.lens`) are adjusted together (Brown 1971,
Photogrammetric Engineering 37, 855; Triggs et al. 2000, Sec. 6.3 for the elimination of the points). Focal length and
principal point are held: in narrow fields the images do not separate them from the distance and the attitude, and an
error of them does no harm (decision 0063).

Errors of keypoints are correlated between neighbours on the ground, which have similar shading. The covariance is
therefore the one that is robust to clusters: the scores of patches of ground take the place of a noise model (Liang and
Zeger 1986, Biometrika 73, 13).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.gauss_newton import MOST_ITERATIONS
from photoclinometry.model.geometry import skew, so3_exp
from photoclinometry.model.lens import Lens, displacement_terms
from photoclinometry.model.projection import project
from photoclinometry.model.robust import HUBER_LIMIT, SIGMA_PER_MEDIAN, SIGNIFICANT, huber_weight
from photoclinometry.model.sparse import SparseModel

RADIAL_SIGMA = 0.02
"""Prior standard deviation of the displacement of a corner by each of k1 and k2, as a share of half the diagonal:
uncalibrated lenses of long focal length are off by up to 1 or 2 per cent."""
DECENTRING_SIGMA_PX = 0.1
"""The same for p1 and p2 [px]: the centring of lenses is far better than their curvature. Ten views determine them to
0.01 px; where few and nearly parallel views confuse them with a tilt of the ground, this prior separates the two."""
COEFFICIENTS = 4

PATCHES = 8
"""Number of patches along each side of the ground for the covariance: enough for four coefficients, and each wider than
the neighbourhood of correlated errors."""

FEWEST_REDUNDANT = 200
"""Fewest redundant measurements: the covariance of four coefficients by 64 patches needs several in each."""
MOST_KEYPOINTS = 20_000
"""Models with more keypoints are thinned to every n-th point: 10,000 keypoints of ten views determine a distortion to
0.1 px."""

LEAST_NOISE_PX = 1e-3
"""Least standard deviation of keypoints [px]: none are found better."""

NOTICEABLE_PX = 0.5
"""Displacement of a keypoint from which on images count as distorted [px]. Below it maps are as good as without
distortion: 2 px at the corner reduce the relief by 3 per cent (decision 0046)."""
_SETTLED = 0.01
"""The adjustment ends when a step lowers the cost, a sum of squares in units of the noise, by less than this."""
_GAUGE = 1e-9
"""Share of each pose's information that is added to it, since nothing else determines place, attitude and scale of the
whole; it does not change covariances of the lens."""
_MOST_DAMPING = 1e6
_FIRST_DAMPING = 1e-3


@dataclass(frozen=True, kw_only=True)
class LensEstimate:
    """The distortion that keypoints show in the images of one camera."""

    camera: Camera
    corner_px: np.ndarray
    """(4,) displacements of a corner by k1, k2, p1 and p2, as of `Lens.corner_px`."""
    covariance: np.ndarray
    """(4, 4) of `corner_px` [px^2]."""
    shift_px: float
    """Largest displacement of a keypoint."""
    shift_sigma_px: float
    """Its standard deviation, along its direction."""

    @property
    def lens(self) -> Lens:
        return Lens.of_corner_px(self.corner_px, self.camera)

    @property
    def is_clear(self) -> bool:
        """Whether the displacement is worth a correction and exceeds the effect of errors of keypoints, which amounts
        to 4.4 sigmas where light changes most (decision 0063)."""
        return self.shift_px > max(NOTICEABLE_PX, SIGNIFICANT * self.shift_sigma_px)


class _State(NamedTuple):
    rotation: np.ndarray
    """(K, 3, 3) body_from_cam."""
    center: np.ndarray
    """(K, 3)."""
    points: np.ndarray
    """(P, 3)."""
    lens: np.ndarray
    """(C, 4) `corner_px` of each camera."""


class _Residuals(NamedTuple):
    error: np.ndarray
    """(M, 2) predicted minus observed pixels."""
    by_position: np.ndarray
    """(M, 2, 3) derivatives by the point's position. Those of the distortion, below some per cent, are left out."""
    terms: np.ndarray
    """(M, 2, 4) derivatives by the camera's coefficients."""

    @property
    def size(self) -> np.ndarray:
        """(M,) [px]."""
        return np.linalg.norm(self.error, axis=-1)


class _Reduced(NamedTuple):
    """Normal equations with the points eliminated, whose inverse information is L^T L."""

    information: np.ndarray
    """(n, n)."""
    gradient: np.ndarray
    """(n,)."""
    root: Any
    """(3 P, 3 P) sparse, L."""
    mixed: Any
    """(3 P, n) sparse, L times the points' rows."""
    of_points: np.ndarray
    """(3 P,) L times the points' gradient."""


@dataclass(frozen=True, kw_only=True)
class _Normal:
    """Normal equations, the points' blocks by themselves. The other unknowns are n = 6 K + 4 C."""

    rows: Any
    """(2 M, n) sparse, weighted derivatives by poses and lenses."""
    residual: np.ndarray
    """(2 M,) weighted."""
    point: np.ndarray
    """(M,) the point of each observation."""
    information: np.ndarray
    """(n, n), priors included."""
    gradient: np.ndarray
    """(n,), priors included."""
    of_points: np.ndarray
    """(P, 3, 3) information."""
    mixed: Any
    """(3 P, n) sparse."""
    points_gradient: np.ndarray
    """(3 P,)."""
    damped: np.ndarray
    """(n,) addition to the diagonal of the information by a damping of 1."""

    def reduced(self, damping: float) -> _Reduced:
        """With the points eliminated."""
        from scipy.sparse import bsr_matrix

        diagonal = np.einsum("pii->pi", self.of_points)
        blocks = self.of_points + np.eye(3) * ((damping + _GAUGE) * diagonal)[:, None]
        lower = np.linalg.inv(np.linalg.cholesky(blocks))
        count = len(blocks)
        root = bsr_matrix((lower, np.arange(count), np.arange(count + 1)), (3 * count, 3 * count)).tocsr()
        mixed, of_points = root @ self.mixed, root @ self.points_gradient
        information = self.information - (mixed.T @ mixed).toarray()
        information[np.diag_indices_from(information)] += (damping + _GAUGE) * self.damped
        return _Reduced(information, self.gradient - mixed.T @ of_points, root, mixed, of_points)

    def step(self, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """(n,) of poses and lenses, and (P, 3) of the points."""
        reduced = self.reduced(damping)
        step = -np.linalg.solve(reduced.information, reduced.gradient)
        return step, -(reduced.root.T @ (reduced.of_points + reduced.mixed @ step)).reshape(-1, 3)

    def scores(self, reduced: _Reduced) -> np.ndarray:
        """(P, n) contribution of each point to the gradient, once it is eliminated."""
        from scipy.sparse import csr_matrix

        count = len(self.of_points)
        own = csr_matrix((self.residual, (np.repeat(self.point, 2), np.arange(len(self.residual)))))
        through = csr_matrix((reduced.of_points, (np.arange(3 * count) // 3, np.arange(3 * count))))
        return (own @ self.rows - through @ reduced.mixed).toarray()


def estimate_lenses(sparse: SparseModel, cameras: list[Camera], camera_of_view: np.ndarray) -> list[LensEstimate]:
    """The distortion that the keypoints of a model show, beyond that of its cameras; empty where they are too few.

    cameras: (C,) of the views; camera_of_view: (K,) int, index of each view's camera. Projections of points are assumed
    to lie within a few sigmas of the observations, as those of `reconstruct_sparse` do.
    """
    thinned = _with_fewer_points(sparse)
    if _redundancy(thinned) < FEWEST_REDUNDANT:
        return []
    return _Adjustment(thinned, cameras, camera_of_view).estimates()


def _redundancy(sparse: SparseModel) -> int:
    """Coordinates of keypoints less unknowns of points and poses."""
    return 2 * len(sparse.point_view) - 3 * len(sparse.points) - 6 * len(np.unique(sparse.point_view))


def _with_fewer_points(sparse: SparseModel) -> SparseModel:
    """The model with every n-th point alone, so that about MOST_KEYPOINTS remain."""
    every = -(-len(sparse.point_view) // MOST_KEYPOINTS)
    if every <= 1:
        return sparse
    kept = np.zeros(len(sparse.points), bool)
    kept[::every] = True
    own = kept[sparse.point_of_observation]
    return replace(
        sparse,
        points=sparse.points[kept],
        point_start=row_starts(np.diff(sparse.point_start)[kept]),
        point_view=sparse.point_view[own],
        point_xy=sparse.point_xy[own],
    )


class _Adjustment:
    """The bundle adjustment of one model."""

    def __init__(self, sparse: SparseModel, cameras: list[Camera], camera_of_view: np.ndarray):
        self.cameras = cameras
        self.view, self.point = sparse.point_view, sparse.point_of_observation
        self.camera = np.asarray(camera_of_view)[self.view]
        self.observed = sparse.point_xy
        self.intrinsics = np.array([camera.intrinsics for camera in cameras])[self.camera]
        self.views = len(sparse.registered)
        self.spread = float(np.sqrt(2 * len(self.view) / _redundancy(sparse)))
        self.pivot = np.median(sparse.points, axis=0)
        radius = np.array([np.hypot(camera.width, camera.height) / 2.0 for camera in cameras])
        known = np.full((len(cameras), 2), DECENTRING_SIGMA_PX)
        self.prior_sigma = np.hstack([np.repeat(RADIAL_SIGMA * radius[:, None], 2, axis=1), known])
        poses = sparse.body_from_cam
        self.start = _State(poses.rotation, poses.translation, sparse.points, np.zeros((len(cameras), COEFFICIENTS)))
        self.sigma = self._noise(self._residuals(self.start))

    def estimates(self) -> list[LensEstimate]:
        state = self._adjusted()
        found = self._residuals(state)
        covariance = self._covariance(state, found)
        estimates = []
        for number, camera in enumerate(self.cameras):
            own = slice(COEFFICIENTS * number, COEFFICIENTS * (number + 1))
            terms = found.terms[self.camera == number]
            if not len(terms):  # no view of it is registered: the prior, at a corner
                terms = displacement_terms(np.array([[camera.width, camera.height]]), camera)
            estimates.append(_estimate(camera, state.lens[number], covariance[own, own], terms))
        return estimates

    def _covariance(self, state: _State, found: _Residuals) -> np.ndarray:
        """(4 C, 4 C) of all coefficients: H^-1 B H^-1 with the information H, and with B the sum of squared scores of
        the patches of ground and of the prior, which is one more measurement."""
        normal = self._normal(state, found)
        reduced = normal.reduced(0.0)
        of_lens = np.linalg.inv(reduced.information)[6 * self.views :]
        patch = _patches(state.points)
        moved = np.stack([np.bincount(patch, of_points) for of_points in (normal.scores(reduced) @ of_lens.T).T])
        by_prior = of_lens[:, 6 * self.views :] / self.prior_sigma.ravel()
        return moved @ moved.T + by_prior @ by_prior.T

    def _residuals(self, state: _State) -> _Residuals:
        rotation, center = state.rotation[self.view], state.center[self.view]
        ideal, by_position = project(rotation, center, self.intrinsics, state.points[self.point])
        terms = np.empty((len(ideal), 2, COEFFICIENTS))
        for number, camera in enumerate(self.cameras):
            own = self.camera == number
            terms[own] = displacement_terms(ideal[own], camera)
        error = ideal + np.einsum("mij,mj->mi", terms, state.lens[self.camera]) - self.observed
        return _Residuals(error, by_position, terms)

    def _noise(self, found: _Residuals) -> float:
        """Standard deviation of a keypoint along each axis [px], by the median, for the unknowns that fit it."""
        return max(LEAST_NOISE_PX, SIGMA_PER_MEDIAN * float(np.median(np.abs(found.error))) * self.spread)

    def _cost(self, state: _State) -> float:
        """Sum of Huber's losses in units of the noise, and of squares of the prior."""
        size = self._residuals(state).size / self.sigma
        loss = np.where(size < HUBER_LIMIT, size**2, HUBER_LIMIT * (2.0 * size - HUBER_LIMIT))
        return float(loss.sum() + ((state.lens / self.prior_sigma) ** 2).sum())

    def _adjusted(self) -> _State:
        """The state of least cost, by Levenberg-Marquardt."""
        state, cost, damping = self.start, self._cost(self.start), _FIRST_DAMPING
        for _ in range(MOST_ITERATIONS):
            normal = self._normal(state, self._residuals(state))
            while damping < _MOST_DAMPING:
                moved = self._moved(state, *normal.step(damping))
                lower = self._cost(moved)
                if lower < cost:
                    break
                damping *= 5.0
            else:
                break
            gain, state, cost, damping = cost - lower, moved, lower, damping / 10.0
            if gain < _SETTLED:
                break
        return state

    def _moved(self, state: _State, step: np.ndarray, of_points: np.ndarray) -> _State:
        poses = step[: 6 * self.views].reshape(-1, 6)
        turn = so3_exp(poses[:, :3])
        center = np.einsum("kij,kj->ki", turn, state.center - self.pivot) + self.pivot + poses[:, 3:]
        lens = state.lens + step[6 * self.views :].reshape(-1, COEFFICIENTS)
        return _State(turn @ state.rotation, center, state.points + of_points, lens)

    def _normal(self, state: _State, found: _Residuals) -> _Normal:
        """A pose turns its camera about the pivot, in the middle of the points, and moves its centre."""
        count, points, lenses = len(self.view), len(state.points), state.lens.size
        weight = np.sqrt(huber_weight(found.size / self.sigma)) / self.sigma
        by_position = found.by_position * weight[:, None, None]
        by_turn = by_position @ skew(state.points[self.point] - self.pivot)
        rows = np.concatenate([by_turn, -by_position, found.terms * weight[:, None, None]], axis=-1)
        of_view = 6 * self.view[:, None] + np.arange(6)
        of_camera = 6 * self.views + COEFFICIENTS * self.camera[:, None] + np.arange(COEFFICIENTS)
        by_view = _sparse_rows(rows, np.hstack([of_view, of_camera]), 6 * self.views + lenses)
        by_point = _sparse_rows(by_position, 3 * self.point[:, None] + np.arange(3), 3 * points)
        residual = (found.error * weight[:, None]).reshape(2 * count)
        information = (by_view.T @ by_view).toarray()
        damped = np.diag(information).copy()
        damped[damped == 0.0] = 1.0 / _GAUGE  # views without keypoints stay where they are
        damped[6 * self.views :] = 0.0
        gradient = by_view.T @ residual
        own = np.arange(6 * self.views, 6 * self.views + lenses)
        information[own, own] += 1.0 / self.prior_sigma.ravel() ** 2
        gradient[own] += (state.lens / self.prior_sigma**2).ravel()
        of_points = np.zeros((points, 3, 3))
        np.add.at(of_points, self.point, np.swapaxes(by_position, -1, -2) @ by_position)
        return _Normal(
            rows=by_view,
            residual=residual,
            point=self.point,
            information=information,
            gradient=gradient,
            of_points=of_points,
            mixed=by_point.T @ by_view,
            points_gradient=by_point.T @ residual,
            damped=damped,
        )


def _estimate(camera: Camera, corner_px: np.ndarray, covariance: np.ndarray, terms: np.ndarray) -> LensEstimate:
    """The estimate of a camera whose keypoints have terms (n, 2, 4)."""
    shift = terms @ corner_px
    size = np.linalg.norm(shift, axis=-1)
    most = int(np.argmax(size))
    direction = shift[most] / size[most] if size[most] > 0.0 else np.array([1.0, 0.0])
    along = terms[most].T @ direction
    return LensEstimate(
        camera=camera,
        corner_px=corner_px,
        covariance=covariance,
        shift_px=float(size[most]),
        shift_sigma_px=float(np.sqrt(along @ covariance @ along)),
    )


def _sparse_rows(rows: np.ndarray, columns: np.ndarray, width: int) -> Any:
    """(2 M, width) of two rows (M, 2, m) for each observation, whose entries stand in columns (M, m)."""
    from scipy.sparse import csr_matrix

    count, _, entries = rows.shape
    column = np.repeat(columns, 2, axis=0)
    start = entries * np.arange(2 * count + 1)
    return csr_matrix((rows.ravel(), column.ravel(), start), (2 * count, width))


def _patches(points: np.ndarray) -> np.ndarray:
    """(P,) int: the patch of ground of each point, PATCHES x PATCHES with equally many points each, by x and y."""
    column = _equal_parts(points[:, 0])
    patch = np.empty(len(points), int)
    for number in range(PATCHES):
        own = column == number
        patch[own] = PATCHES * number + _equal_parts(points[own, 1])
    return patch


def _equal_parts(values: np.ndarray) -> np.ndarray:
    """(n,) int from 0 to PATCHES - 1: equally many of the values (n,) in each part, the lowest in the first."""
    rank = np.empty(len(values), int)
    rank[np.argsort(values)] = np.arange(len(values))
    return rank * PATCHES // max(len(values), 1)
