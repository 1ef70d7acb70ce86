"""The joint estimate against GTSAM: the same factors, minimised and inverted by somebody else's library.

    python benchmarks/against_gtsam.py [side] [views]

GTSAM (`pip install gtsam`) is given the residuals of `adjust/graph/factors.py` as custom factors over its own Pose3,
Unit3 and vectors. A pose is cam_from_body with the body's origin in the pivot, so that Pose3's steps are orbits, as
ours; as body_from_cam, the paper's, GTSAM stops with "indeterminate linear system" where the map is small.
Printed: how far the costs, the variables and their sigmas are apart, and the CPU seconds of each. GTSAM's are mostly
those of calling Python once for every factor, so the script prints the time of one of its linear solves, too.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import gtsam
import numpy as np

from matched import matched_problem
from photoclinometry.adjust import SolverOptions
from photoclinometry.adjust.covariance.linearized_graph import linearized_graph
from photoclinometry.adjust.covariance.marginals import Marginals, marginals
from photoclinometry.adjust.graph import factors
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.priors import Exposure, Gauge
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.solve.solver import minimize
from photoclinometry.model.geometry import Rigid, skew, so3_log, tangent_basis
from photoclinometry.model.scene import Scene
from uncertainty import BRIGHTNESS_SIGMA, graph_of

KEYPOINT_SIGMA = 0.3
TIGHT = SolverOptions(
    relative_decrease=1e-14,
    absolute_decrease=0.0,
    settled=0.0,
    truncation=1e-10,
    final_truncation=1e-12,
    max_steps=100,
    max_cg_iterations=5000,
)


@dataclass
class Ours:
    """Our graph, its minimum and its covariances."""

    scene: Scene
    graph: FactorGraph
    estimate: Estimate
    cost: float
    found: Marginals
    cpu_s: dict[str, float] = field(default_factory=dict)


def solve(start: Scene) -> Ours:
    """At rounding's precision, for comparison; and timed as `adjust` solves by default."""
    graph = graph_of(start)
    first = Estimate(start.views, start.landmarks, np.median(start.landmarks.position, axis=0))
    spent = {"estimate": cpu(lambda: minimize(graph, first, step_limit=0.5 * start.gsd))[1]}
    solution = minimize(graph, first, TIGHT, step_limit=0.5 * start.gsd)
    at_minimum = start.with_estimate(solution.estimate.views, solution.estimate.landmarks)
    at = linearized_graph(graph, solution.estimate)
    found, spent["covariances"] = cpu(lambda: marginals(at))
    return Ours(at_minimum, graph, solution.estimate, sum(solution.cost.values()), found, spent)


def cpu(work):
    begin = time.process_time()
    out = work()
    return out, time.process_time() - begin


def pose_key(k: int) -> int:
    return gtsam.symbol("x", k)


def sun_key(k: int) -> int:
    return gtsam.symbol("s", k)


def gain_key(k: int) -> int:
    return gtsam.symbol("g", k)


def point_key(j: int) -> int:
    return gtsam.symbol("p", j)


def normal_key(j: int) -> int:
    return gtsam.symbol("n", j)


def albedo_key(j: int) -> int:
    return gtsam.symbol("a", j)


def values_of(scene: Scene, pivot: np.ndarray) -> gtsam.Values:
    """The scene as GTSAM's variables."""
    values, views, points = gtsam.Values(), scene.views, scene.landmarks
    for k in range(len(views)):
        pose = Rigid(views.body_from_cam.rotation[k], views.body_from_cam.translation[k] - pivot).inverse()
        values.insert(pose_key(k), gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.translation))
        values.insert(sun_key(k), gtsam.Unit3(views.sun[k]))
        values.insert(gain_key(k), np.array([views.scale[k], views.bias[k]]))
    for j in range(len(points)):
        values.insert(point_key(j), points.position[j])
        values.insert(normal_key(j), gtsam.Unit3(points.normal[j]))
        values.insert(albedo_key(j), np.array([points.albedo[j]]))
    return values


