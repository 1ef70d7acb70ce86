"""Normals and albedos from brightness alone, where the surface and the cameras are held.

The joint estimate takes brightness at keypoints, whose errors are a tenth of a pixel or more and differ between views:
they blur this brightness. The estimated positions average over all views and are several times better. Brightness is
therefore sampled again where the surface projects, and each landmark's normal and albedo are fitted to it, without
regard to its neighbours. Pictures rendered from the result are as sharp as the images.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.model.image import Image
from photoclinometry.model.projection import projected_keypoints
from photoclinometry.model.reflectance import GRAZING, angles_at, photometric_function
from photoclinometry.model.robust import HUBER_LIMIT, robust_sigma
from photoclinometry.model.scene import Scene
from photoclinometry.model.tiny import TINY
from photoclinometry.photometry.predict import brightness_residuals
from photoclinometry.photometry.render import as_resolved, averaging_sigma, landmark_brightness
from photoclinometry.photometry.sampled_brightness import brightness_with_gradient, landmark_spacing_px
from photoclinometry.surface.map_rays import MapRays

NORMAL_SIGMA_RAD, ALBEDO_SIGMA = 0.1, 0.1
"""Prior standard deviations of the changes of normals, and of albedos relative to their size. They exceed the errors of
the start, and so matter only in directions that too few views determine."""

LEAST_SIGMA = 1e-4
"""Least standard deviation of brightness, as a share of the median: one or two views are fitted exactly, and the prior
must still count."""

LONGEST_STEP = 0.2
"""Bound on a step of the normal [rad] and the albedo's logarithm together: shading is nearly linear within it."""

SETTLED = 1e-5
"""Shorter steps end the iterations: far below the normals' errors."""

ITERATIONS = 6
"""Steps of a landmark's fit at most; SETTLED ends it sooner."""

SIGMA_PASSES = 2
"""The residuals' standard deviation is taken from the scene as given, then from the first fit."""


def brightness_on_surface(scene: Scene, images: Sequence[Image]) -> Scene:
    """The scene with the brightness of its tracks where the landmarks project, instead of at the keypoints.

    images: of the scene's views, in their order. Not lit: shadows and invalid pixels (`sample_brightness`), and
    landmarks that the map's own ground hides from the Sun or from the camera.
    """
    return seen_on_surface(scene, images).scene


class SeenOnSurface(NamedTuple):
    """Brightness and gradients of the images where the landmarks of a scene project."""

    scene: Scene
    """With that brightness, as `brightness_on_surface` gives it."""
    xy: np.ndarray
    """(N, 2) where the landmark of each observation projects [px]."""
    gradient: np.ndarray
    """(N, 2) float32 of the images there along x and y [brightness per px]."""


def seen_on_surface(scene: Scene, images: Sequence[Image]) -> SeenOnSurface:
    """As `brightness_on_surface`, with the images' gradients."""
    tracks = scene.tracks
    xy = projected_keypoints(scene)
    spacing = landmark_spacing_px(scene.views, scene.landmarks.position, scene.reference)
    brightness, gradient, lit = brightness_with_gradient(list(images), tracks.view, xy, spacing_px=spacing)
    landmark, rays = tracks.landmark, MapRays(scene)
    for k in range(len(scene.views)):
        seen = np.flatnonzero(tracks.view == k)
        free = rays.unoccluded_towards(scene.views.sun[k]) & rays.free_up_to(scene.views.body_from_cam.translation[k])
        lit[seen] &= free[landmark[seen]]
        brightness[seen] += unresolved_detail(scene, k)[landmark[seen]]
    return SeenOnSurface(replace(scene, tracks=replace(tracks, brightness=brightness, lit=lit)), xy, gradient)


def unresolved_detail(scene: Scene, view: int) -> np.ndarray:
    """(J,) the modelled brightness at the landmarks minus its average over a pixel of the view.

    A view coarser than the map does not resolve relief between its pixels. Adding this to its brightness removes that
    difference from the residuals. Zero for views as fine as the map, and where there is no reflectance model.
    """
    if scene.reflectance is None or averaging_sigma(scene, view) == 0.0:
        return np.zeros(len(scene.landmarks))
    brightness = landmark_brightness(scene, view, cast_shadows=True)
    return brightness - as_resolved(scene, view, brightness)


def normals_from_shading(scene: Scene, iterations: int = ITERATIONS) -> Scene:
    """The scene with normals and albedos fitted to the lit brightness of its tracks; all else is held.

    Each landmark by itself minimises

        sum huber((measured - scale albedo rho(normal) - bias) / sigma)
            + |normal - before|^2 / NORMAL_SIGMA_RAD^2 + log(albedo / before)^2 / ALBEDO_SIGMA^2

    with sigma from the residuals (their median size), first of the scene as given, then of the fit (Woodham 1980,
    Optical Engineering 19, doi:10.1117/12.7972479, with a reflectance model and a prior). The scene must have a
    reflectance model. Landmarks without lit brightness stay as they are.
    """
    fitted = scene
    for _ in range(SIGMA_PASSES):
        sigma = _residual_sigma(fitted)
        if not sigma > 0:
            break
        fitted = fitted_to_brightness(scene, sigma, iterations, start=fitted)
    return fitted


def fitted_to_brightness(
    scene: Scene, sigma: float, iterations: int = ITERATIONS, *, start: Scene | None = None
) -> Scene:
    """The scene with normals and albedos fitted as by `normals_from_shading`, to brightness of a given sigma.

    The scene's own normals and albedos are the mean of the prior; the iterations start from them, or from those of
    `start`.
    """
    begin = (start or scene).landmarks
    normal, albedo = begin.normal.copy(), begin.albedo.copy()
    _fit(scene, sigma, iterations, normal, albedo)
    return replace(scene, landmarks=replace(scene.landmarks, normal=normal, albedo=albedo))


