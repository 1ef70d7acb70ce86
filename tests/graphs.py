"""A factor graph of an exactly known scene, and the same factors one by one in plain NumPy."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust.graph import factors
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import Brightness, ImageGradients, Keypoints, ObservationTable
from photoclinometry.adjust.graph.priors import (
    Exposure,
    LandmarkPriors,
    PosePriors,
    ReflectancePrior,
)
from photoclinometry.adjust.graph.smoothness import Smoothness, build_neighbours
from photoclinometry.adjust.graph.sun_directions import SunDirections
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.model.geometry import skew, so3_log, tangent_basis
from photoclinometry.model.scene import Scene, Views

KEYPOINT_SIGMA, BRIGHTNESS_SIGMA, SMOOTH_SIGMA = 0.5, 0.003, 0.2
ROTATION_SIGMA, CENTER_SIGMA, SCALE_SIGMA, BIAS_SIGMA = 1e-4, 10.0, 0.01, 0.001


@dataclass(frozen=True)
class Built:
    """A graph and what it was built of."""

    graph: FactorGraph
    used: np.ndarray
    """(N,) bool: brightness that counts."""
    index: np.ndarray
    """(J, 4) neighbours."""
    present: np.ndarray
    """(J, 4) bool."""
    pose_sigma: np.ndarray
    """(K,) of the first view 1, of the others more, times ROTATION_SIGMA and CENTER_SIGMA."""

    @property
    def middle(self) -> int:
        """The landmark whose position is known to 1."""
        return len(self.index) // 2


def graph_of(
    scene: Scene,
    limits: tuple[float, float] | tuple[np.ndarray, float] = (np.inf, np.inf),
    hide: float = 0.0,
    gradients: ImageGradients | None = None,
    *,
    smooth_sigma: float = SMOOTH_SIGMA,
    keypoint_sigma: float = KEYPOINT_SIGMA,
    brightness_sigma: float = BRIGHTNESS_SIGMA,
    pose_sigma: np.ndarray | None = None,
    reflectance_sigma: float | None = None,
    used: np.ndarray | None = None,
    others=(),
) -> Built:
    """The scene's graph with all kinds of factors; a share of the brightness hidden.

    limits: Huber's, of keypoints (one, or one each of even and odd landmarks) and of brightness; others: more groups.
    """
    rng = np.random.default_rng(5)
    tracks, views, landmarks = scene.tracks, len(scene.views), len(scene.landmarks)
    table = ObservationTable(tracks, views)
    if used is None:
        used = rng.uniform(size=len(tracks)) >= hide
    even = np.arange(landmarks) % 2 == 0
    sigma, keypoint_limits = np.full(len(tracks), keypoint_sigma), np.broadcast_to(limits[0], 2)
    grid = np.arange(landmarks).reshape(scene.region.height, scene.region.width)
    index = np.stack([np.roll(grid, s, a).ravel() for a in (0, 1) for s in (-1, 1)], -1)
    far = np.linalg.norm(scene.landmarks.position[index] - scene.landmarks.position[:, None], axis=-1) > 2 * scene.gsd
    pose_sigma = np.r_[1.0, np.full(views - 1, 30.0)] if pose_sigma is None else pose_sigma
    free = np.full(landmarks, np.inf)
    position_sigma = free.copy()
    position_sigma[landmarks // 2] = 1.0
    groups = [
        Keypoints(name="even", table=table, landmarks=even, sigma=sigma, limit=float(keypoint_limits[0])),
        Keypoints(name="odd", table=table, landmarks=~even, sigma=sigma, limit=float(keypoint_limits[1])),
        Brightness(
            table=table,
            reflectance=scene.reflectance,
            used=used,
            brightness=tracks.brightness,
            sigma=brightness_sigma,
            limit=limits[1],
            gradients=gradients,
        ),
        Smoothness(build_neighbours(index, ~far), smooth_sigma),
        SunDirections.of(scene.views),
        PosePriors(
            body_from_cam=scene.views.body_from_cam,
            rotation_sigma=ROTATION_SIGMA * pose_sigma,
            center_sigma=CENTER_SIGMA * pose_sigma,
        ),
        Exposure(scale_sigma=np.full(views, SCALE_SIGMA), bias_sigma=np.full(views, BIAS_SIGMA)),
        LandmarkPriors(landmarks=scene.landmarks, position_sigma=position_sigma, normal_sigma=free, albedo_sigma=free),
        *([] if reflectance_sigma is None else [ReflectancePrior(sigma=reflectance_sigma)]),
        *others,
    ]
    return Built(FactorGraph(groups), used, index, ~far, pose_sigma)


def observation_factors(scene: Scene, estimate: Estimate, gradients: ImageGradients | None = None):
    """For every observation: landmark, view, and `observation_factor`."""
    for n, (j, k) in enumerate(zip(scene.tracks.landmark, scene.tracks.view, strict=True)):
        yield j, k, *observation_factor(scene, estimate, n, j, k, gradients)


def observation_factor(
    scene: Scene, estimate: Estimate, n: int, j: int, k: int, gradients: ImageGradients | None = None
):
    """`factors.projection` and `factors.photometric`, or with gradients `factors.direct`, of observation n, of landmark
    j in view k, at graph_of's sigmas."""
    views, points, tracks = estimate.views, estimate.landmarks, scene.tracks
    pose, position = views.body_from_cam[k], points.position[j]
    projection = factors.projection(
        pose.rotation, pose.translation, views.intrinsics[k], position, tracks.keypoint[n], KEYPOINT_SIGMA,
        estimate.pivot,
    )  # fmt: skip
    what = views.sun[k], views.scale[k], views.bias[k], position, points.normal[j], points.albedo[j]
    parameter_vector, rest = scene.reflectance.parameter_vector, (BRIGHTNESS_SIGMA, estimate.pivot)
    if gradients is None:
        photometric = factors.photometric(parameter_vector, pose.translation, *what, tracks.brightness[n], *rest)
    else:
        camera, image = views.intrinsics[k], (tracks.brightness[n], gradients.at[n], gradients.gradient[n])
        photometric = factors.direct(parameter_vector, pose.rotation, pose.translation, camera, *what, image, *rest)
    return projection, photometric


