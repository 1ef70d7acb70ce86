"""Which views to leave out, and why: those that contradict their witnesses (`witnesses`).

One view at a time: that without which the fewest contradictions remain. It is left out if its own contradiction is
larger than all that is uncertain about it, and does not hang on any single witness.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import Reflectance, photometric_angles
from photoclinometry.model.scene import Image, Scene, Views
from photoclinometry.model.sparse import SparseModel
from photoclinometry.photometry.sun_check import MIN_POINTS, coarse_scene, sun_by_witnesses
from photoclinometry.photometry.sun_fit import SunFit

log = logging.getLogger(__name__)

SIGMAS = 5.0
"""A Sun is wrong that is off by more than so many standard deviations of all that is uncertain about it."""

MODEL_RAD = math.radians(1.0)
"""What a reflectance model that is not quite the ground's moves a fitted Sun: 0.5 to 1.5 degrees in the median of
simulated sites that were mapped with another model than theirs."""

MIN_EXPLAINED = 0.5
"""A view shows something else whose brightness correlates less than this with the map's, whatever its Sun."""

MIN_WITNESSES = 4
"""With fewer others their ground is too uncertain to judge by: of four sound views, one was left out."""

SUSPECTS = 5
"""Views that are tried at a time."""

CONVENTION = "`sun` points from the body towards the Sun, in the camera frame (x right, y down, z forward)"


@dataclass(frozen=True, kw_only=True)
class Misfits:
    """The outcome for K views, as a stage's result."""

    left_out: np.ndarray
    """(K,) bool."""
    reason: np.ndarray
    """(K,) str; empty where there is none."""


@dataclass(frozen=True, kw_only=True)
class _Heard:
    """What the views in use say of every view (K,); zeros where nothing can be said."""

    off: np.ndarray
    """Angle [rad] of the fitted Sun from the stated one."""
    sigma: np.ndarray
    """[rad] of the fit, the statement and the model."""
    explained: np.ndarray

    def contradicts(self) -> np.ndarray:
        """(K,) bool: beyond what noise, statement and model allow."""
        return (self.off > SIGMAS * self.sigma) | (self.explained < MIN_EXPLAINED)


def find_misfits(
    sparse: SparseModel, images: Sequence[Image], views: Views, reflectance: Reflectance, brightness: str
) -> Misfits:
    """Which of the registered views (of K) contradict the others.

    None of fewer than MIN_POINTS sparse points. Raises InputError where half of the Suns, or one of few, light nearly
    nothing of what is bright.
    """
    left_out, reason = np.zeros(len(views), bool), np.full(len(views), "", object)
    kept, found = np.flatnonzero(sparse.registered), []
    if len(sparse.points) >= MIN_POINTS:
        scene = coarse_scene(sparse, images, views, reflectance, brightness)
        _check_horizons(scene)
        found = contradicting(scene)
    for k, why in found:
        left_out[kept[k]], reason[kept[k]] = True, why
    return Misfits(left_out=left_out, reason=reason.astype(str))


def contradicting(scene: Scene) -> list[tuple[int, str]]:
    """Views of a `coarse_scene` to leave out, in order, and why.

    None where that leaves views that contradict each other all the same, far beyond what models err: then it is not
    known who is wrong, and a warning says so.
    """
    used, found = np.ones(len(scene.views), bool), []
    while (used & (heard := _hear(scene, used)).contradicts()).any():
        worst = _worst(scene, used, heard) if used.sum() > MIN_WITNESSES else None
        if worst is None:
            _say_undecided(scene, used, heard)
            if _usual(heard, used) > SIGMAS * MODEL_RAD:
                return []
            break
        used[worst[0]] = False
        found.append(worst)
    for view, why in found:
        log.warning("%s is left out: %s", scene.views.name[view], why)
    return found


