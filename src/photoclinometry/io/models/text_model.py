"""The text format of the paper's authors: COLMAP's, with Suns, brightness, normals and albedos added.

    cameras.txt    CAMERA_ID MODEL WIDTH HEIGHT PARAMS...
    images.txt     IMAGE_ID QW QX QY QZ TX TY TZ SX SY SZ CAMERA_ID NAME SCALE BIAS, and on the next line
                   X Y INTENSITY POINT3D_ID of each keypoint
    points3D.txt   POINT3D_ID X Y Z NX NY NZ ALBEDO R G B ERROR, and IMAGE_ID POINT2D_IDX of each observation

Q and T are cam_from_body, S is the unit vector from the body towards the Sun in the camera frame. Keypoints and
principal points are as in `Camera`. POINT3D_ID of a keypoint may be -1 (the authors' files have -1 throughout); the
tracks of points3D.txt are decisive. INTENSITY is negative where the brightness was omitted.
Driver et al. (2025), data and code: github.com/travisdriver/phomo, huggingface.co/datasets/travisdriver/phomo-data.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry import __version__
from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.models.colmap import distinct_cameras, grey_levels, reprojection_rms_px
from photoclinometry.io.models.text_model_files import (
    CAMERA_FIELDS,
    IMAGE_FIELDS,
    KEYPOINT_FIELDS,
    POINT_FIELDS,
    ImageLines,
    check_point_ids,
    keypoint_rows,
    read_cameras,
    read_images,
    read_points,
)
from photoclinometry.io.site import DEFAULT_SUN_SIGMA_RAD
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.reference_pixels import pixels_of_landmarks
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views

DEFAULT_KEYPOINT_SIGMA_PX = 1.0
"""Standard deviation of keypoints [px], which the files do not hold: the paper's value."""

_FILES = ("cameras.txt", "images.txt", "points3D.txt")
_UNIT = 1e-12
"""Vectors this near to unit length are kept as read, so that what was written reads back the same."""


@dataclass(frozen=True, kw_only=True)
class TextModel:
    """A model as a scene, with the identifiers of its images and points in the files."""

    scene: Scene
    image_id: np.ndarray
    """(K,) int64 of each view."""
    point_id: np.ndarray
    """(J,) int64 of each landmark."""


def read_text_model(
    folder: Path | str,
    *,
    brightness: str = "iof",
    reflectance: Reflectance | None = None,
    body: str | None = None,
    reference: str | None = None,
    keypoint_sigma_px: float = DEFAULT_KEYPOINT_SIGMA_PX,
    sun_sigma_rad: float = DEFAULT_SUN_SIGMA_RAD,
    shadow_threshold: float = 0.0,
) -> TextModel:
    """The model in a folder as a Scene; views and landmarks in the files' order.

    The arguments give the data that the files do not hold: the kind of brightness ("iof" or "dn"), the reflectance, the
    body, the name of the reference image (default: the first), the standard deviations of keypoints [px] and Suns
    [rad], and the brightness below which a keypoint is in shadow. Albedos are not rescaled: the authors' are in units
    of their phase function at zero phase. The Sun of each image serves as measurement and as first estimate.
    Landmarks get pixels of the reference image by `pixels_of_landmarks`. Colours, point errors and keypoints without a
    track are dropped. Raises InputError, with file and line, for models that are missing, damaged or contradictory.
    """
    folder = Path(folder)
    cameras_file, images_file, points_file = (folder / name for name in _FILES)
    images = read_images(images_file, read_cameras(cameras_file))
    points = read_points(points_file)
    views = _views(images, sun_sigma_rad)
    image, row = keypoint_rows(points_file, points, images)
    check_point_ids(images_file, images, points, row)
    xy = np.concatenate([i.xy for i in images])[row]
    level = np.concatenate([i.brightness for i in images])[row]
    lit = level >= max(shadow_threshold, 0.0)
    tracks = Tracks(
        start=points.start,
        view=image.astype(np.int32),
        keypoint=xy,
        keypoint_sigma=np.full(len(xy), float(keypoint_sigma_px)),
        brightness=np.where(lit, level, 0.0),
        lit=lit,
    )
    chosen = 0 if reference is None else _reference(images_file, views.name, reference)
    in_reference = _reference_xy(views, tracks, points.column[:, 1:4], chosen)
    try:
        pixel, region = pixels_of_landmarks(in_reference, views.cameras[chosen])
    except InputError as error:
        raise InputError(f"{points_file}: {error}") from error
    scene = Scene(
        name=folder.resolve().name,
        body=body,
        brightness=brightness,
        reflectance=reflectance,
        views=views,
        landmarks=Landmarks(
            position=points.column[:, 1:4].copy(),
            normal=_units(points.column[:, 4:7]),
            albedo=points.column[:, 7].copy(),
            pixel=pixel,
        ),
        tracks=tracks,
        reference=chosen,
        region=region,
    )
    return TextModel(scene=scene, image_id=np.array([i.id for i in images], np.int64), point_id=points.id)


