"""`site.toml`: the images of a site, their cameras, Sun directions, pose priors, and the region to map.

Angles are in degrees in the file (names end in `_deg`) and in radians here. Every mistake is a SiteError that names
the file, the view, the key and the value found, with what to write instead.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io import site_display
from photoclinometry.io.atomic import write_text
from photoclinometry.io.masks import ALL_USED, BORDER, MASK, Masking, read_masking
from photoclinometry.io.site_body import BODY, BODY_RADIUS, check_outside, read_body
from photoclinometry.io.site_cameras import SiteCamera, read_cameras
from photoclinometry.io.suns_csv import GIVE_SUN
from photoclinometry.io.table import Table
from photoclinometry.io.toml_file import read_toml
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import SiteError
from photoclinometry.model.gamma import LINEAR
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.lens import NO_DISTORTION, Lens
from photoclinometry.model.pose_prior import PosePrior

MIN_VIEWS = 3
"""Fewest views of a site: with two views of a landmark a wrong match cannot be detected."""
DEFAULT_SUN_SIGMA_RAD = 1e-3
"""Standard deviation [rad] of Suns without `sun_sigma_deg`: 0.057 degrees, the paper's value."""
_OWN_SHARE = 0.05
"""Where a site does not state which part of the Suns' errors its images share, each one's own sigma is this part of the
stated one, or DEFAULT_SUN_SIGMA_RAD where that is more. Suns that are known worse than attitudes have an error of one
cause: an alignment, a shape or a frame. Star trackers measure an attitude to some thousandths of a degree."""
_POSE_COMMON = ("pose_common_sigma_deg", "pose_common_sigma")
"""Keys of the standard deviations of errors that all pose priors of an arc share: a rotation of the cameras [degrees],
and a shift [m]."""
_UNIT_TOLERANCE = 1e-3
"""Vectors and quaternions written with three decimals are this near to unit length."""
_ROUNDING = 1e-15
"""A Sun this near to unit length is kept to the last bit, so that what was written reads back the same."""


@dataclass(frozen=True)
class SiteView:
    """One image with its camera, its measured Sun and, if known, a prior of its pose."""

    name: str
    """The image's path as `site.toml` writes it."""
    image: Path
    camera: Camera
    sun: np.ndarray
    """(3,) unit vector from the body towards the Sun, in C."""
    sun_sigma_rad: float = DEFAULT_SUN_SIGMA_RAD
    """Standard deviation of `sun` about each tangent axis; see `Site.sun_sigmas`."""
    pose_prior: PosePrior | None = None
    masking: Masking = ALL_USED
    """Those of its camera included."""
    lens: Lens = NO_DISTORTION
    """Distortion that is removed from the image when it is read, so that `camera` is a pinhole."""
    gamma: float = LINEAR
    """The power to which the image's numbers are raised when it is read, so that they are linear in radiance."""
    arc: str | None = None
    """Name of the arc of attitude and orbit that `sun` and `pose_prior` are of; all views without one are of one."""


@dataclass(frozen=True)
class RegionRequest:
    """The part of the reference image to map. A field that is None is chosen automatically."""

    reference: str | None = None
    """Name of the reference view."""
    center_px: tuple[float, float] | None = None
    """(x, y) in the reference image."""
    size_px: tuple[int, int] | None = None
    """(width, height)."""
    stride: int | None = None
    """Distance of neighbouring landmarks, down and across [px]."""


