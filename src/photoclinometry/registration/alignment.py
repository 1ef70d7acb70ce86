"""Bringing a scene into another frame: by camera poses, then by its surface.

A scene made from images alone has its own origin, orientation and scale. The poses give a first similarity
(paper, section V.A). Its scale and tilt are only as good as the cameras' baselines, so the surface refines it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.gauss_newton import MOST_ITERATIONS
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, tangent_basis
from photoclinometry.model.scene import OWN, Scene, Views

Closest = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Points (n, 3) -> their nearest points on a surface (n, 3), and (n,) bool: not on the surface's rim."""

MINIMUM_SENSITIVITY = 0.01
"""A direction of the similarity is refined by the surface only if the part of its moves along the normals is at least
this share of the moves [-]: a plane does not determine the shift along itself (Zhang et al. 2016, ICRA,
doi:10.1109/ICRA.2016.7487211, remap such directions in the same way)."""

ONE_SIGMA_SHARE = 0.6827
"""Share of a normal distribution within one standard deviation."""

OUTLIER_SIGMAS = 3.0
"""Points whose distance differs from the median by more than this many robust standard deviations are dropped."""

ICP_POINTS = 20_000
"""Most points that are used to determine the similarity: seven numbers need no more."""

SETTLED = 1e-8
"""A step of the similarity shorter than this ends the iterations [rad, and shares of the map's extent]."""


def transform_poses(similarity: Similarity, body_from_cam: Rigid) -> Rigid:
    """Poses in the target's frame; cameras keep their axes, only distances scale."""
    return Rigid(similarity.rotation @ body_from_cam.rotation, similarity(body_from_cam.translation))


def transform_scene(similarity: Similarity, scene: Scene) -> Scene:
    """The same scene in another frame (target_from_B); its predictions for images do not change.

    `Scene.frame` of the result is OWN; the caller sets another one if it applies.
    """
    views, landmarks, around = scene.views, scene.landmarks, scene.surroundings
    moved = replace(
        scene,
        frame=OWN,
        views=replace(
            views,
            body_from_cam=transform_poses(similarity, views.body_from_cam),
            sun=views.sun @ similarity.rotation.T,
        ),
        landmarks=replace(
            landmarks,
            position=similarity(landmarks.position),
            normal=landmarks.normal @ similarity.rotation.T,
        ),
        error_correlation=scene.error_correlation and scene.error_correlation.transformed(similarity),
        surroundings=around and replace(around, depth=similarity.scale * around.depth),
    )
    return replace(moved, uncertainty=_transform_uncertainty(similarity, scene, moved))


def _transform_uncertainty(similarity: Similarity, scene: Scene, moved: Scene) -> dict[str, np.ndarray]:
    """`scene.uncertainty` about the axes and in the unit of `moved` (named as in `evaluate.sigma_calibration`)."""
    lengths = ("position", "translation", "center")
    directions = {
        "normal": (scene.landmarks.normal, moved.landmarks.normal),
        "sun": (scene.views.sun, moved.views.sun),
    }
    found = dict(scene.uncertainty)
    for name, stated in scene.uncertainty.items():
        if name in lengths:
            found[name] = _turn_covariance(stated, similarity.scale * similarity.rotation)
        elif name in directions:
            before, after = directions[name]
            found[name] = _turn_covariance(
                stated, np.swapaxes(tangent_basis(after), -1, -2) @ similarity.rotation @ tangent_basis(before)
            )
    return found


