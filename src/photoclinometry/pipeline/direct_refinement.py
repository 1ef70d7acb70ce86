"""Direct photometric refinement: the last estimate, in which image gradients take the place of matches.

A match belongs to a window, and was found with the very map that it is to correct. Once that map is good to a fraction
of a pixel, no match is needed. The brightness where a landmark projects must equal the prediction from its normal, its
albedo and the Sun, and its gradient in the image shows how this brightness changes as the landmark moves: that of the
predicted brightness, which has less noise than the image's (`predicted_gradients`). Each landmark stays on its ray of
the reference view. Where too few views light a landmark for that, its matches hold it as before. This is the direct
method (Irani and Anandan 1999, doi:10.1007/3-540-44480-7_18) with a reflectance model in the place of constant
brightness.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from photoclinometry.adjust import Adjustment, ImageGradients, Noise
from photoclinometry.model.image import Image
from photoclinometry.model.projection import keypoint_residuals
from photoclinometry.model.row_medians import row_medians
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.albedo import fitted_albedo
from photoclinometry.photometry.cosmic_rays import is_struck
from photoclinometry.photometry.predicted_gradients import with_predicted_gradients
from photoclinometry.photometry.shading import seen_on_surface
from photoclinometry.photometry.smooth_errors import normals_along_surface, smooth_errors
from photoclinometry.pipeline.checks.widened_sigmas import with_inflated_uncertainties
from photoclinometry.pipeline.joint_estimate import EstimateSettings, by_relit_matches

log = logging.getLogger(__name__)

ROUGH_PASSES = 2
"""Rough estimates by the images before the last one. After one alone, normals of four small sites are up to 2 per cent
worse; a third changes them by less than 0.5 per cent."""

LAST_REWEIGHTING = 3
"""Reweighting iterations of the last estimate. The first has the noise of the rough estimates, with that of the matches
for positions; the other two have the noise that was measured in the images."""

MIN_LIT = 5
"""Lit views from which on brightness determines where a landmark lies: one more than it then has unknowns (depth, two
of the normal, albedo). With as many as unknowns, and Suns that differ little, single landmarks go astray."""

MIN_SHARE = 0.5
"""Share of the landmarks that must be lit in MIN_LIT views; with fewer, the last estimate uses matches alone."""

PHOTOMETRY_LANDMARKS = 10_000
"""Landmarks that determine Suns, exposures and reflectance where the geometry is held: dozens for each parameter."""

STRAYED, STRAYED_PX = 8.0, 0.2
"""A landmark has strayed if its projections lie farther from its matches than this multiple of the median landmark's
distance, and farther than this distance [px]. An image's gradient holds for about a pixel, and the gradient at a
shadow's edge is not that of the ground."""


def refine_directly(
    scene: Scene,
    images: Sequence[Image],
    estimate: Callable[[Scene, EstimateSettings], Adjustment],
    noise: Noise | None = None,
    *,
    poses_are_known: bool = False,
) -> Adjustment:
    """The last estimate of a scene by its images, or by its matches where too few views light more than half of it.

    images: of the scene's views, in their order. estimate: as `JointEstimate`. noise: found by an estimate from
    matches. The rough estimates take their weights from it, so that brightness has a low weight and its smooth errors
    bias little. poses_are_known: whether the poses come from a larger model. Smooth errors then hardly bias them, and
    each rough estimate measures its noise.

    ROUGH_PASSES rough estimates are made and a last one, each with brightness and gradients taken where the one before
    projects. Landmarks that stray in a rough one are put back and left to their matches, and brightness that a cosmic
    ray or a hot pixel has raised is left out. Where the rough estimates have converged, the smooth errors of brightness
    are removed before the last one. Uncertainties allow for the resulting move.
    """
    start, gradients = image_gradients(scene, images)
    if np.mean(gradients.of_landmarks(start.tracks)) < MIN_SHARE:
        log.info("too few views light the ground: the last estimate is of matches")
        return estimate(scene, by_relit_matches(noise))
    strayed, struck, before = np.zeros(len(scene.landmarks), bool), np.zeros(len(scene.tracks), bool), None
    for _ in range(ROUGH_PASSES):
        reweighting = None if noise is None or poses_are_known else 1
        settings = EstimateSettings(
            rough=True, all_steps=True, gradients=gradients, noise=noise, reweighting=reweighting
        )
        before = estimate(start, settings)
        noise, strayed = before.noise, strayed | has_strayed(before.scene)
        struck |= is_struck(before.scene)
        start, gradients = image_gradients(reset_landmarks(before.scene, scene, strayed), images, ~strayed, struck)
    assert before is not None
    direct = gradients.of_landmarks(start.tracks)
    log.info("%d of %d landmarks are left to their matches", np.sum(~direct), len(strayed))
    log.info("%d of %d brightnesses are left out as struck by cosmic rays, or of hot pixels", struck.sum(), len(struck))
    if before.converged:
        start, gradients = without_smooth_errors(start, gradients, estimate)
    found = estimate(start, EstimateSettings(gradients=gradients, noise=noise, reweighting=LAST_REWEIGHTING))
    return replace(found, scene=with_inflated_uncertainties(found.scene, before.scene, direct))