@dataclass(frozen=True)
class Site:
    """The content of `site.toml`."""

    name: str
    """For reports."""
    body: str | None
    """Name of the body, in lower case; None where it is not stated."""
    brightness: str
    """"iof": radiance factor I/F; "dn": linear uncalibrated numbers."""
    views: tuple[SiteView, ...]
    """In the order of the file."""
    region: RegionRequest | None
    """None where the run is to choose."""
    path: Path
    """The file itself; image paths are relative to its folder."""
    linear: bool = False
    """The numbers of its images are linear in radiance whatever the files declare (gamma, sRGB)."""
    body_radius_m: float | None = None
    """Mean radius of a body that is not known by name."""
    sun_common_sigma_rad: float | None = None
    """Standard deviation of the common rotation error in C of all Suns of an arc; None where it is not known."""

    @property
    def sun_in_cam(self) -> np.ndarray:
        """(K, 3) unit vectors towards the Sun in C."""
        return unit(np.array([view.sun for view in self.views]))

    @property
    def sun_sigmas(self) -> tuple[np.ndarray, np.ndarray]:
        """Standard deviations [rad] of each Sun's own error (K,), and of the one that all of an arc share (K,).

        Where `sun_common_sigma_rad` is not known, most of a large stated error is assumed to be common.
        """
        stated = np.array([view.sun_sigma_rad for view in self.views])
        if self.sun_common_sigma_rad is not None:
            return stated, np.full(len(stated), self.sun_common_sigma_rad)
        own = np.maximum(_OWN_SHARE * stated, np.minimum(stated, DEFAULT_SUN_SIGMA_RAD))
        return own, np.sqrt(stated**2 - own**2)

    @property
    def arcs(self) -> np.ndarray:
        """(K,) int: number of each view's arc, in the order of their first views."""
        number = {arc: n for n, arc in enumerate(dict.fromkeys(view.arc for view in self.views))}
        return np.array([number[view.arc] for view in self.views])

    @property
    def cameras(self) -> tuple[list[SiteCamera], np.ndarray]:
        """The cameras (C,) with their lenses, masks left out, and the number of each view's (K,)."""
        of_view = [SiteCamera(view.camera, view.lens, gamma=view.gamma) for view in self.views]
        cameras = list(dict.fromkeys(of_view))
        return cameras, np.array([cameras.index(camera) for camera in of_view])

    @property
    def pose_priors(self) -> dict[str, PosePrior]:
        """By the names of the views that have one."""
        return {view.name: view.pose_prior for view in self.views if view.pose_prior is not None}

    def __repr__(self) -> str:
        return site_display.site_line(self)

    def _repr_html_(self) -> str:
        return site_display.site_card(self)


def read_site(path: Path | str) -> Site:
    """The site that a TOML file describes. Images are not opened. Raises SiteError."""
    path = Path(path)
    table = read_toml(path, "site.toml", SiteError).expect(
        *("name", BODY, BODY_RADIUS, "brightness", "linear", "sun_common_sigma_deg", *_POSE_COMMON, "camera"),
        *("cameras", "views", "region"),
    )
    name = table.text("name")
    body, radius = read_body(table)
    brightness = table.choice("brightness", ("iof", "dn"))
    linear = table.boolean("linear", False)
    common = table.number_from_zero("sun_common_sigma_deg", None)
    default, cameras = read_cameras(table, path.parent)
    shared = tuple(float(table.number_from_zero(key, 0.0)) for key in _POSE_COMMON)
    views = tuple(_read_view(path, entry, default, cameras, shared) for entry in table.tables("views"))
    if not views:
        _check_views(table, views)
    region = _read_region(table.table("region", None), views)
    table.finish()
    _check_views(table, views)
    check_outside(table, radius, {view.name: view.pose_prior for view in views if view.pose_prior is not None})
    common = None if common is None else math.radians(common)
    return Site(name, body, brightness, views, region, path, linear, radius, common)


def write_site(path: Path | str, site: Site) -> None:
    """`site` as TOML; each view's name is written as its image path. Raises RunFolderError."""
    import tomli_w

    write_text(path, tomli_w.dumps(site_document(site)))