def dense_jacobian(scene: Scene, estimate: Estimate, gradients: ImageGradients | None = None) -> np.ndarray:
    """(3 N, 10 K + 6 J) whitened Jacobian of projection and brightness, from the factors."""
    base = 10 * len(estimate.views)
    rows = np.zeros((3 * len(scene.tracks), base + 6 * len(estimate.landmarks)))
    for n, (j, k, projection, (_, row)) in enumerate(observation_factors(scene, estimate, gradients)):
        _, by_position, by_pose = projection
        l, c = base + 6 * j, 10 * k
        rows[3 * n : 3 * n + 2, l : l + 3], rows[3 * n : 3 * n + 2, c : c + 6] = by_position, by_pose
        rows[3 * n + 2, l : l + 6], rows[3 * n + 2, c : c + 10] = row[:6], row[6:]
    return rows


def residuals_of(scene: Scene, built: Built):
    """All whitened residuals as a function of an estimate, from the factors in plain NumPy.

    Those of an observation are kept by the view and the landmark that they are of, those of smoothness by the two
    landmarks: derivatives by differences change one of these at a time.
    """
    known: dict[tuple, list[float]] = {}

    def residuals(estimate: Estimate) -> np.ndarray:
        views, points, out = estimate.views, estimate.landmarks, []
        pose = views.body_from_cam
        of_view = bytes_of_rows(pose.rotation, pose.translation, views.sun, views.scale, views.bias)
        of_landmark = bytes_of_rows(points.position, points.normal, points.albedo)
        for n, (j, k) in enumerate(zip(scene.tracks.landmark, scene.tracks.view, strict=True)):
            key = n, of_view[k], of_landmark[j]
            if key not in known:
                (by_keypoint, *_), (by_brightness, _) = observation_factor(scene, estimate, n, j, k)
                known[key] = [*by_keypoint, by_brightness]
            out.extend(known[key])
        for j, m in zip(*np.nonzero(built.present), strict=True):
            other = built.index[j, m]
            key = j, m, of_landmark[j], of_landmark[other]
            if key not in known:
                position, normal = points.position, points.normal
                known[key] = [factors.smoothness(position[j], normal[j], position[other], SMOOTH_SIGMA)[0]]
            out.extend(known[key])
        out.extend(sun_residuals(views))
        start = scene.views.body_from_cam
        turn = so3_log(views.body_from_cam.rotation @ np.swapaxes(start.rotation, 1, 2))
        move = views.body_from_cam.translation - start.translation
        out.extend((turn / (ROTATION_SIGMA * built.pose_sigma[:, None])).ravel())
        out.extend((move / (CENTER_SIGMA * built.pose_sigma[:, None])).ravel())
        out.extend((views.scale - 1.0) / SCALE_SIGMA)
        out.extend(views.bias / BIAS_SIGMA)
        out.extend((points.position - scene.landmarks.position)[built.middle])
        return np.array(out)

    return residuals


