"""The evaluation of a body's folder: against the truth of a simulated body, or another shape model."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.evaluate.body import align_body, compare_body
from photoclinometry.evaluate.body_reference import compare_shapes
from photoclinometry.evaluate.evaluation import Evaluation
from photoclinometry.evaluate.metrics import spread
from photoclinometry.evaluate.same_site import check_same_site
from photoclinometry.io.ground import Mesh, read_ground
from photoclinometry.io.meshes.shape_ply import read_shape_ply
from photoclinometry.io.models.colmap import read_colmap
from photoclinometry.io.run_files import BODY_FILE, POSES_FOLDER, site_path
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.registration.alignment import transform_poses
from photoclinometry.simulate.bodies.truth import BodyTruth, read_body_truth

_PLACES = 2000
"""Places of the surface by which poses are compared."""


def evaluate_body(
    folder: Path, *, truth: str | Path | None = None, reference: str | Path | None = None, unit: str = "m"
) -> Evaluation:
    """The figures of a body's folder against the truth of its simulation, or a mesh (PLY, OBJ) in lengths of `unit`.

    Raises InputError for files that are missing, damaged, or do not belong together, and where none or both are given.
    """
    if (truth is None) == (reference is None):
        raise InputError(
            f"{folder} holds a whole body: give --truth (truth.h5 of its simulation) or --reference (a mesh)"
        )
    shape = read_shape_ply(folder / BODY_FILE)
    if truth is not None:
        return _by_truth(shape, folder, Path(truth))
    assert reference is not None
    mesh = read_ground(reference)
    if not isinstance(mesh, Mesh):
        raise InputError(f"{reference}: is a map; a body is compared with a mesh (PLY, OBJ)")
    known = ShapeModel(mesh.vertices, mesh.faces).with_used_vertices()
    return Evaluation(name=folder.name, metrics=compare_shapes(shape, known, unit), unit=unit)


def _by_truth(shape: ShapeModel, folder: Path, path: Path) -> Evaluation:
    """The figures of `compare_body` after the alignment of `align_body`, and errors of projections by the poses."""
    truth = read_body_truth(path)
    names, cameras, poses, _ = read_colmap(folder / POSES_FOLDER)
    check_same_site(path, truth, names, cameras, poses, _stated_suns(folder, names))
    truth_from_body = align_body(shape, truth, poses, names)
    metrics = compare_body(shape.moved(truth_from_body), truth)
    moved = transform_poses(truth_from_body, poses)
    metrics |= spread(projection_errors(moved, names, truth), "projection_error", "px")
    metrics["images_placed"] = len(names)
    return Evaluation(name=truth.name, metrics=metrics)


def _stated_suns(folder: Path, names: tuple[str, ...]) -> np.ndarray | None:
    """(K, 3) Suns of the views in C, as the body's site states them; None where the site is not there any more."""
    try:
        views = {view.name: view for view in read_site(site_path(folder)).views}
    except InputError:
        return None
    return np.array([views[name].sun for name in names]) if set(names) <= set(views) else None


def projection_errors(body_from_cam: Rigid, names: tuple[str, ...], truth: BodyTruth) -> np.ndarray:
    """(K,) RMS errors of the projections of places of the true surface by poses in the truth's frame [px]."""
    vertices = truth.surface.vertices
    places = vertices[np.linspace(0, len(vertices) - 1, _PLACES).astype(int)]
    found = []
    for k, name in enumerate(names):
        view = truth.view_index(name)
        camera, true = truth.views.cameras[view], truth.views.body_from_cam[view]
        off = camera.pixel_from_cam(body_from_cam[k].inverse()(places)) - camera.pixel_from_cam(true.inverse()(places))
        found.append(np.sqrt(np.mean(np.sum(off**2, -1))))
    return np.array(found)