def _residual_sigma(scene: Scene) -> float:
    """Robust standard deviation of lit brightness about the model's.

    At least LEAST_SIGMA of the median brightness; 0 where nothing is lit, or everything is explained exactly.
    """
    lit = scene.tracks.lit
    if not lit.any():
        return 0.0
    sigma = robust_sigma(brightness_residuals(scene)[lit])
    return max(sigma, LEAST_SIGMA * float(np.median(scene.tracks.brightness[lit]))) if sigma > 0 else 0.0


class _Observations(NamedTuple):
    """Brightness by landmark, as `Tracks` (Numba reserves the name `view`)."""

    start: np.ndarray
    view_index: np.ndarray
    brightness: np.ndarray
    lit: np.ndarray
    sigma: float
    """Standard deviation of brightness."""


class _Lighting(NamedTuple):
    """Properties of K views on which shading depends."""

    sun: np.ndarray
    """(K, 3) in B."""
    center: np.ndarray
    """(K, 3) in B."""
    scale: np.ndarray
    bias: np.ndarray


class _Start(NamedTuple):
    """J landmarks before the fit, the mean of its prior."""

    position: np.ndarray
    """(J, 3)."""
    normal: np.ndarray
    """(J, 3)."""
    albedo: np.ndarray


def _fit(scene: Scene, sigma: float, iterations: int, normal: np.ndarray, albedo: np.ndarray) -> None:
    """Overwrites normals (J, 3) and albedos (J,), where the iterations start, with the fitted ones."""
    views, landmarks, tracks = scene.views, scene.landmarks, scene.tracks
    assert scene.reflectance is not None
    observed = _Observations(tracks.start, tracks.view, tracks.brightness, tracks.lit, sigma)
    lighting = _Lighting(views.sun, views.body_from_cam.translation, views.scale, views.bias)
    start = _Start(landmarks.position, landmarks.normal, landmarks.albedo)
    _fit_all(scene.reflectance.parameter_vector, observed, lighting, start, iterations, normal, albedo)


@njit(cache=True, parallel=True)
def _fit_all(parameter_vector, observed, lighting, start, iterations, normal, albedo):
    for j in prange(albedo.size):
        if start.albedo[j] <= 0.0:
            continue
        for _ in range(iterations):
            if _step(parameter_vector, j, observed, lighting, start, normal, albedo) < SETTLED:
                break


@njit(cache=True, inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _step(parameter_vector, j, observed, lighting, start, normal, albedo):
    """One Gauss-Newton step of landmark j in the tangent plane and the albedo's logarithm.

    Returns its length, before it is cut to LONGEST_STEP.
    """
    n = normal[j]
    one, two = _tangents(n)
    information, gradient = _brightness_information(
        parameter_vector, j, observed, lighting, start, (n, one, two), albedo[j]
    )
    by_normal, by_albedo = 1.0 / NORMAL_SIGMA_RAD**2, 1.0 / ALBEDO_SIGMA**2
    before = start.normal[j]
    gradient += np.array(
        [
            by_normal * _dot(before, one),
            by_normal * _dot(before, two),
            by_albedo * math.log(start.albedo[j] / albedo[j]),
        ]
    )
    information += np.diag(np.array([by_normal, by_normal, by_albedo]))
    step = np.linalg.solve(information, gradient)
    length = math.sqrt(_dot(step, step))
    step *= min(1.0, LONGEST_STEP / max(length, TINY))
    n += step[0] * one + step[1] * two
    n /= math.sqrt(_dot(n, n))
    albedo[j] *= math.exp(step[2])
    return length


@njit(cache=True, inline="always")
def _brightness_information(parameter_vector, j, observed, lighting, start, frame, albedo):
    """Normal equations (3, 3) and negative gradient (3,) of landmark j's lit brightness, weighted by Huber's loss.

    frame: the normal and two tangents, (3,) each.
    """
    normal, one, two = frame
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    row, towards = np.empty(3), np.empty(3)
    for i in range(observed.start[j], observed.start[j + 1]):
        if not observed.lit[i]:
            continue
        k = observed.view_index[i]
        s = lighting.sun[k]
        for c in range(3):
            towards[c] = lighting.center[k, c] - start.position[j, c]
        distance = math.sqrt(_dot(towards, towards))
        mu0, mu, phase = angles_at(s, lighting.center[k], start.position[j], normal)
        if mu0 <= GRAZING or mu <= GRAZING:
            continue
        rho, by_mu0, by_mu, _ = photometric_function(parameter_vector, mu0, mu, phase)
        gain = lighting.scale[k] * albedo / observed.sigma
        row[0] = gain * (by_mu0 * _dot(s, one) + by_mu * _dot(towards, one) / distance)
        row[1] = gain * (by_mu0 * _dot(s, two) + by_mu * _dot(towards, two) / distance)
        row[2] = gain * rho
        residual = (observed.brightness[i] - lighting.bias[k]) / observed.sigma - gain * rho
        weight = min(1.0, HUBER_LIMIT / max(abs(residual), TINY))
        for a in range(3):
            gradient[a] += weight * row[a] * residual
            for b in range(3):
                information[a, b] += weight * row[a] * row[b]
    return information, gradient


@njit(cache=True)
def _tangents(normal):
    """Two unit vectors (3,) that make a right-handed frame with a unit normal."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    one = np.cross(normal, axis)
    one /= math.sqrt(_dot(one, one))
    return one, np.cross(normal, one)