def _turn_covariance(stated: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """The stated uncertainty of n vectors after they are multiplied by turn (d, d) or (n, d, d).

    stated: sigmas (n,) equal in all directions, sigmas (n, d) per axis, or covariances (n, d, d). turn: a rotation
    times a scale. Sigmas (n,) stay (n,); others become covariances (n, d, d). Infinite values of undetermined vectors
    stay as they are. Raises InputError for other shapes.
    """
    stated, size = np.asarray(stated, float), turn.shape[-1]
    if stated.shape[1:] not in ((), (size,), (size, size)):
        raise InputError(f"an uncertainty has shape {stated.shape}; expected (n,), (n, {size}) or (n, {size}, {size})")
    if stated.ndim == 1:
        return stated * np.linalg.norm(turn[..., 0], axis=-1)
    covariance = stated if stated.ndim == 3 else stated[:, :, None] ** 2 * np.eye(stated.shape[1])
    known = np.isfinite(covariance).all((1, 2), keepdims=True)
    turned = turn @ np.where(known, covariance, 0.0) @ np.swapaxes(turn, -1, -2)
    return np.where(known, turned, covariance)


def align_poses(source: Rigid, target: Rigid, distance: float) -> Similarity:
    """target_from_source between paired camera poses (K,), K >= 2, with different centres.

    The rotation is that of least squares over the cameras' axes and over their centres together, centres in
    units of `distance` (from a camera to the surface, in the source's unit): a turn of a camera by an angle and a shift
    sideways by angle x distance have the same effect on the image. It is therefore determined also where all centres
    lie on a line or a plane, where Umeyama's method leaves an axis open or yields a mirror image. Scale and
    translation then follow from the centres. Raises InputError where all centres coincide, and where no positive scale
    fits centres and axes together.
    """
    a = source.translation - source.translation.mean(0)
    b = target.translation - target.translation.mean(0)
    spread_a, spread_b = np.linalg.norm(a), np.linalg.norm(b)
    if len(source) < 2 or spread_a == 0 or spread_b == 0:
        raise InputError(f"{len(source)} cameras at one place: their poses do not determine a scale")
    scale = spread_b / spread_a
    moment = np.einsum("kij,klj->il", target.rotation, source.rotation) + b.T @ a / (scale * distance**2)
    u, _, vt = np.linalg.svd(moment)
    rotation = (u * [1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    scale = float(np.sum(b * (a @ rotation.T)) / spread_a**2)
    if scale <= 0:
        raise InputError("the camera centres contradict their orientations: are the poses of the same views?")
    return Similarity(
        scale,
        rotation,
        target.translation.mean(0) - scale * rotation @ source.translation.mean(0),
    )


def align_views(views: Views, scene: Scene) -> Similarity:
    """scene_from_views by the poses of the scene's views, found in `views` by name. Raises InputError."""
    index = [views.name.index(name) for name in scene.views.name]
    return align_poses(scene.views.body_from_cam, views.body_from_cam[index], camera_distance(scene)).inverse()


def camera_distance(scene: Scene) -> float:
    """Median distance of the cameras from the middle of the map, in units of B."""
    middle = np.median(scene.landmarks.position, axis=0)
    return float(np.median(np.linalg.norm(scene.views.body_from_cam.translation - middle, axis=-1)))


@dataclass(frozen=True)
class IcpResult:
    """The outcome of `refine_on_surface`."""

    similarity: Similarity
    """target_from_source."""
    distance: np.ndarray
    """(n,) signed distances along the normals, in the target's unit; NaN for points beside the surface."""
    determined: int
    """Number of the 7 directions that the surface determines; the others keep the initial alignment."""


def refine_on_surface(
    position: np.ndarray,
    normal: np.ndarray,
    closest: Closest,
    initial: Similarity,
    *,
    iterations: int = MOST_ITERATIONS,
    sample: int = ICP_POINTS,
) -> IcpResult:
    """The similarity that brings points closest to a surface: ICP, point to plane, with scale.

    position, normal: (n, 3) of the source. Each step solves for 7 parameters in closed form, which rigid ICP
    libraries do not offer; `sample` points at most take part. Outliers (OUTLIER_SIGMAS) and points beside the surface
    are dropped. Directions that the surface does not determine (MINIMUM_SENSITIVITY) keep their initial value.
    Raises InputError where nothing overlaps.
    """
    chosen = slice(None, None, max(1, -(-len(position) // sample)))
    points, normals = position[chosen], normal[chosen]
    similarity = initial
    determined = 7
    for _ in range(iterations):
        moved = similarity(points)
        plane = normals @ similarity.rotation.T
        foot, inside = closest(moved)
        distance = np.where(inside, _signed_distance(moved, foot, plane), np.nan)
        if np.count_nonzero(np.isfinite(distance)) < 7:
            raise InputError("the map and the reference surface do not overlap: check frame and unit of both")
        # Derivatives are taken at the feet. Taken at the points, their noise would count as relief, and the scale
        # that fits best would shrink the map to reduce it.
        center = foot.mean(0)
        extent = float(np.sqrt(np.mean(np.sum((foot - center) ** 2, -1))))
        step, determined = _icp_step((foot - center) / extent, plane, distance / extent)
        turn, move, growth = so3_exp(step[:3]), extent * step[3:6], np.exp(step[6])
        update = Similarity(float(growth), turn, center + move - growth * turn @ center)
        similarity = update @ similarity
        if np.linalg.norm(step) < SETTLED:
            break
    moved = similarity(position)
    distance = surface_distance(moved, normal @ similarity.rotation.T, closest)
    return IcpResult(similarity, distance, determined)


def surface_distance(points: np.ndarray, normals: np.ndarray, closest: Closest) -> np.ndarray:
    """Distance (n,) of points to a surface, positive on the side of their normals; NaN beside the surface."""
    foot, inside = closest(points)
    return np.where(inside, _signed_distance(points, foot, normals), np.nan)


def _signed_distance(points: np.ndarray, foot: np.ndarray, normals: np.ndarray) -> np.ndarray:
    offset = points - foot
    return np.copysign(np.linalg.norm(offset, axis=-1), np.sum(offset * normals, -1))


def _icp_step(points: np.ndarray, normals: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, int]:
    """One Gauss-Newton step (7,): rotation, translation, log scale; and the number of directions that the surface
    determines.

    points: (n, 3) feet, centred and of unit extent; normals: (n, 3); distance: (n,), NaN where not used.
    """
    used = np.isfinite(distance)
    center = np.median(distance[used])
    # Not the median deviation: where distances have two clusters it can be zero, and one cluster would be dropped.
    deviation = np.quantile(np.abs(distance[used] - center), ONE_SIGMA_SHARE)
    used &= np.abs(distance - center) <= OUTLIER_SIGMAS * deviation + 1e-12
    p, n, d = points[used], normals[used], distance[used]
    jacobian = np.concatenate([np.cross(p, n), n, np.sum(p * n, -1, keepdims=True)], -1)
    eigenvalue, direction = np.linalg.eigh(jacobian.T @ jacobian / len(d))
    strong = eigenvalue > MINIMUM_SENSITIVITY**2
    gradient = direction.T @ (jacobian.T @ d / len(d))
    solution = np.where(strong, -gradient / np.where(strong, eigenvalue, 1.0), 0.0)
    return direction @ solution, int(strong.sum())