def pose_of(values: gtsam.Values, k: int, pivot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) of body_from_cam and camera centre (3,) in B."""
    pose = values.atPose3(pose_key(k))
    rotation = pose.rotation().matrix().T
    return rotation, pivot - rotation @ pose.translation()


def scene_of(scene: Scene, values: gtsam.Values, pivot: np.ndarray) -> Scene:
    """GTSAM's variables as a scene."""
    views, points = range(len(scene.views)), range(len(scene.landmarks))
    rotation, center = zip(*(pose_of(values, k, pivot) for k in views), strict=True)
    gains = np.array([values.atVector(gain_key(k)) for k in views])
    return scene.with_estimate(
        replace(
            scene.views,
            body_from_cam=Rigid(np.array(rotation), np.array(center)),
            sun=np.array([values.atUnit3(sun_key(k)).point3() for k in views]),
            scale=gains[:, 0],
            bias=gains[:, 1],
        ),
        replace(
            scene.landmarks,
            position=np.array([values.atPoint3(point_key(j)) for j in points]),
            normal=np.array([values.atUnit3(normal_key(j)).point3() for j in points]),
            albedo=np.array([values.atVector(albedo_key(j))[0] for j in points]),
        ),
    )


FROM_POSE3 = -np.eye(6)
"""Our orbit and shift of the camera by Pose3's, which are the body's."""


def from_unit3(direction: gtsam.Unit3) -> np.ndarray:
    """(2, 2) our step on the sphere by Unit3's."""
    return tangent_basis(direction.point3()).T @ direction.basis()


def custom(keys, size: int, work) -> gtsam.CustomFactor:
    """work(values): residual (size,) and one Jacobian per key."""

    def error(_, values, jacobians):
        residual, by_key = work(values)
        if jacobians is not None:
            for i, jacobian in enumerate(by_key):
                jacobians[i] = np.asfortranarray(np.atleast_2d(jacobian))
        return np.atleast_1d(residual)

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(size), keys, error)


def gtsam_graph(ours: Ours) -> gtsam.NonlinearFactorGraph:
    """Every factor and prior of our graph."""
    scene, pivot, smoothness = ours.scene, ours.estimate.pivot, ours.graph.smoothness
    graph, tracks = gtsam.NonlinearFactorGraph(), scene.tracks
    (gauge,) = (group for group in ours.graph.general if isinstance(group, Gauge))
    (exposures,) = (group for group in ours.graph.general if isinstance(group, Exposure))
    intrinsics = scene.views.intrinsics
    for i, (j, k) in enumerate(zip(tracks.landmark, tracks.view, strict=True)):
        graph.push_back(_projection(intrinsics[k], tracks.keypoint[i], pivot, int(j), int(k)))
        graph.push_back(_photometric(scene.reflectance.parameter_vector, tracks.brightness[i], pivot, int(j), int(k)))
    for j, q in zip(smoothness.neighbours.source, smoothness.neighbours.target, strict=True):
        graph.push_back(_smoothness(smoothness.sigma, int(j), int(q)))
    for k in range(len(scene.views)):
        graph.push_back(_sun(scene.views.sun_measured[k], scene.views.sun_sigma[k], pivot, k))
        model = gtsam.noiseModel.Diagonal.Sigmas(np.array([exposures.scale_sigma[k], exposures.bias_sigma[k]]))
        graph.push_back(gtsam.PriorFactorVector(gain_key(k), np.array([1.0, 0.0]), model))
    graph.push_back(_gauge(gauge, pivot))
    model = gtsam.noiseModel.Isotropic.Sigma(3, gauge.position_sigma)
    graph.push_back(gtsam.PriorFactorPoint3(point_key(gauge.landmark), gauge.position, model))
    return graph


