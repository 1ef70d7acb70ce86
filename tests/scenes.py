"""A small site that is known exactly: a smooth analytic surface, exact keypoints, exact brightness.

No ray hides another and nothing lies in cast shadow: slopes stay below 20 degrees, the Sun above 35 degrees.
Lengths are metres, frame B is the local one (z up), and one reference pixel is `GSD` wide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.image import Image
from photoclinometry.model.reflectance import Reflectance, photometric_angles, published
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views
from photoclinometry.model.sparse import SparseModel

GSD = 60.0
FOCAL_PX = 10_000.0
LUNAR_LAMBERT = published("lunar-lambert", "vesta")


@dataclass(frozen=True)
class BumpySurface:
    """Heights and albedos as sums of plane waves over the local horizontal plane."""

    wave: np.ndarray
    """(n, 2) wave vectors [rad/m]."""
    phase: np.ndarray
    """(n,) [rad]."""
    amplitude: np.ndarray
    """(n,) heights [m]."""

    def height(self, xy: np.ndarray) -> np.ndarray:
        """Heights (...,) at (..., 2)."""
        return np.sin(xy @ self.wave.T + self.phase) @ self.amplitude

    def gradient(self, xy: np.ndarray) -> np.ndarray:
        """Slopes (..., 2) at (..., 2)."""
        return (self.amplitude * np.cos(xy @ self.wave.T + self.phase)) @ self.wave

    def normal(self, xy: np.ndarray) -> np.ndarray:
        slope = self.gradient(xy)
        return unit(np.concatenate([-slope, np.ones_like(slope[..., :1])], -1))

    def albedo(self, xy: np.ndarray) -> np.ndarray:
        """Normal albedos (...,) between 0.24 and 0.36, unrelated to the heights."""
        pattern = np.sin(xy[..., 0] / (5 * GSD) + 1.0) * np.cos(xy[..., 1] / (7 * GSD) - 0.5)
        return 0.3 * (1.0 + 0.2 * pattern)

    def hit(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Where rays from `origin` (..., 3) along `direction` (..., 3) meet the surface.

        By Newton's method until every ray is within a micrometre: the step after that leaves rounding alone.
        """
        distance = -origin[..., 2] / direction[..., 2]
        for _ in range(30):
            point = origin + distance[..., None] * direction
            xy = point[..., :2]
            miss = point[..., 2] - self.height(xy)
            closing = direction[..., 2] - np.sum(self.gradient(xy) * direction[..., :2], -1)
            distance = distance - miss / closing
            if np.abs(miss).max() < 1e-6:
                break
        return origin + distance[..., None] * direction


def bumpy_surface(seed: int = 0) -> BumpySurface:
    """Eight waves of 8 to 25 reference pixels; steepest slope about 20 degrees."""
    rng = np.random.default_rng([seed, 1])
    length = rng.uniform(8, 25, 8) * GSD
    heading = rng.uniform(0, 2 * np.pi, 8)
    wave = (2 * np.pi / length)[:, None] * np.stack([np.cos(heading), np.sin(heading)], -1)
    return BumpySurface(wave, rng.uniform(0, 2 * np.pi, 8), 0.065 * length / (2 * np.pi))


def look_at_origin(center: np.ndarray, roll: float) -> Rigid:
    """body_from_cam of a camera at `center` (3,), its axis through the origin, turned by `roll` [rad]."""
    z = unit(-center)
    x = unit(np.cross(z, [0.0, 1.0, 0.1]))
    y = np.cross(z, x)
    x, y = np.cos(roll) * x + np.sin(roll) * y, np.cos(roll) * y - np.sin(roll) * x
    return Rigid(np.stack([x, y, z], -1), center)


