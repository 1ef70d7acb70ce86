"""Factors of a landmark seen in a view: keypoints and brightness, fused into one compiled group.

There are millions of these. All `Keypoints` groups and the `Brightness` of a graph share one table of observations, so
that one pass makes the rows of both, and fifteen stored numbers hold them all (`slot.STORED`). A group switches its
rows on by giving them a weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np

from photoclinometry.adjust.graph import kernels
from photoclinometry.adjust.graph.kernels import Normal
from photoclinometry.adjust.graph.layout import Layout, Measurements, build_layout, spread
from photoclinometry.adjust.graph.product import RowOrigin, multiply, row_origin
from photoclinometry.adjust.graph.reflectance_parameters import Border
from photoclinometry.adjust.graph.slot import STORED, LandmarkState, ViewState
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE, Estimate
from photoclinometry.model.geometry import tangent_basis
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Landmarks, Tracks, Views


class ImageGradients(NamedTuple):
    """Image gradients of N brightnesses at the pixels where they were sampled.

    With them a brightness follows its landmark, so that images determine the landmark's position without matches: the
    measurement is the sampled brightness + gradient . (projected pixel - at).
    """

    at: np.ndarray
    """(N, 2) [px]."""
    gradient: np.ndarray
    """(N, 2) brightness per pixel, single precision suffices; zero where brightness is to stay what it is."""
    factor: np.ndarray | None = None
    """(N,) factor that removes smooth errors from the brightness (`photometry.smooth_errors`); None where they are
    unknown."""
    smooth_over: float = np.inf
    """Standard deviation of the Gaussian average that determined these errors [landmarks]; infinite where there are
    none."""

    def of(self, observations: np.ndarray) -> ImageGradients:
        """Those of some observations, in that order."""
        factor = None if self.factor is None else self.factor[observations]
        return self._replace(at=self.at[observations], gradient=self.gradient[observations], factor=factor)

    def padded(self, count: int) -> ImageGradients:
        """These, and those of `count` more observations, whose brightness counts as it is."""
        at, gradient = (np.pad(part, ((0, count), (0, 0))) for part in (self.at, self.gradient))
        factor = None if self.factor is None else np.pad(self.factor, (0, count), constant_values=1.0)
        return self._replace(at=at, gradient=gradient, factor=factor)

    def of_landmarks(self, tracks: Tracks) -> np.ndarray:
        """(J,) bool: landmarks any of whose brightness follows them."""
        return np.bincount(tracks.landmark, np.any(self.gradient != 0.0, axis=1), len(tracks.start) - 1) > 0


class ObservationTable:
    """N observations of J landmarks in K views, one at most of a landmark in a view, and how they lie in memory.

    Landmarks are in a local order.
    """

    def __init__(self, tracks: Tracks, view_count: int):
        self.tracks, self.view_count = tracks, view_count
        self.layout, self.place = build_layout(tracks, view_count)
        if len(self.place) and np.bincount(self.place).max() > 1:
            raise ValueError("a landmark has two observations in one view; keep one of them")


@dataclass(frozen=True, kw_only=True)
class Keypoints:
    """Predicted pixel minus keypoint over sigma, for all observations of some landmarks (Eqs. 9-10)."""

    name: str
    table: ObservationTable
    landmarks: np.ndarray
    """(J,) bool: whose keypoints these are; no two groups of a graph share one."""
    sigma: np.ndarray
    """(N,) [px]; only that of the group's observations counts."""
    limit: float = np.inf
    """Huber's limit, in sigmas."""


@dataclass(frozen=True, kw_only=True)
class Brightness:
    """scale * albedo * rho + bias minus brightness over sigma (Eqs. 29-32), for the observations `used`."""

    table: ObservationTable
    reflectance: Reflectance
    """From which the estimate's differs by its parameters."""
    used: np.ndarray
    """(N,) bool."""
    brightness: np.ndarray
    """(N,) as sampled."""
    sigma: np.ndarray | float
    """In the images' brightness: of each observation (N,), or of all."""
    limit: float = np.inf
    """Huber's limit, in sigmas."""
    gradients: ImageGradients | None = None
    """Where brightness follows its landmark (direct photometric refinement)."""
    name: str = "brightness"