def _worst(scene: Scene, used: np.ndarray, heard: _Heard) -> tuple[int, str] | None:
    """The view that had best be left out, and why; None where it is not known which."""
    suspicion = np.where(used, np.where(heard.explained < MIN_EXPLAINED, np.inf, heard.off / heard.sigma), -1.0)
    suspects = [k for k in np.argsort(-suspicion, kind="stable")[:SUSPECTS] if used[k]]
    verdicts = []
    for k in suspects:
        rest = used & (np.arange(len(used)) != k)
        without = _hear(scene, rest)
        sigma = math.hypot(heard.sigma[k], _usual(without, rest))
        remaining = int(np.sum(rest & without.contradicts()))
        verdicts.append((remaining, -heard.off[k] / sigma, int(k), sigma))
        if remaining == 0:
            break
    _, _, k, sigma = min(verdicts)
    off = heard.off[k]
    if heard.explained[k] < MIN_EXPLAINED and np.median(heard.explained[used]) > MIN_EXPLAINED:
        return k, (
            f"its brightness is not that of the ground under any Sun (correlation {heard.explained[k]:.2f}): "
            "it shows another place, or its exposure is spoilt"
        )
    if off > SIGMAS * sigma and off > SIGMAS * math.hypot(sigma, _hangs_on_one(scene, used, k)):
        return k, (
            f"its Sun is {math.degrees(off):.0f} degrees off that which its own brightness shows "
            f"(uncertain by {math.degrees(sigma):.1f}); {CONVENTION}"
        )
    return None


def _say_undecided(scene: Scene, used: np.ndarray, heard: _Heard) -> None:
    """Warns of views that stand out, or of all that contradict where everybody does."""
    usual = _usual(heard, used)
    out = used & ((heard.off > SIGMAS * np.hypot(heard.sigma, usual)) | (heard.explained < MIN_EXPLAINED))
    if usual > SIGMAS * MODEL_RAD:
        out |= used & heard.contradicts()
    if out.any():
        named = ", ".join(scene.views.name[k] for k in np.flatnonzero(out))
        log.warning(
            "the Sun directions and the brightness of the views contradict each other (%s), and %d views do not tell "
            "which is wrong; all of these are kept: check their `sun`", named, used.sum(),
        )  # fmt: skip


def _hear(scene: Scene, used: np.ndarray) -> _Heard:
    fits = [sun_by_witnesses(scene, used, k) if used[k] else None for k in range(len(used))]
    own = np.array([_own_sigma(fit) for fit in fits])
    return _Heard(
        off=np.array([fit.off if fit else 0.0 for fit in fits]),
        sigma=np.sqrt(own**2 + scene.views.sun_sigma**2 + MODEL_RAD**2),
        explained=np.array([fit.explained if fit else 1.0 for fit in fits]),
    )


def _usual(heard: _Heard, used: np.ndarray) -> float:
    """How far the Suns of the views in use are off, as a standard deviation per axis [rad], by their median."""
    return float(np.median(heard.off[used])) / 1.1774  # the median of a Rayleigh distribution of sigma 1


def _own_sigma(fit: SunFit | None) -> float:
    return min(fit.sigma, np.pi) if fit else 0.0


def _hangs_on_one(scene: Scene, used: np.ndarray, view: int) -> float:
    """Jackknife standard deviation [rad] per axis of a view's fitted Sun over its witnesses (Efron and Stein 1981)."""
    suns = []
    for other in np.flatnonzero(used & (np.arange(len(used)) != view)):
        fit = sun_by_witnesses(scene, used & (np.arange(len(used)) != other), view)
        if fit is not None:
            suns.append(fit.sun)
    if len(suns) < 2:
        return np.inf
    spread = np.array(suns) - np.mean(suns, axis=0)
    return float(np.sqrt((len(suns) - 1) / len(suns) * np.sum(spread**2) / 2))


def _check_horizons(scene: Scene) -> None:
    """Suns below the horizon of nearly all that is bright are wrong; those of most views are a misunderstanding."""
    views, tracks, marks = scene.views, scene.tracks, scene.landmarks
    dark = []
    for k in range(len(views)):
        seen = tracks.landmark[(tracks.view == k) & tracks.lit]
        if len(seen) == 0:
            continue
        center = views.body_from_cam.translation[k]
        mu0, _, _ = photometric_angles(views.sun[k], center, marks.position[seen], marks.normal[seen])
        if np.mean(mu0 > 0) < 0.1:
            dark.append((k, float(np.mean(mu0 > 0))))
    if dark and (2 * len(dark) >= len(views) or len(views) <= MIN_WITNESSES):
        k, share = dark[0]
        raise InputError(
            f"{views.name[k]}: the Sun direction lights {100 * share:.0f} % of the ground that is bright in the "
            f"image, and so in {len(dark)} of {len(views)} views; {CONVENTION}"
        )
