"""Views of a body from given places, their poses known by priors, under given Suns."""

from pathlib import Path

import numpy as np

from photoclinometry.io.site import Site, SiteView
from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, so3_exp, unit
from photoclinometry.model.pose_prior import PosePrior

CAMERA = Camera("PINHOLE", 1000, 800, (10000.0, 10000.0, 500.0, 400.0))


def direction(lon_deg, lat_deg):
    """Unit vector from the body's centre."""
    lon, lat = np.radians([lon_deg, lat_deg])
    return np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def looking_at_center(center):
    """cam_from_body of a camera whose axis goes through the body's centre, its x axis to the east."""
    z = -unit(np.asarray(center, float))
    x = unit(np.cross(z, [0.0, 0.0, 1.0])) * -1.0
    rotation = np.stack([x, np.cross(z, x), z])
    return Rigid(rotation, -rotation @ center)


def view(name, center, sun_in_body, camera=CAMERA, turned=None):
    """A view with a pose prior; turned: a rotation vector in C [rad] away from the body's centre."""
    pose = looking_at_center(center)
    if turned is not None:
        pose = Rigid(so3_exp(np.array(turned)), np.zeros(3)) @ pose
    sun = pose.rotation @ unit(np.asarray(sun_in_body, float))
    return SiteView(name, Path("/images") / name, camera, sun, pose_prior=PosePrior(pose, 1e-3, 5.0))


def site_of(*views, body="bennu"):
    return Site("site", body, "iof", tuple(views), None, Path("/images/site.toml"))


def site_under_many_suns(count=12, body="bennu"):
    """Views 5 km above longitude 10, a Sun that goes from 60 degrees east to 60 degrees west of it."""
    views = []
    for k, sun in enumerate(np.linspace(-60.0, 60.0, count)):
        views.append(view(f"{k:02d}.fits", 5000.0 * direction(10.0 + k / 10, 5.0), direction(10.0 + sun, 5.0)))
    return site_of(*views, body=body)