def _projection(intrinsics, keypoint, pivot, j, k):
    def work(values):
        rotation, center = pose_of(values, k, pivot)
        residual, by_point, by_pose = factors.projection(
            rotation, center, intrinsics, values.atPoint3(point_key(j)), keypoint, KEYPOINT_SIGMA, pivot
        )
        return residual, (by_point, by_pose @ FROM_POSE3)

    return custom([point_key(j), pose_key(k)], 2, work)


def _photometric(parameter_vector, brightness, pivot, j, k):
    def work(values):
        sun, normal = values.atUnit3(sun_key(k)), values.atUnit3(normal_key(j))
        scale, bias = values.atVector(gain_key(k))
        _, center = pose_of(values, k, pivot)
        residual, row = factors.photometric(
            parameter_vector, center, sun.point3(), scale, bias, values.atPoint3(point_key(j)), normal.point3(),
            values.atVector(albedo_key(j))[0], brightness, BRIGHTNESS_SIGMA, pivot,
        )  # fmt: skip
        by_pose, by_sun = row[6:12] @ FROM_POSE3, row[12:14] @ from_unit3(sun)
        return residual, (row[:3], row[3:5] @ from_unit3(normal), row[5:6], by_pose, by_sun, row[14:])

    return custom([point_key(j), normal_key(j), albedo_key(j), pose_key(k), sun_key(k), gain_key(k)], 1, work)


def _smoothness(sigma, j, q):
    def work(values):
        normal = values.atUnit3(normal_key(j))
        position, neighbour = values.atPoint3(point_key(j)), values.atPoint3(point_key(q))
        residual, row = factors.smoothness(position, normal.point3(), neighbour, sigma)
        return residual, (row[:3], row[3:5] @ from_unit3(normal), row[5:])

    return custom([point_key(j), normal_key(j), point_key(q)], 1, work)


def _sun(measured, sigma, pivot, k):
    def work(values):
        rotation, sun = pose_of(values, k, pivot)[0], values.atUnit3(sun_key(k))
        residual, rows = factors.sun_direction(rotation, sun.point3(), measured, sigma)
        return residual, (np.hstack([rows[:, :3], np.zeros((2, 3))]) @ FROM_POSE3, rows[:, 3:] @ from_unit3(sun))

    return custom([pose_key(k), sun_key(k)], 2, work)


def _gauge(gauge, pivot):
    k, start = gauge.view, gauge.body_from_cam
    sigma = np.repeat([gauge.rotation_sigma, gauge.center_sigma], 3)

    def work(values):
        rotation, center = pose_of(values, k, pivot)
        offset = np.concatenate([so3_log(rotation @ start.rotation.T), center - start.translation])
        by_pose = np.block([[np.eye(3), np.zeros((3, 3))], [-skew(center - pivot), np.eye(3)]])
        return offset / sigma, (by_pose @ FROM_POSE3 / sigma[:, None],)

    return custom([pose_key(k)], 6, work)


def minimise(graph: gtsam.NonlinearFactorGraph, first: gtsam.Values) -> gtsam.Values:
    """By Levenberg-Marquardt, to the relative decrease at which ours stops."""
    options = gtsam.LevenbergMarquardtParams()
    options.setRelativeErrorTol(1e-5)
    options.setlambdaInitial(1e-5)
    options.setDiagonalDamping(True)
    return gtsam.LevenbergMarquardtOptimizer(graph, first, options).optimize()


