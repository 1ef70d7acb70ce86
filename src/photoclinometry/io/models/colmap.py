"""COLMAP's binary models (cameras.bin, images.bin, points3D.bin), read and written without pycolmap.

pycolmap 4.2 does not detect a truncated model (it allocates without bound, or never returns) nor a full disk (it
writes half a model and reports success). The format is small enough to be checked here, and every version of COLMAP
reads these three files. https://colmap.github.io/format.html#binary-file-format
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.reading import read_bytes
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.projection import keypoint_residuals
from photoclinometry.model.scene import Scene

MAX_POINTS = 20_000
"""Landmarks in the model of a run folder, evenly chosen: viewers slow down beyond some ten thousand."""

_MODELS = {0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4)}
"""Camera models by COLMAP's number: name and count of parameters."""
_MODEL_IDS = {name: number for number, (name, _) in _MODELS.items()}
_PARAMETERS_OF_OTHERS = {2: 4, 3: 5, 4: 8, 5: 8, 6: 12, 7: 5, 8: 4, 9: 5, 10: 12}
"""Count of parameters of the models with distortion, to skip them."""
_WHITE_PERCENT = 99.0
"""Percentile of the albedo that is coloured white; single bright points would darken all others."""
_UNIT_TOLERANCE = 1e-3
"""A quaternion farther from unit length is damage."""
_POINT2D = np.dtype([("xy", "<f8", 2), ("point", "<i8")])
_ELEMENT = np.dtype([("image", "<u4"), ("index", "<u4")])


def write_colmap(folder: Path | str, scene: Scene, max_points: int = MAX_POINTS) -> None:
    """The scene's poses, intrinsics and up to `max_points` landmarks with their tracks, coloured by albedo.

    Identifiers of cameras, images and points count from 1, images in the order of the views. The folder is
    replaced whole or not at all. Raises RunFolderError.
    """
    count = len(scene.landmarks)
    chosen = np.unique(np.linspace(0, count - 1, min(count, max_points)).astype(np.int64))
    point_of_landmark = np.zeros(count, np.int64)
    point_of_landmark[chosen] = 1 + np.arange(len(chosen))
    with atomic_path(folder) as temporary:
        temporary.mkdir()
        (temporary / "cameras.bin").write_bytes(_cameras_bytes(scene))
        images, index = _images_bytes(scene, point_of_landmark)
        (temporary / "images.bin").write_bytes(images)
        (temporary / "points3D.bin").write_bytes(_points_bytes(scene, chosen, index))


def read_colmap(folder: Path | str) -> tuple[tuple[str, ...], tuple[Camera, ...], Rigid, np.ndarray]:
    """Names, cameras, body_from_cam (K,) of the images sorted by name, and the points (P, 3) in B.

    Raises InputError for models that are missing, damaged, or use a camera with distortion.
    """
    folder = Path(folder)
    cameras = _read_cameras(_Bytes(folder / "cameras.bin"))
    images = _read_images(_Bytes(folder / "images.bin"), cameras)
    points = _read_points(_Bytes(folder / "points3D.bin"))
    images.sort(key=lambda image: image[0])
    names, wxyz, translation, used = zip(*images, strict=True)
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_quat(np.array(wxyz), scalar_first=True).as_matrix()
    return names, used, Rigid(rotation, np.array(translation)).inverse(), points


def _cameras_bytes(scene: Scene) -> bytes:
    cameras = distinct_cameras(scene)
    parts = [struct.pack("<Q", len(cameras))]
    for number, camera in enumerate(cameras, start=1):
        parts.append(struct.pack("<IiQQ", number, _MODEL_IDS[camera.model], camera.width, camera.height))
        parts.append(np.array(camera.params, "<f8").tobytes())
    return b"".join(parts)


def distinct_cameras(scene: Scene) -> list[Camera]:
    """The distinct cameras of the views, in the order of their first use."""
    return list(dict.fromkeys(scene.views.cameras))


def _images_bytes(scene: Scene, point_of_landmark: np.ndarray) -> tuple[bytes, np.ndarray]:
    """The content of images.bin, and (N,) the index of each observation among its image's keypoints."""
    from scipy.spatial.transform import Rotation

    views, tracks = scene.views, scene.tracks
    cam_from_body = views.body_from_cam.inverse()
    wxyz = Rotation.from_matrix(cam_from_body.rotation).as_quat(canonical=True, scalar_first=True)
    point = point_of_landmark[tracks.landmark]
    index = np.zeros(len(tracks), np.int64)
    cameras = distinct_cameras(scene)
    parts = [struct.pack("<Q", len(views))]
    for k, name in enumerate(views.name):
        seen = np.flatnonzero((tracks.view == k) & (point > 0))
        index[seen] = np.arange(len(seen))
        points = np.empty(len(seen), _POINT2D)
        points["xy"], points["point"] = tracks.keypoint[seen], point[seen]
        pose = (*wxyz[k], *cam_from_body.translation[k])
        parts.append(struct.pack("<I7dI", k + 1, *pose, 1 + cameras.index(views.cameras[k])))
        parts.append(name.encode() + b"\0" + struct.pack("<Q", len(seen)) + points.tobytes())
    return b"".join(parts), index


