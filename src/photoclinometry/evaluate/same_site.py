"""Whether the truth of a simulation belongs to the site of a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.evaluate.compare import view_indices
from photoclinometry.evaluate.pose_errors import relative_rotation_errors
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, angle_between
from photoclinometry.model.scene import Scene
from photoclinometry.simulate.truth import SiteFacts, Truth
from photoclinometry.simulate.truth_file import read_truth

OTHER_SUNS_DEG = 1.0
"""Stated Suns of one site are equal up to the digits of site.toml; those of two sites differ by tens of degrees."""
OTHER_POSES_DEG = 10.0
"""Relative rotations of a map are off by less than a degree; those of two sites differ by tens of degrees."""


def read_truth_of(path: Path | str, scene: Scene) -> Truth:
    """The truth in the file. Raises InputError where it is missing, damaged, or of another site than the scene."""
    truth, views = read_truth(path), scene.views
    check_same_site(path, truth, views.name, views.cameras, views.body_from_cam, views.sun_measured)
    return truth


def check_same_site(
    path: Path | str,
    truth: SiteFacts,
    names: tuple[str, ...],
    cameras: tuple[Camera, ...],
    body_from_cam: Rigid,
    sun_measured: np.ndarray | None,
) -> None:
    """Raises InputError where the truth in the file `path` is of another site than a map with views `names` (K,).

    The truth must have every view, with images of the same size. Suns as stated, in C (K, 3), or poses must agree as
    well: a map with wrong Suns and a map with wrong poses may both be measured. sun_measured None: the poses alone.
    """
    indices = view_indices(names, truth.views.name)
    missing = [name for k, name in enumerate(names) if k not in indices]
    remedy = "give the truth.h5 that lies beside the map's site.toml"
    if missing:
        raise InputError(
            f"{path}: is the truth of another site: it has {len(names) - len(missing)} of the map's {len(names)} "
            f"views, and not {missing[0]!r}; {remedy}"
        )
    index = [indices[k] for k in range(len(names))]
    for name, camera, true in zip(names, cameras, (truth.views.cameras[k] for k in index), strict=True):
        if (camera.width, camera.height) != (true.width, true.height):
            raise InputError(
                f"{path}: is the truth of another site: {name!r} has {true.width} x {true.height} px there, and "
                f"{camera.width} x {camera.height} px in the map; {remedy}"
            )
    turned = float(np.median(relative_rotation_errors(body_from_cam, truth.views.body_from_cam[index])))
    found = f"the relative rotations of its cameras by {turned:.0f} degrees"
    if sun_measured is not None:
        off = float(np.degrees(np.median(angle_between(sun_measured, truth.views.sun_measured[index]))))
        if off < OTHER_SUNS_DEG:
            return
        found = f"its Suns by {off:.0f} and {found}"
    if turned > OTHER_POSES_DEG:
        raise InputError(f"{path}: is the truth of another site: {found} differ from the map's (medians); {remedy}")
