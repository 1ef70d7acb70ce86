"""The three files of a text model (format: `text_model.py`), read and checked, also against each other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from photoclinometry.io.models.number_lines import (
    Rows,
    announced_count,
    fault,
    first_not_whole,
    parse_numbers,
    read_lines,
    read_rows,
)
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit

CAMERA_FIELDS = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"
IMAGE_FIELDS = "IMAGE_ID QW QX QY QZ TX TY TZ SX SY SZ CAMERA_ID NAME SCALE BIAS"
KEYPOINT_FIELDS = "X Y INTENSITY POINT3D_ID"
POINT_FIELDS = "POINT3D_ID X Y Z NX NY NZ ALBEDO R G B ERROR"

_PARTS = "with cameras.txt, images.txt and points3D.txt"
_POINT_NUMBERS = len(POINT_FIELDS.split())
_UNIT_TOLERANCE = 1e-3
"""A quaternion farther from unit length is damage."""
_MAX_DIGITS = 15
"""Digits of an identifier that a double holds exactly."""


@dataclass(frozen=True)
class ImageLines:
    """The two lines of an image: its quaternion scaled to unit length, other values as written."""

    id: int
    line: int
    """Line of the file that holds the keypoints."""
    name: str
    camera: Camera
    wxyz: np.ndarray
    """(4,) rotation of cam_from_body."""
    translation: np.ndarray
    """(3,) of cam_from_body."""
    sun: np.ndarray
    """(3,) towards the Sun, in C; not zero."""
    scale: float
    bias: float
    xy: np.ndarray
    """(n, 2) keypoints [px]."""
    brightness: np.ndarray
    """(n,)."""
    point_id: np.ndarray
    """(n,) int64, -1 where omitted."""


class PointLines(NamedTuple):
    """The lines of J points, with the N observations of their tracks."""

    line: np.ndarray
    """(J,) int64 line of the file."""
    id: np.ndarray
    """(J,) int64."""
    column: np.ndarray
    """(J, 12) POINT_FIELDS; no normal is zero."""
    start: np.ndarray
    """(J + 1,) int64: observations of point j are start[j]:start[j + 1]."""
    image_id: np.ndarray
    """(N,) int64."""
    keypoint_index: np.ndarray
    """(N,) int64 POINT2D_IDX: index among the image's keypoints."""


def read_cameras(path: Path) -> dict[int, Camera]:
    """The cameras by identifier. Raises InputError."""
    cameras: dict[int, Camera] = {}
    for line, text in enumerate(read_lines(path, _PARTS), 1):
        if not (words := _words(path, line, text)):
            continue
        if len(words) < 5:
            raise fault(path, line, f"holds {len(words)} values, expected {CAMERA_FIELDS}")
        number, width, height = _integers(path, line, "CAMERA_ID, WIDTH and HEIGHT", *words[:1], *words[2:4])
        params = parse_numbers(path, line, " ".join(["0"] * 4 + words[4:]).encode())[4:]
        if number in cameras:
            raise fault(path, line, f"camera {number} is there twice; give each camera its own number")
        try:
            cameras[number] = Camera(words[1], width, height, tuple(params.tolist()))
        except InputError as error:
            raise fault(path, line, f"camera {number}: {error}") from error
    _check_count(path, "cameras", len(cameras))
    return cameras


def read_images(path: Path, cameras: dict[int, Camera]) -> list[ImageLines]:
    """The images in the file's order. Raises InputError."""
    images: list[ImageLines] = []
    header: tuple[int, list[str]] | None = None
    for line, text in enumerate(read_lines(path, _PARTS), 1):
        if header is None:
            words = _words(path, line, text)
            header = (line, words) if words else None
        else:
            images.append(_image(path, *header, line, text, cameras))
            header = None
    if header is not None:
        raise fault(path, header[0], "the line of this image's keypoints is missing; get the file again")
    _check_count(path, "images", len(images))
    for what, values in (("number", [i.id for i in images]), ("name", [i.name for i in images])):
        seen: set[int | str] = set()
        for image, value in zip(images, values, strict=True):
            if value in seen:
                raise fault(
                    path, image.line - 1, f"the {what} {value} is that of an earlier image; give each image its own"
                )
            seen.add(value)
    return images


