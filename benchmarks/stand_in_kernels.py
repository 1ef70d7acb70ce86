"""Made-up positions and attitudes as SPICE kernels, beside those of clock, frames, instrument and rotation.

The orbit of the body about the Sun is continued from a time that real kernels cover, or follows from its elements.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import spiceypy as spice

from photoclinometry.ingest.cameras import camera_named
from photoclinometry.ingest.radiometry import AU_KM
from photoclinometry.io.spice import kernel_files
from photoclinometry.model.geometry import Rigid, unit

_ORBIT_STEP_S = 600.0
"""Interval of the states of the body about the Sun [s]; interpolated by cubics, they are good to a millimetre."""
_LIGHT_TIME_S = 3600.0
"""Largest light time of apparent Suns [s]: 7 astronomical units."""
_HELD_S = 30.0
"""Positions and attitudes stay for this long before and after an image [s]."""
_SUN, _BARYCENTER, _J2000 = 10, 0, 1
"""NAIF's numbers."""
_SUN_GM = 1.32712440041e11
"""Of the planetary ephemeris DE440 [km^3 s^-2]."""
_M_PER_KM = 1000.0
_DISCRETE_STATES, _CUBIC_STATES, _DISCRETE_ATTITUDES = 9, 13, 3
"""Types of SPK and CK segments that are written."""


@dataclass(frozen=True, kw_only=True)
class Elements:
    """An orbit about the Sun, in the ecliptic of J2000."""

    perihelion_au: float
    eccentricity: float
    inclination_deg: float
    node_deg: float
    argument_deg: float
    """Of the perihelion."""
    at_perihelion: str
    """[UTC]."""

    def state(self, time: float) -> np.ndarray:
        """(6,) position and velocity [km, km/s] in J2000 at a time [s TDB past J2000]."""
        angles = np.radians([self.inclination_deg, self.node_deg, self.argument_deg])
        begin = spice.str2et(self.at_perihelion)
        conic = np.array([self.perihelion_au * AU_KM, self.eccentricity, *angles, 0.0, begin, _SUN_GM])
        state = np.array(spice.conics(conic, time))
        turn = spice.pxform("ECLIPJ2000", "J2000", 0.0)
        return np.concatenate([turn @ state[:3], turn @ state[3:]])


@dataclass(frozen=True, kw_only=True)
class Mission:
    """The names and numbers by which SPICE knows a camera, its spacecraft and the body."""

    camera: str
    """Its name in the table of cameras."""
    filter: str
    spacecraft: int
    bus: int
    """Frame of the spacecraft."""
    mount: int | None = None
    """The camera's frame that a kernel of attitudes relates to the spacecraft's; the instrument's is fixed to it.

    None where the instrument's frame is fixed to the spacecraft's."""
    body: int
    fixed: str
    """The body's frame."""
    real_time: str
    """A time that the real kernels cover, or a day on which the mission was there [UTC]."""
    undistorted: bool = False
    """Whether the archive has taken the distortion out of its files."""
    elements: Elements | None = None
    """The body's orbit where no real kernel has it."""
    definitions: str = ""
    """Clock, frames, instrument and rotation as a text kernel, where no real kernels are at hand."""

    @property
    def code(self) -> int:
        """The instrument."""
        return camera_named(self.camera).code_with_filter(self.filter)

    @property
    def frame(self) -> str:
        """The instrument's frame; its kernels are loaded."""
        return spice.frmnam(self.code)


@dataclass(frozen=True)
class Shot:
    """One image: when, from where, and how the instrument is held."""

    time: float
    """Of the middle of the exposure [s TDB past J2000]."""
    body_from_instrument: Rigid
    """In the body-fixed frame [m]."""


@contextmanager
def furnished(files: Sequence[Path]) -> Iterator[None]:
    """Kernels loaded while the block runs."""
    spice.kclear()
    try:
        for file in files:
            spice.furnsh(str(file))
        yield
    finally:
        spice.kclear()


