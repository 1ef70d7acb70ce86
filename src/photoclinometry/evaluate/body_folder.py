"""The evaluation of a body's folder: its surface and poses against the truth of a simulated body."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.evaluate.body import align_body, compare_body
from photoclinometry.evaluate.evaluation import Evaluation
from photoclinometry.evaluate.metrics import spread
from photoclinometry.io.meshes.shape_ply import read_shape_ply
from photoclinometry.io.models.colmap import read_colmap
from photoclinometry.model.geometry import Rigid
from photoclinometry.registration.alignment import transform_poses
from photoclinometry.simulate.bodies.truth import BodyTruth, read_body_truth

BODY_FILE, POSES_FOLDER = "body.ply", "sparse"
"""What a body's folder holds."""
_PLACES = 2000
"""Places of the surface by which poses are compared."""


def is_body(folder: Path) -> bool:
    """Whether a folder holds the surface of a body."""
    return (Path(folder) / BODY_FILE).is_file()


def evaluate_body(folder: Path, truth_file: Path) -> Evaluation:
    """The figures of `compare_body` after the alignment of `align_body`, and how far projections are off by the poses.

    Raises InputError for files that are missing, damaged, or do not belong together.
    """
    folder, truth = Path(folder), read_body_truth(truth_file)
    shape = read_shape_ply(folder / BODY_FILE)
    names, _, poses, _ = read_colmap(folder / POSES_FOLDER)
    truth_from_body = align_body(shape, truth, poses, names)
    metrics = compare_body(shape.moved(truth_from_body), truth)
    moved = transform_poses(truth_from_body, poses)
    metrics |= spread(projection_errors(moved, names, truth), "projection_error", "px")
    metrics["images_placed"] = len(names)
    return Evaluation(name=truth.name, metrics=metrics)


def projection_errors(body_from_cam: Rigid, names: tuple[str, ...], truth: BodyTruth) -> np.ndarray:
    """(K,) by how much places of the true surface project wrongly by poses in the truth's frame, RMS [px]."""
    vertices = truth.surface.vertices
    places = vertices[np.linspace(0, len(vertices) - 1, _PLACES).astype(int)]
    found = []
    for k, name in enumerate(names):
        view = truth.view_index(name)
        camera, true = truth.views.cameras[view], truth.views.body_from_cam[view]
        off = camera.pixel_from_cam(body_from_cam[k].inverse()(places)) - camera.pixel_from_cam(true.inverse()(places))
        found.append(np.sqrt(np.mean(np.sum(off**2, -1))))
    return np.array(found)