def _image(path: Path, at: int, words: list[str], line: int, text: bytes, cameras: dict[int, Camera]) -> ImageLines:
    """The image of the words in line `at` and of the keypoints in the next one, `line`."""
    if len(words) != len(IMAGE_FIELDS.split()):
        raise fault(path, at, f"holds {len(words)} values, expected {IMAGE_FIELDS} (names cannot hold spaces)")
    number, camera = _integers(path, at, "IMAGE_ID and CAMERA_ID", words[0], words[11])
    values = parse_numbers(path, at, " ".join([*words[:12], "0", *words[13:]]).encode())
    wxyz, translation, sun, scale, bias = values[1:5], values[5:8], values[8:11], values[13], values[14]
    if camera not in cameras:
        raise fault(path, at, f"image {number} uses camera {camera}, which cameras.txt does not hold")
    if abs(math.hypot(*wxyz) - 1.0) > _UNIT_TOLERANCE:
        raise fault(path, at, f"image {number}: QW QX QY QZ is not a rotation (its length is {math.hypot(*wxyz):.4g})")
    if not np.any(sun):
        raise fault(path, at, f"image {number} has no Sun (SX SY SZ are zero); was this model made of geometry alone?")
    if scale <= 0:
        raise fault(path, at, f"image {number}: SCALE is {scale:g}, expected a positive number")
    light = (float(scale), float(bias))
    keypoints = _keypoints(path, line, number, text)
    return ImageLines(number, line, words[12], cameras[camera], unit(wxyz), translation, sun, *light, *keypoints)