def write_orbit(folder: Path, real: Path, mission: Mission, hours: float) -> None:
    """Copies the real text kernels and writes orbit.bsp: Sun and body for `hours` from the real time.

    real: the folder of the mission's real kernels; of a mission with definitions leap seconds and constants are copied.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for file in kernel_files([real]):
        generic = re.fullmatch(r"naif\d+\.tls|pck\d+\.tpc", file.name)
        if file.suffix.lower() not in (".bsp", ".bc") and (generic or not mission.definitions):
            shutil.copy2(file, folder / file.name)
    if mission.definitions:
        (folder / f"{mission.camera}.tf").write_text(mission.definitions)
    with furnished(kernel_files([real])):
        begin = spice.str2et(mission.real_time)
        if mission.elements:
            sun, body = np.zeros(6), mission.elements.state(begin)
        else:
            sun = spice.spkgeo(_SUN, begin, "J2000", _BARYCENTER)[0]
            body = spice.spkgeo(mission.body, begin, "J2000", _SUN)[0]
    times = begin + np.arange(-_LIGHT_TIME_S, 3600.0 * hours + 2 * _ORBIT_STEP_S, _ORBIT_STEP_S)
    with furnished(kernel_files([folder])):
        drift = np.concatenate([sun[:3] + np.outer(times - begin, sun[3:]), np.tile(sun[3:], (len(times), 1))], 1)
        states = np.array([spice.prop2b(_SUN_GM, body, time - begin) for time in times])
    handle = spice.spkopn(str(folder / "orbit.bsp"), "stand-in orbit", 0)
    for target, center, values in ((_SUN, _BARYCENTER, drift), (mission.body, _SUN, states)):
        span = (times[0], times[-1], "stand-in")
        spice.spkw13(handle, target, center, "J2000", *span, 3, len(times), values, times)
    spice.spkcls(handle)


def write_shots(folder: Path, mission: Mission, shots: Sequence[Shot]) -> None:
    """Writes spacecraft.bsp and attitudes.bc beside the kernels of `write_orbit`; about an image the craft rests."""
    with furnished(kernel_files([folder])):
        positions = [_inertial(mission, s) @ s.body_from_instrument.translation / _M_PER_KM for s in shots]
        turns = [s.body_from_instrument.rotation.T @ _inertial(mission, s).T for s in shots]
        held = np.array([[s.time - _HELD_S, s.time + _HELD_S] for s in shots])
        ticks = np.vectorize(lambda time: spice.sce2c(mission.spacecraft, time))(held)
        _write_positions(folder / "spacecraft.bsp", mission, held, np.array(positions))
        _write_attitudes(folder / "attitudes.bc", mission, ticks, _bus_from_inertial(mission, turns))


def _inertial(mission: Mission, shot: Shot) -> np.ndarray:
    """(3, 3) J2000 from body-fixed."""
    return spice.pxform(mission.fixed, "J2000", shot.time)


def _bus_from_inertial(mission: Mission, turns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Attitudes of the spacecraft that those of the instrument follow from; a mount is taken to be straight."""
    held_from_instrument = spice.pxform(mission.frame, spice.frmnam(mission.mount or mission.bus), 0.0)
    return [held_from_instrument @ turn for turn in turns]


def _write_positions(path: Path, mission: Mission, held: np.ndarray, positions: np.ndarray) -> None:
    handle = spice.spkopn(str(path), "stand-in positions", 0)
    states = np.concatenate([positions, np.zeros_like(positions)], 1).repeat(2, 0)
    spice.spkw09(
        handle,
        mission.spacecraft,
        mission.body,
        "J2000",
        held[0, 0],
        held[-1, 1],
        "stand-in",
        1,
        len(states),
        states,
        held.ravel(),
    )
    spice.spkcls(handle)


def _write_attitudes(path: Path, mission: Mission, ticks: np.ndarray, turns: Sequence[np.ndarray]) -> None:
    """ticks: (n, 2) begin and end of each image's attitude by the spacecraft's clock."""
    handle = spice.ckopn(str(path), "stand-in attitudes", 0)
    frames = [(mission.bus, "J2000", np.repeat([spice.m2q(turn) for turn in turns], 2, axis=0))]
    if mission.mount is not None:
        straight = np.tile([1.0, 0.0, 0.0, 0.0], (2 * len(turns), 1))
        frames.append((mission.mount, spice.frmnam(mission.bus), straight))
    for frame, reference, quaternions in frames:
        spice.ckw03(
            handle,
            ticks[0, 0],
            ticks[-1, 1],
            frame,
            reference,
            False,
            "stand-in",
            len(quaternions),
            ticks.ravel(),
            quaternions,
            np.zeros((len(quaternions), 3)),
            len(ticks),
            ticks[:, 0].copy(),
        )
    spice.ckcls(handle)


def sun_from_body(mission: Mission, time: float) -> np.ndarray:
    """(3,) unit vector towards the Sun, body-fixed, apparent from the body's centre."""
    return unit(spice.spkpos("SUN", time, mission.fixed, "LT+S", str(mission.body))[0])


def instrument_from_body(mission: Mission, time: float) -> Rigid:
    """Pose [m] with the corrections that ISIS makes: the spacecraft's place is minus the body's apparent place.

    Addenda of ISIS may name another correction (AMICA: none).
    """
    turn = spice.pxform(mission.fixed, mission.frame, time)
    named = f"INS{mission.code}_LIGHTTIME_CORRECTION"
    correction = spice.gcpool(named, 0, 1)[0] if spice.expool(named) else "LT+S"
    seen = spice.spkpos(str(mission.body), time, mission.fixed, correction, str(mission.spacecraft))[0]
    return Rigid(turn, turn @ seen * _M_PER_KM)