def bytes_of_rows(*values: np.ndarray) -> list[bytes]:
    """All that arrays (n, ...) have in each of their rows."""
    return [row.tobytes() for row in np.column_stack([np.reshape(each, (len(each), -1)) for each in values])]


def perturbed(scene: Scene, seed: int = 0, size: float = 1.0) -> Estimate:
    """An estimate away from the scene's values."""
    rng = np.random.default_rng(seed)
    views, landmarks = len(scene.views), len(scene.landmarks)
    camera = rng.normal(size=(views, 10)) * size * np.r_[[1e-5] * 3, [5.0] * 3, [1e-3] * 2, 1e-2, 1e-3]
    landmark = rng.normal(size=(landmarks, 6)) * size * np.r_[[10.0] * 3, [0.05] * 2, 0.01]
    pivot = scene.landmarks.position.mean(0)
    return Estimate(scene.views, scene.landmarks, pivot).step(camera, landmark)


def gradients_of(scene: Scene, seed: int = 11) -> ImageGradients:
    """Brightness that changes by a few per cent per pixel about where the landmarks are seen."""
    gradient = 0.003 * np.random.default_rng(seed).normal(size=(len(scene.tracks), 2))
    return ImageGradients(scene.tracks.keypoint + 0.2, gradient.astype(np.float32).astype(float))


def some_tracks_missing(scene: Scene) -> Scene:
    """A third of the observations taken away."""
    tracks = scene.tracks
    keep = np.random.default_rng(1).uniform(size=len(tracks)) < 0.67
    counts = np.bincount(tracks.landmark[keep], minlength=len(tracks.start) - 1)
    names = ("view", "keypoint", "keypoint_sigma", "brightness", "lit")
    fewer = {name: getattr(tracks, name)[keep] for name in names}
    return replace(scene, tracks=replace(tracks, start=np.concatenate([[0], np.cumsum(counts)]), **fewer))


def sun_residuals(views: Views) -> np.ndarray:
    """(2 K,) Suns less those measured, in the tangent planes of these, whitened by the covariance of their errors: of
    each view's own, and of one rotation in C of all of an arc."""
    tangent = [tangent_basis(sun) for sun in views.sun_measured]
    in_cam = np.einsum("kij,ki->kj", views.body_from_cam.rotation, views.sun)
    off = np.concatenate([plane.T @ sun for plane, sun in zip(tangent, in_cam, strict=True)])
    turned = np.concatenate(
        [
            sigma * plane.T @ skew(sun)
            for plane, sun, sigma in zip(tangent, views.sun_measured, views.sun_common_sigma, strict=True)
        ]
    )
    arc = np.repeat(views.arc, 2)
    covariance = np.diag(np.repeat(views.sun_sigma**2, 2)) + turned @ turned.T * (arc[:, None] == arc)
    return np.linalg.solve(np.linalg.cholesky(covariance), off)
