"""A table of poses and Suns, read as a site without images.

    view,x_m,y_m,z_m,sun_x,sun_y,sun_z,focal_px,width_px,height_px

in the frame of the poses, such as the body-fixed one: the camera's centre, the direction towards the Sun, and the
camera, a pinhole whose principal point is in the middle. Optional columns: `qw,qx,qy,qz` (attitude, x_C = R x_B + t, as
in site.toml), or else `target_x_m,target_y_m,target_z_m` (a point at which it looks; by default the origin);
`center_sigma_m,rotation_sigma_deg` (the expected uncertainty of the pose), `sun_sigma_deg`.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from photoclinometry.io.csv_rows import CsvRow, read_csv_rows
from photoclinometry.io.site import DEFAULT_SUN_SIGMA_RAD, Site, SiteView
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.simulate.trajectory import looking_at

CENTER, SUN = ("x_m", "y_m", "z_m"), ("sun_x", "sun_y", "sun_z")
SIZE = ("focal_px", "width_px", "height_px")
COLUMNS = ("view", *CENTER, *SUN, *SIZE)
ATTITUDE, TARGET = ("qw", "qx", "qy", "qz"), ("target_x_m", "target_y_m", "target_z_m")

_SMALLEST, _LARGEST = 1e-9, 1e15
"""Lengths, directions and sigmas beyond these are damage or mistakes of a unit [m, px, degrees]."""
_LARGEST_PX = 65535
"""Of the width and height of an image [px]."""
_PARALLEL = 1e-6
"""Sine of the angle to the axis z below which a camera looks along it, and up in its image is y."""


def read_table(path: Path | str) -> Site:
    """The views of a table as a site; poses whose sigmas it does not give are known for planning alone (infinite).

    Raises InputError that names the line.
    """
    path = Path(path)
    views: dict[str, SiteView] = {}
    for row in read_csv_rows(path, "table of poses and Suns", COLUMNS):
        view = _view(row, path)
        if view.name in views:
            raise row.error(f"view {view.name!r} occurs twice; give each a name of its own")
        views[view.name] = view
    if not views:
        raise InputError(f"{path}: has no view; write a line for each")
    return Site(name=path.stem, body=None, brightness="iof", views=tuple(views.values()), region=None, path=path)


def _view(row: CsvRow, path: Path) -> SiteView:
    name, center, sun = row.name("view"), _vector(row, CENTER), _vector(row, SUN)
    if np.linalg.norm(sun) < _SMALLEST:
        raise row.error("the direction towards the Sun is the zero vector")
    focal, width, height = _positive(row, "focal_px"), _pixels(row, "width_px"), _pixels(row, "height_px")
    pose = _pose(row, center)
    sigma = _positive(row, "sun_sigma_deg") if row.has("sun_sigma_deg") else math.degrees(DEFAULT_SUN_SIGMA_RAD)
    prior = PosePrior(
        pose.inverse(),
        math.radians(_positive(row, "rotation_sigma_deg")) if row.has("rotation_sigma_deg") else math.inf,
        _positive(row, "center_sigma_m") if row.has("center_sigma_m") else math.inf,
    )
    return SiteView(
        name=name,
        image=path.parent / name,
        camera=Camera("PINHOLE", width, height, (focal, focal, 0.5 * width, 0.5 * height)),
        sun=unit(sun) @ pose.rotation,
        sun_sigma_rad=math.radians(sigma),
        pose_prior=prior,
    )


def _pose(row: CsvRow, center: np.ndarray) -> Rigid:
    """body_from_cam by the attitude, or by the target of the camera."""
    from scipy.spatial.transform import Rotation

    if row.has(ATTITUDE[0]):
        quaternion = _vector(row, ATTITUDE)
        if np.linalg.norm(quaternion) < _SMALLEST:
            raise row.error("the attitude qw,qx,qy,qz is the zero quaternion")
        return Rigid(Rotation.from_quat(quaternion, scalar_first=True).as_matrix().T, center)
    target = _vector(row, TARGET) if row.has(TARGET[0]) else np.zeros(3)
    if np.allclose(center, target) or np.linalg.norm(center - target) < _SMALLEST:
        raise row.error("the camera is at the point that it looks at; give qw,qx,qy,qz or another target")
    return looking_from(center, target)


def looking_from(center: np.ndarray, target: np.ndarray) -> Rigid:
    """body_from_cam of a camera that looks at a target; up in its image is as near as possible to the axis z."""
    forward = unit(target - center)
    north = (0.0, 0.0, 1.0) if np.linalg.norm(np.cross(forward, (0.0, 0.0, 1.0))) > _PARALLEL else (0.0, 1.0, 0.0)
    return looking_at(center, target, 0.0, north)


def _vector(row: CsvRow, columns: tuple[str, ...]) -> np.ndarray:
    found = np.array([row.number(column) for column in columns])
    if np.abs(found).max() > _LARGEST:
        raise row.error(f"{','.join(columns)} are {found.tolist()}, expected numbers up to {_LARGEST:g}")
    return found


def _positive(row: CsvRow, column: str) -> float:
    value = row.positive(column)
    if not _SMALLEST <= value <= _LARGEST:
        raise row.error(f"{column} is {value:g}, expected a number from {_SMALLEST:g} to {_LARGEST:g}")
    return value


def _pixels(row: CsvRow, column: str) -> int:
    value = row.positive(column)
    if value > _LARGEST_PX or value != int(value):
        raise row.error(f"{column} is {value:g}, expected a whole number of pixels up to {_LARGEST_PX}")
    return int(value)