def from_zenith(angle: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) `angle` away from the vertical, towards `azimuth` from x to y [rad]."""
    return np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], -1)


def synthetic_scene(
    size: int = 40,
    views: int = 6,
    seed: int = 0,
    reflectance: Reflectance | None = LUNAR_LAMBERT,
    keypoint_noise_px: float = 0.0,
    brightness_noise: float = 0.0,
) -> Scene:
    """A scene that explains itself exactly: size x size landmarks, every one seen and lit in every view.

    With a reflectance model that has no phase function, brightness is "dn" with a scale and a bias per view;
    otherwise it is "iof" with scale 1 and bias 0. `brightness_noise` is relative to the mean brightness.
    `reflectance=None` renders as Lunar-Lambert and leaves the scene without a model (geometry alone).
    """
    rng = np.random.default_rng(seed)
    surface = bumpy_surface(seed)
    margin = 20 + size // 4
    width = size + 2 * margin
    camera = Camera("PINHOLE", width, width, (FOCAL_PX, FOCAL_PX, width / 2 + 0.3, width / 2 - 0.2))

    # Cameras around the zenith, the first nearest to it; Suns all around at 20 to 50 degrees from it.
    off_nadir = np.deg2rad(np.r_[3.0, rng.uniform(8, 28, views - 1)])
    azimuth = np.linspace(0, 2 * np.pi, views, endpoint=False) + rng.uniform(-0.3, 0.3, views)
    distance = GSD * FOCAL_PX * np.r_[1.0, rng.uniform(0.9, 1.1, views - 1)]
    centers = distance[:, None] * from_zenith(off_nadir, azimuth)
    poses = [look_at_origin(c, roll) for c, roll in zip(centers, rng.uniform(-0.5, 0.5, views), strict=True)]
    body_from_cam = Rigid(np.stack([p.rotation for p in poses]), centers)
    sun = from_zenith(np.deg2rad(rng.uniform(20, 50, views)), rng.permutation(azimuth) + rng.uniform(-0.3, 0.3, views))

    calibrated = reflectance is None or reflectance.predicts_absolute_brightness
    all_views = Views(
        name=tuple(f"images/{k:03d}.fits" for k in range(views)),
        cameras=(camera,) * views,
        body_from_cam=body_from_cam,
        sun=sun,
        scale=np.ones(views) if calibrated else rng.uniform(200.0, 400.0, views),
        bias=np.zeros(views) if calibrated else rng.uniform(1.0, 5.0, views),
        dark_level=np.zeros(views),
        sun_measured=np.einsum("kji,kj->ki", body_from_cam.rotation, sun),
        sun_sigma=np.full(views, 1e-3),
        sun_common_sigma=np.zeros(views),
        arc=np.zeros(views, int),
    )

    # One landmark where the ray of each reference pixel meets the surface.
    region = Region(row=margin, col=margin, height=size, width=size)
    rays = camera.ray_in_cam(region.pixel_centers().reshape(-1, 2)) @ poses[0].rotation.T
    position = surface.hit(np.broadcast_to(centers[0], rays.shape), rays)
    rows, cols = np.divmod(np.arange(size * size), size)
    landmarks = Landmarks(
        position=position,
        normal=surface.normal(position[:, :2]),
        albedo=surface.albedo(position[:, :2]),
        pixel=np.stack([rows + region.row, cols + region.col], -1).astype(np.int32),
    )

    # Every landmark is projected into every view.
    model = reflectance or LUNAR_LAMBERT
    keypoint = np.stack([all_views.project(k, position) for k in range(views)], 1)
    brightness = np.stack(
        [_brightness(model, all_views, k, position, landmarks.normal, landmarks.albedo) for k in range(views)],
        1,
    )
    count = size * size * views
    brightness = brightness + brightness_noise * brightness.mean() * rng.normal(size=brightness.shape)
    tracks = Tracks(
        start=np.arange(0, count + 1, views, dtype=np.int64),
        view=np.tile(np.arange(views, dtype=np.int32), size * size),
        keypoint=keypoint.reshape(-1, 2) + keypoint_noise_px * rng.normal(size=(count, 2)),
        keypoint_sigma=np.full(count, max(keypoint_noise_px, 0.1)),
        brightness=brightness.ravel(),
        lit=np.ones(count, bool),
    )
    return Scene(
        name="bumps",
        body=None,
        brightness="iof" if calibrated else "dn",
        reflectance=reflectance,
        views=all_views,
        landmarks=landmarks,
        tracks=tracks,
        reference=0,
        region=region,
    )


def level(scene: Scene, distance: float) -> Scene:
    """The scene's map as level ground under the reference camera, at a depth."""
    pose, camera = scene.views.body_from_cam[scene.reference], scene.views.cameras[scene.reference]
    rays = camera.ray_in_cam(scene.region.pixel_centers()).reshape(-1, 3)
    flat = replace(
        scene.landmarks,
        position=pose(distance * rays),
        normal=np.broadcast_to(-pose.rotation[:, 2], (len(rays), 3)),
    )
    return replace(scene, landmarks=flat)