def model_fingerprint(folder: Path) -> str:
    """SHA-256 (hex) of the three files of a model."""
    whole = hashlib.sha256()
    for name in _FILES:
        with open(folder / name, "rb") as file:
            whole.update(hashlib.file_digest(file, "sha256").digest())
    return whole.hexdigest()


def write_text_model(
    folder: Path | str, scene: Scene, *, image_id: np.ndarray | None = None, point_id: np.ndarray | None = None
) -> None:
    """Write the scene as a text model, which `read_text_model` reads back.

    Keypoints, brightness, positions, normals, albedos, scales, biases and intrinsics are kept to the last bit, poses
    and Suns to 1e-15. The Suns are the estimated ones, so that refining a refined model takes them for measurements.
    Brightness that is not lit is written as -1. A point's colour is its albedo, its error the RMS residual of its
    keypoints [px]. image_id (K,), point_id (J,): identifiers in the files, by default from 0. The folder is replaced
    whole or not at all. Raises InputError for values that the format cannot hold (names with spaces, negative
    brightness that is lit), and RunFolderError if it cannot be written.
    """
    images = np.arange(len(scene.views)) if image_id is None else np.asarray(image_id)
    points = np.arange(len(scene.landmarks)) if point_id is None else np.asarray(point_id)
    _check_writable(scene)
    index = _index_in_view(scene.tracks, len(scene.views))
    with atomic_path(folder) as temporary:
        temporary.mkdir()
        parts = (
            _camera_lines(scene),
            _image_lines(scene, images, points),
            _point_lines(scene, images, points, index),
        )
        for name, lines in zip(_FILES, parts, strict=True):
            with open(temporary / name, "w", encoding="utf-8", newline="\n") as file:
                file.writelines(line + "\n" for line in lines)


def _check_writable(scene: Scene) -> None:
    for name in scene.views.name:
        if name.split() != [name]:
            raise InputError(f"view {name!r}: a text model separates values by spaces; rename the image without any")
    tracks = scene.tracks
    negative = np.flatnonzero(tracks.lit & (tracks.brightness < 0))
    if len(negative):
        level, name = tracks.brightness[negative[0]], scene.views.name[tracks.view[negative[0]]]
        raise InputError(
            f"the brightness {level:g} of a keypoint in {name} is lit and negative, which a text model omits; "
            "mark it as not lit, or give the images an offset"
        )


def _index_in_view(tracks: Tracks, view_count: int) -> np.ndarray:
    """(N,) index of each observation among those of its view, in the order of the tracks."""
    index = np.empty(len(tracks), np.int64)
    for k in range(view_count):
        seen = np.flatnonzero(tracks.view == k)
        index[seen] = np.arange(len(seen))
    return index


def _header(what: str, count: int, *fields: str) -> list[str]:
    lines = [f"# Text model of Photoclinometry-from-Motion, written by photoclinometry {__version__}"]
    return [*lines, *(f"# {field}" for field in fields), f"# Number of {what}: {count}"]


def _camera_lines(scene: Scene) -> Iterator[str]:
    cameras = distinct_cameras(scene)
    yield from _header("cameras", len(cameras), CAMERA_FIELDS)
    for number, camera in enumerate(cameras):
        yield " ".join(map(str, (number, camera.model, camera.width, camera.height, *map(float, camera.params))))


