"""The joint estimate as one problem: its factors, its cost and normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from photoclinometry.adjust import kernels
from photoclinometry.adjust.factors import sun_direction
from photoclinometry.adjust.kernels import CAMERA_SIZE, LANDMARK_SIZE, STORED, CameraState, LandmarkState
from photoclinometry.adjust.layout import Layout, Measurements
from photoclinometry.adjust.parameters import Border, linearize_parameters, no_border
from photoclinometry.adjust.priors import Priors
from photoclinometry.adjust.product import Linearized, linearized, multiply
from photoclinometry.adjust.smoothing import Neighbours, add_smoothness, linearize_smoothness
from photoclinometry.adjust.variables import Estimate
from photoclinometry.model.geometry import tangent_basis
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Landmarks, Views

COST_TERMS: tuple[str, ...] = ("keypoint", "brightness", "smoothness", "sun", "prior")


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
    border: Border
    """What the reflectance parameters add."""

    @property
    def gradient(self) -> np.ndarray:
        """(10 K + 6 J + T,)."""
        return np.concatenate([self.camera_gradient.ravel(), self.landmark_gradient.ravel(), self.border.gradient])


class Problem:
    """Cost and normal equations of a set of factors; buffers are kept between calls."""

    def __init__(
        self,
        layout: Layout,
        measured: Measurements,
        neighbours: Neighbours,
        priors: Priors,
        reflectance: Reflectance | None,
        *,
        smooth_sigma: float,
    ):
        """reflectance: at the start, None without brightness; smooth_sigma [rad]."""
        self.layout, self.measured, self.neighbours, self.priors = layout, measured, neighbours, priors
        self.reflectance, self.smooth_sigma = reflectance, smooth_sigma
        self.with_brightness = bool(np.any(measured.brightness_weight))
        views, landmarks = len(priors.views), len(priors.landmarks)
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

    def release(self) -> None:
        """Lets go of measurements and buffers, a gigabyte for ten million observations; priors and neighbours stay."""
        del self.layout, self.measured, self._stored, self._normal, self._smooth_rows, self._smooth_residual

    def cost(self, estimate: Estimate) -> np.ndarray:
        """Squared whitened residuals by COST_TERMS (5,), after the loss; the objective is their sum."""
        return self._observe(estimate, with_jacobian=False)[0]

    def linearize(self, estimate: Estimate) -> tuple[np.ndarray, NormalEquations]:
        """Cost by term (5,) and the normal equations."""
        cost, cameras, landmarks = self._observe(estimate, with_jacobian=True)
        block, gradient = self._normal.landmark_block, self._normal.landmark_gradient
        rest = np.zeros(block.shape, np.float32)
        add_smoothness(self.neighbours, self._smooth_rows, self._smooth_residual, block, rest, gradient)
        self.priors.add_landmarks(estimate, block, rest, gradient)
        _make_invertible(block, rest)
        where = linearized(cameras, landmarks, estimate.pivot)
        camera_observed = _full(self._normal.camera_block.sum(0))
        camera_rest, camera_gradient = self.of_cameras(estimate)
        camera_block = camera_observed + camera_rest
        _make_invertible(camera_block, camera_rest)
        return cost, NormalEquations(
            camera_block=camera_block,
            camera_gradient=self._normal.camera_gradient.sum(0) + camera_gradient,
            camera_rest=camera_rest,
            landmark_block=block,
            landmark_gradient=gradient,
            landmark_rest=rest,
            smooth_rows=self._smooth_rows.copy(),
            where=where,
            border=self._border(estimate, cameras, landmarks, where),
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
        views = estimate.views
        cameras, landmarks = states(views, estimate.landmarks)
        kernels.linearize(
            self.layout, self.measured, cameras, landmarks, estimate.pivot, self._packed(estimate),
            with_jacobian, self._stored, self._normal,
        )  # fmt: skip
        cost = np.zeros(len(COST_TERMS))
        cost[:2] = self._normal.cost.sum(0)
        cost[2] = linearize_smoothness(
            self.neighbours, landmarks.position, landmarks.normal, landmarks.normal_basis,
            self.smooth_sigma, self._smooth_rows, self._smooth_residual,
        )  # fmt: skip
        cost[3] = np.sum(self._sun_rows(views)[0] ** 2) if self.with_brightness else 0.0
        cost[4] = self.priors.cost(estimate)
        return cost, cameras, landmarks

    def reflectance_at(self, estimate: Estimate) -> Reflectance | None:
        """The reflectance with the parameters of an estimate."""
        if self.reflectance is None or len(estimate.parameters) == 0:
            return self.reflectance
        return self.reflectance.with_parameters(self.reflectance.parameters * (1.0 + estimate.parameters))

    def _packed(self, estimate: Estimate) -> np.ndarray:
        """`Reflectance.packed` of an estimate."""
        reflectance = self.reflectance_at(estimate)
        return np.zeros(3) if reflectance is None else reflectance.packed

    def of_cameras(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Blocks (K, 10, 10) and gradient (K, 10) of the priors and the Sun factors."""
        block, gradient = self.priors.of_cameras(estimate)
        if self.with_brightness:
            residual, sun_rows = self._sun_rows(estimate.views)
            views, touched = range(len(estimate.views)), [0, 1, 2, 6, 7]
            block[np.ix_(views, touched, touched)] += np.einsum("kri,krj->kij", sun_rows, sun_rows)
            gradient[:, touched] += np.einsum("kri,kr->ki", sun_rows, residual)
        return block, gradient

    def _sun_rows(self, views: Views) -> tuple[np.ndarray, np.ndarray]:
        """`sun_rows`, with the Suns held as `Priors.view_factor` says."""
        residual, rows = sun_rows(views)
        return self.priors.view_factor * residual, self.priors.view_factor * rows

    def _border(self, estimate: Estimate, cameras: CameraState, landmarks: LandmarkState, where: Linearized) -> Border:
        """The estimated reflectance parameters' part, priors included."""
        count = len(estimate.parameters)
        if count == 0 or self.reflectance is None:
            return no_border(len(cameras.center), len(landmarks.albedo))
        border = linearize_parameters(
            self.layout, self.measured, cameras, landmarks, where, self._packed(estimate), self.reflectance.parameters,
            self._stored, len(self._camera_out),
        )  # fmt: skip
        weight = self.priors.reflectance**-2.0
        return border._replace(
            block=border.block + weight * np.eye(count), gradient=border.gradient + weight * estimate.parameters
        )


def states(views: Views, landmarks: Landmarks) -> tuple[CameraState, LandmarkState]:
    """What the kernels need of an estimate, contiguous."""
    pose, plain = views.body_from_cam, np.ascontiguousarray
    return CameraState(
        plain(pose.rotation),
        plain(pose.translation),
        views.intrinsics,
        plain(views.sun),
        tangent_basis(views.sun),
        plain(views.scale),
        plain(views.bias),
    ), LandmarkState(
        plain(landmarks.position), plain(landmarks.normal), tangent_basis(landmarks.normal), plain(landmarks.albedo)
    )


def sun_rows(views: Views) -> tuple[np.ndarray, np.ndarray]:
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
