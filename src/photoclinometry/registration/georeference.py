"""Putting a map into the body-fixed metric frame by pose priors.

A map made from images alone has its own origin, orientation and unit of length. Pose priors (`PosePrior`: from kernels,
tables, SUMFILEs) determine the similarity between the two frames, each weighted by its own sigmas. The scene's
predictions for images do not change.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.gauss_newton import gauss_newton
from photoclinometry.model.geometry import Rigid, Similarity, skew, so3_exp, so3_log
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.robust import SIGNIFICANT, huber_weight
from photoclinometry.model.scene import BODY_FIXED, OWN, Scene
from photoclinometry.model.warning import warn
from photoclinometry.registration.alignment import align_poses, camera_distance, transform_poses, transform_scene
from photoclinometry.registration.pose_knowledge import disagreement, pose_information

log = logging.getLogger(__name__)

MIN_PRIORS = 3
"""Fewest agreeing priors for a frame: between two, a wrong one cannot be distinguished from a right one."""
FAR_RAD = np.radians(5.0)
"""Images determine attitudes far better than this [rad]: an attitude's prior is left out if it is off by more, and
SIGNIFICANT."""
CONTRADICTS = 2.5
"""A prior is left out if it disagrees with images and other priors by this many sigmas, root mean square over its six,
and by this multiple of the median: by 6 sigmas in one of the six directions. Sound ones disagree by 2 at most
(0008)."""
RESIDUALS = 6
"""Number of residuals of each prior: three of position, three of attitude."""
_SMALL_RAD = 1e-6
"""Below this angle the series of the inverse left Jacobian is cut, since its closed form divides zero by zero."""


@dataclass(frozen=True, kw_only=True)
class Georeference:
    """The frame on which priors agree, and their residuals."""

    similarity: Similarity
    """metric_from_B: body-fixed, in the priors' unit of length."""
    names: tuple[str, ...]
    """(n,) views with priors."""
    position_residual: np.ndarray
    """(n, 3) camera centres of the scene minus those of the priors, in the metric frame."""
    rotation_residual: np.ndarray
    """(n, 3) rotation vectors from the priors' attitudes to the scene's, in the metric frame [rad]."""
    position_sigma: np.ndarray
    """(n,) as the priors state."""
    rotation_sigma: np.ndarray
    """(n,) as the priors state [rad]."""
    covariance: np.ndarray
    """(7, 7) of rotation [rad], translation of the cameras' mean centre, and log scale, if the sigmas are true."""
    used: np.ndarray
    """(n,) bool: priors that determine the frame."""
    disagreement: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) of `pose_knowledge.disagreement`; empty where images were not used."""

    @property
    def rms_position(self) -> float:
        """Root mean square distance of camera centres, in the priors' unit, of the priors used."""
        return float(np.sqrt(np.mean(np.sum(self.position_residual[self.used] ** 2, -1))))

    @property
    def rms_rotation(self) -> float:
        """Root mean square angle between attitudes [rad], of the priors used."""
        return float(np.sqrt(np.mean(np.sum(self.rotation_residual[self.used] ** 2, -1))))

    @property
    def deviation(self) -> np.ndarray:
        """(n,) residuals in sigmas, root mean square over a prior's six."""
        return deviation(self.position_residual, self.rotation_residual, self.position_sigma, self.rotation_sigma)

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of the scale."""
        return float(np.sqrt(self.covariance[6, 6]))


def deviation(
    position: np.ndarray, rotation: np.ndarray, position_sigma: float | np.ndarray, rotation_sigma: float | np.ndarray
) -> np.ndarray:
    """(n,) residuals (n, 3) of positions and of attitudes in their sigmas (n,), root mean square over the six."""
    squares = np.sum(position**2, -1) / position_sigma**2 + np.sum(rotation**2, -1) / rotation_sigma**2
    return np.sqrt(squares / RESIDUALS)


def georeferenced(scene: Scene, priors: Mapping[str, PosePrior]) -> tuple[Scene, Georeference]:
    """The scene in the frame and unit of the priors of its views (by name), and the fit with its residuals.

    Priors that contradict the images are left out, and named in the log. Uncertainties are transformed, too
    (`alignment.transform_scene`). Raises InputError for fewer than MIN_PRIORS priors, or fewer that agree, and for
    cameras whose poses determine no scale.
    """
    fit = agreement(scene, priors)
    outliers = {fit.names[k]: describe(fit, int(k)) for k in np.flatnonzero(~fit.used)}
    some = "; ".join([*list(outliers.values())[:3], *(["..."] if len(outliers) > 3 else [])])
    if fit.used.sum() < MIN_PRIORS:
        raise InputError(
            f"only {fit.used.sum()} of {len(fit.used)} pose priors agree with the images and each other: "
            f"{some}; check cam_from_body in site.toml "
            "(x_C = R x_B + t, x right, y down, z forward, metres)"
        )
    for name, outlier in outliers.items():
        warn(log, "prior-contradicts", "pose prior left out, it contradicts the images: %s", outlier, view=name)
    frame = BODY_FIXED if scene.frame == OWN else scene.frame
    return replace(transform_scene(fit.similarity, scene), frame=frame), fit


def agreement(scene: Scene, priors: Mapping[str, PosePrior]) -> Georeference:
    """The fit of the scene's poses to those priors of its views (by name) that agree with the images and each other.

    A prior is left out if it disagrees with the pose of its view by the images and the other priors (`disagreement`) by
    more than CONTRADICTS sigmas and more than CONTRADICTS times the median, since errors of images are larger than
    their known sigmas; or if its attitude is off by more than SIGNIFICANT sigmas and FAR_RAD. The worst goes first: a
    wrong prior makes sound ones look wrong. Fewer than MIN_PRIORS may be left in `used`. Where views belong to several
    arcs, the common error of an arc's priors is part of their sigmas. Raises InputError where fewer are given.
    """
    seen = [k for k, name in enumerate(scene.views.name) if name in priors]
    if len(seen) < MIN_PRIORS:
        raise InputError(
            f"{len(seen)} of the {len(scene.views)} views have a pose prior, at least {MIN_PRIORS} are needed to put "
            "the map into their frame; add cam_from_body to more views of site.toml"
        )
    distance = camera_distance(scene)
    names = tuple(scene.views.name[k] for k in seen)
    poses, known = scene.views.body_from_cam[seen], [priors[name] for name in names]
    if len(set(scene.views.arc[seen])) > 1:
        known = [_with_arcs_error(prior) for prior in known]
    information, used = pose_information(scene), np.ones(len(seen), bool)
    while True:
        fit = fit_to_priors(poses, known, distance, names, used)
        fit = replace(fit, disagreement=_disagreement(fit, information, np.array(seen)))
        agree = used & _agree(fit)
        if agree.sum() < MIN_PRIORS or (agree == used).all():
            return replace(fit, used=agree)
        used = used & (np.arange(len(seen)) != np.argmax(np.where(used & ~agree, fit.disagreement, -1.0)))


def _with_arcs_error(prior: PosePrior) -> PosePrior:
    """The prior with sigmas that contain the error of its arc. The error of a single arc moves the frame; those of
    several arcs make them contradict each other."""
    return replace(
        prior,
        rotation_sigma_rad=float(np.hypot(prior.rotation_sigma_rad, prior.common_rotation_sigma_rad)),
        translation_sigma=float(np.hypot(prior.translation_sigma, prior.common_translation_sigma)),
    )


def _disagreement(fit: Georeference, information: np.ndarray, view: np.ndarray) -> np.ndarray:
    """(n,) of the priors of views (n,). information: of the scene's poses, in its own frame."""
    frame = fit.similarity
    turned, moved = fit.rotation_residual @ frame.rotation, fit.position_residual @ frame.rotation / frame.scale
    sigma = np.repeat(np.stack([fit.rotation_sigma, fit.position_sigma / frame.scale], -1), 3, axis=-1)
    return disagreement(information, -np.concatenate([turned, moved], -1), sigma, view, fit.used)


