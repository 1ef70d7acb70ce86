"""Keypoints and matches of all views, in COLMAP's database.

COLMAP registers no view whose principal point lies outside its picture, as that of a crop may. Its pictures are
therefore padded (`padding_px`). Keypoints are shifted by that where they enter COLMAP and where they leave it: all
functions here take and return pixels of the views' own images.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.atomic import unwritable
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import OutputError, PhotoclinometryError
from photoclinometry.model.image import Image
from photoclinometry.model.progress import Progress
from photoclinometry.sfm.keypoints import sift_keypoints
from photoclinometry.sfm.options import SfmOptions
from photoclinometry.sfm.pictures import brightness_picture, relief_picture

DATABASE = "database.db"

_PROBE = bytes(1 << 20)
"""Data written as a test to find out why COLMAP could not write."""

_LEFT_BY_SQLITE = ("", "-wal", "-shm", "-journal")
"""Endings of the files of a database."""


@contextmanager
def disk_errors(work_dir: Path) -> Iterator[None]:
    """Within the block, failures to write below `work_dir`, COLMAP's too, are an OutputError with the disk's reason.

    COLMAP and SQLite raise RuntimeErrors, which do not state the cause: a small file is written to find out. Where it
    can be written, errors other than SQLite's are left as they are.
    """
    try:
        yield
    except OSError as error:
        raise unwritable(Path(error.filename or work_dir), error) from error
    except RuntimeError as error:
        if isinstance(error, PhotoclinometryError):
            raise
        check_disk(work_dir, DATABASE)
        if "SQLite" in str(error) or "database" in str(error):
            raise OutputError(f"{work_dir / DATABASE}: cannot be written: {error}; check the disk") from error
        raise


def check_disk(work_dir: Path, file: str) -> None:
    """Raises OutputError with the disk's reason where nothing can be written in `work_dir`, such as `file` just now."""
    try:
        _probe(work_dir)
    except OSError as error:
        raise unwritable(work_dir / file, error) from error


def _probe(work_dir: Path) -> None:
    """Raises OSError where nothing can be written in `work_dir`."""
    path = work_dir / ".probe"
    try:
        with open(path, "wb") as stream:
            stream.write(_PROBE)
            stream.flush()
            os.fsync(stream.fileno())
    finally:
        with suppress(OSError):
            path.unlink()


def image_file(view: int) -> str:
    return f"{view:05d}.png"


def write_views(
    images: list[Image], cameras: list[Camera], work_dir: Path, options: SfmOptions, progress: Progress
) -> None:
    """A new database with the keypoints of every view; one COLMAP camera per distinct set of intrinsics."""
    import cv2
    import pycolmap

    pictures = work_dir / "images"
    pictures.mkdir(exist_ok=True)
    database_path = work_dir / DATABASE
    for ending in _LEFT_BY_SQLITE:
        database_path.with_name(DATABASE + ending).unlink(missing_ok=True)
    with pycolmap.Database.open(database_path) as database:
        view_cameras = _write_cameras(database, cameras)
        for view, image in enumerate(images):
            picture = brightness_picture(image)
            if not cv2.imwrite(str(pictures / image_file(view)), picture):
                _probe(pictures)
                raise OSError(None, "OpenCV cannot write this picture", str(pictures / image_file(view)))
            keypoints, descriptors = sift_keypoints(picture, image.valid, options.max_features)
            image_id = _write_view(database, view, view_cameras[view])
            database.write_keypoints(image_id, _padded(keypoints, cameras[view]))
            _write_descriptors(database, image_id, descriptors)
            progress("features", view + 1, len(images))


def padding_px(camera: Camera) -> np.ndarray:
    """(2,) columns on the left and rows on top that are added to the camera's image for COLMAP [px].

    The whole pixels that put the principal point inside; zero where its coordinates are not negative.
    """
    return np.maximum(np.ceil(np.negative(camera.principal_px)), 0.0)


def padded_size(camera: Camera) -> tuple[int, int]:
    """Width and height [px] of COLMAP's picture: the image with the padding that puts the principal point inside."""
    padding = padding_px(camera)
    far = np.maximum((camera.width, camera.height), np.ceil(camera.principal_px)) + padding
    return int(far[0]), int(far[1])


