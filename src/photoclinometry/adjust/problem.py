"""The joint estimate as one problem: its variables, its factors, its cost and normal equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np

from photoclinometry.adjust import kernels
from photoclinometry.adjust.factors import sun_direction
from photoclinometry.adjust.kernels import CAMERA_SIZE, LANDMARK_SIZE, STORED, CameraState, LandmarkState
from photoclinometry.adjust.layout import Layout, Measurements
from photoclinometry.adjust.product import Linearized, linearized, multiply
from photoclinometry.adjust.smoothing import Neighbours, add_smoothness, linearize_smoothness
from photoclinometry.geometry import Rigid, skew, so3_exp, so3_log, sphere_step, tangent_basis
from photoclinometry.scene import Landmarks, Views

COST_TERMS: tuple[str, ...] = ("keypoint", "brightness", "smoothness", "sun", "prior")


@dataclass(frozen=True)
class Priors:
    """What is known beforehand, as standard deviations about the values at which the estimate starts."""

    pose_rotation: np.ndarray
    """(K,) [rad]; infinite where free."""
    pose_translation: np.ndarray
    """(K,) in units of B; infinite where free."""
    scale: np.ndarray
    """(K,); infinite where free."""
    bias: np.ndarray
    """(K,) in the images' brightness; infinite where free."""
    landmark: np.ndarray
    """(J,) position, in units of B; infinite where free."""
    views: Views
    """The values the camera priors are about."""
    position: np.ndarray
    """(J, 3) the values the landmark priors are about."""


@dataclass(frozen=True)
class Estimate:
    """A value for every variable."""

    views: Views
    landmarks: Landmarks
    pivot: np.ndarray
    """(3,) the point in B about which cameras orbit; any point in the middle of the map."""

    def step(self, camera: np.ndarray, landmark: np.ndarray) -> Estimate:
        """Moved by local coordinates (K, 10) and (J, 6), as `factors` defines them."""
        views, landmarks = self.views, self.landmarks
        pose = views.body_from_cam
        turn = so3_exp(camera[:, :3])
        arm = np.einsum("kij,kj->ki", turn, pose.translation - self.pivot + camera[:, 3:6])
        moved = Rigid(turn @ pose.rotation, self.pivot + arm)
        return Estimate(
            replace(
                views,
                body_from_cam=moved,
                sun=sphere_step(views.sun, camera[:, 6:8]),
                scale=views.scale + camera[:, 8],
                bias=views.bias + camera[:, 9],
            ),
            replace(
                landmarks,
                position=landmarks.position + landmark[:, :3],
                normal=sphere_step(landmarks.normal, landmark[:, 3:5]),
                albedo=landmarks.albedo + landmark[:, 5],
            ),
            self.pivot,
        )


@dataclass
class NormalEquations:
    """H x = -g at one estimate: what `linearize` leaves behind."""

    camera_block: np.ndarray
    """(K, 10, 10) diagonal blocks, everything included."""
    camera_gradient: np.ndarray
    """(K, 10)."""
    camera_rest: np.ndarray
    """(K, 10, 10) the part of `camera_block` that is not from observations."""
    landmark_block: np.ndarray
    """(J, 6, 6) diagonal blocks, everything included."""
    landmark_gradient: np.ndarray
    """(J, 6)."""
    landmark_rest: np.ndarray
    """(J, 6, 6) float32: the part of `landmark_block` that is not from observations."""
    smooth_rows: np.ndarray
    """(P, 5) float32, by pair of neighbours."""
    where: Linearized
    """Where the observations' rows were made."""


