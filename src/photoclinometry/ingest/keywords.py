"""Intrinsics from the keywords of instrument kernels and ISIS addenda, found in kernels or in ISIS cubes.

INS-nnn_FOCAL_LENGTH, _PIXEL_SIZE or _PIXEL_PITCH, _ITRANSS and _ITRANSL (pixels per mm), _BORESIGHT_SAMPLE and _LINE
(counted from 1), _CCD_CENTER (counted from 0), _RAD_DIST_COEFF, _OD_K, _OPENCV_OD_... are defined in NAIF's instrument
kernels and in the sources of ISIS's cameras.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from photoclinometry.ingest.detector import BORESIGHT_Z, Detector, detector_of_matrix
from photoclinometry.ingest.distortion import (
    BrownConrady,
    Decentred,
    Distortion,
    InverseRadial,
    OnAxes,
    Radial,
    Taylor,
)
from photoclinometry.io.archives.pvl import Block
from photoclinometry.model.errors import InputError
from photoclinometry.model.warning import warn

logger = logging.getLogger(__name__)

_SHORTEST_FOCAL_MM = 1.0
"""No camera has a shorter focal length: smaller numbers are metres."""
_LARGEST_PIXEL_MM = 0.5
"""No detector has larger pixels: larger numbers are micrometres."""
_SMALLEST_PIXEL_MM = 1e-4
"""No detector has smaller pixels: smaller numbers are metres."""
_CORRECTED_RADIUS = 0.5
"""OD_K begins with about 1 if it gives the corrected radius, with about 0 if it gives the correction."""
_OCAMS_TERMS = 5
"""OCAMS gives five terms of OD_K, k_0 ... k_4; other cameras give at most three."""

_UNDISTORTED = ("", "NONE")
"""Values of DISTORTION_MODEL for images without distortion."""
_OF_DISTORTION = re.compile(
    r"DISTORT|(^|_)DIST(_|$)|(^|_)OD_|DECENTER|RADIAL|TANGENTIAL|OPENCV|POLYNOM|^K\d$|RAD_DIST_COEFF"
)
"""Parts of the names that instrument kernels and ISIS's addenda give to coefficients of distortion."""
_TAYLOR_TERMS = 10
_BESIDE = (("OD_T_X", "OD_T_Y"), ("OD_T_Y", "OD_T_X"), ("DECENTER", "PP"), ("DECENTER", "OD_K"))
"""Keywords of a distortion, and those without which they mean nothing."""
_BACKWARDS = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
"""`Detector.frame` of a camera that looks along -z of its frame: half a turn about x."""
_UNDERSTOOD = re.compile(r"(OD_K|OD_CENTER|DECENTER|OD_T_[XY]|RAD_DIST_COEFF|OPENCV_OD_[KPFCA])(_|$)|DISTORTION_MODEL$")
"""Those that are read here. OpenCV's OD_A is a skew, which moves no pixel of a known kernel by 0.03 px."""
_OPENCV = ("OPENCV_OD_K", "OPENCV_OD_P", "OPENCV_OD_F", "OPENCV_OD_C")
_COEFFICIENTS = re.compile(r"OD_K|OD_P$|OD_T_|RAD_DIST_COEFF")
_INSTEAD = "take the distortion out of the image by the mission's tools and pass --undistorted"

Keywords = Mapping[str, tuple[Any, ...]]
"""The values of keywords by name."""


def keywords_of_label(label: Block) -> Keywords:
    """The keywords that spiceinit stored in an ISIS cube."""
    held = label.block("NAIFKEYWORDS") or Block("")
    return {name: value if isinstance(value, tuple) else (value,) for name, value in reversed(held.statements)}