def _keypoints(path: Path, line: int, number: int, text: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, brightness and points' numbers of an image's keypoints."""
    values = parse_numbers(path, line, text)
    if len(values) % 4:
        what = f"image {number} has {len(values)} values, no multiple of 4 ({KEYPOINT_FIELDS}); cut short?"
        raise fault(path, line, what)
    values = values.reshape(-1, 4)
    bad = first_not_whole(values[:, 3], lowest=-1)
    if bad is not None:
        what = f"keypoint {bad} of image {number} has POINT3D_ID {values[bad, 3]:g}, expected a point's number, or -1"
        raise fault(path, line, what)
    return values[:, :2].copy(), values[:, 2].copy(), values[:, 3].astype(np.int64)


def read_points(path: Path) -> PointLines:
    """The points in the file's order. Raises InputError."""
    blocks = [_points(path, rows) for rows in read_rows(path, _PARTS)]
    line, ids, column, length, image_id, index = map(np.concatenate, zip(*blocks, strict=True))
    _check_count(path, "points", len(ids))
    again = _repeated(ids)
    if again is not None:
        raise fault(path, int(line[again]), f"point {ids[again]} is there twice; give each point its own number")
    return PointLines(line, ids, column, np.concatenate([[0], np.cumsum(length)]), image_id, index)


def _points(path: Path, rows: Rows) -> tuple[np.ndarray, ...]:
    """Lines, ids, columns, lengths of tracks, and the tracks' images and indices of a block of points."""
    size = np.diff(rows.start)
    wrong = np.flatnonzero((size < _POINT_NUMBERS) | ((size - _POINT_NUMBERS) % 2 != 0))
    if len(wrong):
        what = f"holds {size[wrong[0]]} values, expected {POINT_FIELDS} and pairs of IMAGE_ID POINT2D_IDX; cut short?"
        raise fault(path, int(rows.line[wrong[0]]), what)
    fixed = rows.start[:-1, None] + np.arange(_POINT_NUMBERS)
    column = rows.value[fixed]
    zero = np.flatnonzero(~column[:, 4:7].any(-1))
    if len(zero):
        what = f"the normal of point {column[zero[0], 0]:.0f} is zero; was this model made of geometry alone?"
        raise fault(path, int(rows.line[zero[0]]), what)
    tracked = np.ones(len(rows.value), bool)
    tracked[fixed] = False
    pair = rows.value[tracked].reshape(-1, 2)
    length = (size - _POINT_NUMBERS) // 2
    each = np.arange(len(size))
    for values, row in ((column[:, 0], each), (pair.ravel(), np.repeat(each, 2 * length))):
        bad = first_not_whole(values)
        if bad is not None:
            what = f"{values[bad]:.17g} is not a POINT3D_ID, IMAGE_ID or POINT2D_IDX, which are whole numbers from 0"
            raise fault(path, int(rows.line[row[bad]]), what)
    ids, pair = column[:, 0].astype(np.int64), pair.astype(np.int64)
    return rows.line, ids, column, length, pair[:, 0], pair[:, 1]


def keypoint_rows(path: Path, points: PointLines, images: Sequence[ImageLines]) -> tuple[np.ndarray, np.ndarray]:
    """(N,) index of each observation's image, and (N,) row of its keypoint in the keypoints of all images.

    path: points3D.txt. Raises InputError for tracks that name an image or keypoint that images.txt does not hold, an
    image twice, or a keypoint of another track.
    """
    point = np.repeat(np.arange(len(points.id)), np.diff(points.start))

    def error(observation: int, what: str) -> InputError:
        j = point[observation]
        return fault(path, int(points.line[j]), f"the track of point {points.id[j]} {what}")

    numbers = np.array([i.id for i in images])
    order = np.argsort(numbers)
    image = order[np.minimum(np.searchsorted(numbers, points.image_id, sorter=order), len(order) - 1)]
    for o in np.flatnonzero(numbers[image] != points.image_id)[:1]:
        raise error(o, f"names image {points.image_id[o]}, which images.txt does not hold")
    count = np.array([len(i.xy) for i in images])
    for o in np.flatnonzero((points.keypoint_index < 0) | (points.keypoint_index >= count[image]))[:1]:
        index, holder = points.keypoint_index[o], points.image_id[o]
        what = f"names keypoint {index} of image {holder}, which has {count[image[o]]} (from 0)"
        raise error(o, what + " in images.txt")
    twice = _repeated(point * len(images) + image)
    if twice is not None:
        raise error(twice, f"names image {points.image_id[twice]} twice; keep one of its keypoints")
    row = (np.cumsum(count) - count)[image] + points.keypoint_index
    twice = _repeated(row)
    if twice is not None:
        what = (
            f"names keypoint {points.keypoint_index[twice]} of image {points.image_id[twice]}, as an earlier track does"
        )
        raise error(twice, what)
    return image, row


def _repeated(values: np.ndarray) -> int | None:
    """Index of the first value (n,) that equals an earlier one; None if all differ."""
    order = np.argsort(values, kind="stable")
    again = order[1:][np.diff(values[order]) == 0]
    return int(again.min()) if len(again) else None


def check_point_ids(path: Path, images: Sequence[ImageLines], points: PointLines, row: np.ndarray) -> None:
    """Raises InputError unless every keypoint's POINT3D_ID is -1 or the point whose track names it.

    path: images.txt; row: (N,) of `keypoint_rows`.
    """
    stated = np.concatenate([i.point_id for i in images])
    tracked = np.full(len(stated), -1)
    tracked[row] = np.repeat(points.id, np.diff(points.start))
    for bad in np.flatnonzero((stated != -1) & (stated != tracked))[:1]:
        first = np.cumsum([0] + [len(i.xy) for i in images])
        k = int(np.searchsorted(first, bad, side="right")) - 1
        if stated[bad] not in points.id:
            what = "points3D.txt does not hold"
        elif tracked[bad] < 0:
            what = "whose track in points3D.txt does not name it"
        else:
            what = f"but points3D.txt has it in the track of point {tracked[bad]}"
        where = f"keypoint {bad - first[k]} of image {images[k].id} has POINT3D_ID {stated[bad]}, "
        raise fault(path, images[k].line, where + what + "; write the track's point, or -1")


def _check_count(path: Path, what: str, found: int) -> None:
    """Raises InputError if a file holds nothing, or not as many items as its first comments announce."""
    announced = announced_count(path, what)
    if not found or (announced is not None and announced != found):
        expected = "" if announced is None else f", {announced} are announced"
        raise InputError(f"{path}: holds {found} {what}{expected}: it was cut short or changed; get it again")


def _words(path: Path, line: int, text: bytes) -> list[str]:
    """The words of a line; empty for a comment. Raises InputError unless the line is UTF-8."""
    try:
        words = text.decode("utf-8").split()
    except UnicodeDecodeError as error:
        raise fault(path, line, f"is not UTF-8 text ({error.reason}); save the file as UTF-8") from error
    return [] if words and words[0].startswith("#") else words


def _integers(path: Path, line: int, what: str, *words: str) -> Iterator[int]:
    """The words as whole numbers from 0; what: their names, for the error."""
    for word in words:
        if not (word.isascii() and word.isdigit() and len(word) <= _MAX_DIGITS):
            raise fault(path, line, f"{what} must be whole numbers from 0, found {word!r}")
        yield int(word)