def to_colmap(camera: Camera) -> Any:
    """The pycolmap camera of the padded picture. Its pixels are those of the image plus `padding_px`."""
    import pycolmap

    width, height = padded_size(camera)
    *focal, cx, cy = camera.params
    left, top = padding_px(camera)
    return pycolmap.Camera(model=camera.model, width=width, height=height, params=[*focal, cx + left, cy + top])


def _padded(keypoints: np.ndarray, camera: Camera) -> np.ndarray:
    """Keypoints (n, 2 or more), x and y first, in the padded picture."""
    shifted = keypoints.copy()
    shifted[:, :2] += padding_px(camera).astype(keypoints.dtype)
    return shifted


def _write_cameras(database: Any, cameras: list[Camera]) -> list[Any]:
    """Each view's COLMAP camera, with its trivial rig."""
    import pycolmap

    made = {}
    for camera in dict.fromkeys(cameras):
        c = to_colmap(camera)
        c.has_prior_focal_length = True
        c.camera_id = database.write_camera(c)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(c.sensor_id)
        rig.rig_id = database.write_rig(rig)
        made[camera] = (c, rig)
    return [made[camera] for camera in cameras]


def _write_view(database: Any, view: int, camera_and_rig: tuple[Any, Any]) -> int:
    """Writes a view as a COLMAP image in a frame of its own; returns the image's id."""
    import pycolmap

    camera, rig = camera_and_rig
    image = pycolmap.Image(name=image_file(view), camera_id=camera.camera_id)
    image.image_id = database.write_image(image)
    frame = pycolmap.Frame()
    frame.rig_id = rig.rig_id
    frame.add_data_id(image.data_id)
    database.write_frame(frame)
    return image.image_id


@dataclass(frozen=True, kw_only=True)
class DescriptorMatches:
    """The keypoints of K views, and their matches by descriptors, right or wrong."""

    keypoints: list[np.ndarray]
    """By view, (n, 2) pixels."""
    pairs: dict[tuple[int, int], np.ndarray]
    """By two views (a, b), (m, 2) indices of the keypoints of a and of b."""

    def both_ways(self) -> Iterator[tuple[int, int, np.ndarray]]:
        """Each pair twice: a view, the other, and the indices (m, 2) of their keypoints in this order."""
        for (a, b), index in self.pairs.items():
            yield a, b, index
            yield b, a, index[:, ::-1]


def read_matches(cameras: Sequence[Camera], work_dir: Path) -> DescriptorMatches:
    """All matches of the views that have these cameras."""
    import pycolmap

    with pycolmap.Database.open(work_dir / DATABASE) as database:
        image_id = _image_ids(database)
        view = {number: k for k, number in image_id.items()}
        keypoints = [_keypoints(database, image_id[k], c)[:, :2].astype(float) for k, c in enumerate(cameras)]
        pairs = {}
        for pair_id, index in zip(*database.read_all_matches(), strict=True):
            a, b = pycolmap.pair_id_to_image_pair(pair_id)
            pairs[view[a], view[b]] = np.asarray(index)
    return DescriptorMatches(keypoints=keypoints, pairs=pairs)


def write_matches(work_dir: Path, pairs: Mapping[tuple[int, int], np.ndarray]) -> None:
    """Matches of views (a, b), (m, 2) each, in place of those that their descriptors gave before."""
    import pycolmap

    with pycolmap.Database.open(work_dir / DATABASE) as database:
        image_id = _image_ids(database)
        for (a, b), index in pairs.items():
            if database.exists_matches(image_id[a], image_id[b]):
                database.delete_matches(image_id[a], image_id[b])
            database.write_matches(image_id[a], image_id[b], index.astype(np.uint32))


def write_verified_matches(work_dir: Path, pairs: Mapping[tuple[int, int], np.ndarray]) -> None:
    """Verified matches of views (a, b), (m, 2) each, in place of those that were verified before."""
    import pycolmap

    with pycolmap.Database.open(work_dir / DATABASE) as database:
        image_id = _image_ids(database)
        for (a, b), index in pairs.items():
            verified = pycolmap.TwoViewGeometry()
            verified.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
            verified.inlier_matches = index.astype(np.uint32)
            known = database.exists_two_view_geometry(image_id[a], image_id[b])
            write = database.update_two_view_geometry if known else database.write_two_view_geometry
            write(image_id[a], image_id[b], verified)


