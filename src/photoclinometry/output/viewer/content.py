"""What the viewer is given of a scene: numbers as JSON, and arrays as `arrays.packed` makes them.

Everything is in the map's local frame (`surface/relief.py`): origin in the middle of the map, x to the right and y up
in the reference image along the mean plane, z out of the ground. Lengths are metres, or ground sample distances of
the reference image where the scene's unit is unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from photoclinometry.evaluate.evaluate import landmark_photometric_error
from photoclinometry.evaluate.sigmas import landmark_sigmas
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import BODY_FIXED, Image, Scene
from photoclinometry.output.viewer.arrays import packed, share_of_peak, three_digits
from photoclinometry.output.viewer.pictures import pictures
from photoclinometry.photometry.render import averaging_sigma, landmark_faces
from photoclinometry.surface.relief import angles_from_sun, local_frame

FORMAT = 1
"""Version of what the page's program reads."""
_POSITION_STEP_GSD = 1e-3
"""Step of stored positions: a thousandth of a ground sample, a tenth of their smallest standard deviations."""
_NORMAL_STEP = 1.0 / 2**15
"""Step of stored components of normals: 0.002 degrees."""
_ALBEDO_LEVELS = 20_000
"""Steps from zero to the greatest albedo: 0.005 %."""

Content = dict[str, Any]


def viewer_content(scene: Scene, images: Sequence[Image] = ()) -> Content:
    """The scene for the page. images: of its views, in any order; without them the page compares with none."""
    frame = local_frame(scene)
    length = 1.0 if scene.unit else 1.0 / scene.gsd
    return {
        "format": FORMAT,
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
        "views": _views(scene, frame, length),
        "reflectance": _reflectance(scene.reflectance),
        "place": _place(scene, frame),
        "landmarks": _landmarks(scene, frame, length),
        "faces": packed(landmark_faces(scene), 1.0),
        "surroundings": _surroundings(scene, length),
        "pictures": pictures(scene, images),
    }


def _views(scene: Scene, frame: Rigid, length: float) -> list[Content]:
    """Camera, pose, Sun and exposure of each view; `averaging` is `render.averaging_sigma` [landmarks]."""
    views, found = scene.views, []
    for k, name in enumerate(views.name):
        camera, pose = views.cameras[k], frame.inverse() @ views.body_from_cam[k]
        azimuth, elevation = np.degrees(angles_from_sun(frame, views.sun[k]))
        found.append(
            {
                "name": name,
                "width": camera.width,
                "height": camera.height,
                "focal": list(camera.focal_px),
                "principal": list(camera.principal_px),
                "local_from_cam": pose.rotation.tolist(),
                "center": (pose.translation * length).tolist(),
                "sun_azimuth_deg": azimuth,
                "sun_elevation_deg": elevation,
                "scale": float(views.scale[k]),
                "bias": float(views.bias[k]),
                "averaging": averaging_sigma(scene, k),
            }
        )
    return found


def _reflectance(reflectance: Reflectance | None) -> Content | None:
    """The model's statement for the graphics processor, and its numbers; None where the page cannot render."""
    if reflectance is None or reflectance.model.shader is None or not np.isfinite(reflectance.packed).all():
        return None
    names, units, _ = reflectance.described
    return {
        "name": reflectance.name,
        "shader": reflectance.model.shader,
        "packed": reflectance.packed.tolist(),
        "parameters": names,
        "units": units,
        "absolute": reflectance.predicts_absolute_brightness,
    }


def _place(scene: Scene, frame: Rigid) -> Content:
    """Where the map lies: its local frame in B, and whether that is body-fixed, so that north is known."""
    return {
        "body_fixed": scene.frame == BODY_FIXED,
        "body_from_local": frame.rotation.tolist(),
        "origin": frame.translation.tolist(),
    }


def _landmarks(scene: Scene, frame: Rigid, length: float) -> Content:
    """Arrays of the landmarks in the scene's order; `cell` counts the map's grid row by row."""
    row, col = scene.cells
    cell = row * scene.region.grid_shape[1] + col
    landmarks = scene.landmarks
    found = {
        "cell": packed(cell, 1.0),
        "position": packed(frame.inverse()(landmarks.position) * length, _POSITION_STEP_GSD * scene.gsd * length),
        "normal": packed(landmarks.normal @ frame.rotation, _NORMAL_STEP),
        "views": packed(np.diff(scene.tracks.start), 1.0),
    }
    if scene.reflectance is not None:
        found["albedo"] = packed(landmarks.albedo, share_of_peak(landmarks.albedo, _ALBEDO_LEVELS))
        residual = 100.0 * landmark_photometric_error(scene, remove_scale_and_bias=True)
        found["residual"] = packed(residual, three_digits(residual))
    return found | _sigmas(scene, length)


def _sigmas(scene: Scene, length: float) -> Content:
    """Standard deviations of position and height [the page's unit of length], normal [degrees], albedo [%]."""
    found = {}
    for name, values in landmark_sigmas(scene).items():
        quantity = name.split("_sigma_")[0]
        in_unit = values * scene.gsd * length if name.endswith("_gsd") else values
        found[f"sigma_{quantity}"] = packed(in_unit, three_digits(in_unit))
    return found


def _surroundings(scene: Scene, length: float) -> Content | None:
    """Depths of the ground around the map, which casts shadows; None where it is not known."""
    around = scene.surroundings
    if around is None:
        return None
    depth = packed(around.depth.ravel() * length, _POSITION_STEP_GSD * scene.gsd * length)
    rows, cols = around.depth.shape
    return {"depth": depth, "rows": rows, "cols": cols, "stride": around.stride}