def _agree(fit: Georeference) -> np.ndarray:
    """(n,) bool: priors within the bounds of `agreement`."""
    near = fit.disagreement <= CONTRADICTS * max(1.0, float(np.median(fit.disagreement[fit.used])))
    turned = np.linalg.norm(fit.rotation_residual, axis=-1)
    return near & (turned <= np.maximum(FAR_RAD, SIGNIFICANT * fit.rotation_sigma))


def describe(fit: Georeference, k: int) -> str:
    """The error of one view's prior, as a sentence."""
    moved, turned = (np.linalg.norm(part[k]) for part in (fit.position_residual, fit.rotation_residual))
    return (
        f"{fit.names[k]} is off by {moved:.4g} m and {np.degrees(turned):.3g} degrees, at sigmas of "
        f"{fit.position_sigma[k]:.3g} m and {np.degrees(fit.rotation_sigma[k]):.3g} degrees: "
        f"{fit.disagreement[k]:.3g} sigmas from what images and other priors say"
    )


def fit_to_priors(
    body_from_cam: Rigid,
    priors: list[PosePrior],
    distance: float,
    names: tuple[str, ...] = (),
    used: np.ndarray | None = None,
) -> Georeference:
    """The similarity that brings (n,) poses to their priors, positions and attitudes: least squares with Huber's loss.

    distance: from a camera to the surface in the scene's unit, for the first guess. used: (n,) bool, priors that
    determine it; all by default. Raises InputError where centres coincide.
    """
    known = _stacked(priors)
    used = np.ones(len(priors), bool) if used is None else used
    sigma = np.array([[p.translation_sigma, p.rotation_sigma_rad] for p in priors], float)

    def linearize(similarity: Similarity) -> tuple[np.ndarray, np.ndarray]:
        residual, jacobian = _linearized(similarity, body_from_cam, known, sigma)
        weight = used * huber_weight(np.linalg.norm(residual, axis=-1) / np.sqrt(RESIDUALS))
        gradient = np.einsum("n,nri,nr->i", weight, jacobian, residual)
        return gradient, np.einsum("n,nri,nrj->ij", weight, jacobian, jacobian)

    def move(similarity: Similarity, step: np.ndarray) -> Similarity:
        return _moved(similarity, _middle(similarity, body_from_cam), step)

    start = align_poses(body_from_cam[used], known[used], distance)
    fit = gauss_newton(start, linearize, move)
    moved = transform_poses(fit.state, body_from_cam)
    return Georeference(
        similarity=fit.state,
        names=names or tuple(str(k) for k in range(len(priors))),
        position_residual=moved.translation - known.translation,
        rotation_residual=so3_log(moved.rotation @ np.swapaxes(known.rotation, -1, -2)),
        position_sigma=sigma[:, 0],
        rotation_sigma=sigma[:, 1],
        covariance=np.linalg.inv(fit.information),
        used=used,
    )


