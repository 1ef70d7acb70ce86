"""Visibility of one place of the body in the views of a site, by their pose priors: resolution and angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.io.site import Site, SiteView
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, angle_between, unit
from photoclinometry.registration.place import Place

BEYOND_LIMB = "beyond the limb"
"""Remark for a place on the other side of the body."""


@dataclass(frozen=True, kw_only=True)
class Sighting:
    """One view's sight of a place. Angles are those at the place, against the normal of the reference ellipsoid."""

    name: str
    """The view's."""
    pixel: tuple[float, float]
    """(x, y) of the place in the image [px]."""
    gsd_m: float
    """One pixel across the line of sight, at the place [m]."""
    emission_deg: float
    """Between the normal and the direction to the camera."""
    incidence_deg: float
    """Between the normal and the direction to the Sun; above 90 it is night there."""
    phase_deg: float
    """Between the directions to the Sun and to the camera."""
    distance_m: float
    """From the camera to the place."""
    sub_spacecraft_deg: float
    """Angle at the body's centre between the place and the point below the spacecraft."""
    to_camera: np.ndarray
    """(3,) unit vector from the place to the camera, in the body-fixed frame."""
    to_sun: np.ndarray
    """(3,) unit vector towards the Sun, in the body-fixed frame."""


@dataclass(frozen=True, kw_only=True)
class Sightings:
    """The views that see a place, in the order of the site, and the numbers of those that do not."""

    place: Place
    seen: tuple[Sighting, ...]
    beyond_limb: int
    """Views from which the place lies behind the body."""
    outside_image: int
    """Views that have the place on their side of the body, but not in the image."""
    without_prior: int
    """Views without a pose prior, of which nothing is known."""


def sightings(site: Site, place: Place) -> Sightings:
    """Visibility of a place in the views of a site with pose priors.

    A view sees it if the emission angle is below 90 degrees and the place projects into the image: the body is replaced
    by its ellipsoid, and no ground hides other ground. Raises InputError where no view has a pose prior, or where a
    prior puts the camera inside the ellipsoid.
    """
    views = [view for view in site.views if view.pose_prior is not None]
    if not views:
        raise InputError(
            f"{site.path}: none of its {len(site.views)} views has a pose prior (cam_from_body), so that nobody knows "
            "which of them see a place. Make the site again by `phomo ingest` with --kernels (SPICE), with --sumfiles, "
            "or of ISIS cubes after spiceinit, and without --no-pose-priors"
        )
    seen: list[Sighting] = []
    beyond = outside = 0
    for view in views:
        found = sighting(view, place)
        hidden = unseen_where(view, found)
        if found is not None and not hidden:
            seen.append(found)
        elif hidden == BEYOND_LIMB:
            beyond += 1
        else:
            outside += 1
    return Sightings(
        place=place,
        seen=tuple(seen),
        beyond_limb=beyond,
        outside_image=outside,
        without_prior=len(site.views) - len(views),
    )


def sighting(view: SiteView, place: Place) -> Sighting | None:
    """A view's sight of a place, also beyond the limb and beside the image; None where it lies behind the camera.

    The view has a pose prior. Raises InputError where that puts the camera inside the ellipsoid.
    """
    assert view.pose_prior is not None
    pose = view.pose_prior.cam_from_body
    center = pose.inverse().translation
    _check_outside(view, center, place)
    in_cam = pose(place.position)
    if in_cam[2] <= 0:
        return None
    to_camera, to_sun = unit(center - place.position), _sun(view, pose)
    x, y = view.camera.pixel_from_cam(in_cam)
    return Sighting(
        name=view.name,
        pixel=(float(x), float(y)),
        gsd_m=float(in_cam[2] / np.sqrt(np.prod(view.camera.focal_px))),
        emission_deg=_degrees(place.normal, to_camera),
        incidence_deg=_degrees(place.normal, to_sun),
        phase_deg=_degrees(to_sun, to_camera),
        distance_m=float(np.linalg.norm(center - place.position)),
        sub_spacecraft_deg=_degrees(place.position, center),
        to_camera=to_camera,
        to_sun=to_sun,
    )


def unseen_where(view: SiteView, found: Sighting | None) -> str:
    """The position of a place that a view does not see, by the view's sight of it; empty if the view sees it."""
    if found is None:
        return "behind the camera"
    if found.emission_deg >= 90.0:
        return BEYOND_LIMB
    x, y = found.pixel
    inside = 0.0 <= x <= view.camera.width and 0.0 <= y <= view.camera.height
    return "" if inside else f"beside the image, at pixel {x:.0f} {y:.0f}"


def light_and_sight(seen: Sequence[Sighting]) -> np.ndarray:
    """(n, n) differences between views [rad]: root of the summed squares of the angles between Suns and between
    cameras.

    The former separates albedo from slope, the latter gives depth; both count the same.
    """
    return differences(np.array([s.to_sun for s in seen]), np.array([s.to_camera for s in seen]))


def differences(suns: np.ndarray, cameras: np.ndarray) -> np.ndarray:
    """(n, n) as of `light_and_sight`, by unit vectors (n, 3) towards Suns and cameras."""
    return np.hypot(angle_between(suns[:, None], suns[None]), angle_between(cameras[:, None], cameras[None]))


def _sun(view: SiteView, pose: Rigid) -> np.ndarray:
    """(3,) unit vector towards the Sun in the body-fixed frame."""
    return unit(pose.rotation.T @ view.sun)


def _degrees(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(angle_between(a, b)))


def _check_outside(view: SiteView, center: np.ndarray, place: Place) -> None:
    axes = np.array(place.semi_axes_m)
    if not axes.all():
        return
    size = " x ".join(f"{axis:g}" for axis in axes)
    if np.linalg.norm(center / axes) <= 1.0:
        raise InputError(
            f"{view.name}: its pose prior puts the camera {np.linalg.norm(center):.4g} m from the body's centre, "
            f"inside the body ({size} m): the prior is not in the body-fixed frame in metres, or the body or its "
            "radius (--radii-m) is another"
        )