def polish(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.Values:
    """To rounding's precision, by Gauss and Newton."""
    options = gtsam.GaussNewtonParams()
    options.setRelativeErrorTol(1e-15)
    options.setAbsoluteErrorTol(1e-12)
    options.setMaxIterations(30)
    return gtsam.GaussNewtonOptimizer(graph, values, options).optimize()


def covariances(graph, values, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """GTSAM's marginals (K, 10, 10) and (J, 6, 6) in our coordinates; zero between variables of GTSAM's."""
    found = gtsam.Marginals(graph, values)
    cameras, landmarks = np.zeros((len(scene.views), 10, 10)), np.zeros((len(scene.landmarks), 6, 6))
    for k, block in enumerate(cameras):
        sun = values.atUnit3(sun_key(k))
        block[:6, :6] = FROM_POSE3 @ found.marginalCovariance(pose_key(k)) @ FROM_POSE3.T
        block[6:8, 6:8] = from_unit3(sun) @ found.marginalCovariance(sun_key(k)) @ from_unit3(sun).T
        block[8:, 8:] = found.marginalCovariance(gain_key(k))
    for j, block in enumerate(landmarks):
        normal = from_unit3(values.atUnit3(normal_key(j)))
        block[:3, :3] = found.marginalCovariance(point_key(j))
        block[3:5, 3:5] = normal @ found.marginalCovariance(normal_key(j)) @ normal.T
        block[5:, 5:] = found.marginalCovariance(albedo_key(j))
    return cameras, landmarks


def compare(side: int, views: int, *, from_start: bool = True) -> dict[str, float]:
    """The claims of the module's docstring, as numbers. from_start: GTSAM begins at our start, not at our end."""
    start, _ = matched_problem(side, views)
    ours = solve(start)
    graph, first = gtsam_graph(ours), values_of(start if from_start else ours.scene, ours.estimate.pivot)
    values, seconds = cpu(lambda: minimise(graph, first))
    values = polish(graph, values)
    (cameras, landmarks), inverting = cpu(lambda: covariances(graph, values, ours.scene))
    linear = graph.linearize(values)
    _, once = cpu(linear.optimize)

    count = len(start.views)
    blocks = ours.found.views.reshape(count, 10, count, 10)[range(count), :, range(count), :]
    sigma = [np.sqrt(np.einsum("naa->na", b)) for b in (blocks, ours.found.landmark)]
    theirs = [np.sqrt(np.einsum("naa->na", b)) for b in (cameras, landmarks)]
    apart = local_difference(ours.estimate, scene_of(start, values, ours.estimate.pivot))
    return {
        "landmarks": len(start.landmarks),
        "observations": len(start.tracks),
        "cost": ours.cost,
        "cost difference, relative": abs(2.0 * graph.error(values) / ours.cost - 1.0),
        "variables apart at most [their sigma]": max(np.max(np.abs(a) / s) for a, s in zip(apart, sigma, strict=True)),
        "sigmas apart at most, relative": max(np.max(np.abs(t / s - 1)) for t, s in zip(theirs, sigma, strict=True)),
        "our estimate [CPU s]": ours.cpu_s["estimate"],
        "our covariances [CPU s]": ours.cpu_s["covariances"],
        "GTSAM's estimate [CPU s]": seconds,
        "GTSAM's covariances [CPU s]": inverting,
        "one linear solve of GTSAM's [CPU s]": once,
        "time ratio of the estimates": seconds / ours.cpu_s["estimate"],
    }


def local_difference(ours: Estimate, theirs: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(K, 10) and (J, 6): from our estimate to theirs in local coordinates, to first order."""
    a, b = ours.views, theirs.views
    turn = so3_log(b.body_from_cam.rotation @ np.swapaxes(a.body_from_cam.rotation, 1, 2))
    moved = b.body_from_cam.translation - a.body_from_cam.translation
    shift = moved - np.cross(turn, a.body_from_cam.translation - ours.pivot)
    sun = np.einsum("kia,ki->ka", tangent_basis(a.sun), b.sun)
    camera = np.column_stack([turn, shift, sun, b.scale - a.scale, b.bias - a.bias])
    p, q = ours.landmarks, theirs.landmarks
    normal = np.einsum("jia,ji->ja", tangent_basis(p.normal), q.normal)
    return camera, np.column_stack([q.position - p.position, normal, q.albedo - p.albedo])


def main(side: int = 17, views: int = 8) -> None:
    for name, value in compare(side, views).items():
        print(f"{name:40} {value:.4g}")


if __name__ == "__main__":
    import sys

    main(*map(int, sys.argv[1:]))
