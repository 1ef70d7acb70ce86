"""Camera poses and Suns of a mission to a body: approach, images of the whole body, and close-ups, from all sides.

The Sun and the camera's station stand still in inertial space while the body spins below, as at Bennu's and Ryugu's
home positions; in the body-fixed frame both go round. Stations differ in latitude and phase angle. The Sun stands
north of the equator for northern stations and south of it for southern ones, so that both poles are lit at some time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.simulate.trajectory import looking_at

SUN_LATITUDE_DEG = 14.0
"""Latitude of the Sun for northern stations; for southern ones it is negative."""
WHOLE_SHARE = 0.78
"""Share of an image's width that the longest axis of a body takes in images of the whole body."""
CLOSE_UP = 1.7
"""Ground sample distance of images of the whole body over that of close-ups."""
APPROACH = 2.0
"""Ground sample distance on approach over that of images of the whole body."""
_OFF_MIDDLE = 0.5
"""Distance from the body's middle towards its edge at which close-ups aim, to all sides [way to the edge]."""
_DISTANCE_SPREAD = 0.03
"""Largest relative variation of the distance at a station."""
_SPIN_SPREAD = 0.15
"""Largest irregularity of the times between images [intervals]."""
_ROLL_SPREAD_DEG = 4.0
"""Standard deviation of the camera's roll at a station."""
_PHASE_MARGIN_DEG = 1.0
"""A phase angle is this much larger at least than the difference of latitudes of Sun and station."""
_LARGEST_JITTER = 2.0
"""Pointing errors are cut off here [standard deviations]."""
_NORTH = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class Station:
    """A place in inertial space from which the spinning body is seen."""

    gsd: float
    """Ground sample distance over that of close-ups."""
    latitude_deg: float
    """Of the point below the camera."""
    phase_deg: float
    """Angle between Sun and camera."""
    evening: bool
    """Whether the camera stands east of the Sun, over the afternoon."""
    share: float
    """Weight that the number of images is dealt by."""


def _stations(gsd: float, rows: tuple[tuple[float, float, bool, float], ...]) -> tuple[Station, ...]:
    return tuple(
        Station(gsd=gsd, latitude_deg=latitude, phase_deg=phase, evening=evening, share=share)
        for latitude, phase, evening, share in rows
    )


SHORT_MISSION = (
    *_stations(APPROACH * CLOSE_UP, ((4.0, 18.0, True, 2.0),)),
    *_stations(CLOSE_UP, ((5.0, 25.0, False, 12.0),)),
    *_stations(1.0, ((40.0, 35.0, False, 13.0), (-40.0, 35.0, True, 13.0))),
)
"""Stations for few images: their neighbours must overlap, 28 degrees of the body's rotation apart for 40 images."""
MISSION = (
    *_stations(APPROACH * CLOSE_UP, ((4.0, 18.0, True, 6.0),)),
    *_stations(
        CLOSE_UP,
        (
            (5.0, 25.0, False, 18.0),
            (-5.0, 75.0, True, 12.0),
            (68.0, 60.0, False, 9.0),
            (-68.0, 60.0, True, 9.0),
        ),
    ),
    *_stations(1.0, ((8.0, 12.0, True, 22.0), (38.0, 35.0, False, 22.0), (-38.0, 35.0, True, 22.0))),
)
"""Stations for many images."""
FEW_IMAGES = 70
"""Fewer images are those of the short mission."""


def mission_of(count: int) -> tuple[Station, ...]:
    """The stations that a number of images is dealt to."""
    return SHORT_MISSION if count < FEW_IMAGES else MISSION


def finest_gsd(reach: float, image_px: int) -> float:
    """Ground sample distance of close-ups [m] of a body of greatest radius `reach` [m], if the preset chooses it."""
    return 2.0 * reach / (WHOLE_SHARE * image_px * CLOSE_UP)


