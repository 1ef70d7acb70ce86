"""Which views to leave out, and why: those whose brightness contradicts all the others (`sun_check`).

Views are left out one at a time: each time the view without which the fewest contradictions remain. Its own
contradiction must be larger than all uncertainties together, and must hold whichever single other view is left out
(jackknife). Where this does not identify the wrong view, the outstanding ones are doubtful: the dense map constrains
their Suns better (`doubtful_suns`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.reflectance import Reflectance, photometric_angles
from photoclinometry.model.robust import SIGNIFICANT, jackknife_sigma
from photoclinometry.model.scene import Scene, Views
from photoclinometry.model.sparse import SparseModel
from photoclinometry.model.suns import SUN_CONVENTION
from photoclinometry.model.warning import warn
from photoclinometry.photometry.predict import exposure_is_free
from photoclinometry.photometry.sun_check import MIN_POINTS, coarse_scene, gains_of_views, sun_from_other_views
from photoclinometry.photometry.sun_fit import MIN_LIT_SHARE, SunFit

log = logging.getLogger(__name__)

MODEL_RAD = math.radians(1.0)
"""Error of a fitted Sun due to a wrong reflectance model: median 0.5 to 1.5 degrees on simulated sites that were mapped
with another model than their own."""

AS_A_WHOLE_RAD = math.radians(10.0)
"""The Suns as a whole are wrong where the typical one is off by more, per axis. Sound sites under strong light have up
to 7.3 degrees, since their sparse ground is coarse; mirrored, swapped, shuffled or equal Suns have 15 to 79."""

MIN_EXPLAINED = 0.5
"""A view whose brightness correlates less than this with the map's, under its best Sun, shows something else."""

MIN_OTHER_VIEWS = 4
"""Least number of other views in use for a view to be left out: the ground from fewer is too uncertain as a reference
(with three others, a sound view was left out)."""

FEW_SIGMAS = 8.0
"""Takes the place of SIGNIFICANT where fewer are in use, in standard deviations of the jackknife. These have two
degrees of freedom then: Student's t exceeds 8 in 1.5 % of cases. Among four simulated views, a view that is off by 30
degrees is named in 83 to 89 % of cases, one off by 60 in 94 %; sound ones are named in 17 to 33 %, with a limit of 5 in
67 %."""

OTHER_EXPOSURE = 3.0
"""A calibrated view has another exposure or unit if its brightness exceeds this multiple of the others' prediction, or
is below the prediction over this. Gains of sound simulated views, relative to the typical one, are 0.94 to 1.07 in
seven sites and 0.71 to 1.43 in three, two of which have Suns all round."""

SUSPECTS = 5
"""Views that are tried as the one to leave out, the most suspicious first: each costs a Sun fit of all the others."""

RAYLEIGH_MEDIAN = math.sqrt(2.0 * math.log(2.0))
"""Median length of a vector of two normal components of standard deviation 1 (Rayleigh's distribution)."""


@dataclass(frozen=True, kw_only=True)
class InconsistentViews:
    """The outcome for K views, as a stage's result."""

    left_out: np.ndarray
    """(K,) bool."""
    reason: np.ndarray
    """(K,) str; empty where the view is kept."""
    doubtful: np.ndarray
    """(K,) bool: kept, though the sparse points contradict their Suns."""


@dataclass(frozen=True, kw_only=True)
class Contradictions:
    """The outcome of the Sun checks of a `coarse_scene`; views by their index."""

    left_out: tuple[tuple[int, str], ...] = ()
    """To be left out, in this order, and why."""
    doubtful: tuple[int, ...] = ()
    """Outstanding views where the wrong ones cannot be distinguished from the right ones."""


@dataclass(frozen=True, kw_only=True)
class _SunChecks:
    """The leave-one-out Sun check of every view (K,); views out of use or without a fit have no contradiction."""

    off: np.ndarray
    """Angle [rad] of the fitted Sun from the stated one."""
    sigma: np.ndarray
    """Standard deviation per axis [rad] of the fit, the statement and the model together."""
    explained: np.ndarray
    """Correlation of brightness with the ground's under the fitted Sun."""

    def inconsistent(self) -> np.ndarray:
        """(K,) bool: the contradiction is beyond noise, the stated sigma and the model's error."""
        return (self.off > SIGNIFICANT * self.sigma) | (self.explained < MIN_EXPLAINED)

    def typical_off(self, used: np.ndarray) -> float:
        """Standard deviation per axis [rad] of the errors of the Suns of views `used` (K,), from their median."""
        return float(np.median(self.off[used])) / RAYLEIGH_MEDIAN


