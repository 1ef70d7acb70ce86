"""The viewer's data of a scene: numbers as JSON, and arrays in the form of `arrays.packed`.

Everything is in the map's local frame (`surface/relief.py`): origin in the middle of the map, x to the right and y up
in the reference image along the mean plane, z out of the ground. Lengths are metres, or ground sample distances of
the reference image where the scene's unit is unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from photoclinometry.evaluate.evaluate import landmark_photometric_error
from photoclinometry.evaluate.unreliable import albedo_is_known, known_sigmas, normal_is_known
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.image import Image
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.output.viewer.arrays import packed, share_of_peak, three_digits
from photoclinometry.output.viewer.pictures import pictures
from photoclinometry.output.viewer.views import reflectance_content, views_content
from photoclinometry.photometry.render import averaging_sigma
from photoclinometry.surface.relief import local_frame

FORMAT = 1
"""Version of the data format of the page's program."""
POSITION_STEP_GSD = 1e-3
"""Step of stored positions: a thousandth of a ground sample, a tenth of their smallest standard deviations."""
NORMAL_STEP = 1.0 / 2**15
"""Step of stored components of normals: 0.002 degrees."""
ALBEDO_LEVELS = 20_000
"""Steps from zero to the greatest albedo: 0.005 %."""

Content = dict[str, Any]


def viewer_content(
    scene: Scene, images: Sequence[Image] = (), pose_priors: Mapping[str, PosePrior] | None = None
) -> Content:
    """The scene for the page.

    images: of its views, in any order; without them the page compares with none. pose_priors: by name of view; they
    count where the scene is in their frame.
    """
    frame = local_frame(scene)
    length = 1.0 if scene.unit else 1.0 / scene.gsd
    return {
        "format": FORMAT,
        "kind": "region",
        "name": scene.name,
        "body": scene.body,
        "brightness": scene.brightness,
        "unit": scene.unit or "GSD",
        "gsd": scene.gsd * length,
        "spacing": scene.spacing * length,
        "grid": {
            "rows": scene.region.grid_shape[0],
            "cols": scene.region.grid_shape[1],
            "row": scene.region.row,
            "col": scene.region.col,
            "stride": scene.region.stride,
        },
        "reference": scene.reference,
        "views": views_content(
            scene.views,
            frame,
            length,
            [averaging_sigma(scene, k) for k in range(len(scene.views))],
            pose_priors if scene.frame == BODY_FIXED else None,
        ),
        "reflectance": reflectance_content(scene.reflectance),
        "place": _place(scene, frame),
        "landmarks": _landmarks(scene, frame, length),
        "faces": packed(landmark_faces(scene), 1.0),
        "surroundings": _surroundings(scene, length),
        "pictures": pictures(scene.views, scene.landmarks.position, images),
    }


def _place(scene: Scene, frame: Rigid) -> Content:
    """Place of the map: its local frame in B, and whether that is body-fixed, so that north is known."""
    return {
        "body_fixed": scene.frame == BODY_FIXED,
        "body_from_local": frame.rotation.tolist(),
        "origin": frame.translation.tolist(),
    }


def _landmarks(scene: Scene, frame: Rigid, length: float) -> Content:
    """Arrays of the landmarks in the scene's order; `cell` counts the map's grid row by row.

    Renderings need all normals and albedos; layers do not show those that `unknown_normal` and `unknown_albedo` mark.
    """
    row, col = scene.cells
    cell = row * scene.region.grid_shape[1] + col
    landmarks = scene.landmarks
    found = {
        "cell": packed(cell, 1.0),
        "position": packed(frame.inverse()(landmarks.position) * length, POSITION_STEP_GSD * scene.gsd * length),
        "normal": packed(landmarks.normal @ frame.rotation, NORMAL_STEP),
        "views": packed(np.diff(scene.tracks.start), 1.0),
    }
    if scene.reflectance is not None:
        found["albedo"] = packed(landmarks.albedo, share_of_peak(landmarks.albedo, ALBEDO_LEVELS))
        residual = 100.0 * landmark_photometric_error(scene, remove_scale_and_bias=True)
        found["residual"] = packed(residual, three_digits(residual))
    unknown = {"unknown_normal": ~normal_is_known(scene), "unknown_albedo": ~albedo_is_known(scene)}
    found |= {name: packed(marked, 1.0) for name, marked in unknown.items() if marked.any()}
    return found | _sigmas(scene, length)


def _sigmas(scene: Scene, length: float) -> Content:
    """Standard deviations of position and height [the page's unit of length], normal [degrees], albedo [%]."""
    found = {}
    for name, values in known_sigmas(scene).items():
        quantity = name.split("_sigma_")[0]
        in_unit = values * scene.gsd * length if name.endswith("_gsd") else values
        found[f"sigma_{quantity}"] = packed(in_unit, three_digits(in_unit))
    return found


def _surroundings(scene: Scene, length: float) -> Content | None:
    """Depths of the ground around the map, which casts shadows; None where it is not known."""
    around = scene.surroundings
    if around is None:
        return None
    depth = packed(around.depth.ravel() * length, POSITION_STEP_GSD * scene.gsd * length)
    rows, cols = around.depth.shape
    return {"depth": depth, "rows": rows, "cols": cols, "stride": around.stride}
