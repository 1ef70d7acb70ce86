"""Pose and Sun of one exposure, from SPICE kernels, ISIS tables, a SUMFILE or a label."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from photoclinometry.ingest.facts import Facts
from photoclinometry.io.archives.product import Product
from photoclinometry.io.models.sumfile import SumFile
from photoclinometry.io.spice import Kernels
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import METRES, Rigid, unit

_J2000 = datetime(2000, 1, 1, 12)
"""Epoch of SPICE's times, TDB."""
_M_PER_KM = METRES["km"]
"""Sites are in metres; kernels, tables and SUMFILEs are in kilometres."""
_LARGEST_VALUE = 1e15
"""Numbers of a table beyond this (positions in km, quaternions) are damage."""
_SMALLEST_NORM = 1e-9
"""A row of a table below this length is empty."""
_ROTATION_TOLERANCE = 1e-6
"""Rotation matrices written with seven digits are this near to orthonormal."""
_QUATERNION_LENGTH = (0.9, 1.1)
"""Quaternions are normalised; outside of this range they are something else."""


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """Pose and Sun of one exposure, in the instrument's frame."""

    sun: np.ndarray
    """(3,) unit vector from the body towards the Sun."""
    instrument_from_body: Rigid | None
    """Pose [m]; None if only the Sun is known."""
    source: str
    """For people: where pose and Sun are from."""
    sun_distance_km: float | None = None
    position_sigma_m: float | None = None
    """Standard deviation of the position, if the source gives it."""
    pointing_sigma_rad: float | None = None
    time: datetime | None = None
    """UTC, or TDB, which is a minute ahead; if the source gives it."""

    def turned(self, cam_from_instrument: np.ndarray) -> Geometry:
        """The same in the camera's frame; cam_from_instrument: (3, 3) rotation."""
        pose = self.instrument_from_body
        turn = Rigid(cam_from_instrument, np.zeros(3))
        return replace(self, sun=cam_from_instrument @ self.sun, instrument_from_body=pose and turn @ pose)


def geometry_from_kernels(
    kernels: Kernels, facts: Facts, spacecraft: int, code: int, body: str, delay_s: float
) -> Geometry:
    """Pose and Sun by SPICE. Raises InputError.

    The corrections for light time and aberration are those of ISIS, so that poses agree with its cubes. The position is
    that of the spacecraft seen from the body (LT+S); with the instrument's keyword SWAP_OBSERVER_TARGET it is minus
    that of the body seen from the spacecraft. LIGHTTIME_CORRECTION names another correction. The Sun is seen from the
    body's centre. Attitudes of body and camera are those at the middle of the exposure.
    """
    time = exposure_time(kernels, facts, spacecraft, delay_s)
    number = kernels.body_code(body)
    fixed = kernels.body_frame(number)
    frame = _instrument_frame(kernels, code)
    turn = kernels.rotation(fixed, frame, time)
    correction = str((kernels.keyword(f"INS{code}_LIGHTTIME_CORRECTION") or ("LT+S",))[0])
    swapped = str((kernels.keyword(f"INS{code}_SWAP_OBSERVER_TARGET") or ("FALSE",))[0]).upper() == "TRUE"
    if swapped:
        camera = -kernels.position(str(number), time, fixed, correction, str(spacecraft))
    else:
        camera = kernels.position(str(spacecraft), time, fixed, correction, str(number))
    sun = kernels.position("SUN", time, fixed, "LT+S", str(number))
    return Geometry(
        sun=turn @ unit(sun),
        instrument_from_body=Rigid(turn, -turn @ camera * _M_PER_KM),
        source="SPICE kernels",
        sun_distance_km=float(np.linalg.norm(sun)),
        time=_J2000 + timedelta(seconds=time),
    )


def exposure_time(kernels: Kernels, facts: Facts, spacecraft: int, delay_s: float) -> float:
    """The middle of the exposure [s TDB past J2000], by the spacecraft clock if the label has it, else by UTC.

    delay_s: time from the clock count to the beginning of the exposure. Raises InputError.
    """
    half = (facts.exposure_s or 0.0) / 2.0
    if facts.clock is not None:
        return kernels.time_of_clock(spacecraft, facts.clock) + delay_s + half
    if facts.start is not None:
        return kernels.time_of_utc(facts.start) + half
    raise InputError("the label has neither a spacecraft clock count nor a start time; pass --sumfiles or --suns")


def _instrument_frame(kernels: Kernels, code: int) -> str:
    named = kernels.frame_name(code)
    if named is None:
        fov = kernels.keyword(f"INS{code}_FOV_FRAME")
        named = str(fov[0]) if fov else None
    if named is None:
        raise InputError(f"SPICE knows no frame of instrument {code}; load its frames kernel (*.tf)")
    return named


def geometry_from_tables(product: Product) -> Geometry | None:
    """Pose and Sun by the tables of an ISIS cube; None if it has none. Raises InputError.

    InstrumentPointing holds quaternions J2000 -> camera; InstrumentPosition and SunPosition the camera and the Sun
    relative to the body's centre in J2000 [km]; BodyRotation quaternions J2000 -> body-fixed. A ConstantRotation in
    a table's label is applied after the quaternion.
    """
    names = ("InstrumentPointing", "InstrumentPosition", "BodyRotation", "SunPosition")
    if not all(product.tables.get(name) for name in names):
        return None
    instrument_from_j2000 = _table_rotation(product, "InstrumentPointing")
    body_from_j2000 = _table_rotation(product, "BodyRotation")
    camera, sun = _table_vector(product, "InstrumentPosition"), _table_vector(product, "SunPosition")
    turn = instrument_from_j2000 @ body_from_j2000.T
    return Geometry(
        sun=instrument_from_j2000 @ unit(sun),
        instrument_from_body=Rigid(turn, -instrument_from_j2000 @ camera * _M_PER_KM),
        source="ISIS tables",
        sun_distance_km=float(np.linalg.norm(sun)),
    )


