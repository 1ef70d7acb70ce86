"""A joint estimate whose truth is known: observations drawn from the very model that is inverted.

No image is rendered and nothing is matched, so any size can be made in seconds, and what comes out measures the
estimate alone. The geometry is Dawn's over Vesta: a focal length of 10,700 px from 11,300 ground samples, cameras 2 to
25 degrees and Suns 30 to 65 degrees from the vertical, all round. Lengths are ground samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter

from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, align_similarity, angle_between, so3_exp, unit
from photoclinometry.model.reflectance import Reflectance, published
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views
from photoclinometry.photometry.albedo import initial_albedo
from photoclinometry.photometry.predict import shading
from photoclinometry.surface.neighbours import normals_from_neighbours

FOCAL_PX, ALTITUDE = 10_700.0, 680e3 / 60.0


OPTIONS = AdjustOptions(
    brightness_sigma=0.0015,
    scale_sigma=0.01,
    keypoint_correlation_px=1.0,
    brightness_correlation_px=1.0,
    keypoint_loss=np.inf,
    brightness_loss=np.inf,
    reflectance_sigma=0.0,
    max_reweightings=1,
)
"""The estimate of problems whose errors are what `Noise` says, and independent."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviations of the measurements and of the start."""

    keypoint_px: float = 0.3
    brightness: float = 0.01
    """Relative."""
    sun_rad: float = 1e-3
    scale: float = 0.01
    bias: float = 1e-4
    start_position: float = 0.3
    """[GSD]."""
    start_rotation_rad: float = 3e-5
    start_center: float = 0.5
    """[GSD]."""


def matched_problem(
    side: int,
    views: int = 29,
    *,
    seed: int = 0,
    reflectance: Reflectance | None = None,
    brightness: str = "iof",
    views_per_landmark: int | None = None,
    noise: Noise | None = None,
) -> tuple[Scene, Scene]:
    """The start and the truth of side x side landmarks seen by most of the views.

    views_per_landmark: the mean of how many views see a landmark, for campaigns of many images; left out, most do.
    reflectance: Lunar-Lambert for Vesta if left out. brightness: "iof", or "dn" with gains of a factor of two.
    """
    reflectance, noise = reflectance or published("lunar-lambert", "vesta"), noise or Noise()
    rng = np.random.default_rng(seed)
    landmarks = _ground(side, rng)
    truth_views = _campaign(views, brightness, noise, rng)
    landmark, view = np.nonzero(_visible(landmarks, truth_views, views_per_landmark, rng))
    rho = shading(landmark, view, truth_views, landmarks.position, landmarks.normal, reflectance)[2]
    clean = truth_views.scale[view] * landmarks.albedo[landmark] * rho
    bright = clean * (1 + noise.brightness * rng.normal(size=len(view))) + truth_views.bias[view]
    keypoint = np.empty((len(view), 2))
    for k in range(views):
        seen = view == k
        keypoint[seen] = truth_views.project(k, landmarks.position[landmark[seen]])
    tracks = Tracks(
        start=np.concatenate([[0], np.cumsum(np.bincount(landmark, minlength=side * side))]),
        view=view.astype(np.int32),
        keypoint=keypoint + noise.keypoint_px * rng.normal(size=keypoint.shape),
        keypoint_sigma=np.full(len(view), noise.keypoint_px),
        brightness=bright,
        lit=np.ones(len(view), bool),
    )
    truth = Scene(
        name=f"matched-{side}x{side}x{views}",
        body=None,
        brightness=brightness,
        reflectance=reflectance,
        views=truth_views,
        landmarks=landmarks,
        tracks=tracks,
        reference=0,
        region=Region.of_image(side, side),
    )
    return _start(truth, noise, rng), truth


