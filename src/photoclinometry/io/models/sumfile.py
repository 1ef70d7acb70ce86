"""SUMFILE: the camera, pose and Sun of one image, in the format of SPC (stereophotoclinometry).

The body-fixed frame is in km. CX, CY, CZ are the axes of the camera, CZ along the boresight. A direction (x, y, z) in
that frame falls on the focal plane at MMFL * (x / z, y / z) [mm], which K-MATRIX and CTR take to (sample, line).
Samples and lines count from 1 at the centre of the first pixel, half a pixel more than this package's.
Gaskell et al. (2008), Meteoritics & Planetary Science 43, 1049-1061, doi:10.1111/j.1945-5100.2008.tb00692.x.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import write_text
from photoclinometry.io.reading import read_limited
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, unit

_Point = tuple[str, tuple[float, ...]]
"""A landmark's name and its numbers."""

PIXEL_OFFSET = 0.5
"""SUMFILE coordinate minus this package's: the first pixel's centre is 1 there and 0.5 here [px]."""
_MAX_BYTES = 1 << 24
"""16 MiB: SUMFILEs have some kilobytes; larger files are something else."""
_HEADER = (
    ("NPX, NLN, THRSH", 4),
    ("MMFL, CTR", 3),
    ("SCOBJ", 3),
    ("CX", 3),
    ("CY", 3),
    ("CZ", 3),
    ("SZ", 3),
    ("K-MATRIX", 6),
    ("DISTORTION", 4),
    ("SIGMA_VSO", 3),
    ("SIGMA_PTG", 3),
)
"""The lines after name and time: key, and count of numbers."""
_UNIT_TOLERANCE = 1e-6
"""Unit vectors written with eleven digits are nearer than this to orthonormal."""


@dataclass(frozen=True, kw_only=True)
class SumFile:
    """The content of a SUMFILE, in its units: km, mm, radians, pixels counted from 1."""

    name: str
    utc: str
    """Time of the exposure's middle as written, such as "2019 MAR 14 19:01:23.961"."""
    width: int
    height: int
    threshold: tuple[int, int]
    """Lowest and highest DN that SPC uses."""
    focal_mm: float
    center: tuple[float, float]
    """(sample, line) of the boresight."""
    camera_to_body: tuple[float, float, float]
    """SCOBJ: from the camera to the body's centre, in B [km]."""
    axes: tuple[tuple[float, float, float], ...]
    """CX, CY, CZ: the camera's axes, unit vectors in B."""
    sun: tuple[float, float, float]
    """SZ: unit vector from the body towards the Sun, in B."""
    k_matrix: tuple[float, ...]
    """(6,): sample = center + k[0] x + k[1] y + k[2] x y, line = center + k[3] x + k[4] y + k[5] x y [px/mm]."""
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    position_sigma: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """SIGMA_VSO [km]."""
    pointing_sigma: tuple[float, float, float] = (1e-3, 1e-3, 1e-3)
    """SIGMA_PTG [rad]."""
    landmarks: tuple[tuple[str, float, float], ...] = ()
    """Name, sample, line."""
    limbs: tuple[tuple[str, float, float, float], ...] = ()
    """Name, sample, line, residual [px]."""

    @property
    def body_from_axes(self) -> Rigid:
        """Pose of the frame of CX, CY, CZ; its translation is the camera's centre in B [km]."""
        return Rigid(np.array(self.axes).T, -np.array(self.camera_to_body))


