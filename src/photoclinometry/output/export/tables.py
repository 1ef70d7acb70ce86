"""Landmarks and views as CSV tables, one row each; names of columns end in the unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.evaluate.unreliable import albedo_is_known, normal_is_known, only_known
from photoclinometry.io.csv_columns import Columns, write_csv
from photoclinometry.io.rasters.globe import geographic
from photoclinometry.model.sigma import sigma_along, sigma_of_length
from photoclinometry.output.export.frame import Framed


def write_tables(folder: Path, framed: Framed) -> dict[str, str]:
    """Writes landmarks.csv and views.csv; returns descriptions by file name. Raises RunFolderError."""
    write_csv(folder / "landmarks.csv", landmark_columns(framed))
    write_csv(folder / "views.csv", view_columns(framed))
    return {
        "landmarks.csv": "landmarks",
        "views.csv": "camera centres, body_from_cam as quaternions, Suns, scales, biases, dark levels",
    }


def landmark_columns(framed: Framed) -> Columns:
    """Position, longitude and latitude if known, normal, albedo, standard deviations, pixel, observations.

    NaN where nothing determines a normal or an albedo.
    """
    scene, landmarks = framed.scene, framed.scene.landmarks
    length = "_m" if framed.metric else ""
    columns: Columns = {axis + length: landmarks.position[:, i] for i, axis in enumerate("xyz")}
    if framed.globe is not None:
        lon, lat, height = geographic(framed.globe, landmarks.position).T
        columns |= {"longitude_deg": lon, "latitude_deg": lat, "height_m": height}
    told, known = normal_is_known(scene), albedo_is_known(scene)
    columns |= {f"normal_{axis}": only_known(landmarks.normal[:, i], told) for i, axis in enumerate("xyz")}
    if scene.reflectance is not None:
        columns["albedo"] = only_known(landmarks.albedo, known)
    stated = scene.uncertainty
    if "position" in stated:
        axes = np.broadcast_to(np.eye(3)[:, None], (3, len(landmarks), 3))
        columns |= {f"sigma_{a}{length}": sigma_along(stated["position"], axes[i]) for i, a in enumerate("xyz")}
    if "normal" in stated:
        columns["sigma_normal_deg"] = only_known(np.degrees(sigma_of_length(stated["normal"], 2)), told)
    if "albedo" in stated:
        columns["sigma_albedo"] = only_known(sigma_of_length(stated["albedo"], 1), known)
    if "albedo_relative" in stated:
        columns["sigma_albedo_relative"] = only_known(stated["albedo_relative"], known)
    columns |= {"row_px": landmarks.pixel[:, 0], "col_px": landmarks.pixel[:, 1]}
    return columns | {"observations": np.diff(scene.tracks.start)}


def view_columns(framed: Framed) -> Columns:
    """Name, camera centre, body_from_cam as a unit quaternion, Sun, scale, bias and dark level of each view."""
    from scipy.spatial.transform import Rotation

    views, length = framed.scene.views, "_m" if framed.metric else ""
    wxyz = Rotation.from_matrix(views.body_from_cam.rotation).as_quat(canonical=True, scalar_first=True)
    columns: Columns = {"name": views.name}
    columns |= {f"center_{a}{length}": views.body_from_cam.translation[:, i] for i, a in enumerate("xyz")}
    columns |= {f"body_from_cam_{a}": wxyz[:, i] for i, a in enumerate("wxyz")}
    columns |= {f"sun_{a}": views.sun[:, i] for i, a in enumerate("xyz")}
    return columns | {"scale": views.scale, "bias": views.bias, "dark_level": views.dark_level}
