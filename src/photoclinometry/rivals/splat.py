"""Gaussian splatting: a cloud of Gaussians whose brightness depends on the direction of view.

Kerbl et al. (2023), ACM Transactions on Graphics 42(4), doi:10.1145/3592433, on the CPU: projection and blending in
`gaussians/`. The cloud starts from the run's landmarks, as in the paper's comparison (section VI.C), with the mean
distance to the three nearest as its size. Each view has a gain and an offset of its own, trained with the cloud; a view
that was held out gets them as every method that does not know the light. Only the map's part of each image is trained.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.scene import Landmarks, Scene
from photoclinometry.rivals.gaussians.cloud import Cloud, flat_quaternions, rotations
from photoclinometry.rivals.gaussians.colour import Colour, HarmonicColour, Light, outward
from photoclinometry.rivals.gaussians.harmonics import MOST_DEGREE, first_coefficient
from photoclinometry.rivals.gaussians.loss import Target, draw, draw_values
from photoclinometry.rivals.gaussians.projection import Pinhole
from photoclinometry.rivals.gaussians.train import Training, train
from photoclinometry.rivals.outcome import COVERED, Outcome, surface_map
from photoclinometry.rivals.problem import Problem
from photoclinometry.surface.neighbours import normals_from_neighbours

FIRST_OPACITY = 0.1
"""Of all Gaussians at the start (Kerbl et al. 2023)."""
FLATNESS = 0.3
"""Thickness over width at the start of Gaussians that have a normal: less would be thinner than a pixel shows."""
MARGIN_PX = 8
"""Pixels around the map's part of an image that are drawn with it: half a tile."""


@dataclass(frozen=True, kw_only=True)
class SplatOptions(Ranged):
    """Gaussian splatting."""

    iterations: Annotated[int, Range(least=1, most=1_000_000)] = 1000
    """Views that are rendered and learnt from, one after the other. The paper has 30,000, of hundreds of images; of a
    dozen views, more than 1,000 learn the views used by heart, and predict others worse."""
    degree: Annotated[int, Range(least=0, most=MOST_DEGREE)] = 1
    """Degree of the spherical harmonics."""
    growth: Annotated[float, Range(least=1, most=100)] = 2.0
    """Gaussians at most, over those at the start."""
    stride: Annotated[int, Range(least=1, most=1000)] = 1
    """Spacing of the landmarks from which the cloud starts, down and across."""


def run_splat(problem: Problem, options: SplatOptions | None = None, progress: Progress = no_progress) -> Outcome:
    """The predictions of Gaussian splatting; its map has the rendered depths of the reference view."""
    options = options or SplatOptions()
    colour = HarmonicColour(degree=options.degree)
    return splatted(problem, options, colour, "splat", progress)


def splatted(problem: Problem, options: SplatOptions, colour: Colour, name: str, progress: Progress) -> Outcome:
    """The predictions of a cloud with a colour, trained on the views that the run has used."""
    boxes = [_box(mask) for mask in problem.footprint]
    targets = [_target(problem, k, boxes[k]) for k in range(len(problem.images))]
    start = first_cloud(problem, options.stride, colour, targets)
    offset = start.position - np.median(start.position, axis=0)
    training = Training(
        iterations=options.iterations,
        growth=options.growth,
        radius=float(np.linalg.norm(offset, axis=-1).max()),
        exposures=isinstance(colour, HarmonicColour),
    )
    done = train(start, colour, targets[: problem.train], training, lambda n, of: progress(name, n, of))
    rendered, covered = [], []
    for k, (image, box, target) in enumerate(zip(problem.images, boxes, targets, strict=True)):
        drawn = draw(done.cloud, colour, target.camera, target.light, target.mask.shape)
        gain, bias = done.exposure[k] if k < problem.train else (1.0, 0.0)
        whole, there = np.zeros(image.valid.shape), np.zeros(image.valid.shape, bool)
        whole[box], there[box] = problem.peak * (gain * drawn.picture + bias), 1.0 - drawn.made.left > COVERED
        rendered.append(whole)
        covered.append(there)
    return Outcome(
        name=name,
        rendered=rendered,
        covered=covered,
        knows_light=not isinstance(colour, HarmonicColour),
        scene=cloud_map(problem.scene, done.cloud, colour),
        history=tuple(done.history),
    )


