"""Albedos of landmarks and scales of views from brightness, while the geometry is held."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import GRAZING, Reflectance
from photoclinometry.model.robust import REWEIGHTINGS, huber_weight, robust_sigma
from photoclinometry.model.scene import Scene, Tracks, Views
from photoclinometry.model.suns import SUN_CONVENTION
from photoclinometry.model.tiny import TINY
from photoclinometry.photometry.predict import exposure_is_free, reflectance_of, shading

SCALE_SWEEPS = 3
"""Albedos and scales are estimated in turns, first against the reference's albedos, then against the mean of all."""


def predicted_ratio(
    position: np.ndarray,
    normal: np.ndarray,
    landmark: np.ndarray,
    view: np.ndarray,
    views: Views,
    reflectance: Reflectance,
) -> tuple[np.ndarray, np.ndarray]:
    """rho (N,) of each observation: brightness at albedo 1 and scale 1; and (N,) bool, neither angle is grazing."""
    mu0, mu, rho = shading(landmark, view, views, position, normal, reflectance)
    return rho, (mu0 > GRAZING) & (mu > GRAZING)


class _Unshaded(NamedTuple):
    """n usable observations of J landmarks in K views, divided by their shading."""

    value: np.ndarray
    """(n,) (brightness - bias) / rho = scale * albedo."""
    landmark: np.ndarray
    """(n,) index."""
    view: np.ndarray
    """(n,) index."""
    landmarks: int
    """J."""
    views: int
    """K."""

    def mean_by_landmark(self, scale: np.ndarray, used: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Albedo (J,): mean over the observations `used` (n,) bool of value / scale (K,); NaN of none."""
        landmark, value = self.landmark[used], (self.value / scale[self.view])[used]
        number = np.bincount(landmark, minlength=self.landmarks)
        total = np.bincount(landmark, value, minlength=self.landmarks)
        return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def fitted_albedo(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Albedo (J,) of each landmark from its lit and not grazing brightness, with the rest of the scene held; the old
    albedo where there is no such brightness. And (N,) bool: the brightness used.

    Least squares with Huber's loss, whose limit is computed from all residuals.
    """
    points, tracks, views = scene.landmarks, scene.tracks, scene.views
    rho, oblique = predicted_ratio(
        points.position, points.normal, tracks.landmark, tracks.view, views, reflectance_of(scene)
    )
    used = tracks.lit & oblique & (rho > 0)
    of, view = tracks.landmark[used], tracks.view[used]
    gain, measured = views.scale[view] * rho[used], tracks.brightness[used] - views.bias[view]
    albedo, weight = points.albedo, np.ones(len(of))
    for _ in range(REWEIGHTINGS):
        count = len(points)
        total, squares = (np.bincount(of, weight * gain * by, count) for by in (measured, gain))
        albedo = np.where(squares > 0, total / np.where(squares > 0, squares, 1.0), points.albedo)
        off = np.abs(gain * albedo[of] - measured)
        weight = huber_weight(off / max(robust_sigma(off), TINY))
    return albedo, used


def initial_albedo(
    position: np.ndarray,
    normal: np.ndarray,
    tracks: Tracks,
    views: Views,
    reflectance: Reflectance,
    reference: int,
    estimate_scale: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First albedo (J,) as the mean over views of (brightness - bias) / (scale rho), and scale (K,).

    position, normal: (J, 3) in B. Also returns (J,) bool: the landmark has an observation that is lit and not grazing;
    the albedo of others is the median of those.
    estimate_scale: for uncalibrated brightness, or models without a phase function. Each view's scale is then the
    median ratio of its brightness to the one that the other views' albedos predict, the reference's being 1.
    Otherwise `views.scale` holds. Bias is `views.bias` throughout.
    Raises InputError where no observation is usable.
    """
    landmark, view = tracks.landmark, tracks.view
    rho, oblique = predicted_ratio(position, normal, landmark, view, views, reflectance)
    usable = np.flatnonzero(tracks.lit & oblique & (rho > 0))
    if not len(usable):
        raise InputError(
            "no observation is lit: the Suns contradict the poses and the surface; check `sun` of all views in "
            f"site.toml; {SUN_CONVENTION}"
        )
    value = (tracks.brightness[usable] - views.bias[view[usable]]) / rho[usable]
    unshaded = _Unshaded(value, landmark[usable], view[usable], len(position), len(views))
    scale = _relative_scales(unshaded, reference) if estimate_scale else np.array(views.scale, float)
    albedo = unshaded.mean_by_landmark(scale)
    known = np.isfinite(albedo)
    return np.where(known, albedo, np.median(albedo[known])), scale, known


def with_model(scene: Scene, reflectance: Reflectance) -> Scene:
    """The scene with a reflectance model, and the first albedos and scales by it; biases are zero.

    Raises InputError where no observation is usable.
    """
    landmarks, views = scene.landmarks, scene.views
    views = replace(views, scale=np.ones(len(views)), bias=np.zeros(len(views)))
    free = exposure_is_free(scene.brightness, reflectance)
    albedo, scale, _ = initial_albedo(
        landmarks.position, landmarks.normal, scene.tracks, views, reflectance, scene.reference, free
    )
    return replace(
        scene,
        reflectance=reflectance,
        views=replace(views, scale=scale),
        landmarks=replace(landmarks, albedo=albedo),
    )


def _relative_scales(unshaded: _Unshaded, reference: int) -> np.ndarray:
    """(K,) scale of each view relative to the reference's, from the landmarks that they share.

    First against the reference alone, if it has usable observations, then against the mean of all views. A view
    without a usable observation keeps 1.
    """
    scale = np.ones(unshaded.views)
    of_reference = unshaded.view == reference
    for sweep in range(SCALE_SWEEPS):
        albedo = unshaded.mean_by_landmark(scale, of_reference if sweep == 0 and of_reference.any() else slice(None))
        predicted = albedo[unshaded.landmark]
        comparable = predicted > 0  # False where NaN
        for k in range(unshaded.views):
            at = np.flatnonzero(comparable & (unshaded.view == k))
            if len(at):
                scale[k] = max(np.median(unshaded.value[at] / predicted[at]), TINY)
        scale /= scale[reference]
    return scale