def _points_bytes(scene: Scene, chosen: np.ndarray, index: np.ndarray) -> bytes:
    """The content of points3D.bin; a point's error is its `reprojection_rms_px`."""
    tracks, landmarks = scene.tracks, scene.landmarks
    errors = reprojection_rms_px(scene)
    grey = grey_levels(landmarks.albedo)
    parts = [struct.pack("<Q", len(chosen))]
    for number, j in enumerate(chosen, start=1):
        rows = slice(tracks.start[j], tracks.start[j + 1])
        track = np.empty(rows.stop - rows.start, _ELEMENT)
        track["image"], track["index"] = tracks.view[rows] + 1, index[rows]
        colour = (int(grey[j]),) * 3
        parts.append(struct.pack("<Q3d3BdQ", number, *landmarks.position[j], *colour, errors[j], len(track)))
        parts.append(track.tobytes())
    return b"".join(parts)


def reprojection_rms_px(scene: Scene) -> np.ndarray:
    """(J,) RMS distance between each landmark's keypoints and projections [px]; -1 (COLMAP's) without keypoints."""
    tracks = scene.tracks
    squared = np.sum(keypoint_residuals(scene) ** 2, -1)
    count = np.diff(tracks.start)
    mean = np.bincount(tracks.landmark, squared, len(count)) / np.maximum(count, 1)
    return np.where(count > 0, np.sqrt(mean), -1.0)


def grey_levels(albedo: np.ndarray) -> np.ndarray:
    """(J,) uint8: 0 for albedo 0, 255 for the 99th percentile and above."""
    top = float(np.nanpercentile(albedo, _WHITE_PERCENT)) if len(albedo) else 1.0
    return np.clip(np.nan_to_num(255.0 * albedo / (top if top > 0 else 1.0)), 0, 255).astype(np.uint8)


class _Bytes:
    """A file's bytes, unpacked in order. Raises InputError at the end of the data."""

    def __init__(self, path: Path):
        self.path = path
        self.at = 0
        remedy = (
            "give the folder of a COLMAP model in binary form (`colmap model_converter --output_type BIN` makes one)"
        )
        self.data = read_bytes(path, remedy=remedy)

    def unpack(self, form: str) -> tuple[Any, ...]:
        form = "<" + form
        return struct.unpack(form, self.take(struct.calcsize(form)))

    def take(self, size: int) -> bytes:
        if size > len(self.data) - self.at:
            raise self.error(f"it ends after {len(self.data)} bytes, {self.at + size} are announced")
        self.at += size
        return self.data[self.at - size : self.at]

    def text(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise self.error("a name without end")
        name = self.take(end + 1 - self.at)[:-1]
        try:
            return name.decode()
        except UnicodeDecodeError as error:
            raise self.error(f"the name {name[:40]!r} is not UTF-8") from error

    def error(self, what: str) -> InputError:
        return InputError(f"{self.path}: is not a complete COLMAP model ({what}); export it again")


def _read_cameras(data: _Bytes) -> dict[int, Camera | str]:
    """Cameras by identifier; instead of a camera with distortion, the reason why it cannot be used."""
    cameras: dict[int, Camera | str] = {}
    for _ in range(data.unpack("Q")[0]):
        number, model, width, height = data.unpack("IiQQ")
        if model in _MODELS:
            name, count = _MODELS[model]
            params = data.unpack(f"{count}d")
            if not np.isfinite(params).all():
                raise data.error(f"camera {number} has parameters that are not finite")
            try:
                cameras[number] = Camera(name, width, height, params)
            except InputError as error:
                raise data.error(f"camera {number}: {error}") from error
        elif model in _PARAMETERS_OF_OTHERS:
            data.take(8 * _PARAMETERS_OF_OTHERS[model])
            cameras[number] = f"camera {number} has a distortion model (COLMAP's number {model})"
        else:
            raise data.error(f"camera {number} has the unknown model number {model}")
    return cameras


def _read_images(data: _Bytes, cameras: dict[int, Camera | str]) -> list[tuple[str, list[float], list[float], Camera]]:
    """(name, wxyz, translation, camera) of each image, in the file's order."""
    images = []
    for _ in range(data.unpack("Q")[0]):
        number, *pose, camera_number = data.unpack("I7dI")
        name = data.text()
        data.take(_POINT2D.itemsize * data.unpack("Q")[0])
        camera = cameras.get(camera_number)
        if isinstance(camera, str):
            raise InputError(f"{data.path}: {camera}; undistort the model first (colmap image_undistorter)")
        if camera is None:
            raise data.error(f"image {number} uses camera {camera_number}, which does not exist")
        if not np.isfinite(pose).all() or abs(math.hypot(*pose[:4]) - 1.0) > _UNIT_TOLERANCE:
            raise data.error(f"image {number} has no valid pose")
        images.append((name, pose[:4], pose[4:], camera))
    if not images:
        raise InputError(f"{data.path}: holds no image; give a model with registered images")
    return images


def _read_points(data: _Bytes) -> np.ndarray:
    points = []
    for _ in range(data.unpack("Q")[0]):
        *_, x, y, z, _red, _green, _blue, _error, length = data.unpack("Q3d3BdQ")
        data.take(_ELEMENT.itemsize * length)
        points.append((x, y, z))
    return np.array(points, float).reshape(-1, 3)