def first_cloud(problem: Problem, stride: int, colour: Colour, targets: list[Target]) -> Cloud:
    """Gaussians at evenly spaced landmarks of the run; flat ones where colours have a normal, else round ones."""
    from scipy.spatial import KDTree

    scene = problem.scene
    row, col = scene.cells
    position = scene.landmarks.position[(row % stride == 0) & (col % stride == 0)]
    distance = KDTree(position).query(position, k=4)[0][:, 1:].mean(-1)
    log_scale, quaternion = np.tile(np.log(distance)[:, None], 3), np.tile([1.0, 0.0, 0.0, 0.0], (len(position), 1))
    if isinstance(colour, HarmonicColour):
        middle = float(np.mean([target.picture[target.mask].mean() for target in targets[: problem.train]]))
        coefficients = np.zeros((len(position), (colour.degree + 1) ** 2))
        coefficients[:, 0] = first_coefficient(np.full(len(position), middle))
        own = {"harmonics": coefficients}
    else:
        normal = normals_from_neighbours(position, scene.views.body_from_cam.translation.mean(0))
        quaternion, log_scale[:, 2] = flat_quaternions(normal), log_scale[:, 2] + np.log(FLATNESS)
        own = {"log_albedo": np.full(len(position), np.log(np.median(scene.landmarks.albedo)))}
    logit = np.full(len(position), np.log(FIRST_OPACITY / (1.0 - FIRST_OPACITY)))
    return Cloud(position=position, log_scale=log_scale, quaternion=quaternion, logit=logit, colour=own)


def cloud_map(scene: Scene, cloud: Cloud, colour: Colour) -> Scene:
    """The map that a cloud is: rendered depths at the reference's pixels, with normals, and albedos where it has them.

    Harmonics have no normals: those of the rendered surface are taken.
    """
    camera, pose = scene.views.cameras[scene.reference], scene.views.body_from_cam[scene.reference]
    region, center = scene.region, pose.translation
    pinhole = _pinhole(scene, scene.reference, region.row, region.col)
    axis = outward(rotations(cloud.quaternion)[..., 2], cloud.position, center)
    depth = pose.inverse()(cloud.position)[:, 2]
    albedo = np.exp(cloud.colour.get("log_albedo", np.zeros(len(cloud))))
    values = np.column_stack([depth, axis, albedo])
    drawn, covered = draw_values(cloud, pinhole, values, (region.height, region.width))
    row, col = (scene.landmarks.pixel - (region.row, region.col)).T
    there = covered[row, col] > COVERED
    position = pose(camera.ray_in_cam(scene.landmarks.pixel[:, ::-1] + 0.5) * drawn[row, col, :1])
    position = np.where(there[:, None], position, np.nan)
    if isinstance(colour, HarmonicColour):
        return surface_map(scene, position)
    normal = drawn[row, col, 1:4]
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    found = Landmarks(position=position, normal=normal, albedo=drawn[row, col, 4], pixel=scene.landmarks.pixel)
    kept = np.flatnonzero(there)
    return replace(scene, landmarks=found[kept], tracks=scene.tracks.of_landmarks(kept)[0], uncertainty={})


def _target(problem: Problem, k: int, box: tuple[slice, slice]) -> Target:
    """The map in a view, of peak 1."""
    image, views, peak = problem.images[k], problem.views, problem.peak
    return Target(
        camera=_pinhole(problem.scene.with_estimate(views, problem.scene.landmarks), k, box[0].start, box[1].start),
        light=Light(
            center=views.body_from_cam.translation[k],
            sun=views.sun[k],
            scale=float(views.scale[k]) / peak,
            bias=float(views.bias[k]) / peak,
        ),
        picture=np.where(image.valid, image.brightness, 0.0)[box].astype(float) / peak,
        mask=problem.footprint[k][box],
    )


def _pinhole(scene: Scene, k: int, row: int, col: int) -> Pinhole:
    """A view's camera, for the part of its picture from a pixel on."""
    cam_from_body = scene.views.body_from_cam[k].inverse()
    intrinsics = scene.views.intrinsics[k] - (0.0, 0.0, col, row)
    rotation = np.ascontiguousarray(cam_from_body.rotation)
    return Pinhole(rotation, np.ascontiguousarray(cam_from_body.translation), intrinsics)


def _box(mask: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns of a mask with a margin; the first pixel where it is empty."""
    if not mask.any():
        return slice(0, 1), slice(0, 1)
    rows, cols = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    top, left = max(int(rows[0]) - MARGIN_PX, 0), max(int(cols[0]) - MARGIN_PX, 0)
    return slice(top, int(rows[-1]) + 1 + MARGIN_PX), slice(left, int(cols[-1]) + 1 + MARGIN_PX)