def _read_view(
    path: Path, table: Table, default: SiteCamera | None, cameras: dict[str, SiteCamera], shared: tuple[float, ...]
) -> SiteView:
    """shared: standard deviations of the errors that all pose priors of an arc share [degrees, m]."""
    table.expect("image", "camera", "sun", "sun_sigma_deg", "arc", "cam_from_body", MASK, BORDER)
    name = table.text("image")
    table.where += f" ({name})"
    chosen = table.text("camera", None)
    if chosen is not None and chosen not in cameras:
        known = ", ".join(cameras) or "none are named; leave the key out"
        raise table.error("camera", f"there is no [cameras.{chosen}] (known: {known})")
    camera = default if chosen is None else cameras[chosen]
    if camera is None:
        raise table.error("camera", f"is missing; name one of {', '.join(cameras)}")
    masking = camera.masking.joined(read_masking(table, path.parent))
    sun = _read_sun(table)
    sigma_deg = table.positive_number("sun_sigma_deg", None)
    sigma = DEFAULT_SUN_SIGMA_RAD if sigma_deg is None else float(np.deg2rad(sigma_deg))
    prior = _read_prior(table.table("cam_from_body", None), shared)
    arc = table.text("arc", None)
    table.finish()
    return SiteView(name, path.parent / name, camera.camera, sun, sigma, prior, masking, camera.lens, camera.gamma, arc)


def _read_sun(table: Table) -> np.ndarray:
    """The key `sun` as a unit vector; a length off by the rounding of a few decimals is corrected."""
    sun = table.numbers("sun", 3, GIVE_SUN)
    length = math.hypot(*sun)
    if length == 0.0:
        raise table.error("sun", f"is the zero vector; {GIVE_SUN}")
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise table.error("sun", f"{sun.tolist()} has length {length:.6g}, not 1; {GIVE_SUN}")
    return sun if abs(length - 1.0) < _ROUNDING else sun / length


def _read_prior(table: Table | None, shared: tuple[float, ...]) -> PosePrior | None:
    if table is None:
        return None
    from scipy.spatial.transform import Rotation

    table.expect("rotation_wxyz", "translation", "sigma_deg", "sigma")
    wxyz = table.numbers("rotation_wxyz", 4, "give a unit quaternion, scalar first")
    length = math.hypot(*wxyz)
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise table.error("rotation_wxyz", f"has length {length:.6g}, not 1; give a unit quaternion")
    translation = table.numbers("translation", 3)
    rotation_sigma = float(np.deg2rad(table.positive_number("sigma_deg")))
    sigma = float(table.positive_number("sigma"))
    table.finish()
    rotation = Rotation.from_quat(wxyz / length, scalar_first=True).as_matrix()
    return PosePrior(Rigid(rotation, translation), rotation_sigma, sigma, math.radians(shared[0]), shared[1])


def _read_region(table: Table | None, views: tuple[SiteView, ...]) -> RegionRequest | None:
    if table is None:
        return None
    table.expect("reference", "center_px", "size_px", "stride")
    reference = table.text("reference", None)
    center = table.numbers("center_px", 2) if "center_px" in table else None
    size = table.positive_integers("size_px", 2) if "size_px" in table else None
    stride = table.positive_integer("stride") if "stride" in table else None
    table.finish()
    by_name = {view.name: view for view in views}
    if reference is not None and reference not in by_name:
        raise table.error("reference", f"{reference!r} is not the image of any view", nearest=(reference, by_name))
    if center is not None and reference is None:
        raise table.error("center_px", "is a position in the reference image: give `reference`, too")
    if reference is not None:
        _check_inside(table, by_name[reference], center, size)
    elif size is not None and all((size > (v.camera.width, v.camera.height)).any() for v in views):
        raise table.error("size_px", f"{size.tolist()} is larger than every image; shrink it")
    if size is not None and stride is not None and stride >= min(size):
        raise table.error(
            "stride",
            f"{stride} leaves a single row of landmarks in a region of {size.tolist()} px; choose a smaller stride",
        )
    return RegionRequest(
        reference,
        None if center is None else (float(center[0]), float(center[1])),
        None if size is None else (int(size[0]), int(size[1])),
        stride,
    )