def detector_from_keywords(
    held: Keywords,
    code: int,
    filter_name: str | None,
    size: tuple[int, int],
    table: Detector | None = None,
    *,
    undistorted: bool = False,
) -> Detector | None:
    """The detector of instrument `code`, with lines and samples as in ISIS's cubes; None if a keyword is missing.

    size: (width, height) of the whole detector, used if no keyword gives it. table: the camera of the table in the
    order of ISIS's cubes: its axes are taken where keywords give none, as in NAIF's instrument kernels without an
    addendum of ISIS, and then its distortion, if keywords give none of that either. undistorted: whether the image is
    free of distortion, so that any may be stated. Raises InputError for keywords that cannot be those of a camera, and
    for a distortion that is not understood.
    """

    def numbers(name: str, count: int = 1) -> tuple[float, ...] | None:
        return _numbers(held, f"INS{code}_{name}", count)

    focal = numbers("FOCAL_LENGTH")
    matrix, pitch = _matrix(numbers), _pitch(numbers)
    samples, lines = numbers("PIXEL_SAMPLES"), numbers("PIXEL_LINES")
    width, height = (int(samples[0]), int(lines[0])) if samples and lines else size
    center = _center(numbers, (width, height))
    is_film = _is_film(held, code)
    if is_film:
        width, height, center = *size, _center_of_film(numbers, size, matrix)
    if focal is None or center is None or (matrix is None and pitch is None):
        return None
    focal_mm = focal[0] * 1e3 if focal[0] < _SHORTEST_FOCAL_MM else focal[0]
    axes = np.array(table.axes if table else np.eye(2)) if matrix is None else matrix
    if matrix is not None and pitch is not None:
        axes = matrix / np.linalg.norm(matrix, axis=1, keepdims=True)
    plain = detector_of_matrix(
        axes if pitch is None else axes / np.array(pitch)[:, None],
        width=width,
        height=height,
        focal_mm=focal_mm,
        center=center,
    )
    stated_axes = plain.axes
    frame, plain = _looking(numbers("BORESIGHT", 3), plain, is_film=is_film)
    model = str(held.get(f"INS{code}_DISTORTION_MODEL", ("",))[0]).strip().upper()
    if not undistorted:
        _check_understood(held, code)
    distortion, principal = _distortion(numbers, plain, stated_axes, filter_name, model)
    if distortion is None and matrix is None and table is not None:
        distortion = table.distortion
    if not undistorted:
        fault = _unusable(held, code, model, filter_name) if distortion is None else None
        if fault is not None:
            distortion = _of_table(table, fault)
    return Detector(
        width=width,
        height=height,
        focal_mm=focal_mm,
        pitch_mm=plain.pitch_mm,
        center=principal,
        axes=plain.axes,
        frame=frame,
        distortion=distortion,
    )


def _is_film(held: Keywords, code: int) -> bool:
    """Whether the keywords are those of an Apollo Metric camera, whose frames were scanned with a wide margin."""
    return f"INS{code}_DECENTER" in held and f"INS{code}_PP" in held


def _center_of_film(numbers: Numbers, size: tuple[int, int], matrix: np.ndarray | None) -> tuple[float, float] | None:
    """The principal point of scanned film: PP [mm] from the middle of the scan, as in ISIS's ApolloMetricCamera.

    ISIS counts pixels from 1, so that its middle of n pixels, n / 2, is at (n - 1) / 2 here. CCD_CENTER is that of a
    nominal scan without margin.
    """
    point = numbers("PP", 2)
    if point is None or matrix is None:
        return None
    offset = matrix @ np.array(point[:2])
    return float((size[0] - 1) / 2 + offset[0]), float((size[1] - 1) / 2 + offset[1])


def _looking(
    boresight: tuple[float, ...] | None, plain: Detector, *, is_film: bool
) -> tuple[tuple[tuple[float, float, float], ...], Detector]:
    """`Detector.frame`, and the detector with its axes in that frame.

    A camera looks along -z if BORESIGHT is (0, 0, -1). Keywords of Apollo's Metric cameras have (0, 0, 1) although
    their x was reversed in 2013 and ISIS takes the direction (x, y, -f) since. A scanned positive is no mirror image,
    so that for these the axes of samples and lines decide.
    """
    backwards = plain.mirrored if is_film else boresight is not None and boresight[2] < 0
    if not backwards:
        return BORESIGHT_Z, plain
    if is_film:
        logger.info("the camera looks along -z of its frame, as its samples and lines are not mirrored then")
    (sx, sy), (lx, ly) = plain.axes
    return _BACKWARDS, replace(plain, axes=((sx, -sy), (lx, -ly)))