def thinned(scene: Scene, stride: int) -> Scene:
    """The map of every `stride`-th pixel, down and across, of a scene whose landmarks all have the same views."""
    row, col = (scene.landmarks.pixel - (scene.region.row, scene.region.col)).T
    fewer = with_landmarks(scene, (row % stride == 0) & (col % stride == 0))
    return replace(fewer, region=replace(scene.region, stride=stride))


def with_landmarks(scene: Scene, there: np.ndarray) -> Scene:
    """The map of the landmarks where `there` (J,)."""
    kept = np.flatnonzero(there)
    return replace(scene, landmarks=scene.landmarks[kept], tracks=scene.tracks.of_landmarks(kept)[0])


def with_coarse_view(scene: Scene, view: int, factor: int = 2) -> Scene:
    """The scene with one view by a camera with larger pixels, by a factor."""
    camera = scene.views.cameras[view]
    coarse = Camera("PINHOLE", camera.width // factor, camera.height // factor, tuple(np.divide(camera.params, factor)))
    cameras = tuple(coarse if k == view else c for k, c in enumerate(scene.views.cameras))
    return replace(scene, views=replace(scene.views, cameras=cameras))


def sparse_model_of(scene: Scene, registered: list[bool] | np.ndarray | None = None, every: int = 1) -> SparseModel:
    """The scene's landmarks as sparse points, which all registered views see."""
    points = scene.landmarks.position[::every]
    there = np.ones(len(scene.views), bool) if registered is None else np.array(registered)
    views = np.flatnonzero(there)
    pixels = [scene.views.project(k, points) for k in views]
    return SparseModel(
        registered=there,
        body_from_cam=scene.views.body_from_cam,
        points=points,
        point_start=len(views) * np.arange(len(points) + 1),
        point_view=np.tile(views, len(points)).astype(np.int32),
        point_xy=np.stack(pixels, axis=1).reshape(-1, 2),
        mean_reprojection_px=0.1,
    )


def synthetic_images(scene: Scene, seed: int = 0) -> list[Image]:
    """The exact images of `synthetic_scene(seed=seed)`: brightness at each pixel centre, no blur."""
    surface, model = bumpy_surface(seed), scene.reflectance or LUNAR_LAMBERT
    images = []
    for k, camera in enumerate(scene.views.cameras):
        whole = Region.of_image(camera.height, camera.width)
        pose = scene.views.body_from_cam[k]
        rays = camera.ray_in_cam(whole.pixel_centers()) @ pose.rotation.T
        point = surface.hit(np.broadcast_to(pose.translation, rays.shape), rays)
        xy = point[..., :2]
        bright = _brightness(model, scene.views, k, point, surface.normal(xy), surface.albedo(xy))
        images.append(Image(scene.views.name[k], bright.astype(np.float32), np.ones(bright.shape, bool)))
    return images


def _brightness(model, views, k, position, normal, albedo):
    """Eqs. 29 and 30 in one view, written out here so that tests of the renderer have something to meet."""
    angles = photometric_angles(views.sun[k], views.body_from_cam.translation[k], position, normal)
    return views.scale[k] * albedo * model(*angles) + views.bias[k]