def _check_inside(table: Table, view: SiteView, center: np.ndarray | None, size: np.ndarray | None) -> None:
    bounds = np.array([view.camera.width, view.camera.height])
    half = np.zeros(2) if size is None else size / 2
    middle = bounds / 2 if center is None else center
    if (middle - half < 0).any() or (middle + half > bounds).any():
        key = "size_px" if center is None else "center_px"
        raise table.error(
            key,
            f"the region reaches outside {view.name}: x {middle[0] - half[0]:g} to {middle[0] + half[0]:g}, "
            f"y {middle[1] - half[1]:g} to {middle[1] + half[1]:g}, in an image of {bounds[0]} x {bounds[1]}"
            "; move the centre or shrink the size",
        )


def _check_views(table: Table, views: tuple[SiteView, ...]) -> None:
    if len(views) < MIN_VIEWS:
        raise table.error("views", f"there are {len(views)}, at least {MIN_VIEWS} are needed; add [[views]]")
    first: dict[str, str] = {}
    for view in views:
        place = os.path.realpath(view.image)
        if place in first:
            raise table.error("views", f"{first[place]} and {view.name} are the same file; remove one of the two views")
        first[place] = view.name


def site_document(site: Site) -> dict[str, Any]:
    """The content of `site.toml` as nested dictionaries. Several cameras are numbered."""
    document: dict[str, Any] = {"name": site.name}
    if site.body is not None:
        document[BODY] = site.body
    if site.body_radius_m is not None:
        document[BODY_RADIUS] = float(site.body_radius_m)
    document["brightness"] = site.brightness
    if site.linear:
        document["linear"] = True
    if site.sun_common_sigma_rad is not None:
        document["sun_common_sigma_deg"] = math.degrees(site.sun_common_sigma_rad)
    priors = list(site.pose_priors.values())
    if priors and any((priors[0].common_rotation_sigma_rad, priors[0].common_translation_sigma)):
        shared = math.degrees(priors[0].common_rotation_sigma_rad), float(priors[0].common_translation_sigma)
        document |= dict(zip(_POSE_COMMON, shared, strict=True))
    cameras, of_view = site.cameras
    entries = [camera.entry() for camera in cameras]
    if len(cameras) == 1:
        document["camera"] = entries[0]
    else:
        document["cameras"] = {f"camera{n}": entry for n, entry in enumerate(entries)}
    if site.region is not None:
        region = {"reference": site.region.reference}
        region |= {key: getattr(site.region, key) for key in ("center_px", "size_px", "stride")}
        document["region"] = {key: value for key, value in region.items() if value is not None}
    document["views"] = []
    for view, number in zip(site.views, of_view, strict=True):
        entry: dict[str, Any] = {"image": view.name}
        if len(cameras) > 1:
            entry["camera"] = f"camera{number}"
        entry["sun"] = np.asarray(view.sun, float).tolist()
        entry["sun_sigma_deg"] = float(np.rad2deg(view.sun_sigma_rad))
        if view.arc is not None:
            entry["arc"] = view.arc
        if view.pose_prior is not None:
            entry["cam_from_body"] = _prior_dict(view.pose_prior)
        entry |= view.masking.document(site.path.parent)
        document["views"].append(entry)
    return document


def _prior_dict(prior: PosePrior) -> dict[str, Any]:
    from scipy.spatial.transform import Rotation

    return {
        "rotation_wxyz": Rotation.from_matrix(prior.cam_from_body.rotation).as_quat(scalar_first=True).tolist(),
        "translation": np.asarray(prior.cam_from_body.translation, float).tolist(),
        "sigma_deg": float(np.rad2deg(prior.rotation_sigma_rad)),
        "sigma": float(prior.translation_sigma),
    }
