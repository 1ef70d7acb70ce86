"""Pose priors in a run: they place the map, take part in the joint estimate, and are compared with it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust import Adjustment, PosePriors
from photoclinometry.evaluate.metrics import spread
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, so3_log
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.robust import SIGNIFICANT
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.registration.alignment import camera_distance
from photoclinometry.registration.georeference import MIN_PRIORS, agreement, deviation, fit_to_priors, georeferenced

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Placed:
    """A scene in the frame of its pose priors."""

    scene: Scene
    pose_priors: PosePriors
    """The priors that agree with the scene, in its frame."""
    names: tuple[str, ...]
    """Views whose priors these are."""


@dataclass(frozen=True, kw_only=True)
class PriorRow:
    """How far the estimate of a view is from its pose prior.

    Sigmas are of the view's own error and of that which all of its arc have in common.
    """

    name: str
    """The view's."""
    used: bool
    """Whether the prior took part in the estimate."""
    center_off_m: float
    """Distance of the camera from where the prior puts it."""
    center_sigma_m: float
    """Of the prior, along each axis."""
    rotation_off_deg: float
    """Angle between the attitudes."""
    rotation_sigma_deg: float
    """Of the prior, about each axis."""
    off_sigmas: float
    """Root mean square over the six."""


def usable_priors(priors: Mapping[str, PosePrior], scene: Scene) -> dict[str, PosePrior]:
    """The priors (by name) of the scene's views; none, with the reason in the log, where they are too few."""
    usable = {name: prior for name, prior in priors.items() if name in scene.views.name}
    if usable and len(usable) < MIN_PRIORS:
        warn(
            log,
            "priors-too-few",
            "%d of the %d views have a pose prior, at least %d are needed: the map stays in a frame of its own",
            len(usable),
            len(scene.views),
            MIN_PRIORS,
        )
        return {}
    return usable


def place_by_priors(scene: Scene, priors: Mapping[str, PosePrior]) -> Placed | None:
    """The scene in the priors' frame, in metres, with those priors that agree with it.

    Which agree is judged anew by each scene that an estimate starts from, as poses become better. None, with the
    reason in the log, where the priors do not determine the frame.
    """
    try:
        moved, fit = georeferenced(scene, priors)
    except InputError as error:
        warn(log, "priors-too-few", "pose priors are not used, the map stays in the frame that it has: %s", error)
        return None
    log.info(
        "the map is in the frame of the pose priors of %d views: %.4g m and %.3g degrees from them (RMS), "
        "scale known to %.2g %%, one pixel is %.4g m on the ground",
        fit.used.sum(),
        fit.rms_position,
        np.degrees(fit.rms_rotation),
        100.0 * fit.scale_sigma,
        moved.gsd,
    )
    agreeing = {name: priors[name] for name, used in zip(fit.names, fit.used, strict=True) if used}
    return Placed(scene=moved, pose_priors=priors_in_frame(moved, agreeing), names=tuple(agreeing))


def estimate_with_priors(
    start: Scene, priors: Mapping[str, PosePrior], estimate: Callable[[Scene, PosePriors], Adjustment]
) -> Adjustment | None:
    """The joint estimate, from `start` in the priors' frame, with those priors that agree; None as `place_by_priors`.

    Some wrong priors show only in the estimate, which they have bent by then. It is made again without them, from the
    same start.
    """
    placed = place_by_priors(start, priors)
    if placed is None:
        return None
    found = estimate(placed.scene, placed.pose_priors)
    agreeing = {name: priors[name] for name in placed.names}
    fit = agreement(found.scene, agreeing)
    if fit.used.all() or fit.used.sum() < MIN_PRIORS:
        return found
    still = {name: agreeing[name] for name, used in zip(fit.names, fit.used, strict=True) if used}
    again = place_by_priors(start, still)
    if again is None:
        return found
    log.info("estimated again without priors that contradict the images")
    return estimate(again.scene, again.pose_priors)


def priors_in_frame(scene: Scene, priors: Mapping[str, PosePrior]) -> PosePriors:
    """The priors as the joint estimate takes them, in the scene's frame; views without one are free."""
    views = scene.views
    return priors_of_views(views.name, views.body_from_cam, priors, views.arc)


