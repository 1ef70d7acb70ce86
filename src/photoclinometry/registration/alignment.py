"""Bringing a scene into another frame: by camera poses, then by its surface.

A scene made from images alone has its own origin, orientation and scale. Poses give the similarity first
(paper, section V.A). Their scale and tilt are only as good as the cameras' baselines, so the surface refines
it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, tangent_basis
from photoclinometry.model.scene import OWN, Scene, Views

Closest = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Points (n, 3) -> their nearest points on a surface (n, 3), and (n,) bool: not on the surface's rim."""

MINIMUM_SENSITIVITY = 0.01
"""A direction of the similarity is refined by the surface only if it moves points along their normals by this
share of how far it moves them: a plane says nothing about sliding along itself (Zhang et al. 2016, ICRA,
doi:10.1109/ICRA.2016.7487211, remap such directions in the same way)."""


def transform_poses(similarity: Similarity, body_from_cam: Rigid) -> Rigid:
    """Poses in the target's frame; cameras keep their axes, only distances scale."""
    return Rigid(similarity.rotation @ body_from_cam.rotation, similarity(body_from_cam.translation))


def transform_scene(similarity: Similarity, scene: Scene) -> Scene:
    """The same scene in another frame (target_from_B): nothing that it predicts about images changes.

    Of which kind that frame is, `Scene.frame`, is for the caller to say.
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
        surroundings=around and replace(around, depth=similarity.scale * around.depth),
    )
    return replace(moved, uncertainty=_transform_uncertainty(similarity, scene, moved))


def _transform_uncertainty(similarity: Similarity, scene: Scene, moved: Scene) -> dict[str, np.ndarray]:
    """`scene.uncertainty` about the axes and in the unit of `moved`, as the table in `calibrate.py` has them."""
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
    """What is stated about n vectors, as `metrics.normalised_square` takes it, of turn (d, d) or (n, d, d) @ vector.

    turn: a rotation times a scale. Sigmas alike in all directions stay so, (n,); others become covariances (n, d, d).
    """
    stated, size = np.asarray(stated, float), turn.shape[-1]
    if stated.shape[1:] not in ((), (size,), (size, size)):
        raise InputError(f"an uncertainty has shape {stated.shape}: it says nothing about vectors of {size} numbers")
    if stated.ndim == 1:
        return stated * np.linalg.norm(turn[..., 0], axis=-1)
    covariance = stated if stated.ndim == 3 else stated[:, :, None] ** 2 * np.eye(stated.shape[1])
    return turn @ covariance @ np.swapaxes(turn, -1, -2)


def align_poses(source: Rigid, target: Rigid, distance: float) -> Similarity:
    """target_from_source between paired camera poses (K,), K >= 2, with different centres.

    The rotation is that of least squares over the cameras' axes and over their centres together, centres in
    units of `distance` (from a camera to the surface, in the source's unit): a camera turned by an angle and
    one moved sideways by angle x distance see the same. So it is determined also where all centres lie on a
    line or a plane, which leaves Umeyama's method short of an axis or with a mirror image. Scale and
    translation then follow from the centres. Raises InputError.
    """
    a = source.translation - source.translation.mean(0)
    b = target.translation - target.translation.mean(0)
    spread_a, spread_b = np.linalg.norm(a), np.linalg.norm(b)
    if len(source) < 2 or spread_a == 0 or spread_b == 0:
        raise InputError(f"{len(source)} cameras at one place: their poses do not tell a scale")
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
    """scene_from_views by the poses of the views that both have (by name). Raises InputError as `align_poses`."""
    shared = [views.name.index(name) for name in scene.views.name]
    theirs = views.body_from_cam[shared]
    return align_poses(scene.views.body_from_cam, theirs, camera_distance(scene)).inverse()


def camera_distance(scene: Scene) -> float:
    """Median distance of the cameras from the middle of the map, in units of B."""
    middle = np.median(scene.landmarks.position, axis=0)
    return float(np.median(np.linalg.norm(scene.views.body_from_cam.translation - middle, axis=-1)))


@dataclass(frozen=True)
class IcpResult:
    """What `refine_on_surface` found."""

    similarity: Similarity
    """target_from_source."""
    distance: np.ndarray
    """(n,) signed distances along the normals, in the target's unit, NaN for points beside the surface."""
    determined: int
    """How many of the 7 directions the surface determines; the others keep the initial alignment."""


def refine_on_surface(
    position: np.ndarray,
    normal: np.ndarray,
    closest: Closest,
    initial: Similarity,
    *,
    iterations: int = 30,
    sample: int = 20_000,
) -> IcpResult:
    """The similarity that brings points closest to a surface: ICP, point to plane, with scale.

    position, normal: (n, 3) of the source. Each step solves for 7 parameters in closed form, which rigid ICP
    libraries do not offer; `sample` points at most take part. Robust: residuals beyond 3 robust standard
    deviations are dropped, as are points beside the surface. Raises InputError where nothing overlaps.
    """
    chosen = slice(None, None, max(1, len(position) // sample))
    points, normals = position[chosen], normal[chosen]
    similarity = initial
    determined = 7
    for _ in range(iterations):
        moved = similarity(points)
        plane = normals @ similarity.rotation.T
        foot, inside = closest(moved)
        distance = np.where(inside, _signed_distance(moved, foot, plane), np.nan)
        # Derivatives are taken at the feet: taken at the points, their noise would count as relief, which
        # shrinking the map would cure.
        center = foot.mean(0)
        extent = float(np.sqrt(np.mean(np.sum((foot - center) ** 2, -1))))
        step, determined = _icp_step((foot - center) / extent, plane, distance / extent)
        turn, move, growth = so3_exp(step[:3]), extent * step[3:6], np.exp(step[6])
        update = Similarity(float(growth), turn, center + move - growth * turn @ center)
        similarity = update @ similarity
        if np.linalg.norm(step) < 1e-8:
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


def _icp_step(points, normals, distance):
    """One Gauss-Newton step (7,) for centred points of unit extent: rotation, translation, log scale."""
    used = np.isfinite(distance)
    if used.sum() < 7:
        raise InputError("the map and the reference surface do not overlap: check frame and unit of both")
    center = np.median(distance[used])
    # Of a normal distribution that share lies within one sigma. The median deviation would be nought where the
    # distances have two heaps, and then drop one of them.
    deviation = np.quantile(np.abs(distance[used] - center), 0.6827)
    used &= np.abs(distance - center) <= 3.0 * deviation + 1e-12
    p, n, d = points[used], normals[used], distance[used]
    jacobian = np.concatenate([np.cross(p, n), n, np.sum(p * n, -1, keepdims=True)], -1)
    eigenvalue, direction = np.linalg.eigh(jacobian.T @ jacobian / len(d))
    strong = eigenvalue > MINIMUM_SENSITIVITY**2
    gradient = direction.T @ (jacobian.T @ d / len(d))
    solution = np.where(strong, -gradient / np.where(strong, eigenvalue, 1.0), 0.0)
    return direction @ solution, int(strong.sum())