def lacking_keywords(held: Keywords, code: int) -> list[str]:
    """Missing keywords of the detector of instrument `code`: their names, with those that would suffice instead."""
    needed = (
        ("FOCAL_LENGTH",),
        ("PIXEL_SIZE", "PIXEL_PITCH", "ITRANSS and ITRANSL"),
        ("CCD_CENTER", "CENTER", "FOV_CENTER_PIXEL", "BORESIGHT_SAMPLE and BORESIGHT_LINE"),
    )

    def is_held(names: str) -> bool:
        return all(f"INS{code}_{name}" in held for name in names.split(" and "))

    return [f"INS{code}_{' or '.join(choices)}" for choices in needed if not any(is_held(names) for names in choices)]


Numbers = Callable[..., tuple[float, ...] | None]


def _of_distortion(held: Keywords, code: int) -> list[str]:
    """The names of keywords of the instrument that hold coefficients of a distortion other than zero."""
    prefix = f"INS{code}_"
    named = [name for name in held if name.startswith(prefix) and _OF_DISTORTION.search(name.removeprefix(prefix))]
    return sorted(name for name in named if any(isinstance(v, int | float) and v != 0 for v in held[name]))


def _of_table(table: Detector | None, fault: str) -> Distortion | None:
    """The distortion of a camera of the table, with a warning. Raises InputError with the fault for other cameras."""
    if table is None:
        raise InputError(f"{fault}; {_INSTEAD}")
    given = "takes its distortion from the table of cameras" if table.distortion else "is taken to have no distortion"
    warn(logger, "distortion-unused", "%s. The camera is in the table of cameras, and %s", fault, given)
    return table.distortion


def _check_understood(held: Keywords, code: int) -> None:
    """Raises InputError if keywords state a distortion that is not known here."""
    unknown = [name for name in _of_distortion(held, code) if not _UNDERSTOOD.match(name.removeprefix(f"INS{code}_"))]
    if unknown:
        raise InputError(f"{', '.join(unknown)}: a distortion of this kind is not known here; {_INSTEAD}")
    for name, other in _BESIDE:
        if f"INS{code}_{name}" in held and f"INS{code}_{other}" not in held:
            raise InputError(f"INS{code}_{name}: is a distortion that lacks INS{code}_{other}; {_INSTEAD}")


def _unusable(held: Keywords, code: int, model: str, filter_name: str | None) -> str | None:
    """The distortion keywords that are given although they define none for this image; None if there are none."""
    stated = [name for name in _of_distortion(held, code) if _COEFFICIENTS.search(name)]
    if not stated:
        given = f"INS{code}_DISTORTION_MODEL is {model}"
        return None if model in _UNDISTORTED else f"{given}, and its coefficients are missing"
    if any(re.search(r"OD_K_", name) for name in stated):
        return f"{', '.join(stated)}: is the distortion of other filters than the label's ({filter_name})"
    lacking = [f"INS{code}_{name}" for name in _OPENCV if f"INS{code}_{name}" not in held]
    return f"{', '.join(stated)}: " + (
        f"OpenCV's distortion lacks {', '.join(lacking)}" if lacking else f"is not of the DISTORTION_MODEL {model}"
    )


def _numbers(held: Keywords, name: str, count: int) -> tuple[float, ...] | None:
    values = held.get(name)
    if values is None:
        return None
    try:
        numbers = tuple(float(v) for v in values)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) < count or not np.isfinite(numbers).all():
        raise InputError(f"{name} is {values!r}, expected {count} numbers; correct the kernel")
    return numbers


def _matrix(numbers: Numbers) -> np.ndarray | None:
    """(2, 2) pixels per mm."""
    sample, line = numbers("ITRANSS", 3), numbers("ITRANSL", 3)
    return None if sample is None or line is None else np.array([sample[1:3], line[1:3]])


def _pitch(numbers: Numbers) -> tuple[float, float] | None:
    """Pitch of samples and lines [mm]. Kernels give mm, micrometres or metres, distinguished by size."""
    size = numbers("PIXEL_SIZE") or numbers("PIXEL_PITCH")
    if size is None or min(size) <= 0:
        return None
    scale = 1e-3 if size[0] > _LARGEST_PIXEL_MM else 1e3 if size[0] < _SMALLEST_PIXEL_MM else 1.0
    return size[0] * scale, size[min(1, len(size) - 1)] * scale


