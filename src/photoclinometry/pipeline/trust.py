"""Whether a map is to be trusted: a few general statements, each of which a sound map fulfils by far."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photoclinometry.adjust import Adjustment
from photoclinometry.model.scene import Scene
from photoclinometry.model.tiny import TINY
from photoclinometry.model.warning import Warned
from photoclinometry.photometry.predict import observation_brightness
from photoclinometry.pipeline.checks.relief_check import FAR_OFF, ReliefCheck
from photoclinometry.pipeline.relighting import INCONSISTENT_SHARE
from photoclinometry.pipeline.response_check import CODE as RESPONSE

LEAST_EXPLAINED = 0.5
"""A map must explain this share of how brightness changes between images, see `change_explained`. By theory, a model
that explains nothing has 0 and a perfect one nearly 1. Small simulated sites under moderate and strong light have 0.90
and 0.96; with all Suns mirrored -2.2 and -0.3, all equal -4.2 and -1.4, with one image ten times too bright -1.0 and
-4.9."""

MOST_LEFT_OUT = 0.5
"""If more than this share of the views is left out, those that were used are the exception, and nothing shows which
part of the site is right."""

HIGHEST_ALBEDO = 2.0
"""Median normal albedo that no surface has: Enceladus, the brightest body known, has 1.4 (Verbiscer et al. 2007)."""

NOT_LINEAR = "the numbers of the images are not linear in radiance"
"""A statement about all images: a tile of a body with this warning has no worse map than others."""

SWEEPS = 5
"""Alternating least squares of albedos and exposures: five and fifty give the same share, to 0.0005, on sound sites and
on such with wrong Suns or exposures."""


def why_untrusted(
    adjustment: Adjustment, left_out: int, warnings: Sequence[Warned], relief: ReliefCheck | None = None
) -> tuple[str, ...]:
    """The reasons why a map is not to be trusted; none of a sound one.

    left_out: number of views that the map was made without, but for those held out. warnings: all of the run.
    """
    scene, reasons = adjustment.scene, []
    if not adjustment.converged:
        reasons.append(f"the joint estimate has not converged: {adjustment.message}")
    if any(warned.code == "most-suns-contradict" for warned in warnings):
        reasons.append("the Sun directions as a whole contradict the images: check the convention of `sun`")
    reasons += [*encoded_images(warnings), *inverted_relief(warnings)]
    used = len(scene.views)
    if left_out > MOST_LEFT_OUT * (used + left_out):
        reasons.append(f"{left_out} of {used + left_out} views are left out")
    if relief is not None and relief.is_off(FAR_OFF):
        reasons.append(f"the relief of the map is {relief.ratio:.2f} of that which the parallax of the images shows")
    if scene.reflectance is None:
        return tuple(reasons)
    off, explained = brightness_off(scene), change_explained(scene)
    if not (off <= INCONSISTENT_SHARE or explained >= LEAST_EXPLAINED):  # NaN is no evidence
        reasons.append(
            f"the brightness is {100 * off:.0f} % off what the map predicts, {_times(explained)} what one albedo for "
            "each landmark and one exposure for each image leave: check the Sun directions and what the brightness is"
        )
    albedo = float(np.median(scene.landmarks.albedo))
    if scene.brightness == "iof" and albedo > HIGHEST_ALBEDO:
        reasons.append(f"the median albedo is {albedo:.3g}, which no surface has: the brightness is not I/F")
    return tuple(reasons)


def encoded_images(warnings: Sequence[Warned]) -> list[str]:
    """The reason for distrust where images were found not to be linear; none without that warning."""
    return [NOT_LINEAR] if any(warned.code == RESPONSE for warned in warnings) else []


def inverted_relief(warnings: Sequence[Warned]) -> list[str]:
    """The reason for distrust of a map whose sparse model was warned of as inverted; none without such a warning."""
    if not any(warned.code in ("relief-by-shading", "relief-inverted") for warned in warnings):
        return []
    return ["brightness shows the relief with hills for hollows: check `sun`, and the poses"]


def brightness_off(scene: Scene) -> float:
    """Median size of the residuals of lit brightness over the median brightness; 0 without any."""
    lit = scene.tracks.lit
    if not lit.any():
        return 0.0
    measured = scene.tracks.brightness[lit]
    return float(np.median(np.abs(observation_brightness(scene)[lit] - measured)) / abs(np.median(measured)))


def change_explained(scene: Scene) -> float:
    """The share of the change of brightness between images that the map explains.

    It is 1 - a / b, where a and b are median sizes of residuals: a of the map, b of I_jk = albedo_j exposure_k, the
    model of ground without slopes under any light. 1 where everything is explained, below 0 where the map explains less
    than such a ground. Medians keep a view with a wrong exposure from deciding. 1 where nothing is lit.
    """
    tracks = scene.tracks
    lit = tracks.lit
    if not lit.any():
        return 1.0
    measured, landmark, view = tracks.brightness[lit], tracks.landmark[lit], tracks.view[lit]
    left = np.median(np.abs(measured - _flat_ground(measured, landmark, view, len(scene.landmarks), len(scene.views))))
    of_map = np.median(np.abs(measured - observation_brightness(scene)[lit]))
    return float(1.0 - of_map / max(left, TINY))


def _flat_ground(
    measured: np.ndarray, landmark: np.ndarray, view: np.ndarray, landmarks: int, views: int
) -> np.ndarray:
    """(N,) least-squares fit of albedo_j exposure_k to the brightness (N,), by turns."""
    exposure = np.ones(views)
    albedo = exposure
    for _ in range(SWEEPS):
        own = exposure[view]
        albedo = np.bincount(landmark, measured * own, landmarks) / np.maximum(
            np.bincount(landmark, own**2, landmarks), TINY
        )
        of = albedo[landmark]
        exposure = np.bincount(view, measured * of, views) / np.maximum(np.bincount(view, of**2, views), TINY)
    return albedo[landmark] * exposure[view]


def _times(explained: float) -> str:
    return f"{1.0 - explained:.1f} times"
