"""Normals and albedos from brightness alone, where the surface and the cameras are held.

The joint estimate takes brightness at keypoints, which err by a tenth of a pixel or more, each view's in its own
way: what it sees is blurred. The positions that it finds average over all views, and are several times better. So
brightness is taken again where the surface projects, and every landmark's normal and albedo are fitted to it,
without regard to its neighbours. Pictures rendered from that are as sharp as the images.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numba import njit, prange

from photoclinometry.model.projection import (
    projected_keypoints,
)
from photoclinometry.model.reflectance import phase_angle, photometric_function
from photoclinometry.model.scene import Image, Scene
from photoclinometry.photometry.initialize import GRAZING, landmark_spacing_px, sample_brightness
from photoclinometry.photometry.predict import (
    brightness_residuals,
)
from photoclinometry.photometry.render import as_resolved, averaging_sigma, landmark_brightness
from photoclinometry.surface.relief import in_sunlight, unobstructed

NORMAL_SIGMA_RAD, ALBEDO_SIGMA = 0.1, 0.1
"""How far normals, and albedos relative to their own size, are expected to move: what few views leave open stays."""

LEAST_SIGMA = 1e-4
"""Of the median brightness: one or two views are fitted exactly, and what was known before must still count."""

HUBER = 3.0
"""Residuals beyond this many standard deviations count less."""


def brightness_on_surface(scene: Scene, images: Sequence[Image]) -> Scene:
    """The scene with the brightness of its tracks where the landmarks project, instead of at the keypoints.

    images: of the scene's views, in their order. Not lit: what `sample_brightness` takes for shadow or no
    measurement, and where the map's own ground stands before the Sun or the camera.
    """
    tracks = scene.tracks
    xy = projected_keypoints(scene)
    spacing = landmark_spacing_px(scene.views, scene.landmarks.position, scene.reference)
    brightness, lit = sample_brightness(list(images), tracks.view, xy, spacing_px=spacing)
    for k in range(len(scene.views)):
        seen = np.flatnonzero(tracks.view == k)
        free = in_sunlight(scene, scene.views.sun[k]) & in_view(scene, k)
        lit[seen] &= free[tracks.landmark[seen]]
        brightness[seen] += detail_beyond(scene, k)[tracks.landmark[seen]]
    return replace(scene, tracks=replace(tracks, brightness=brightness, lit=lit))


def detail_beyond(scene: Scene, view: int) -> np.ndarray:
    """(J,) what the scene's model says of a view's brightness at the landmarks beyond what its pixels average over.

    A view coarser than the map says nothing of the relief between its pixels; with this added to what it measured, it
    agrees with the map about that. Zero for views as fine as the map, and where there is no reflectance model.
    """
    if scene.reflectance is None or averaging_sigma(scene, view) == 0.0:
        return np.zeros(len(scene.landmarks))
    brightness = landmark_brightness(scene, view, cast_shadows=True)
    return brightness - as_resolved(scene, view, brightness)


def in_view(scene: Scene, view: int) -> np.ndarray:
    """(J,) bool: no other part of the map stands between the landmark and the camera."""
    return unobstructed(scene, scene.views.body_from_cam.translation[view] - scene.landmarks.position)


def normals_from_shading(scene: Scene, iterations: int = 6) -> Scene:
    """The scene with normals and albedos fitted to the lit brightness of its tracks; all else is held.

    Each landmark by itself minimises

        sum huber((measured - scale albedo rho(normal) - bias) / sigma)
            + |normal - before|^2 / NORMAL_SIGMA_RAD^2 + log(albedo / before)^2 / ALBEDO_SIGMA^2

    with sigma from the residuals (their median size), first of the scene as given, then of the fit (Woodham 1980,
    Optical Engineering 19, doi:10.1117/12.7972479, with a reflectance model and a prior). The scene must have a
    reflectance model. Landmarks without lit brightness stay as they are.
    """
    fitted = scene
    for _ in range(2):
        sigma = _residual_sigma(fitted)
        if not sigma > 0:
            break
        normal, albedo = fitted.landmarks.normal.copy(), fitted.landmarks.albedo.copy()
        _fit(scene, sigma, iterations, normal, albedo)
        fitted = replace(scene, landmarks=replace(scene.landmarks, normal=normal, albedo=albedo))
    return fitted


def _residual_sigma(scene: Scene) -> float:
    """Standard deviation of lit brightness about the scene's own, from the median size.

    At least LEAST_SIGMA of the median brightness; 0 where nothing is lit, or everything is explained exactly.
    """
    lit = scene.tracks.lit
    if not lit.any():
        return 0.0
    size = 1.4826 * float(np.median(np.abs(brightness_residuals(scene))[lit]))
    return max(size, LEAST_SIGMA * float(np.median(scene.tracks.brightness[lit]))) if size > 0 else 0.0


def _fit(scene: Scene, sigma: float, iterations: int, normal: np.ndarray, albedo: np.ndarray) -> None:
    """Writes the fitted normals (J, 3) and albedos (J,), which hold where to start."""
    views, marks, tracks = scene.views, scene.landmarks, scene.tracks
    assert scene.reflectance is not None
    _fit_all(
        scene.reflectance.packed, tracks.start, tracks.view, tracks.brightness, tracks.lit, views.sun,
        views.body_from_cam.translation, views.scale, views.bias, marks.position, marks.normal, marks.albedo,
        sigma, iterations, normal, albedo,
    )  # fmt: skip


@njit(cache=True, parallel=True)
def _fit_all(
    packed, start, view, brightness, lit, sun, center, scale, bias, position, before, albedo_before, sigma,
    iterations, normal, albedo,
):  # fmt: skip
    for j in prange(position.shape[0]):
        if albedo_before[j] <= 0.0:
            continue
        for _ in range(iterations):
            moved = _step(
                packed, start[j], start[j + 1], view, brightness, lit, sun, center, scale, bias, position[j],
                before[j], albedo_before[j], sigma, normal[j], albedo, j,
            )  # fmt: skip
            if moved < 1e-5:
                break


@njit(cache=True, inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _step(
    packed, first, last, view, brightness, lit, sun, center, scale, bias, position, before, albedo_before, sigma,
    normal, albedo, j,
):  # fmt: skip
    """One Gauss-Newton step in the tangent plane and the albedo's logarithm; returns its size, limited to 0.2."""
    one, two = _tangents(normal)
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    row, towards = np.empty(3), np.empty(3)
    for i in range(first, last):
        if not lit[i]:
            continue
        k = view[i]
        s = sun[k]
        for c in range(3):
            towards[c] = center[k, c] - position[c]
        distance = math.sqrt(_dot(towards, towards))
        mu0, mu, cosine = _dot(s, normal), _dot(towards, normal) / distance, _dot(s, towards) / distance
        if mu0 <= GRAZING or mu <= GRAZING:
            continue
        phase = phase_angle(cosine, math.sqrt(max(1.0 - cosine * cosine, 0.0)))
        rho, by_mu0, by_mu, _ = photometric_function(packed, mu0, mu, phase)
        gain = scale[k] * albedo[j] / sigma
        row[0] = gain * (by_mu0 * _dot(s, one) + by_mu * _dot(towards, one) / distance)
        row[1] = gain * (by_mu0 * _dot(s, two) + by_mu * _dot(towards, two) / distance)
        row[2] = gain * rho
        residual = (brightness[i] - bias[k]) / sigma - gain * rho
        weight = min(1.0, HUBER / max(abs(residual), 1e-12))
        for a in range(3):
            gradient[a] += weight * row[a] * residual
            for b in range(3):
                hessian[a, b] += weight * row[a] * row[b]
    stiff, firm = 1.0 / NORMAL_SIGMA_RAD**2, 1.0 / ALBEDO_SIGMA**2
    gradient += np.array(
        [stiff * _dot(before, one), stiff * _dot(before, two), firm * math.log(albedo_before / albedo[j])]
    )
    hessian += np.diag(np.array([stiff, stiff, firm]))
    step = np.linalg.solve(hessian, gradient)
    size = math.sqrt(_dot(step, step))
    step *= min(1.0, 0.2 / max(size, 1e-12))
    normal += step[0] * one + step[1] * two
    normal /= math.sqrt(_dot(normal, normal))
    albedo[j] *= math.exp(step[2])
    return size


@njit(cache=True)
def _tangents(normal):
    """Two unit vectors (3,) that make a right-handed frame with a unit normal."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    one = np.cross(normal, axis)
    one /= math.sqrt(_dot(one, one))
    return one, np.cross(normal, one)