def _ground(side: int, rng: np.random.Generator) -> Landmarks:
    """Rough ground of 7 degrees of slope with craters of 4 to a tenth of the side; albedo 0.15 to 0.5."""
    size = side + 4
    height = _coloured(size, -2.0, 0.15, rng)
    slope = np.hypot(*np.gradient(height))
    height *= np.tan(np.radians(7.0)) / np.sqrt(np.mean(slope**2))
    y, x = np.mgrid[-2 : side + 2, -2 : side + 2].astype(float)
    for _ in range(max(6, side * side // 1600)):
        (cx, cy), radius = rng.uniform(0, side, 2), 4 + side / 12 * rng.power(0.6) * 0.6
        reach = int(np.ceil(5 * radius))
        near = np.s_[max(0, int(cy) - reach) : int(cy) + reach, max(0, int(cx) - reach) : int(cx) + reach]
        d = np.hypot(x[near] - cx, y[near] - cy) / radius
        bowl = np.where(d < 1, -0.35 + 0.45 * d**2, 0.10 * np.exp(-3 * (np.maximum(d, 1) - 1)))
        height[near] += 0.35 * radius * rng.uniform(0.5, 1) * bowl
    height = gaussian_filter(height, 1.0)
    by_y, by_x = (g[2:-2, 2:-2].ravel() for g in np.gradient(height))
    pixel = np.stack(np.divmod(np.arange(side * side), side), -1).astype(np.int32)
    xy = pixel[:, ::-1] - (side - 1) / 2
    pattern = _coloured(side, 0.0, 0.06, rng)
    return Landmarks(
        position=np.column_stack([xy, height[2:-2, 2:-2].ravel()]),
        normal=unit(np.column_stack([-by_x, -by_y, np.ones_like(by_x)])),
        albedo=np.clip(0.32 + 0.07 * pattern / pattern.std(), 0.15, 0.5).ravel(),
        pixel=pixel,
    )


def _coloured(size: int, slope: float, cutoff: float, rng: np.random.Generator) -> np.ndarray:
    """Noise (size, size) of amplitude k^slope up to about `cutoff` cycles a sample."""
    k = np.hypot(np.fft.fftfreq(2 * size)[:, None], np.fft.rfftfreq(2 * size))
    k[0, 0] = 1.0
    spectrum = np.fft.rfft2(rng.normal(size=(2 * size, 2 * size))) * k**slope * np.exp(-((k / cutoff) ** 2))
    spectrum[0, 0] = 0.0
    return np.fft.irfft2(spectrum)[:size, :size]


def _campaign(count: int, brightness: str, noise: Noise, rng: np.random.Generator) -> Views:
    camera = Camera("PINHOLE", 1024, 1024, (FOCAL_PX, FOCAL_PX, 512.0, 512.0))
    off, azimuth = np.radians(rng.uniform(2, 25, count)), rng.uniform(0, 2 * np.pi, count)
    center = ALTITUDE * np.column_stack([np.tan(off) * np.cos(azimuth), np.tan(off) * np.sin(azimuth), np.ones(count)])
    z = unit(np.column_stack([rng.normal(0, 5, (count, 2)), np.zeros(count)]) - center)
    roll = rng.uniform(0, 2 * np.pi, count)
    x = unit(np.cross(np.column_stack([np.cos(roll), np.sin(roll), np.zeros(count)]), z))
    rotation = np.stack([x, np.cross(z, x), z], -1)
    incidence, sun_azimuth = np.radians(rng.uniform(30, 65, count)), rng.uniform(0, 2 * np.pi, count)
    sun = np.column_stack(
        [np.sin(incidence) * np.cos(sun_azimuth), np.sin(incidence) * np.sin(sun_azimuth), np.cos(incidence)]
    )
    scale, bias = 1 + noise.scale * rng.normal(size=count), noise.bias * rng.normal(size=count)
    if brightness == "dn":
        gain = 3000.0 * np.exp2(rng.uniform(-0.5, 0.5, count))
        scale, bias = gain / gain[0], bias * 10
    scale[0] = 1.0
    measured = unit(sun + noise.sun_rad * rng.normal(size=sun.shape))
    return Views(
        name=tuple(f"{k:03d}" for k in range(count)),
        cameras=(camera,) * count,
        body_from_cam=Rigid(rotation, center),
        sun=sun,
        scale=scale,
        bias=bias,
        sun_measured=np.einsum("kji,kj->ki", rotation, measured),
        sun_sigma=np.full(count, noise.sun_rad),
        sun_common_sigma=np.zeros(count),
        arc=np.zeros(count, int),
        dark_level=np.zeros(count),
    )


def _visible(landmarks: Landmarks, views: Views, per_landmark: int | None, rng: np.random.Generator) -> np.ndarray:
    """(J, K) bool: a side of the map is missing in each view, and a tenth of the rest; grazing light is left out."""
    xy, count = landmarks.position[:, :2], len(views)
    seen = rng.uniform(size=(len(xy), count)) < 0.9
    width = np.sqrt(len(xy))
    for k in range(count):
        if per_landmark is None:
            along = xy @ unit(rng.normal(size=2))
            seen[:, k] &= along >= np.quantile(along, rng.uniform(0, 0.3))
        else:
            # a disc whose area is the share of the views that see a landmark
            middle = rng.uniform(-0.5, 0.5, 2) * width
            away = np.abs((xy - middle + width / 2) % width - width / 2)
            seen[:, k] &= np.hypot(*away.T) < width * np.sqrt(per_landmark / count / np.pi / 0.9)
        to_camera = unit(views.body_from_cam.translation[k] - landmarks.position)
        seen[:, k] &= (landmarks.normal @ views.sun[k] > 0.1) & (np.sum(to_camera * landmarks.normal, -1) > 0.1)
    return seen


def _start(truth: Scene, noise: Noise, rng: np.random.Generator) -> Scene:
    """A simulated result of structure from motion and triangulation: noisy poses and points, plane-fit normals."""
    views, count = truth.views, len(truth.views)
    turn = noise.start_rotation_rad * rng.normal(size=(count, 3))
    move = noise.start_center * rng.normal(size=(count, 3))
    turn[0] = move[0] = 0.0
    rotation = so3_exp(turn) @ views.body_from_cam.rotation
    poses = Rigid(rotation, views.body_from_cam.translation + move)
    sun = np.einsum("kij,kj->ki", rotation, views.sun_measured)
    registered = replace(views, body_from_cam=poses, sun=sun, scale=np.ones(count), bias=np.zeros(count))
    position = truth.landmarks.position + noise.start_position * rng.normal(size=truth.landmarks.position.shape)
    normal = normals_from_neighbours(position, poses.translation.mean(0))
    tracks, reflectance = truth.tracks, truth.reflectance
    assert reflectance is not None
    free = truth.brightness == "dn" or not reflectance.predicts_absolute_brightness
    albedo, scale, _ = initial_albedo(position, normal, tracks, registered, reflectance, 0, free)
    landmarks = replace(truth.landmarks, position=position, normal=normal, albedo=albedo)
    return truth.with_estimate(replace(registered, scale=scale), landmarks)


def rms_errors(found: Scene, truth: Scene) -> dict[str, float]:
    """Of position [GSD], normal [deg] and albedo [%], after the best similarity and the median albedo's factor."""
    landmarks, true = found.landmarks, truth.landmarks
    fit = align_similarity(landmarks.position, true.position)
    ratio = landmarks.albedo / true.albedo
    errors = {
        "position": np.linalg.norm(fit(landmarks.position) - true.position, axis=1),
        "normal": np.degrees(angle_between(landmarks.normal @ fit.rotation.T, true.normal)),
        "albedo": 100 * (ratio / np.median(ratio) - 1),
    }
    return {name: float(np.sqrt(np.mean(error**2))) for name, error in errors.items()}


def main(side: int = 400, views: int = 29, views_per_landmark: int = 0, uncertainty: int = 0) -> None:
    """Prints what the estimate costs once kernels are compiled, and how far from the truth it ends.

    views_per_landmark: 0 for most views. uncertainty: 1 to find the covariances too.
    """
    import resource
    import time

    options = replace(OPTIONS, uncertainty=bool(uncertainty))
    adjust(matched_problem(20, min(views, 29))[0], options)
    start, truth = matched_problem(side, views, views_per_landmark=views_per_landmark or None)
    cpu = time.process_time()
    found = adjust(start, options)
    cpu = time.process_time() - cpu
    print(f"{truth.name}: {len(truth.tracks)} observations, {found.message}")
    print(f"{cpu:.1f} CPU s, {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GB at most")
    for (name, error), of in zip(rms_errors(found.scene, truth).items(), ("GSD", "deg", "%"), strict=True):
        print(f"{name}: {error:.3f} {of} RMS")


if __name__ == "__main__":
    import sys

    main(*map(int, sys.argv[1:]))