def _image_lines(scene: Scene, image_id: np.ndarray, point_id: np.ndarray) -> Iterator[str]:
    from scipy.spatial.transform import Rotation

    views, tracks = scene.views, scene.tracks
    cameras = distinct_cameras(scene)
    cam_from_body = views.body_from_cam.inverse()
    wxyz = Rotation.from_matrix(cam_from_body.rotation).as_quat(canonical=True, scalar_first=True)
    sun = np.einsum("kij,kj->ki", cam_from_body.rotation, views.sun)
    number = np.concatenate([wxyz, cam_from_body.translation, sun], -1).tolist()
    brightness = np.where(tracks.lit, tracks.brightness, -1.0)
    point = np.asarray(point_id)[tracks.landmark]
    yield from _header("images", len(views), IMAGE_FIELDS, f"{KEYPOINT_FIELDS} of each keypoint")
    for k, name in enumerate(views.name):
        camera = cameras.index(views.cameras[k])
        light = (float(views.scale[k]), float(views.bias[k]))
        yield " ".join(map(str, (image_id[k], *number[k], camera, name, *light)))
        seen = tracks.view == k
        columns = (*tracks.keypoint[seen].T.tolist(), brightness[seen].tolist(), point[seen].tolist())
        yield " ".join([f"{x!r} {y!r} {level!r} {j}" for x, y, level, j in zip(*columns, strict=True)])


def _point_lines(scene: Scene, image_id: np.ndarray, point_id: np.ndarray, index: np.ndarray) -> Iterator[str]:
    landmarks, tracks = scene.landmarks, scene.tracks
    numbers = np.column_stack([landmarks.position, landmarks.normal, landmarks.albedo]).tolist()
    grey = grey_levels(landmarks.albedo).tolist()
    error = reprojection_rms_px(scene).tolist()
    start, image, place = tracks.start.tolist(), image_id[tracks.view].tolist(), index.tolist()
    yield from _header("points", len(landmarks), f"{POINT_FIELDS}, and IMAGE_ID POINT2D_IDX of each observation")
    for j, number in enumerate(point_id.tolist()):
        rows = slice(start[j], start[j + 1])
        track = [f"{k} {i}" for k, i in zip(image[rows], place[rows], strict=True)]
        yield " ".join([str(number), *map(repr, numbers[j]), *[str(grey[j])] * 3, repr(error[j]), *track])


def _views(images: Sequence[ImageLines], sun_sigma_rad: float) -> Views:
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_quat([i.wxyz for i in images], scalar_first=True).as_matrix()
    body_from_cam = Rigid(rotation, np.array([i.translation for i in images])).inverse()
    sun = _units(np.array([i.sun for i in images]))
    return Views(
        name=tuple(i.name for i in images),
        cameras=tuple(i.camera for i in images),
        body_from_cam=body_from_cam,
        sun=np.einsum("kij,kj->ki", body_from_cam.rotation, sun),
        scale=np.array([i.scale for i in images]),
        bias=np.array([i.bias for i in images]),
        dark_level=np.zeros(len(images)),
        sun_measured=sun,
        sun_sigma=np.full(len(images), float(sun_sigma_rad)),
        sun_common_sigma=np.zeros(len(images)),
        arc=np.zeros(len(images), int),
    )


def _reference(path: Path, names: Sequence[str], name: str) -> int:
    if name not in names:
        raise InputError(f"{path}: holds no image {name!r} to be the reference; it holds {', '.join(names)}")
    return list(names).index(name)


def _reference_xy(views: Views, tracks: Tracks, position: np.ndarray, reference: int) -> np.ndarray:
    """(J, 2) position of each landmark in the reference image [px]: its keypoint there, or else its projection."""
    xy = views.project(reference, position)
    seen = tracks.view == reference
    xy[tracks.landmark[seen]] = tracks.keypoint[seen]
    return xy


def _units(vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) scaled to unit length, unless they have it up to rounding."""
    # By the largest component first: squares of huge or tiny ones leave the range of doubles.
    scaled = vectors / np.abs(vectors).max(-1, keepdims=True)
    good = np.abs(np.linalg.norm(scaled, axis=-1) * np.abs(vectors).max(-1) - 1.0) < _UNIT
    return np.where(good[:, None], vectors, unit(scaled))