@dataclass(frozen=True)
class ObservationRows:
    """Rows of all observations at one estimate, and their contribution to the normal equations of views and
    parameters."""

    cost: np.ndarray
    """(2,) squared whitened residuals of keypoints and of brightness, after the loss."""
    layout: Layout
    stored: np.ndarray
    """(STORED P,) float32, see `slot.STORED`."""
    where: RowOrigin
    view_block: np.ndarray
    """(K, 10, 10)."""
    view_gradient: np.ndarray
    """(K, 10)."""
    border: Border
    """The contribution of the reflectance parameters."""

    def multiply(self, views: np.ndarray, landmarks: np.ndarray, landmark_out: np.ndarray) -> np.ndarray:
        """J^T J x: views (K, 10) and landmarks (J, 6) of x, float32, without parameters.

        landmark_out (J, 6), float32, takes the landmarks' part; the views' (K, 10) is returned.
        """
        out = np.empty((numba.get_num_threads(), *views.shape))
        multiply(self.layout, self.stored, self.where, views, landmarks, out, landmark_out)
        return out.sum(0)


class Observations:
    """The fused group of a graph's `Keypoints` and `Brightness`, which must share one table."""

    def __init__(self, keypoints: Sequence[Keypoints], brightness: Brightness | None):
        """Raises ValueError where groups do not share the table, or two have the keypoints of one landmark."""
        tables = {id(group.table): group.table for group in [*keypoints, *([brightness] if brightness else [])]}
        if len(tables) != 1:
            raise ValueError(f"keypoints and brightness of a graph share one table of observations, got {len(tables)}")
        (self.table,) = tables.values()
        tracks = self.table.tracks
        if keypoints and np.any(np.sum([group.landmarks for group in keypoints], axis=0) > 1):
            raise ValueError("two groups have the keypoints of one landmark")
        self.keypoint_weight = np.zeros(len(tracks), np.float32)
        self.keypoint_limit = np.full(len(tracks.start) - 1, np.inf)
        for group in keypoints:
            mine = group.landmarks[tracks.landmark]
            self.keypoint_weight[mine] = 1.0 / group.sigma[mine]
            self.keypoint_limit[group.landmarks] = group.limit
        self.brightness_weight, self.brightness_limit = np.zeros(len(tracks), np.float32), np.inf
        self.reflectance: Reflectance | None = None
        """From which the estimate's differs by its parameters; None without brightness."""
        self._sampled, self._gradients = np.zeros(len(tracks)), None
        if brightness is not None:
            self.brightness_weight[:] = brightness.used / brightness.sigma
            self.brightness_limit, self.reflectance = float(brightness.limit), brightness.reflectance
            self._sampled, self._gradients = brightness.brightness, brightness.gradients

    def reflectance_at(self, estimate: Estimate) -> Reflectance | None:
        """The reflectance with the parameters of an estimate."""
        if self.reflectance is None or len(estimate.parameters) == 0:
            return self.reflectance
        return self.reflectance.moved(estimate.parameters)

    def parameter_vector_at(self, estimate: Estimate) -> np.ndarray:
        """`Reflectance.parameter_vector` of an estimate."""
        reflectance = self.reflectance_at(estimate)
        return np.zeros(3) if reflectance is None else reflectance.parameter_vector

    @property
    def brightness_at_origin_and_gradient(self) -> tuple[np.ndarray, np.ndarray]:
        """Brightness is linear in the pixel where it is taken: its value (N,) at pixel (0, 0), and gradient (N, 2)."""
        if self._gradients is None:
            return self._sampled, np.zeros((len(self._sampled), 2), np.float32)
        gradient = self._gradients.gradient.astype(np.float32, copy=False)
        return self._sampled - np.sum(gradient * self._gradients.at, -1), gradient

    @cached_property
    def measured(self) -> Measurements:
        """All measurements with their weights, by place."""
        place, size = self.table.place, self.table.layout.places
        brightness, by_observation = self.brightness_at_origin_and_gradient
        gradient = np.zeros((2, size), np.float32)
        if by_observation.any():
            gradient = np.array([spread(axis, place, size, np.float32) for axis in by_observation.T])
        return Measurements(
            np.array([spread(axis, place, size) for axis in self.table.tracks.keypoint.T]),
            spread(brightness, place, size),
            gradient,
            spread(self.keypoint_weight, place, size, np.float32),
            spread(self.brightness_weight, place, size, np.float32),
            self.keypoint_limit,
            self.brightness_limit,
        )

    def cost(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Squared whitened residuals after the loss: (2,) of keypoints and of brightness, and (J,) of each landmark."""
        views, landmarks = states(estimate.views, estimate.landmarks)
        normal = _empty_normal(0, len(estimate.views), 0)._replace(landmark_cost=np.zeros(len(estimate.landmarks)))
        self._pass(estimate, views, landmarks, False, np.zeros(0, np.float32), normal)
        return normal.cost.sum(0), normal.landmark_cost

    def linearize(self, estimate: Estimate) -> tuple[ObservationRows, np.ndarray, np.ndarray]:
        """The rows, and their contribution to the landmarks' blocks (J, 6, 6) and gradients (J, 6)."""
        views, landmarks = states(estimate.views, estimate.landmarks)
        stored = np.empty(STORED * self.table.layout.places, np.float32)
        normal = _empty_normal(len(estimate.landmarks), len(estimate.views), len(self._unit(estimate)))
        self._pass(estimate, views, landmarks, True, stored, normal)
        where = row_origin(views, landmarks, estimate.pivot)
        rows = ObservationRows(
            cost=normal.cost.sum(0),
            layout=self.table.layout,
            stored=stored,
            where=where,
            view_block=_full(normal.view_block.sum(0)),
            view_gradient=normal.view_gradient.sum(0),
            border=Border(
                by_landmark=normal.by_parameter,
                by_view=np.swapaxes(normal.view_by_parameter.sum(0), 1, 2).copy(),
                block=_full(normal.parameter_block.sum(0)),
                gradient=normal.parameter_gradient.sum(0),
            ),
        )
        return rows, normal.landmark_block, normal.landmark_gradient

    def _pass(
        self,
        estimate: Estimate,
        views: ViewState,
        landmarks: LandmarkState,
        with_jacobian: bool,
        stored: np.ndarray,
        normal: Normal,
    ) -> None:
        kernels.linearize(
            self.table.layout, self.measured, views, landmarks, estimate.pivot, self.parameter_vector_at(estimate),
            self._unit(estimate), with_jacobian, stored, normal,
        )  # fmt: skip

    def _unit(self, estimate: Estimate) -> np.ndarray:
        """(T,) unit in which each reflectance parameter changes; none where they are held."""
        if len(estimate.parameters) == 0 or self.reflectance is None:
            return np.zeros(0)
        return self.reflectance.parameter_scale


def states(views: Views, landmarks: Landmarks) -> tuple[ViewState, LandmarkState]:
    """The parts of an estimate that the kernels need, contiguous."""
    pose, plain = views.body_from_cam, np.ascontiguousarray
    return ViewState(
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


def _empty_normal(landmarks: int, views: int, parameters: int) -> Normal:
    threads = numba.get_num_threads()
    return Normal(
        np.empty((landmarks, LANDMARK_SIZE, LANDMARK_SIZE)),
        np.empty((landmarks, LANDMARK_SIZE)),
        np.empty((threads, views, VIEW_SIZE, VIEW_SIZE)),
        np.empty((threads, views, VIEW_SIZE)),
        np.empty((landmarks, LANDMARK_SIZE, parameters), np.float32),
        np.empty((threads, views, parameters, VIEW_SIZE)),
        np.empty((threads, parameters, parameters)),
        np.empty((threads, parameters)),
        np.empty((threads, 2)),
        np.empty(0),
    )


def _full(lower: np.ndarray) -> np.ndarray:
    """Symmetric matrices (..., n, n) from their lower triangles."""
    strict = np.tril(lower, -1)
    return np.tril(lower) + np.swapaxes(strict, -1, -2)
