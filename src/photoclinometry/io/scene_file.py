"""`scene.h5`: a Scene as HDF5, exact to the last bit.

Every dataset has the attributes `unit`, `frame` ("B" body-fixed, "C" camera, "image", or "-") and `description`, and
checksums, so that damage is noticed on reading. Lengths are in the unit of frame B: metres where it is body-fixed.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike

from photoclinometry import __version__
from photoclinometry.io.hdf5 import check_hdf5, new_hdf5
from photoclinometry.model.camera import Camera
from photoclinometry.model.error_correlation import ErrorCorrelation
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import MODELS, Reflectance
from photoclinometry.model.region import Region
from photoclinometry.model.scene import (
    BODY_FIXED,
    OWN,
    SHARED,
    VIEW_ARRAYS,
    Landmarks,
    Scene,
    Surroundings,
    Tracks,
    Views,
)

FORMAT = "photoclinometry scene"
VERSION = 1

# Unit, frame and description of each dataset. LENGTH and BRIGHTNESS are replaced by the scene's units.
_LENGTH, _BRIGHTNESS = "LENGTH", "BRIGHTNESS"
_VIEWS = {
    "name": ("-", "-", "name of each view: its image path as site.toml writes it"),
    "camera": ("-", "-", "index of each view's camera"),
    "rotation": ("1", "B", "body_from_cam rotation matrices (K, 3, 3): x_B = rotation x_C + translation"),
    "translation": (_LENGTH, "B", "camera centres (K, 3)"),
    "sun": ("1", "B", "estimated unit vectors from the body towards the Sun (K, 3)"),
    "scale": ("1", "-", "measured brightness = scale * model + bias"),
    "bias": (_BRIGHTNESS, "-", "measured brightness = scale * model + bias"),
    "dark_level": (_BRIGHTNESS, "-", "had been taken from the measured brightness of uncalibrated images before"),
    "sun_measured": ("1", "C", "measured unit vectors from the body towards the Sun (K, 3)"),
    "sun_sigma": ("rad", "C", "standard deviation of each view's own error of sun_measured about each tangent axis"),
    "sun_common_sigma": (
        "rad",
        "C",
        "standard deviation of the rotation that errors of all sun_measured of an arc share",
    ),
    "arc": ("-", "-", "number of the arc of attitude and orbit that each view's Sun and pose prior are of"),
}
_LATER = {"sun_common_sigma": float, "dark_level": float, "arc": int}
"""Fields that older files do not have, with their types: zero there."""
_LANDMARKS = {
    "position": (_LENGTH, "B", "landmark positions (J, 3)"),
    "normal": ("1", "B", "outward unit normals (J, 3)"),
    "albedo": (_BRIGHTNESS, "-", "normal albedo where brightness is I/F, else relative albedo"),
    "pixel": ("px", "image", "(row, col) of each landmark's pixel in the reference image"),
}
_TRACKS = {
    "start": ("-", "-", "observations of landmark j are start[j] to start[j + 1]"),
    "view": ("-", "-", "index of the view of each observation"),
    "keypoint": ("px", "image", "(x, y) of each observation; (0.5, 0.5) is the centre of the top-left pixel"),
    "keypoint_sigma": ("px", "image", "standard deviation of each keypoint coordinate"),
    "brightness": (_BRIGHTNESS, "-", "brightness at the keypoint; valid only where lit"),
    "lit": ("-", "-", "whether the keypoint is lit and its brightness valid"),
}
_DEPTH = (
    _LENGTH,
    "C",
    "depth in the reference camera of the ground around the map, at every `stride`-th pixel; NaN where unknown",
)
_CORRELATION = {
    "length_px": ("px", "image", "lengths of exponentials of the distance between landmarks in the reference image"),
    "share": ("1", "-", "shares of the variance of positions that these have; the rest is of each landmark alone"),
    "frame": (
        "rad, unit of length of B, 1",
        "B",
        "covariance of rotation, translation and scale of the frame about the pivot; empty where it is the map's own",
    ),
    "pivot": (_LENGTH, "B", "what the frame turns about"),
}
_UNCERTAINTY_UNITS = {
    "position": (_LENGTH, "B"),
    "translation": (_LENGTH, "B"),
    "center": (_LENGTH, "B"),
    "normal": ("rad", "B"),
    "rotation": ("rad", "C"),
    "sun": ("rad", "B"),
    "albedo": (_BRIGHTNESS, "-"),
    "bias": (_BRIGHTNESS, "-"),
    "scale": ("1", "-"),
}


def write_scene(path: Path | str, scene: Scene) -> None:
    """The whole scene as one file. Raises RunFolderError."""
    with new_hdf5(path) as file:
        file.attrs.update(format=FORMAT, version=VERSION, written_by=f"photoclinometry {__version__}")
        file.attrs.update(name=scene.name, brightness=scene.brightness, reference=scene.reference)
        if scene.body is not None:
            file.attrs["body"] = scene.body
        file.attrs["frame"] = scene.frame
        file.create_group("region").attrs.update({f.name: getattr(scene.region, f.name) for f in fields(Region)})
        if scene.reflectance is not None:
            model = file.create_group("reflectance")
            model.attrs["name"] = scene.reflectance.name
            names, units, meaning = scene.reflectance.described
            _Writer(model, scene)("parameters", scene.reflectance.values, (units, "-", f"{names}: {meaning}"))
        _write_views(file, scene)
        for group, part, spec in (
            ("landmarks", scene.landmarks, _LANDMARKS),
            ("tracks", scene.tracks, _TRACKS),
        ):
            write = _Writer(file.create_group(group), scene)
            for name, about in spec.items():
                write(name, getattr(part, name), about)
        if scene.surroundings is not None:
            group = file.create_group("surroundings")
            group.attrs["stride"] = scene.surroundings.stride
            _Writer(group, scene)("depth", scene.surroundings.depth, _DEPTH)
        write = _Writer(file.create_group("uncertainty"), scene)
        for name, sigma in scene.uncertainty.items():
            unit, frame = _UNCERTAINTY_UNITS.get(name, ("as the quantity", "as the quantity"))
            if np.ndim(sigma) == 3:
                unit = f"{write.units.get(unit, unit)} squared"
            kind = "covariance" if np.ndim(sigma) == 3 else "standard deviation"
            write(name, sigma, (unit, frame, f"{kind} of {name}"))
        if scene.error_correlation is not None:
            write = _Writer(file.create_group("error_correlation"), scene)
            for name, about in _CORRELATION.items():
                write(name, getattr(scene.error_correlation, name), about)


def read_scene(path: Path | str) -> Scene:
    """The scene that `write_scene` wrote, with the same values and types.

    Raises RunFolderError if the file is missing, damaged, of another version, or not a scene.
    """
    path = Path(path)
    if not path.is_file():
        raise RunFolderError(f"{path}: there is no such file; run the site first, or check the path")
    check_hdf5(path, "scene file", "run the site again", RunFolderError)
    try:
        with h5py.File(path, "r") as file:
            _check_version(path, file)
            scene = _read(file)
    except InputError:
        raise
    # A damaged file makes h5py raise nearly every built-in exception.
    except Exception as error:
        first_line = str(error).splitlines()[0] if str(error) else ""
        raise RunFolderError(
            f"{path}: is not a scene file, or is damaged ({type(error).__name__}: {first_line}); run the site again"
        ) from error
    fault = _inconsistency(scene)
    if fault:
        raise RunFolderError(f"{path}: contradicts itself ({fault}); run the site again")
    return scene


class _Writer:
    """Writes datasets of one group with their attributes."""

    def __init__(self, group: h5py.Group, scene: Scene):
        self.group = group
        brightness = "I/F" if scene.brightness == "iof" else "DN"
        self.units = {_LENGTH: scene.unit or "unit of length of B", _BRIGHTNESS: brightness}

    def __call__(self, name: str, values: ArrayLike, about: tuple[str, str, str]) -> None:
        values = np.asarray(values)
        if values.dtype.kind == "U":
            values = np.char.encode(values, "utf-8")
        checked = {"fletcher32": True} if values.size and values.ndim else {}
        dataset = self.group.create_dataset(name, data=values, **checked)
        unit, frame, description = about
        dataset.attrs.update(unit=self.units.get(unit, unit), frame=frame, description=description)


def _write_views(file: h5py.File, scene: Scene) -> None:
    views = scene.views
    cameras = list(dict.fromkeys(views.cameras))
    for number, camera in enumerate(cameras):
        group = file.create_group(f"cameras/{number}")
        group.attrs.update(model=camera.model, width=camera.width, height=camera.height)
        order = "f, cx, cy" if camera.model == "SIMPLE_PINHOLE" else "fx, fy, cx, cy"
        _Writer(group, scene)("params", np.array(camera.params, float), ("px", "image", order))
    values = {f.name: getattr(views, f.name) for f in fields(Views)}
    values["name"] = np.array(views.name)
    values["camera"] = np.array([cameras.index(c) for c in views.cameras], np.int32)
    values["rotation"] = views.body_from_cam.rotation
    values["translation"] = views.body_from_cam.translation
    write = _Writer(file.create_group("views"), scene)
    for name, about in _VIEWS.items():
        write(name, values[name], about)


def _check_version(path: Path, file: Any) -> None:
    if file.attrs.get("format") != FORMAT:
        raise RunFolderError(f"{path}: is an HDF5 file, but not a photoclinometry scene; check the path")
    found = file.attrs.get("version")
    if found != VERSION:
        raise RunFolderError(
            f"{path}: is a scene of format version {found} ({file.attrs.get('written_by', 'unknown writer')}), "
            f"this is photoclinometry {__version__}, which reads version {VERSION}; run the site again"
        )


def _read(file: Any) -> Scene:
    reflectance = None
    if "reflectance" in file:
        model = file["reflectance"]
        earlier = "disk" in model.attrs  # files written before parameters had names
        parts = ("weight", "phase_coefficients") if earlier else ("parameters",)
        values = np.concatenate([model[part][()] for part in parts])
        name = str(model.attrs["disk" if earlier else "name"])
        reflectance = Reflectance(name, tuple(values.tolist()) if MODELS[name].parameters else ())
    return Scene(
        name=str(file.attrs["name"]),
        body=str(file.attrs["body"]) if "body" in file.attrs else None,
        brightness=str(file.attrs["brightness"]),
        reflectance=reflectance,
        views=_read_views(file),
        landmarks=Landmarks(**{name: file["landmarks"][name][()] for name in _LANDMARKS}),
        tracks=Tracks(**{name: file["tracks"][name][()] for name in _TRACKS}),
        reference=int(file.attrs["reference"]),
        region=Region(
            **{name: int(value) for name, value in file["region"].attrs.items()}
        ),  # stride is missing in older files
        uncertainty={name: dataset[()] for name, dataset in file["uncertainty"].items()},
        error_correlation=_read_correlation(file),
        surroundings=_read_surroundings(file),
        frame=str(file.attrs.get("frame", OWN)),  # missing in files written before pose priors were used
    )


def _read_correlation(file: Any) -> ErrorCorrelation | None:
    if "error_correlation" not in file:
        return None  # also in older files
    group = file["error_correlation"]
    return ErrorCorrelation(**{name: group[name][()] for name in _CORRELATION})


def _read_surroundings(file: Any) -> Surroundings | None:
    if "surroundings" not in file:
        return None
    group = file["surroundings"]
    return Surroundings(depth=group["depth"][()], stride=int(group.attrs["stride"]))


def _read_views(file: Any) -> Views:
    cameras = [
        Camera(
            str(group.attrs["model"]),
            int(group.attrs["width"]),
            int(group.attrs["height"]),
            tuple(group["params"][()].tolist()),
        )
        for group in (file[f"cameras/{number}"] for number in range(len(file["cameras"])))
    ]
    stored = file["views"]
    values = {name: stored[name][()] for name in _VIEWS if name in stored or name not in _LATER}
    for name, kind in _LATER.items():
        values.setdefault(name, np.zeros(len(values["name"]), kind))
    return Views(
        name=tuple(name.decode() for name in values.pop("name")),
        cameras=tuple(cameras[number] for number in values.pop("camera")),
        body_from_cam=Rigid(values.pop("rotation"), values.pop("translation")),
        **values,
    )


def _inconsistency(scene: Scene) -> str | None:
    """The first contradiction between the arrays of a scene, in words; None if there is none."""
    views, landmarks, tracks, region = scene.views, scene.landmarks, scene.tracks, scene.region
    k, j, n = len(views.name), len(landmarks.position), len(tracks.view)
    lengths = [
        *((getattr(views, name), k) for name in VIEW_ARRAYS),
        (views.cameras, k),
        (views.body_from_cam.rotation, k),
        (views.body_from_cam.translation, k),
        *((getattr(landmarks, name), j) for name in _LANDMARKS),
        (tracks.start, j + 1),
        *((getattr(tracks, name), n) for name in _TRACKS if name != "start"),
    ]
    if scene.frame not in (OWN, BODY_FIXED, SHARED):
        return f"its frame is {scene.frame!r}"
    if any(len(values) != expected for values, expected in lengths):
        return "arrays of different lengths"
    if tracks.start[0] != 0 or tracks.start[-1] != n or (np.diff(tracks.start) < 0).any():
        return "tracks do not add up"
    if n and not 0 <= tracks.view.min() <= tracks.view.max() < k:
        return "a track names a view that does not exist"
    if not 0 <= scene.reference < k:
        return "the reference view does not exist"
    inside = (landmarks.pixel >= (region.row, region.col)) & (
        landmarks.pixel < (region.row + region.height, region.col + region.width)
    )
    if not inside.all():
        return "a landmark lies outside the region"
    around = scene.surroundings
    if around is not None:
        camera = views.cameras[scene.reference]
        image = Region.of_image(camera.height, camera.width, stride=max(1, around.stride))
        if around.depth.shape != image.grid_shape:
            return "its surroundings have not the size of the reference image"
    if region.stride < 1 or ((landmarks.pixel - (region.row, region.col)) % region.stride).any():
        return "a landmark lies off the map's grid"
    return None