def find_inconsistent_views(
    sparse: SparseModel, images: Sequence[Image], views: Views, reflectance: Reflectance, brightness: str
) -> InconsistentViews:
    """Which of the registered views (of K) contradict the others.

    None are found where there are fewer than MIN_POINTS sparse points. Raises InputError if in half of the views, or in
    one of few, the stated Sun lights nearly none of the bright ground.
    """
    left_out, doubtful = np.zeros((2, len(views)), bool)
    reason = np.full(len(views), "", object)
    kept, found = np.flatnonzero(sparse.registered), Contradictions()
    if len(sparse.points) >= MIN_POINTS:
        scene = coarse_scene(sparse, images, views, reflectance, brightness)
        _check_horizons(scene)
        found = inconsistent_views(scene)
    for k, why in found.left_out:
        left_out[kept[k]], reason[kept[k]] = True, why
    doubtful[kept[list(found.doubtful)]] = True
    return InconsistentViews(left_out=left_out, reason=reason.astype(str), doubtful=doubtful)


def inconsistent_views(scene: Scene) -> Contradictions:
    """Views of a `coarse_scene` to leave out, and doubtful ones.

    None is left out if the remaining views still contradict each other far beyond the models' errors: then the wrong
    ones cannot be distinguished from the right ones. Suns that are wrong as a whole are warned of.
    """
    used, found, doubtful = np.ones(len(scene.views), bool), [], ()
    while (used & (checks := _check_suns(scene, used)).inconsistent()).any():
        worst = _worst(scene, used, checks) if used.sum() > MIN_OTHER_VIEWS else None
        if worst is None:
            doubtful = _doubtful(scene, used, checks)
            if checks.typical_off(used) > SIGNIFICANT * MODEL_RAD:
                return Contradictions(doubtful=doubtful)
            break
        used[worst[0]] = False
        found.append(worst)
    found += _exposed_otherwise(scene, used)
    for view, why in found:
        name = scene.views.name[view]
        warn(log, "view-left-out", "%s is left out: %s", name, why, view=name)
    return Contradictions(left_out=tuple(found), doubtful=doubtful)


def _exposed_otherwise(scene: Scene, used: np.ndarray) -> list[tuple[int, str]]:
    """Views in use (K,) bool whose exposure differs from that of the others, as `inconsistent_views` names them.

    None where exposures are free, and none where too few others are left for a judgement.
    """
    assert scene.reflectance is not None
    if exposure_is_free(scene.brightness, scene.reflectance):
        return []
    gain = gains_of_views(scene, used)
    judged = np.isfinite(gain)
    if judged.sum() <= MIN_OTHER_VIEWS:
        return []
    factor = gain / np.median(gain[judged])
    other = np.abs(np.log(factor)) > math.log(OTHER_EXPOSURE)
    if judged.sum() - other.sum() < MIN_OTHER_VIEWS:
        return []
    return [
        (int(k), f"it is {factor[k]:.3g} times as bright as the other views show its ground to be under its light: "
         "check its exposure and its unit")
        for k in np.flatnonzero(other)
    ]  # fmt: skip


def _worst(scene: Scene, used: np.ndarray, checks: _SunChecks) -> tuple[int, str] | None:
    """The view to leave out next, and why; None where no view is certainly wrong."""
    k, sigma = _most_contradicting(scene, used, checks)
    off = checks.off[k]
    if checks.explained[k] < MIN_EXPLAINED and np.median(checks.explained[used]) > MIN_EXPLAINED:
        return k, (
            f"its brightness is not that of the ground under any Sun (correlation {checks.explained[k]:.2f}): "
            "it shows another place, or its exposure is spoilt"
        )
    if off > SIGNIFICANT * sigma and off > SIGNIFICANT * math.hypot(sigma, _jackknife_sigma(scene, used, k)):
        return k, (
            f"its Sun is {math.degrees(off):.0f} degrees off that which its own brightness shows "
            f"(uncertain by {math.degrees(sigma):.1f}); {SUN_CONVENTION}"
        )
    return None


def _most_contradicting(scene: Scene, used: np.ndarray, checks: _SunChecks) -> tuple[int, float]:
    """The view without which the fewest views are inconsistent, and its Sun's standard deviation per axis [rad].

    Among equals, the view whose Sun is off by the most standard deviations. The standard deviation includes the errors
    of the other views' Suns without it.
    """
    suspicion = np.where(used, np.where(checks.explained < MIN_EXPLAINED, np.inf, checks.off / checks.sigma), -1.0)
    suspects = [k for k in np.argsort(-suspicion, kind="stable")[:SUSPECTS] if used[k]]
    outcomes = []
    for k in suspects:
        rest = used & (np.arange(len(used)) != k)
        without = _check_suns(scene, rest)
        sigma = math.hypot(checks.sigma[k], without.typical_off(rest))
        remaining = int(np.sum(rest & without.inconsistent()))
        outcomes.append((remaining, -checks.off[k] / sigma, int(k), sigma))
        if remaining == 0:
            break
    _, _, k, sigma = min(outcomes)
    return k, sigma


