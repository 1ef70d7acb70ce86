"""First values of normals and albedos, and the brightness at the keypoints."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Image, Views
from photoclinometry.photometry.predict import shading
from photoclinometry.surface.sampling import as_coarse, sample_image

GRAZING = np.cos(np.radians(85.0))
"""Observations at larger incidence or emission say nothing reliable about albedo."""


def normals_from_neighbours(position: np.ndarray, camera_centers: np.ndarray, count: int = 32) -> np.ndarray:
    """(J, 3) unit normals of planes through each point's `count` nearest neighbours, itself included.

    position: (J, 3), J >= 3; camera_centers: (K, 3), in the same frame. The normal is the eigenvector of the
    neighbours' scatter with the least eigenvalue, turned towards the mean camera centre.
    Raises ValueError for fewer than 3 points.
    """
    from scipy.spatial import KDTree

    position = np.asarray(position, float)
    if len(position) < 3:
        raise ValueError(f"a plane needs 3 points, got {len(position)}")
    _, near = KDTree(position).query(position, k=min(count, len(position)), workers=-1)
    normal = np.empty_like(position)
    for part in np.array_split(np.arange(len(position)), max(1, len(position) // 20_000)):
        around = position[np.asarray(near)[part]]
        around = around - around.mean(1, keepdims=True)
        normal[part] = np.linalg.eigh(np.einsum("jni,jnk->jik", around, around))[1][..., 0]
    away = np.sum(normal * (np.mean(camera_centers, axis=0) - position), -1) < 0
    normal[away] *= -1
    return normal


def neighbours(position: np.ndarray, count: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """The nearest other points: (J, count) int32 indices and (J, count) bool, which of them are near enough.

    A pair is dropped when farther apart than the mean + 3 standard deviations of all such distances, which
    cuts across the holes of a map (the paper's configuration). Raises ValueError unless J > count.
    """
    from scipy.spatial import KDTree

    if len(position) <= count:
        raise ValueError(f"{count} neighbours need more than {count} points, got {len(position)}")
    distance, near = KDTree(position).query(position, k=count + 1, workers=-1)
    # Of coinciding points the first column need not be the point itself.
    own = near == np.arange(len(position))[:, None]
    own[~own.any(1), -1] = True
    near, distance = np.asarray(near)[~own].reshape(-1, count), np.asarray(distance)[~own].reshape(-1, count)
    return near.astype(np.int32), distance <= distance.mean() + 3 * distance.std()


def sample_brightness(
    images: list[Image],
    view: np.ndarray,
    keypoint: np.ndarray,
    shadow_fraction: float = 0.15,
    spacing_px: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Brightness (N,) at keypoints (N, 2) [px] of views (N,), and where it is a measurement.

    spacing_px: (K,) pixels of each image between landmarks; images that see finer than the map are smoothed to its
    resolution, or relief between landmarks would pass for noise, and views of other resolutions would disagree.

    Not lit (False): outside of the image's pixel centres, any of the four pixels invalid, or brightness below
    `shadow_fraction` of the median over the view's own keypoints: a shadow holds scattered light and camera
    offset, which no reflectance model explains. Where not valid the brightness is 0 and means nothing.
    """
    brightness, lit = np.zeros(len(view)), np.zeros(len(view), bool)
    for k in np.unique(view):
        mine = np.flatnonzero(view == k)
        image = images[k] if spacing_px is None else as_coarse(images[k], float(spacing_px[k]))
        value, valid = sample_image(image, keypoint[mine])
        if valid.any():
            brightness[mine] = value
            lit[mine] = valid & (value > shadow_fraction * np.median(value[valid]))
    return brightness, lit


def landmark_spacing_px(views: Views, position: np.ndarray, reference: int) -> np.ndarray:
    """(K,) pixels of each view across one pixel of the reference view, whose resolution the landmarks (J, 3) have.

    Whatever the stride: a map of larger stride has every so many of the same landmarks.
    """
    gsd = np.array([views.gsd(k, position) for k in range(len(views))])
    return gsd[reference] / gsd


def predicted_ratio(
    position: np.ndarray,
    normal: np.ndarray,
    landmark: np.ndarray,
    view: np.ndarray,
    views: Views,
    reflectance: Reflectance,
) -> tuple[np.ndarray, np.ndarray]:
    """rho (N,) of each observation: brightness at unit albedo, scale 1; and (N,) bool, not grazing."""
    mu0, mu, rho = shading(landmark, view, views, position, normal, reflectance)
    return rho, (mu0 > GRAZING) & (mu > GRAZING)


def initial_albedo(
    position: np.ndarray,
    normal: np.ndarray,
    start: np.ndarray,
    view: np.ndarray,
    brightness: np.ndarray,
    lit: np.ndarray,
    views: Views,
    reflectance: Reflectance,
    reference: int,
    estimate_scale: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First albedo (J,) as the mean over views of (brightness - bias) / (scale rho), and scale (K,).

    start (J + 1,), view, brightness, lit (N,): tracks. Also returns (J,) bool: the landmark had an observation
    that is lit and not grazing; the albedo of others is the median of those.
    estimate_scale: for uncalibrated brightness, or models without a phase function, each view's scale is
    found first: the median ratio of what it measured to what the albedos of the views so far predict;
    the reference's is 1. Otherwise `views.scale` holds. Bias is `views.bias` throughout.
    Raises ValueError where no observation is usable.
    """
    landmark = np.repeat(np.arange(len(position)), np.diff(start))
    rho, seen = predicted_ratio(position, normal, landmark, view, views, reflectance)
    usable = lit & seen & (rho > 0)
    if not usable.any():
        raise ValueError("no observation is lit: the Sun directions contradict the geometry")
    unscaled = np.divide(brightness - views.bias[view], rho, out=np.zeros_like(rho), where=usable)
    scale = np.array(views.scale, float)
    if estimate_scale:
        scale = relative_scales(unscaled, usable, landmark, view, len(position), len(views), reference)
    albedo, known = _mean_by_landmark(unscaled / scale[view], usable, landmark, len(position))
    return np.where(known, albedo, np.median(albedo[known])), scale, known


def relative_scales(
    unscaled: np.ndarray,
    usable: np.ndarray,
    landmark: np.ndarray,
    view: np.ndarray,
    landmark_count: int,
    view_count: int,
    reference: int,
    sweeps: int = 3,
) -> np.ndarray:
    """(K,) gain of each view relative to the reference's, from brightness / rho of common landmarks.

    unscaled, usable, landmark, view: (N,). First against the reference alone, then against the mean of all.
    A view without a usable observation keeps 1.
    """
    scale = np.ones(view_count)
    first = usable & (view == reference)
    for sweep in range(sweeps):
        base = first if sweep == 0 and first.any() else usable
        albedo, known = _mean_by_landmark(unscaled / scale[view], base, landmark, landmark_count)
        comparable = usable & known[landmark] & (albedo[landmark] > 0)
        for k in range(view_count):
            mine = np.flatnonzero(comparable & (view == k))
            if len(mine):
                scale[k] = max(np.median(unscaled[mine] / albedo[landmark[mine]]), 1e-12)
        scale /= scale[reference]
    return scale


def _mean_by_landmark(
    value: np.ndarray, usable: np.ndarray, landmark: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    number = np.bincount(landmark[usable], minlength=count)
    total = np.bincount(landmark[usable], value[usable], minlength=count)
    return total / np.maximum(number, 1), number > 0