def sumfile_of_view(
    name: str, camera: Camera, body_from_cam: Rigid, sun: np.ndarray, *, utc: str, pixel_mm: float = 0.01
) -> SumFile:
    """The SUMFILE of a view: body_from_cam in km, sun (3,) towards the Sun in B.

    A SUMFILE gives the focal length in mm and pixels per mm; only their product matters. pixel_mm: pitch of a sample,
    by default 10 microns.
    """
    focal, pitch = camera.focal_px, 1.0 / pixel_mm
    rotation = body_from_cam.rotation
    return SumFile(
        name=name,
        utc=utc,
        width=camera.width,
        height=camera.height,
        threshold=(0, 65535),
        focal_mm=focal[0] * pixel_mm,
        center=(camera.principal_px[0] + PIXEL_OFFSET, camera.principal_px[1] + PIXEL_OFFSET),
        camera_to_body=_triple(-body_from_cam.translation),
        axes=(_triple(rotation[:, 0]), _triple(rotation[:, 1]), _triple(rotation[:, 2])),
        sun=_triple(unit(sun)),
        k_matrix=(pitch, 0.0, 0.0, 0.0, pitch * focal[1] / focal[0], 0.0),
    )


def read_sumfile(path: Path | str) -> SumFile:
    """The SUMFILE at `path`. Raises InputError that names the line, its content, and what was expected."""
    path = Path(path)
    lines = _lines(path)
    if len(lines) < 2 + len(_HEADER):
        raise InputError(f"{path}: has {len(lines)} lines, a SUMFILE has {2 + len(_HEADER)} and more; get it again")
    if not lines[0].strip():
        raise InputError(f"{path}, line 1: expected the name of the image, found an empty line; get it again")
    value = {key: _numbers(path, n, lines[n - 1], key, count) for n, (key, count) in enumerate(_HEADER, start=3)}
    _check(path, value)
    landmarks, limbs = _points(path, lines, 2 + len(_HEADER))
    width, height, low, high = (int(v) for v in value["NPX, NLN, THRSH"])
    focal, *center = value["MMFL, CTR"]
    return SumFile(
        name=lines[0].strip(),
        utc=lines[1].strip(),
        width=width,
        height=height,
        threshold=(low, high),
        focal_mm=focal,
        center=(center[0], center[1]),
        camera_to_body=_triple(value["SCOBJ"]),
        axes=tuple(_triple(value[key]) for key in ("CX", "CY", "CZ")),
        sun=_triple(value["SZ"]),
        k_matrix=value["K-MATRIX"],
        distortion=value["DISTORTION"],
        position_sigma=_triple(value["SIGMA_VSO"]),
        pointing_sigma=_triple(value["SIGMA_PTG"]),
        landmarks=tuple((name, *_pair(rest)) for name, rest in landmarks),
        limbs=tuple((name, *_triple(rest)) for name, rest in limbs),
    )


def write_sumfile(path: Path | str, summary: SumFile) -> None:
    """`summary` in SPC's columns. Raises RunFolderError.

    The columns hold 11 digits of lengths and directions, 4 or 5 decimals of K-MATRIX, 2 of keypoints. Numbers read
    from a SUMFILE are written back unchanged; others are rounded.
    """
    write_text(path, format_sumfile(summary))


def format_sumfile(summary: SumFile) -> str:
    """The text of a SUMFILE."""
    s = summary
    lines = [s.name, s.utc]
    lines.append("".join(f"{v:6d}" for v in (s.width, s.height, *s.threshold)) + " " * 22 + "NPX, NLN, THRSH")
    vectors = [("MMFL, CTR", (s.focal_mm, *s.center)), ("SCOBJ", s.camera_to_body)]
    vectors += [*zip(("CX", "CY", "CZ"), s.axes, strict=True), ("SZ", s.sun)]
    lines += [_row("20.10E", values, key) for key, values in vectors]
    lines.append("".join(f"{_ten_columns(v):>10}" for v in s.k_matrix) + "   K-MATRIX")
    lines.append(_row("15.5E", s.distortion, "DISTORTION"))
    lines.append(_row("20.10E", s.position_sigma, "SIGMA_VSO"))
    lines.append(_row("20.10E", s.pointing_sigma, "SIGMA_PTG"))
    lines.append("LANDMARKS")
    lines += [f"{name:6}" + "".join(f"{v:10.2f}" for v in rest) for name, *rest in s.landmarks]
    lines.append("LIMB FITS")
    lines += [f"{name:6}" + "".join(f"{v:10.2f}" for v in rest) for name, *rest in s.limbs]
    lines.append("END FILE")
    return "\n".join(line.ljust(80) for line in lines) + "\n"