def images_at_stations(count: int) -> np.ndarray:
    """(count,) station of each image, in order: as near to the stations' shares as whole numbers can be."""
    mission = mission_of(count)
    share = np.cumsum([station.share for station in mission])
    bound = np.concatenate([[0.0], share / share[-1]]) * count
    return np.clip(np.searchsorted(bound, np.arange(count) + 0.5) - 1, 0, len(mission) - 1)


def draw_mission(
    rng: np.random.Generator, count: int, gsd: float, focal_px: float, points: np.ndarray, pointing_jitter_px: float
) -> tuple[Rigid, np.ndarray]:
    """body_from_cam of `count` views (K,), and the unit vectors towards the Sun in B (K, 3).

    gsd: of close-ups [m], in the plane through the body's middle; points: (n, 3) of its surface.
    """
    station_of = images_at_stations(count)
    poses, suns = [], []
    for number, station in enumerate(mission_of(count)):
        n = int((station_of == number).sum())
        start, roll = rng.uniform(0.0, 2.0 * math.pi, 2)
        turn = (np.arange(n) + _SPIN_SPREAD * rng.uniform(-1.0, 1.0, n)) * 2.0 * math.pi / max(n, 1)
        sun, camera = station_directions(station)
        for k in range(n):
            body_from_inertial = _about_z(-start - turn[k])
            center = body_from_inertial @ camera * gsd * station.gsd * focal_px
            center = center * rng.uniform(1.0 - _DISTANCE_SPREAD, 1.0 + _DISTANCE_SPREAD)
            jitter = np.clip(rng.standard_normal(2), -_LARGEST_JITTER, _LARGEST_JITTER) * pointing_jitter_px
            across = _sideways(center)
            target = across @ (jitter * gsd * station.gsd)
            if station.gsd == 1.0:
                target = target + across @ _off_middle(points @ across, k)
            tilt = roll + math.radians(_ROLL_SPREAD_DEG) * rng.standard_normal()
            poses.append(looking_at(center, target, tilt, _NORTH))
            suns.append(body_from_inertial @ sun)
    return Rigid(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])), np.array(suns)


def station_directions(station: Station) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (3,) towards the Sun and towards the camera, z along the body's axis, the Sun over longitude 0."""
    latitude = math.radians(station.latitude_deg)
    sun_latitude = math.copysign(math.radians(SUN_LATITUDE_DEG), latitude)
    nearest = abs(latitude - sun_latitude) + math.radians(_PHASE_MARGIN_DEG)
    phase = max(math.radians(station.phase_deg), nearest)
    # The spherical law of cosines.
    cos_longitude = (math.cos(phase) - math.sin(latitude) * math.sin(sun_latitude)) / (
        math.cos(latitude) * math.cos(sun_latitude)
    )
    longitude = math.acos(min(max(cos_longitude, -1.0), 1.0)) * (1.0 if station.evening else -1.0)
    return _direction(0.0, sun_latitude), _direction(longitude, latitude)


def _direction(longitude: float, latitude: float) -> np.ndarray:
    c = math.cos(latitude)
    return np.array([c * math.cos(longitude), c * math.sin(longitude), math.sin(latitude)])


def _about_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _sideways(center: np.ndarray) -> np.ndarray:
    """(3, 2) unit vectors to the right and up of the line of sight to the middle of the body."""
    right = unit(np.cross(-center, _NORTH))
    return np.stack([right, unit(np.cross(right, -center))], -1)


def _off_middle(outline: np.ndarray, number: int) -> np.ndarray:
    """(2,) where the close-up of that number aims: to four sides and the middle of a body seen at (n, 2), in turn."""
    if number % 5 == 4:
        return np.zeros(2)
    angle = math.pi * (0.25 + 0.5 * (0, 2, 1, 3)[number % 5])
    along = outline @ [math.cos(angle), math.sin(angle)]
    return _OFF_MIDDLE * outline[np.argmax(along)]