def _center(numbers: Numbers, size: tuple[int, int]) -> tuple[float, float] | None:
    """Pixel coordinates of the boresight; (0.5, 0.5) is the centre of the first pixel.

    size: (width, height). The middle of the detector is 511.5 of 1024 pixels counted from 0, as in most kernels, and
    512.5 counted from 1 (Hayabusa2's ONC).
    """
    ccd = numbers("CCD_CENTER", 2) or numbers("CENTER", 2) or numbers("FOV_CENTER_PIXEL", 2)
    if ccd is not None:
        from_one = ccd[:2] == ((size[0] + 1) / 2, (size[1] + 1) / 2)
        return (ccd[0] - 0.5, ccd[1] - 0.5) if from_one else (ccd[0] + 0.5, ccd[1] + 0.5)
    sample, line = numbers("BORESIGHT_SAMPLE"), numbers("BORESIGHT_LINE")
    return None if sample is None or line is None else (sample[0] - 0.5, line[0] - 0.5)


def _of_focal_plane(numbers: Numbers) -> Distortion | None:
    """A distortion that keywords state along the axes of the focal plane; None if there is none."""
    x, y = numbers("OD_T_X", _TAYLOR_TERMS), numbers("OD_T_Y", _TAYLOR_TERMS)
    if x is not None and y is not None:
        return Taylor(x[:_TAYLOR_TERMS], y[:_TAYLOR_TERMS])
    decentring = numbers("DECENTER", 3)
    k = None if decentring is None else numbers("OD_K", 3)
    if k is None or decentring is None:
        return None
    return Decentred((k[0], k[1], k[2]), (decentring[0], decentring[1]), decentring[2])


def _distortion(
    numbers: Numbers,
    plain: Detector,
    axes: tuple[tuple[float, float], tuple[float, float]],
    filter_name: str | None,
    model: str,
) -> tuple[Distortion | None, tuple[float, float]]:
    """The distortion (None if there is none) and the principal point, which OpenCV's model gives separately."""
    opencv = _opencv(numbers, plain)
    if opencv is not None and model != "OCAMS":
        return opencv
    stated = _of_focal_plane(numbers)
    if stated is not None:
        return OnAxes(stated, axes), plain.center
    dawn = numbers("RAD_DIST_COEFF")
    if dawn is not None:
        return Radial((0.0, 0.0, dawn[0])), plain.center
    of_filter = f"_{(filter_name or '').strip().upper()}" if filter_name else ""
    # SamCam's addendum has two sets. Those by filter contradict the kernel's field of view by 6 %.
    sets = ("", of_filter) if model == "OCAMS" else (of_filter, "")
    k, middle = next(
        ((numbers(f"OD_K{s}"), numbers(f"OD_CENTER{s}", 2)) for s in sets if numbers(f"OD_K{s}")), (None,) * 2
    )
    if k is None or not any(k):
        return None, plain.center
    if len(k) >= _OCAMS_TERMS and middle is not None:
        # ISIS counts these pixels from 1.
        offset = [float((m - 0.5 - c) * p) for m, c, p in zip(middle, plain.center, plain.pitch_mm, strict=False)]
        return Radial(k, (offset[0], offset[1])), plain.center
    return InverseRadial(_powers(k, plain.pitch_mm[0])), plain.center


def _powers(k: tuple[float, ...], pitch: float) -> tuple[float, ...]:
    """OD_K as the coefficients of `InverseRadial`: a correction of k0 + k1 r^2 + k2 r^4 [mm].

    Hayabusa2's ONC gives the corrected radius instead, k0 r + k1 r^3 + k2 r^5 [px], with k0 near 1.
    """
    k0, k1, k2 = (*k, 0.0, 0.0)[:3]
    if k0 > _CORRECTED_RADIUS:
        k0, k1, k2 = 1.0 - k0, -k1 / pitch**2, -k2 / pitch**4
    return k0, 0.0, k1, 0.0, k2


def _opencv(numbers: Numbers, plain: Detector) -> tuple[BrownConrady, tuple[float, float]] | None:
    k, p, focal, center = (numbers(name, count) for name, count in zip(_OPENCV, (6, 2, 2, 2), strict=True))
    if k is None or p is None or focal is None or center is None:
        return None
    nominal = [float(plain.focal_mm / pitch) for pitch in plain.pitch_mm]
    model = BrownConrady(plain.focal_mm, k[:6], (p[0], p[1]), (focal[0] / nominal[0], focal[1] / nominal[1]))
    return model, (center[0] - 0.5, center[1] - 0.5)