def without_smooth_errors(
    scene: Scene, gradients: ImageGradients, estimate: Callable[[Scene, EstimateSettings], Adjustment]
) -> tuple[Scene, ImageGradients]:
    """The scene and gradients of the last estimate.

    The normals get the long waves of the surface. With that geometry held, the photometry is estimated. The smooth
    differences of brightness that remain in each view become the gradients' factor. Scene and gradients are returned as
    given where normals and surface agree.
    """
    along = normals_along_surface(scene, gradients.of_landmarks(scene.tracks))
    if along is None:
        log.info("normals and surface agree")
        return scene, gradients
    turned = replace(scene, landmarks=replace(scene.landmarks, normal=along.normal))
    step = max(1, int(np.sqrt(len(scene.landmarks) / PHOTOMETRY_LANDMARKS)))
    found = estimate(turned.of_every(step), EstimateSettings(rough=True, photometry_alone=True)).scene
    told = replace(turned, views=found.views, reflectance=found.reflectance)
    albedo, used = fitted_albedo(told)
    kept = replace(told, landmarks=replace(turned.landmarks, albedo=albedo))
    error = smooth_errors(kept, used, along.sigma)
    log.info(
        "normals turned by %.2f deg over %.1f landmarks; smooth errors of brightness: %.2f %%",
        np.degrees(np.sqrt(np.mean(along.tilt**2))),
        along.sigma,
        100.0 * np.sqrt(np.mean(error[used] ** 2)),
    )
    return kept, gradients._replace(factor=1.0 + error, smooth_over=along.sigma)


def image_gradients(
    scene: Scene, images: Sequence[Image], among: np.ndarray | None = None, struck: np.ndarray | None = None
) -> tuple[Scene, ImageGradients]:
    """The scene with the brightness where its landmarks project (`brightness_on_surface`), and its gradients there.

    images: of the scene's views, in their order. Gradients are zero where it is not lit, and of landmarks that are lit
    in fewer than MIN_LIT views or not `among` those chosen (J,). Observations that are `struck` (N,) are not lit.
    """
    measured, xy, gradient = seen_on_surface(scene, images)
    if struck is not None:
        measured = replace(measured, tracks=replace(measured.tracks, lit=measured.tracks.lit & ~struck))
    tracks = measured.tracks
    direct = np.bincount(tracks.landmark[tracks.lit], minlength=len(scene.landmarks)) >= MIN_LIT
    if among is not None:
        direct &= among
    used = tracks.lit & direct[tracks.landmark]
    gradient = with_predicted_gradients(measured, gradient)
    return measured, ImageGradients(xy, np.where(used[:, None], gradient, np.float32(0.0)))


def has_strayed(scene: Scene) -> np.ndarray:
    """(J,) bool: landmarks that lie far off their matches, in the median of their views."""
    middle = row_medians(np.linalg.norm(keypoint_residuals(scene), axis=-1), scene.tracks.start)
    return middle > max(STRAYED * np.median(middle), STRAYED_PX)


def reset_landmarks(scene: Scene, before: Scene, which: np.ndarray) -> Scene:
    """The scene with landmarks `which` (J,) as they were before, relative to the reference view, since frames may
    differ."""
    now, then = (one.views.body_from_cam[one.reference] for one in (scene, before))
    landmarks, old = scene.landmarks, before.landmarks
    position, normal, albedo = landmarks.position.copy(), landmarks.normal.copy(), landmarks.albedo.copy()
    seen, saw = now.inverse()(position), then.inverse()(old.position)
    scale = np.median(seen[~which, 2] / saw[~which, 2])
    position[which] = now(scale * saw[which])
    normal[which] = old.normal[which] @ (now.rotation @ then.rotation.T).T
    albedo[which] = old.albedo[which]
    return replace(scene, landmarks=replace(landmarks, position=position, normal=normal, albedo=albedo))
