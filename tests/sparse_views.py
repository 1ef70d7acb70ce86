"""Views from around the zenith of rough ground, painted or under Suns, and true poses: for structure from motion."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, so3_log
from photoclinometry.model.image import Image
from photoclinometry.model.region import Region
from photoclinometry.sfm import SfmOptions
from scenes import from_zenith, look_at_origin

FOCAL_PX = 4000.0  # focal / width = 13: longer than what COLMAP takes by default
CAMERA = Camera("PINHOLE", 300, 300, (FOCAL_PX, FOCAL_PX, 150.0, 150.0))
ALL_VALID = np.ones((300, 300), bool)
OPTIONS = SfmOptions(max_features=1500, threads=2)


def views_around(count):
    """(count,) body_from_cam: 4 to 20 degrees from the zenith, one pixel covers a unit of length."""
    angle, azimuth = np.radians(np.linspace(4, 20, count)), 2.4 * np.arange(count)
    centers = FOCAL_PX * from_zenith(angle, azimuth)
    poses = [look_at_origin(c, 0.1 * k) for k, c in enumerate(centers)]
    return Rigid(np.stack([p.rotation for p in poses]), centers)


def ground_behind_pixels(pose, height, camera=CAMERA):
    """(2, 300 * 300) rows and columns of a grid of heights (512, 512), origin in its middle, that pixels show."""
    rays = camera.ray_in_cam(Region.of_image(300, 300).pixel_centers()) @ pose.rotation.T
    z = 0.0
    for _ in range(8):  # fixed point: slopes are gentle
        point = pose.translation + ((z - pose.translation[2]) / rays[..., 2])[..., None] * rays
        at = point[..., 1::-1].reshape(-1, 2).T + 256
        z = map_coordinates(height, at, order=1, mode="nearest").reshape(300, 300)
    return at


def painted(pose, seed, camera=CAMERA):
    """A view of a textured relief: noise of several scales painted on heights of about 8 units."""
    rng = np.random.default_rng(seed)
    paint = sum(s * gaussian_filter(rng.normal(size=(512, 512)), s) for s in (1.2, 2.5, 5, 10))
    at = ground_behind_pixels(pose, gaussian_filter(rng.normal(size=(512, 512)), 20) * 500, camera)
    bright = map_coordinates(paint, at, order=3, mode="nearest").reshape(300, 300)
    return (10.0 + bright + 0.01 * rng.normal(size=bright.shape)).astype(np.float32)


def painted_site(count=5, seed=0, prefix="a"):
    """Views of one painted relief, lit from everywhere alike: images and poses."""
    poses = views_around(count)
    pictures = [painted(poses[k], seed) for k in range(count)]
    return [Image(f"{prefix}{k}.fits", p, np.ones(p.shape, bool)) for k, p in enumerate(pictures)], poses


def relief_of(seed):
    """(512, 512) heights: hills of about 8 units, without which poses are hard to tell, and detail of all scales."""
    rng = np.random.default_rng(seed)
    hills = 800 * gaussian_filter(rng.normal(size=(512, 512)), 25)
    return hills + sum(0.25 * s**2 * gaussian_filter(rng.normal(size=(512, 512)), s) for s in (1.5, 3, 6, 12))


def shaded(pose, sun, height, noise_seed):
    """What a camera sees of the relief, Lambert's cosine of the Sun's angle for brightness."""
    at = ground_behind_pixels(pose, height)
    slope = np.array([map_coordinates(g, at, order=3, mode="nearest").reshape(300, 300) for g in np.gradient(height)])
    cosine = (sun[2] - slope[1] * sun[0] - slope[0] * sun[1]) / np.sqrt(1 + (slope**2).sum(0))
    noise = 0.003 * np.random.default_rng(noise_seed).normal(size=cosine.shape)
    return np.maximum(0.1 * cosine, 0.0) + noise


def sun_at(azimuth_deg, incidence_deg=55.0):
    """Unit vector towards the Sun, azimuths from x (columns) to y (rows)."""
    azimuth, incidence = np.radians([azimuth_deg, incidence_deg])
    return np.array([np.sin(incidence) * np.cos(azimuth), np.sin(incidence) * np.sin(azimuth), np.cos(incidence)])


def lit_site(azimuths_deg, seed=0, prefix="a"):
    """Views of one relief, each under its own Sun: images, Suns in C, poses."""
    poses, height = views_around(len(azimuths_deg)), relief_of(seed)
    suns = [sun_at(azimuth) for azimuth in azimuths_deg]
    pictures = [shaded(poses[k], sun, height, 10 * seed + k) for k, sun in enumerate(suns)]
    images = [Image(f"{prefix}{k}.fits", p.astype(np.float32), ALL_VALID) for k, p in enumerate(pictures)]
    return images, np.array([poses[k].rotation.T @ sun for k, sun in enumerate(suns)]), poses


def rotation_errors_deg(found, true):
    """Between the relative rotations of all pairs of views."""
    pairs = [(a, b) for a in range(len(true)) for b in range(a)]
    difference = [
        (true.rotation[a].T @ true.rotation[b]).T @ (found.rotation[a].T @ found.rotation[b]) for a, b in pairs
    ]
    return np.degrees(np.linalg.norm(so3_log(np.array(difference)), axis=-1))