def read_keypoints(cameras: Sequence[Camera], work_dir: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each view, which has one of these cameras, keypoints (n, 4) and descriptors (n, 128), as of
    `sift_keypoints`."""
    import pycolmap

    with pycolmap.Database.open(work_dir / DATABASE) as database:
        image_id = _image_ids(database)
        return [
            (_keypoints(database, image_id[view], camera), _descriptors(database, image_id[view]))
            for view, camera in enumerate(cameras)
        ]


def add_relief_keypoints(
    images: list[Image], cameras: Sequence[Camera], sun_in_cam: np.ndarray, work_dir: Path, options: SfmOptions
) -> None:
    """Adds SIFT keypoints of every view's relief (`relief_picture`) and deletes all matches. sun_in_cam: (K, 3)."""
    import pycolmap

    with pycolmap.Database.open(work_dir / DATABASE) as database:
        image_id = _image_ids(database)
        descriptors = {}
        for view, image in enumerate(images):
            keypoints = database.read_keypoints(image_id[view])
            descriptors[view] = _descriptors(database, image_id[view])
            picture = relief_picture(image, sun_in_cam[view])
            if picture is not None:
                more, described = sift_keypoints(picture, image.valid, options.max_features)
                keypoints = np.concatenate([keypoints, _padded(more, cameras[view])])
                descriptors[view] = np.concatenate([descriptors[view], described])
            database.update_keypoints(image_id[view], keypoints)
        for clear in (database.clear_descriptors, database.clear_matches, database.clear_two_view_geometries):
            clear()
        for view, data in descriptors.items():
            _write_descriptors(database, image_id[view], data)


def _image_ids(database: Any) -> dict[int, int]:
    """COLMAP's image id by view."""
    return {int(Path(image.name).stem): image.image_id for image in database.read_all_images()}


def _keypoints(database: Any, image_id: int, camera: Camera) -> np.ndarray:
    """(n, 4) keypoints in the image."""
    keypoints = np.array(database.read_keypoints(image_id))
    keypoints[:, :2] -= padding_px(camera).astype(keypoints.dtype)
    return keypoints


def _descriptors(database: Any, image_id: int) -> np.ndarray:
    """(n, 128)."""
    return np.asarray(database.read_descriptors(image_id).data)


def _write_descriptors(database: Any, image_id: int, data: np.ndarray) -> None:
    import pycolmap

    database.write_descriptors(image_id, pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.SIFT, data))


def numbers_of_matches(count: int, work_dir: Path) -> np.ndarray:
    """(K, K) numbers of matches between `count` views by their descriptors, right or wrong."""
    import pycolmap

    with pycolmap.Database.open(work_dir / DATABASE) as database:
        return _by_views(count, database, database.read_num_matches())


def verified_numbers(count: int, work_dir: Path) -> np.ndarray:
    """(K, K) numbers of verified matches between `count` views."""
    import pycolmap

    with pycolmap.Database.open(work_dir / DATABASE) as database:
        return _by_views(count, database, database.read_two_view_geometry_num_inliers())


def first_pairs(count: int, work_dir: Path) -> list[tuple[int, int]]:
    """COLMAP's ids of the images of pairs with verified matches, those with most of them first."""
    import pycolmap

    number = np.triu(verified_numbers(count, work_dir), 1)
    order = np.argsort(-number, axis=None, kind="stable")[: np.count_nonzero(number)]
    with pycolmap.Database.open(work_dir / DATABASE) as database:
        ids = _image_ids(database)
    return [(ids[int(a)], ids[int(b)]) for a, b in zip(*np.divmod(order, count), strict=True)]


def _by_views(count: int, database: Any, numbers: tuple[list[int], list[int]]) -> np.ndarray:
    """(K, K) from COLMAP's ids of pairs of images, and a number of each."""
    import pycolmap

    view = {image_id: view for view, image_id in _image_ids(database).items()}
    found = np.zeros((count, count), int)
    for pair_id, number in zip(*numbers, strict=True):
        a, b = (view[image_id] for image_id in pycolmap.pair_id_to_image_pair(pair_id))
        found[a, b] = found[b, a] = number
    return found