def _doubtful(scene: Scene, used: np.ndarray, checks: _SunChecks) -> tuple[int, ...]:
    """The views that stand out, or all inconsistent ones where even the typical Sun is off.

    None, and a warning, where the Suns as a whole are wrong, or where no Sun makes a view look like the ground: the map
    gives no more information on these.

    Among few views, those that stand out whichever single other view is left out: the ground from the two or three
    others is itself uncertain, and does not test the Suns as a whole.
    """
    few, typical = used.sum() <= MIN_OTHER_VIEWS, checks.typical_off(used)
    contradict = not few and typical > SIGNIFICANT * MODEL_RAD
    doubt = [_jackknife_sigma(scene, used, int(k)) for k in np.flatnonzero(used)] if few else typical
    sigma = checks.sigma.copy()
    sigma[used] = np.hypot(sigma[used], doubt)
    limit = FEW_SIGMAS if few else SIGNIFICANT
    out = used & ((checks.off > limit * sigma) | (checks.explained < MIN_EXPLAINED))
    if contradict:
        out |= used & checks.inconsistent()
    found = tuple(np.flatnonzero(out).tolist())
    as_a_whole = contradict and typical > AS_A_WHOLE_RAD
    if as_a_whole or (checks.explained[out] < MIN_EXPLAINED).any():
        warn_undecided([scene.views.name[k] for k in found], int(used.sum()), as_a_whole=as_a_whole)
        return ()
    return found


def warn_undecided(names: Sequence[str], views: int, *, as_a_whole: bool = False) -> None:
    """Warns of views whose Suns and brightness contradict each other.

    as_a_whole: whether this shows that the Suns as a whole are wrong.
    """
    warn(
        log, "most-suns-contradict" if as_a_whole else "sun-undecided",
        "the Sun directions and the brightness of the views contradict each other (%s), and %d views do not tell which "
        "is wrong; all of these are kept: check their `sun`", ", ".join(names), views,
    )  # fmt: skip


def _check_suns(scene: Scene, used: np.ndarray) -> _SunChecks:
    """The leave-one-out check of each view in use (K,) bool against the others in use."""
    fits = [sun_from_other_views(scene, used, k) if used[k] else None for k in range(len(used))]
    fit_sigma, views = np.array([_fit_sigma(fit) for fit in fits]), scene.views
    return _SunChecks(
        off=np.array([fit.off if fit else 0.0 for fit in fits]),
        sigma=np.sqrt(fit_sigma**2 + views.sun_sigma**2 + views.sun_common_sigma**2 + MODEL_RAD**2),
        explained=np.array([fit.explained if fit else 1.0 for fit in fits]),
    )


def _fit_sigma(fit: SunFit | None) -> float:
    """[rad]; no direction is more uncertain than half a turn."""
    return min(fit.sigma, np.pi) if fit else 0.0


def _jackknife_sigma(scene: Scene, used: np.ndarray, view: int) -> float:
    """Jackknife standard deviation per axis [rad] of a view's fitted Sun over the other views.

    Infinite where fewer than two fits are possible.
    """
    suns = []
    for other in np.flatnonzero(used & (np.arange(len(used)) != view)):
        fit = sun_from_other_views(scene, used & (np.arange(len(used)) != other), view)
        if fit is not None:
            suns.append(fit.sun)
    if len(suns) < 2:
        return np.inf
    return float(np.linalg.norm(jackknife_sigma(np.array(suns)))) / math.sqrt(2.0)


def _check_horizons(scene: Scene) -> None:
    """Raises InputError if in most views the Sun is below the horizon of the bright ground: a wrong convention.

    One such view of few is refused, too; one of many is left to the Sun check.
    """
    views, tracks, landmarks = scene.views, scene.tracks, scene.landmarks
    unlit = []
    for k in range(len(views)):
        seen = tracks.landmark[(tracks.view == k) & tracks.lit]
        if len(seen) == 0:
            continue
        center = views.body_from_cam.translation[k]
        mu0, _, _ = photometric_angles(views.sun[k], center, landmarks.position[seen], landmarks.normal[seen])
        share = float(np.mean(mu0 > 0))
        if share < MIN_LIT_SHARE:
            unlit.append((k, share))
    if unlit and (2 * len(unlit) >= len(views) or len(views) <= MIN_OTHER_VIEWS):
        k, share = unlit[0]
        raise InputError(
            f"{views.name[k]}: the Sun direction lights {100 * share:.0f} % of the ground that is bright in the "
            f"image, and so in {len(unlit)} of {len(views)} views; {SUN_CONVENTION}"
        )