class Problem:
    """Cost and normal equations of a set of factors; buffers are kept between calls."""

    def __init__(
        self,
        layout: Layout,
        measured: Measurements,
        neighbours: Neighbours,
        priors: Priors,
        packed_reflectance: np.ndarray,
        *,
        smooth_sigma: float,
    ):
        """smooth_sigma [rad]."""
        self.layout, self.measured, self.neighbours, self.priors = layout, measured, neighbours, priors
        self.packed, self.smooth_sigma = packed_reflectance, smooth_sigma
        self.with_brightness = bool(np.any(measured.brightness_weight))
        views, landmarks = len(priors.views), len(priors.position)
        threads = numba.get_num_threads()
        self._stored = np.zeros(STORED * layout.places, np.float32)
        self._normal = kernels.Normal(
            np.zeros((landmarks, LANDMARK_SIZE, LANDMARK_SIZE)),
            np.zeros((landmarks, LANDMARK_SIZE)),
            np.zeros((threads, views, CAMERA_SIZE, CAMERA_SIZE)),
            np.zeros((threads, views, CAMERA_SIZE)),
            np.zeros((threads, 2)),
        )
        pairs = len(neighbours.target)
        self._smooth_rows = np.zeros((pairs, 5), np.float32)
        self._smooth_residual = np.zeros(pairs)
        self._camera_out = np.zeros((threads, views, CAMERA_SIZE))

    def cost(self, estimate: Estimate) -> np.ndarray:
        """Squared whitened residuals by COST_TERMS (5,), after the loss; the objective is their sum."""
        return self._observe(estimate, with_jacobian=False)[0]

    def linearize(self, estimate: Estimate) -> tuple[np.ndarray, NormalEquations]:
        """Cost by term (5,) and the normal equations."""
        cost, cameras, landmarks = self._observe(estimate, with_jacobian=True)
        block, gradient = self._normal.landmark_block, self._normal.landmark_gradient
        rest = np.zeros(block.shape, np.float32)
        add_smoothness(self.neighbours, self._smooth_rows, self._smooth_residual, block, rest, gradient)
        held = np.flatnonzero(np.isfinite(self.priors.landmark))
        weight = self.priors.landmark[held] ** -2.0
        for part in (block, rest):
            part[held[:, None], range(3), range(3)] += weight[:, None]
        moved = estimate.landmarks.position[held] - self.priors.position[held]
        gradient[held, :3] += weight[:, None] * moved
        _make_invertible(block, rest)
        camera_observed = _full(self._normal.camera_block.sum(0))
        camera_rest, prior_gradient = self.camera_priors(estimate)
        camera_block = camera_observed + camera_rest
        _make_invertible(camera_block, camera_rest)
        return cost, NormalEquations(
            camera_block=camera_block,
            camera_gradient=self._normal.camera_gradient.sum(0) + prior_gradient,
            camera_rest=camera_rest,
            landmark_block=block,
            landmark_gradient=gradient,
            landmark_rest=rest,
            smooth_rows=self._smooth_rows.copy(),
            where=linearized(cameras, landmarks, estimate.pivot),
        )

    def multiply_observations(
        self, equations: NormalEquations, camera: np.ndarray, landmark: np.ndarray, landmark_out: np.ndarray
    ) -> np.ndarray:
        """J^T J x of the observations at the last `linearize`: camera (K, 10), landmark (J, 6), float32.

        landmark_out (J, 6), float32, takes the landmarks' part; the cameras' (K, 10) is returned.
        """
        multiply(self.layout, self._stored, equations.where, camera, landmark, self._camera_out, landmark_out)
        return self._camera_out.sum(0)

    def _observe(self, estimate: Estimate, *, with_jacobian: bool):
        views, points = estimate.views, estimate.landmarks
        cameras = CameraState(
            np.ascontiguousarray(views.body_from_cam.rotation),
            np.ascontiguousarray(views.body_from_cam.translation),
            views.intrinsics,
            views.sun,
            tangent_basis(views.sun),
            views.scale,
            views.bias,
        )
        landmarks = LandmarkState(points.position, points.normal, tangent_basis(points.normal), points.albedo)
        kernels.linearize(
            self.layout, self.measured, cameras, landmarks, estimate.pivot, self.packed,
            with_jacobian, self._stored, self._normal,
        )  # fmt: skip
        cost = np.zeros(len(COST_TERMS))
        cost[:2] = self._normal.cost.sum(0)
        cost[2] = linearize_smoothness(
            self.neighbours, landmarks.position, landmarks.normal, landmarks.normal_basis,
            self.smooth_sigma, self._smooth_rows, self._smooth_residual,
        )  # fmt: skip
        cost[3:] = self._prior_cost(estimate)
        return cost, cameras, landmarks

    def _prior_cost(self, estimate: Estimate) -> tuple[float, float]:
        priors, start, now = self.priors, self.priors.views, estimate.views
        turned, moved = _pose_offset(now, start)
        total = np.sum((turned / priors.pose_rotation[:, None]) ** 2)
        total += np.sum((moved / priors.pose_translation[:, None]) ** 2)
        total += np.sum(((now.scale - start.scale) / priors.scale) ** 2)
        total += np.sum(((now.bias - start.bias) / priors.bias) ** 2)
        offset = estimate.landmarks.position - priors.position
        total += np.sum((offset / priors.landmark[:, None]) ** 2)
        sun = _sun_rows(now)[0] if self.with_brightness else np.zeros(1)
        return float(np.sum(sun**2)), float(total)

    def camera_priors(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Blocks (K, 10, 10) and gradient (K, 10) of the Sun factors and of the priors on poses, scales, biases."""
        priors, start, now = self.priors, self.priors.views, estimate.views
        count = len(now)
        turned, moved = _pose_offset(now, start)
        sigma = np.column_stack(
            [
                np.repeat(priors.pose_rotation[:, None], 3, 1),
                np.repeat(priors.pose_translation[:, None], 3, 1),
                np.full((count, 2), np.inf),
                priors.scale,
                priors.bias,
            ]
        )
        offset = np.column_stack([turned, moved, np.zeros((count, 2)), now.scale - start.scale, now.bias - start.bias])
        rows = np.tile(np.eye(CAMERA_SIZE), (count, 1, 1))
        rows[:, 3:6, :3] = -skew(now.body_from_cam.translation - estimate.pivot)
        block = np.einsum("kri,kr,krj->kij", rows, sigma**-2.0, rows)
        gradient = np.einsum("kri,kr,kr->ki", rows, sigma**-2.0, offset)
        if self.with_brightness:
            residual, sun_rows = _sun_rows(now)
            touched = [0, 1, 2, 6, 7]
            block[np.ix_(range(count), touched, touched)] += np.einsum("kri,krj->kij", sun_rows, sun_rows)
            gradient[:, touched] += np.einsum("kri,kr->ki", sun_rows, residual)
        return block, gradient


def _pose_offset(now: Views, start: Views) -> tuple[np.ndarray, np.ndarray]:
    """Turn (K, 3) [rad] and move (K, 3) from `start` to `now`, in B.

    The turn is the rotation vector: its derivative by omega is the identity up to half its length, which the
    tightness of any useful pose prior keeps below 1e-3.
    """
    turn = so3_log(now.body_from_cam.rotation @ np.swapaxes(start.body_from_cam.rotation, -1, -2))
    return turn, now.body_from_cam.translation - start.body_from_cam.translation


def _sun_rows(views: Views) -> tuple[np.ndarray, np.ndarray]:
    """Whitened Sun residuals (K, 2) and Jacobians (K, 2, 5), see `factors.sun_direction`."""
    rows = [
        sun_direction(*args)
        for args in zip(views.body_from_cam.rotation, views.sun, views.sun_measured, views.sun_sigma, strict=True)
    ]
    return np.array([r for r, _ in rows]), np.array([j for _, j in rows])


def _full(lower: np.ndarray) -> np.ndarray:
    """Symmetric matrices (..., n, n) from their lower triangles."""
    strict = np.tril(lower, -1)
    return np.tril(lower) + np.swapaxes(strict, -1, -2)


def _make_invertible(block: np.ndarray, rest: np.ndarray) -> None:
    """Ones on the diagonal, of both, where no factor touches a variable: it then stays where it is."""
    diagonal = np.einsum("...ii->...i", block)
    untouched = diagonal == 0.0
    diagonal[untouched] = 1.0
    np.einsum("...ii->...i", rest)[untouched] = 1.0