def _row(form: str, values: Sequence[float], key: str) -> str:
    return "".join(f"{v:{form}}" for v in values) + f"   {key}"


def _ten_columns(value: float) -> str:
    """The number with as many decimals as leave a space before it, for readers that split lines at spaces."""
    return next(text for decimals in (5, 4, 3, 2, 1, 0) if len(text := f"{value:.{decimals}f}") < 10 or not decimals)


def _lines(path: Path) -> list[str]:
    data = read_limited(path, "SUMFILE", _MAX_BYTES)
    try:
        return data.decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not ASCII, so this is not a SUMFILE; check the path"
        ) from error


def _numbers(path: Path, number: int, line: str, key: str, count: int) -> tuple[float, ...]:
    """The first `count` numbers of a line, which may have FORTRAN's exponent D."""
    words = line.replace("D+", "E+").replace("D-", "E-").split()[:count]
    try:
        values = tuple(float(word) for word in words)
    except ValueError:
        values = ()
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(
            f"{path}, line {number}: expected {count} numbers ({key}), found {line.strip()[:60]!r}; get it again"
        )
    return values


def _check(path: Path, value: dict[str, tuple[float, ...]]) -> None:
    """Raises InputError for sizes, a focal length, axes, a Sun or a K-MATRIX that no camera can have."""
    if (
        any(v != int(v) or not 0 <= v < 2**31 for v in value["NPX, NLN, THRSH"])
        or min(value["NPX, NLN, THRSH"][:2]) < 1
    ):
        raise InputError(
            f"{path}: NPX, NLN, THRSH are {value['NPX, NLN, THRSH']}, expected whole numbers of pixels, DN"
        )
    if value["MMFL, CTR"][0] <= 0:
        raise InputError(f"{path}: the focal length MMFL is {value['MMFL, CTR'][0]:g} mm, expected a positive one")
    axes = np.array([value[key] for key in ("CX", "CY", "CZ")])
    # Entries beyond 1 are refused before products of huge ones overflow.
    if np.abs(axes).max() > 2.0 or np.abs(axes @ axes.T - np.eye(3)).max() > _UNIT_TOLERANCE or np.linalg.det(axes) < 0:
        raise InputError(f"{path}: CX, CY, CZ are not right-handed unit vectors at right angles; get it again")
    if abs(math.hypot(*value["SZ"]) - 1.0) > _UNIT_TOLERANCE:
        raise InputError(f"{path}: SZ has length {math.hypot(*value['SZ']):.6g}, expected the Sun's unit vector")
    k = value["K-MATRIX"]
    if k[0] * k[4] == k[1] * k[3]:
        raise InputError(f"{path}: K-MATRIX {k} puts the focal plane on a line; get it again")


def _points(path: Path, lines: list[str], at: int) -> tuple[list[_Point], list[_Point]]:
    """(name, numbers) of the landmarks and of the limb points."""
    sections: dict[str, list[_Point]] = {"LANDMARKS": [], "LIMB FITS": []}
    count = {"LANDMARKS": 2, "LIMB FITS": 3}
    section = ""
    for number, line in enumerate(lines[at:], start=at + 1):
        text = line.strip()
        if text == "END FILE":
            return sections["LANDMARKS"], sections["LIMB FITS"]
        if text in sections:
            section = text
        elif section and text:
            name, _, rest = text.partition(" ")
            sections[section].append((name, _numbers(path, number, rest, f"{section} of {name}", count[section])))
        elif text:
            raise InputError(f"{path}, line {number}: expected LANDMARKS, found {text[:60]!r}; get it again")
    raise InputError(f"{path}: ends without END FILE: it was cut short; get it again")


def _pair(values: Sequence[float]) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _triple(values: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
