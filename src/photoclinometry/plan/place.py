"""The place of a plan, and the views as seen from there, in its local frame.

The local frame has its origin at the place: x east, y north, z along the surface's normal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.io.site import MIN_VIEWS, Site, SiteView
from photoclinometry.model.bodies import SEMI_AXES_M
from photoclinometry.model.errors import InputError
from photoclinometry.model.first_few import first_reasons
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Views
from photoclinometry.plan.options import PlanOptions
from photoclinometry.registration.place import Place, lon_lat_deg, place_at, plane_at, semi_axes
from photoclinometry.registration.view_choice import REGION_PX, reference_view
from photoclinometry.registration.viewing import Sighting, sighting, unseen_where

LISTED = 5
"""Views that an error names with the reason why they do not see the place; the others are counted."""
_PARALLEL = 1e-6
"""Sine of the angle between the normal and the axis z below which north is the axis y."""


@dataclass(frozen=True, kw_only=True)
class PlannedViews:
    """The views that see and light a place, in its local frame [m], and why the others do not."""

    place: Place
    seen: tuple[Sighting, ...]
    views: Views
    """Those of `seen`, in their order."""
    priors: dict[str, PosePrior]
    """By name of view, in the local frame; those with finite sigmas."""
    reference: int
    """Index of the reference view."""
    region_px: int
    """Side of the region [reference px]."""
    not_seen: dict[str, str]
    """Reasons why views do not count, by name."""
    body_from_local: Rigid

    @property
    def gsd_m(self) -> float:
        """Of the reference view."""
        return self.seen[self.reference].gsd_m


def planned_views(site: Site, options: PlanOptions) -> PlannedViews:
    """The views of a site with poses that see the place. Raises InputError: no poses, no such place, too few views."""
    posed = [view for view in site.views if view.pose_prior is not None]
    if not posed:
        raise InputError(
            f"{site.path}: none of its {len(site.views)} views has a pose (cam_from_body), so that nobody knows what "
            "they see. Add pose priors (`phomo ingest` with --kernels or --sumfiles writes them), or plan from a table "
            "of poses and Suns: view,x_m,y_m,z_m,sun_x,sun_y,sun_z,focal_px,width_px,height_px"
        )
    place = _place(site, posed, options)
    seen, not_seen = views_that_see(posed, place)
    not_seen |= {view.name: "it has no pose (cam_from_body)" for view in site.views if view.pose_prior is None}
    if len(seen) < MIN_VIEWS:
        raise InputError(
            f"{site.path}: {len(seen)} of {len(site.views)} views see the place, a map needs {MIN_VIEWS}. "
            f"{first_reasons(not_seen, LISTED)}. Choose another place (--at, --point) or other views"
        )
    by_name = {view.name: view for view in posed}
    reference = _reference(site, seen, by_name)
    frame = _local_frame(place)
    used = [by_name[s.name] for s in seen]
    asked = site.region.size_px if site.region is not None else None
    room = _room(seen[reference], used[reference])
    return PlannedViews(
        place=place,
        seen=tuple(seen),
        views=views_in(frame, used, site),
        priors=_finite_priors(frame, used),
        reference=reference,
        region_px=options.region_px or min(room, min(asked) if asked else REGION_PX),
        not_seen=not_seen,
        body_from_local=frame,
    )


def views_in(body_from_local: Rigid, used: list[SiteView], site: Site) -> Views:
    """Views of the site at their priors' poses, in a local frame."""
    local_from_body = body_from_local.inverse()
    poses = [local_from_body @ _pose(view).inverse() for view in used]
    body_from_cam = Rigid(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
    measured = unit(np.array([view.sun for view in used]))
    own, common = site.sun_sigmas
    index = [site.views.index(view) for view in used]
    return Views(
        name=tuple(view.name for view in used),
        cameras=tuple(view.camera for view in used),
        body_from_cam=body_from_cam,
        sun=np.einsum("kij,kj->ki", body_from_cam.rotation, measured),
        scale=np.ones(len(used)),
        bias=np.zeros(len(used)),
        dark_level=np.zeros(len(used)),
        sun_measured=measured,
        sun_sigma=own[index],
        sun_common_sigma=common[index],
        arc=site.arcs[index],
    )


def _pose(view: SiteView) -> Rigid:
    """cam_from_body."""
    assert view.pose_prior is not None
    return view.pose_prior.cam_from_body


def _finite_priors(body_from_local: Rigid, used: list[SiteView]) -> dict[str, PosePrior]:
    found = {}
    for view in used:
        prior = view.pose_prior
        assert prior is not None
        if math.isfinite(prior.translation_sigma) and math.isfinite(prior.rotation_sigma_rad):
            pose = prior.cam_from_body @ body_from_local
            found[view.name] = replace(prior, cam_from_body=pose)
    return found


def _place(site: Site, posed: list[SiteView], where: PlanOptions) -> Place:
    if where.point is not None:
        if where.at is not None:
            raise InputError("--at and --point are both given; give the place once")
        point = np.array(where.point, float)
        return plane_at(point, _upward(point, posed) if where.normal is None else np.array(where.normal, float))
    radii = where.radii_m if where.radii_m or site.body_radius_m is None else (site.body_radius_m,)
    if where.at is not None:
        return place_at(*where.at, semi_axes(site.body, radii))
    if radii is None and (site.body or "").lower() not in SEMI_AXES_M:
        raise InputError(
            f"{site.path}: says nothing of the body's size, so that the place is not known: give --at LON LAT "
            "with --radii-m, or --point X Y Z of the frame of the poses"
        )
    return _looked_at(site, posed, semi_axes(site.body, radii))


def _upward(point: np.ndarray, posed: list[SiteView]) -> np.ndarray:
    """The mean direction from a point towards the cameras."""
    return np.mean([unit(_pose(view).inverse().translation - point) for view in posed], 0)


def _looked_at(site: Site, posed: list[SiteView], axes: tuple[float, float, float]) -> Place:
    """Where the ray of the region's middle, or the boresight of its reference or of the first view, meets the body."""
    region = site.region
    named = [view for view in posed if region is not None and view.name == region.reference]
    view = (named or posed)[0]
    center = region.center_px if region is not None and named else None
    pixel = np.array(center if center is not None else view.camera.principal_px)
    pose = _pose(view).inverse()
    ray = pose.rotation @ view.camera.ray_in_cam(pixel)
    found = _first_hit(pose.translation / axes, ray / axes)
    if found is None:
        raise InputError(
            f"{site.path}: the middle of {view.name} misses the body's ellipsoid; give the place (--at LON LAT)"
        )
    lon, lat = lon_lat_deg(pose.translation + found * ray)
    return place_at(lon, lat, axes)


def _first_hit(origin: np.ndarray, ray: np.ndarray) -> float | None:
    """Distance along the ray, in its lengths, to the unit sphere; None if it misses."""
    a, b, c = ray @ ray, origin @ ray, origin @ origin - 1.0
    if b * b < a * c or c < 0.0:
        return None
    distance = float((-b - math.sqrt(b * b - a * c)) / a)
    return distance if distance > 0.0 else None


def views_that_see(posed: Sequence[SiteView], place: Place) -> tuple[list[Sighting], dict[str, str]]:
    """The views that see the place by day, and why the others do not."""
    seen: list[Sighting] = []
    not_seen: dict[str, str] = {}
    for view in posed:
        found = sighting(view, place)
        hidden = unseen_where(view, found)
        if found is None or hidden:
            not_seen[view.name] = f"the place lies {hidden}"
        elif found.incidence_deg >= 90.0:
            not_seen[view.name] = f"it is night there (incidence {found.incidence_deg:.0f} degrees)"
        else:
            seen.append(found)
    return seen, not_seen


def _reference(site: Site, seen: list[Sighting], views: dict[str, SiteView]) -> int:
    names = [s.name for s in seen]
    if site.region is not None and site.region.reference in names:
        return names.index(site.region.reference)
    found = reference_view(seen, views)
    if found is None:
        raise InputError(f"{site.path}: the place is at the edge of every image; choose another (--at)")
    return names.index(found.name)


def _room(seen: Sighting, view: SiteView) -> int:
    """Side of the largest square about the place in the image [px]."""
    (x, y), camera = seen.pixel, view.camera
    return int(2.0 * min(x, y, camera.width - x, camera.height - y))


def _local_frame(place: Place) -> Rigid:
    """body_from_local."""
    up = unit(place.normal)
    axis = np.array([0.0, 0.0, 1.0])
    if np.linalg.norm(np.cross(axis, up)) < _PARALLEL:
        axis = np.array([0.0, 1.0, 0.0])
    north = unit(axis - (axis @ up) * up)
    return Rigid(np.stack([np.cross(north, up), north, up], -1), place.position)