def priors_of_views(
    names: Sequence[str], body_from_cam: Rigid, priors: Mapping[str, PosePrior], arc: np.ndarray | None = None
) -> PosePriors:
    """Priors by name as the joint estimate takes them; views without one are free, at the poses (K,).

    arc: (K,) int, number of each view's arc; None where what priors have in common does not matter, or all are of one.
    """
    rotation, center = body_from_cam.rotation.copy(), body_from_cam.translation.copy()
    rotation_sigma, center_sigma = np.full((2, len(names)), np.inf)
    for name, prior in priors.items():
        k, pose = names.index(name), prior.cam_from_body.inverse()
        rotation[k], center[k] = pose.rotation, pose.translation
        rotation_sigma[k], center_sigma[k] = prior.rotation_sigma_rad, prior.translation_sigma
    return PosePriors(
        body_from_cam=Rigid(rotation, center),
        rotation_sigma=rotation_sigma,
        center_sigma=center_sigma,
        common_rotation_sigma=max((prior.common_rotation_sigma_rad for prior in priors.values()), default=0.0),
        common_center_sigma=max((prior.common_translation_sigma for prior in priors.values()), default=0.0),
        arc=None if arc is None else np.unique(arc, return_inverse=True)[1],
    )


def prior_table(scene: Scene, priors: Mapping[str, PosePrior], used: np.ndarray) -> list[PriorRow]:
    """One row per view that has a prior. used: (K,) bool, views whose prior took part in the estimate."""
    rows = []
    for k, name in enumerate(scene.views.name):
        if name not in priors or not len(used):
            continue
        prior, pose = priors[name], scene.views.body_from_cam[k]
        known = prior.cam_from_body.inverse()
        moved, turned = pose.translation - known.translation, so3_log(pose.rotation @ known.rotation.T)
        center_sigma = float(np.hypot(prior.translation_sigma, prior.common_translation_sigma))
        rotation_sigma = float(np.hypot(prior.rotation_sigma_rad, prior.common_rotation_sigma_rad))
        off = float(deviation(moved, turned, center_sigma, rotation_sigma))
        rows.append(
            PriorRow(
                name=name,
                used=bool(used[k]),
                center_off_m=float(np.linalg.norm(moved)),
                center_sigma_m=center_sigma,
                rotation_off_deg=float(np.degrees(np.linalg.norm(turned))),
                rotation_sigma_deg=float(np.degrees(rotation_sigma)),
                off_sigmas=off,
            )
        )
    return rows


def warn_of_outliers(rows: Sequence[PriorRow]) -> None:
    """Names in the log the priors of `prior_table` that were left out, and those that were used though far off."""
    for row in rows:
        if row.used and row.off_sigmas <= SIGNIFICANT:
            continue
        what = "is used, but is far off; check its sigmas" if row.used else "contradicts the images and is left out"
        warn(
            log,
            "prior-contradicts",
            "%s: its pose prior %s: %.4g m and %.3g degrees from the estimate, %.3g sigmas",
            row.name,
            what,
            row.center_off_m,
            row.rotation_off_deg,
            row.off_sigmas,
            view=row.name,
        )


def changes_beside_priors(
    scene: Scene, priors: Mapping[str, PosePrior], used: np.ndarray, what: str
) -> dict[str, float]:
    """What other knowledge of the frame, named `what`, has changed: how far the middle of the map is moved [m], and how
    it is turned [degrees] and scaled [%], from where pose priors alone would put it.

    used: (K,) bool, views whose prior took part in the estimate, or empty. Empty where these alone give no frame.
    """
    names = [name for name, own in zip(scene.views.name, used, strict=True) if own] if len(used) else []
    if len(names) < MIN_PRIORS:
        return {}
    poses = scene.views.body_from_cam[[scene.views.name.index(name) for name in names]]
    alone = fit_to_priors(poses, [priors[name] for name in names], camera_distance(scene), tuple(names)).similarity
    middle = scene.landmarks.position.mean(0)
    return {
        f"{what}_moved_m": float(np.linalg.norm(middle - alone(middle[None])[0])),
        f"{what}_turned_deg": float(np.degrees(np.linalg.norm(so3_log(alone.rotation)))),
        f"{what}_scaled_percent": 100.0 * (1.0 / alone.scale - 1.0),
    }


def prior_metrics(rows: Sequence[PriorRow]) -> dict[str, float]:
    """Figures of `prior_table`, of those that were used."""
    if not rows:
        return {}
    used = [row for row in rows if row.used]
    return {
        "pose_priors_used": len(used),
        "pose_priors_left_out": len(rows) - len(used),
        **spread(np.array([row.center_off_m for row in used]), "pose_prior_center", "m"),
        **spread(np.array([row.rotation_off_deg for row in used]), "pose_prior_rotation", "deg"),
        "pose_prior_deviation_rms_sigmas": float(np.sqrt(np.mean([row.off_sigmas**2 for row in used]))),
    }