def _table_row(product: Product, name: str, columns: tuple[str, ...]) -> np.ndarray:
    """The single record of a table. Raises InputError."""
    table = product.tables[name]
    if any(column not in table for column in columns):
        raise InputError(
            f"{product.path}: table {name} has {', '.join(table)}, expected {', '.join(columns)}: "
            "run spiceinit again, or pass --kernels"
        )
    values = np.stack([table[column] for column in columns], -1)
    if len(values) != 1:
        raise InputError(
            f"{product.path}: table {name} has {len(values)} records, as line scanners do; give a frame camera's image"
        )
    if not (np.abs(values) < _LARGEST_VALUE).all() or np.linalg.norm(values) < _SMALLEST_NORM:
        raise InputError(f"{product.path}: table {name} holds no valid numbers; run spiceinit again, or pass --kernels")
    return values[0]


def _table_vector(product: Product, name: str) -> np.ndarray:
    return _table_row(product, name, ("J2000X", "J2000Y", "J2000Z"))


def _table_rotation(product: Product, name: str) -> np.ndarray:
    """(3, 3) target_from_J2000."""
    quaternion = _table_row(product, name, ("J2000Q0", "J2000Q1", "J2000Q2", "J2000Q3"))
    turn = rotation_of_quaternion(quaternion)
    block = next(b for b in product.label.blocks if b.name == "TABLE" and b.get("NAME") == name)
    constant = block.get("CONSTANTROTATION")
    if constant is None:
        return turn
    return _constant_rotation(product, name, constant) @ turn


def _constant_rotation(product: Product, name: str, written: object) -> np.ndarray:
    """(3, 3) the rotation nearest to the written one, which is rounded."""
    numbers = [v for v in written if isinstance(v, int | float)] if isinstance(written, tuple) else []
    matrix = np.array(numbers if len(numbers) == 9 else [0.0] * 9, float).reshape(3, 3)
    if not (np.abs(matrix) <= 2.0).all() or np.abs(matrix @ matrix.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
        raise InputError(f"{product.path}: ConstantRotation of table {name} is not a rotation; run spiceinit again")
    u, _, vt = np.linalg.svd(matrix)
    return u @ vt


def rotation_of_quaternion(wxyz: np.ndarray) -> np.ndarray:
    """(3, 3) of a quaternion, scalar first, in SPICE's sense: v_to = R v_from. Raises InputError for other lengths."""
    from scipy.spatial.transform import Rotation

    if not _QUATERNION_LENGTH[0] < np.linalg.norm(wxyz) < _QUATERNION_LENGTH[1]:
        raise InputError(f"the attitude {np.asarray(wxyz).tolist()} is not a unit quaternion; pass --kernels instead")
    return Rotation.from_quat(np.asarray(wxyz, float), scalar_first=True).as_matrix()


def geometry_from_sumfile(summary: SumFile) -> Geometry:
    """Pose and Sun by a SUMFILE; the instrument's frame has the axes CX, CY, CZ."""
    pose = summary.body_from_axes.inverse()
    return Geometry(
        sun=unit(pose.rotation @ np.array(summary.sun)),
        instrument_from_body=Rigid(pose.rotation, pose.translation * _M_PER_KM),
        source=f"SUMFILE {summary.name}",
        position_sigma_m=float(np.mean(summary.position_sigma)) * _M_PER_KM or None,
        pointing_sigma_rad=float(np.mean(summary.pointing_sigma)) or None,
    )


def geometry_from_label(product: Product, facts: Facts) -> Geometry | None:
    """The Sun alone, by attitude and Sun position in a label; None if it has none.

    NEAR's labels give the quaternion J2000 -> spacecraft (the MSI is rotated from that frame by 1.5 mrad) and the
    spacecraft's position from the Sun. Dawn's give the quaternion J2000 -> camera and the Sun's position from the
    spacecraft.
    """
    label = product.label
    near = [_real(label.find(f"NEAR-{key:03d}")) for key in range(19, 26)]
    if None not in near:
        attitude = _MSI_FROM_NEAR @ rotation_of_quaternion(np.array(near[:4]))
        return _label_geometry(attitude, -np.array(near[4:], float))
    quaternion, sun = label.find("QUATERNION"), label.find("SC_SUN_POSITION_VECTOR")
    if (facts.spacecraft or "").upper() != "DAWN" or not isinstance(quaternion, tuple) or not isinstance(sun, tuple):
        return None
    numbers = [_real(v) for v in (*quaternion, *sun)]
    if len(numbers) != 7 or None in numbers:
        return None
    return _label_geometry(rotation_of_quaternion(np.array(numbers[:4])), np.array(numbers[4:], float))


_MSI_FROM_NEAR = np.array(
    [
        [0.9999988429, -0.0004838414, 0.0014422523],
        [0.0004838419, 0.9999998829, 0.0],
        [-0.0014422522, 0.0000006978, 0.9999989600],
    ]
)
"""Rotation to NEAR_MSI from NEAR_SC_BUS_PRIME, of the instrument kernel msi15.ti."""


def _label_geometry(instrument_from_j2000: np.ndarray, sun: np.ndarray) -> Geometry | None:
    distance = float(np.linalg.norm(sun))
    if not np.isfinite(distance) or distance == 0:
        return None
    return Geometry(
        sun=unit(instrument_from_j2000 @ sun),
        instrument_from_body=None,
        source="label",
        sun_distance_km=distance,
    )


def _real(value: Any) -> float | None:
    value = getattr(value, "value", value)
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if np.isfinite(number) else None