def _stacked(priors: list[PosePrior]) -> Rigid:
    """(n,) body_from_cam of the priors."""
    poses = [prior.cam_from_body.inverse() for prior in priors]
    return Rigid(np.array([p.rotation for p in poses]), np.array([p.translation for p in poses]))


def _middle(similarity: Similarity, body_from_cam: Rigid) -> np.ndarray:
    """(3,) mean camera centre in the metric frame."""
    return similarity(body_from_cam.translation).mean(0)


def _moved(similarity: Similarity, middle: np.ndarray, step: np.ndarray) -> Similarity:
    """The similarity after a step (7,): rotation and log scale about `middle`, and translation."""
    turn, growth = so3_exp(step[:3]), float(np.exp(step[6]))
    return Similarity(growth, turn, middle + step[3:6] - growth * turn @ middle) @ similarity


def _linearized(
    similarity: Similarity, body_from_cam: Rigid, known: Rigid, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened residuals (n, 6) of positions and attitudes, and their derivatives (n, 6, 7) by the step of `_moved`."""
    moved = transform_poses(similarity, body_from_cam)
    arm = moved.translation - _middle(similarity, body_from_cam)
    turn = so3_log(moved.rotation @ np.swapaxes(known.rotation, -1, -2))
    residual = np.concatenate([(moved.translation - known.translation) / sigma[:, :1], turn / sigma[:, 1:]], -1)
    jacobian = np.zeros((len(sigma), 6, 7))
    jacobian[:, :3, :3] = -skew(arm) / sigma[:, :1, None]
    jacobian[:, :3, 3:6] = np.eye(3) / sigma[:, :1, None]
    jacobian[:, :3, 6] = arm / sigma[:, :1]
    jacobian[:, 3:, :3] = _inverse_left_jacobian(turn) / sigma[:, 1:, None]
    return residual, jacobian


def _inverse_left_jacobian(omega: np.ndarray) -> np.ndarray:
    """(n, 3, 3) d log(exp(w) R) / dw at w = 0, for R = exp(omega); Sola et al. (2018), arXiv:1812.01537, Eq. 146."""
    angle = np.linalg.norm(omega, axis=-1)[:, None, None]
    half = np.maximum(angle, _SMALL_RAD) / 2.0
    hat = skew(omega)
    return np.eye(3) - 0.5 * hat + (1.0 - half / np.tan(half)) / np.maximum(angle, _SMALL_RAD) ** 2 * (hat @ hat)
