"""The factors that the joint estimate minimises, with their variables and noise.

sparse tie points         keypoints of structure from motion                                hold the poses
dense                     keypoints of the map's landmarks                                  where matches determine it
reference rays            keypoints of direct landmarks: the reference view's ray alone     where brightness does
pose-only tie points      their matches, with positions of their own                        hold the poses
control point keypoints   of ground control points
brightness                of lit landmarks; follows direct ones by the image gradients
smoothness                neighbours lie in the tangent plane
Suns, control points      `graph.sun_directions`, `graph.control_points`
laser altimetry           `graph.altimetry`: shots lie in the tangent planes of landmarks
priors                    `graph.priors`: exposures, pose priors or gauge, known poses, landmarks, reflectance
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust.altimeter_tracks import AltimetryFit, altimetry_at, altimetry_group
from photoclinometry.adjust.brightness_weights import relative_sigma, usable_brightness
from photoclinometry.adjust.graph.altimetry import Altimetry
from photoclinometry.adjust.graph.control_points import ControlPoints
from photoclinometry.adjust.graph.general import FactorGroup
from photoclinometry.adjust.graph.graph import Group
from photoclinometry.adjust.graph.observations import Brightness, ImageGradients, Keypoints, ObservationTable
from photoclinometry.adjust.graph.priors import Exposure, Gauge, LandmarkPriors, ReflectancePrior
from photoclinometry.adjust.graph.smoothness import Neighbours, Smoothness, bend_between, build_neighbours
from photoclinometry.adjust.graph.sun_directions import SunDirections
from photoclinometry.adjust.graph.variables import VIEW_SIZE, Estimate
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.adjust.scene_priors import ScenePriors
from photoclinometry.adjust.tie_points import POSE_ONLY_STEP, Members
from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Landmarks, Scene
from photoclinometry.photometry.predict import BIAS_SIGMA, exposure_is_free
from photoclinometry.surface.neighbours import neighbours

BALANCED_CORRELATION_PX = 3.0
"""Brightness correlation up to which smoothness is as given; in landmarks for a map of larger stride."""

DIRECT_SMOOTHNESS = 0.5
"""Factor on the given smoothness where brightness follows landmarks (`ImageGradients`), if errors of brightness are
independent from pixel to pixel: nothing else holds single landmarks against noise."""

BENT_SMOOTHNESS = 0.1
"""Factor on the given smoothness where brightness has no smooth errors. Normals and positions then describe the same
surface, and smoothness allows for the bend between neighbours (`bend_between`). True surfaces of three places depart
from their normals by 0.010 to 0.020 rad in the median where the bend is allowed for, by 0.04 to 0.055 otherwise."""

NEAREST_NEIGHBOUR = 0.05
"""Landmarks nearer than this share of the map's spacing are no neighbours. Rays of the reference view lie a whole
spacing apart, so that only a wrong match puts one so near. The direction between two landmarks a thousandth of the
spacing apart turns round in the shortest of steps, and delays the whole estimate."""

DIRECT_SIGMA_PX = 25.0
"""Keypoints' standard deviation where brightness follows their landmark (`ImageGradients`) [px]: they then hold only
the directions that no image determines. Matches were found with the very map that brightness is to correct."""

RAY_SIGMA_PX = 0.004
"""Standard deviation of a direct landmark from its pixel's ray of the reference view [px]: the choice of the point on
the ground is free, and the ray fixes it."""

CALIBRATED_SCALE_SIGMA = 0.01
"""Prior on the scales of calibrated images about 1: radiometric calibrations of spacecraft cameras agree to a few
percent absolutely, and to better than one from image to image."""

FREE_SCALE_SIGMA = 1e-6
"""Prior on the reference view's scale where no other is known: it is 1."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """The inputs of an estimate's groups, the same in all its reweighting iterations."""

    scene: Scene
    """At the start, with tie points, in the solver's order of landmarks."""
    members: Members
    table: ObservationTable
    options: AdjustOptions
    reflectance: Reflectance | None
    """From which that of the estimate differs by its parameters; None without photometry."""
    gradients: ImageGradients | None
    priors: ScenePriors
    scale_sigma: np.ndarray
    """(K,) as stated; infinite where free."""
    bias_sigma: np.ndarray
    """(K,) as stated."""
    lit: np.ndarray
    """(N,) brightness that counts at the start (`brightness_weights.usable_brightness`)."""
    relative_sigma: np.ndarray
    """(N,) factor on the standard deviation of brightness (`brightness_weights.relative_sigma`); ones where it does not
    follow landmarks."""

    @property
    def first_track(self) -> int:
        """Index of the first altimeter track's shift among the systematic errors: after those of pose priors."""
        return 0 if self.priors.pose_priors is None else self.priors.pose_priors.common_errors

    @property
    def systematic(self) -> np.ndarray:
        """(M, 10) systematic errors at the start: none."""
        tracks = 0 if self.priors.altimetry is None else len(self.priors.altimetry.name)
        return np.zeros((self.first_track + tracks, VIEW_SIZE))

    @property
    def parameters(self) -> np.ndarray:
        """(T,) reflectance parameters at the start, as an `Estimate` has them; none where they are held."""
        start = self.scene.reflectance
        if self.reflectance is None or start is None or not self.estimates_reflectance:
            return np.zeros(0)
        return self.reflectance.relative_change(start)

    def correlation(self, side_px: float) -> float:
        """Side of the square of landmarks that share an error, from that in reference pixels; at least 1."""
        stride = self.scene.region.stride
        return side_px if stride == 1 else max(1.0, side_px / stride)

    @property
    def without_smooth_errors(self) -> bool:
        """Whether smooth errors are taken out of the brightness. This also removes its information on whole views."""
        return self.gradients is not None and self.gradients.factor is not None

    @property
    def smooth_over(self) -> float:
        """Standard deviation of the Gaussian average that determined the smooth errors [landmarks]; infinite where none
        are taken out."""
        return np.inf if self.gradients is None else self.gradients.smooth_over

    @property
    def estimates_reflectance(self) -> bool:
        """Whether its parameters are free. They are not where smooth errors are taken out, since brightness then does
        not determine them."""
        return self.reflectance is not None and self.options.reflectance_sigma > 0 and not self.without_smooth_errors

    @property
    def fixes_frame(self) -> bool:
        """Whether more than the gauge is known of the frame B: two poses, control points, or all positions."""
        known = self.priors.pose_priors
        poses = 0 if known is None else int(np.isfinite(known.center_sigma).sum())
        return poses > 1 or self.priors.control is not None or self.options.position_sigma_gsd is not None


def setup_of(
    scene: Scene,
    members: Members,
    options: AdjustOptions,
    *,
    gradients: ImageGradients | None = None,
    priors: ScenePriors | None = None,
) -> Setup:
    """scene: at the start, with tie points (`tie_points.with_tie_points`), in the solver's order of landmarks."""
    priors = priors or ScenePriors()
    if options.keypoint_sigma_px is not None:
        tracks = scene.tracks
        dense = members.of_map | members.pose_only
        sigma = np.where(dense[tracks.landmark], options.keypoint_sigma_px, tracks.keypoint_sigma)
        scene = replace(scene, tracks=replace(tracks, keypoint_sigma=sigma))
    scale_sigma, bias_sigma = exposure_sigmas(scene, options)
    lit, relative = usable_brightness(scene, options), np.ones(len(scene.tracks))
    if gradients is not None and scene.reflectance is not None:
        relative = relative_sigma(scene, gradients, lit, members.count)
    setup = Setup(
        scene=scene,
        members=members,
        table=ObservationTable(scene.tracks, len(scene.views)),
        options=options,
        reflectance=scene.reflectance,
        gradients=gradients,
        priors=priors,
        scale_sigma=scale_sigma,
        bias_sigma=bias_sigma,
        lit=lit,
        relative_sigma=relative,
    )
    return replace(setup, reflectance=priors.reflectance or scene.reflectance) if setup.estimates_reflectance else setup


def factor_groups(
    setup: Setup,
    lit: np.ndarray,
    noise: Noise,
    smoothness: Smoothness | None,
    altimetry: Altimetry | None = None,
) -> list[Group]:
    """All groups. lit: (N,) brightness that counts; noise: as measured so far; smoothness, altimetry: of an estimate,
    between landmarks and of shots over them."""
    lights: list[Group] = []
    if setup.reflectance is not None and lit.any():
        suns = SunDirections.of(setup.scene.views, noise.view_prior_factor)
        lights = [_brightness(setup, setup.reflectance, lit, noise), suns]
    exposures = Exposure(
        scale_sigma=np.minimum(setup.scale_sigma / noise.view_prior_factor, noise.scale_scatter),
        bias_sigma=setup.bias_sigma / noise.view_prior_factor,
    )
    smooth: list[Group] = [smoothness] if smoothness is not None else []
    shots: list[Group] = [altimetry] if altimetry is not None else []
    return [*_keypoints(setup, noise), *lights, *smooth, *shots, exposures, *_priors(setup)]


def _keypoints(setup: Setup, noise: Noise) -> list[Keypoints]:
    tracks, members, options = setup.table.tracks, setup.members, setup.options
    directly = bool(members.direct.any())
    shared = setup.correlation(noise.keypoint_correlation_px)
    thinned = max(1.0, shared / POSE_ONLY_STEP)
    # The few landmarks that keep their matches amidst direct ones must not follow noise instead.
    of_map = thinned if directly else shared
    matches = options.keypoint_sigma_factor * noise.keypoint_factor * tracks.keypoint_sigma
    pose_only = options.keypoint_sigma_factor * noise.pose_only_keypoint_factor * tracks.keypoint_sigma
    sparse = noise.sparse_keypoint_factor * tracks.keypoint_sigma
    on_ray = tracks.view == setup.scene.reference
    loss = options.keypoint_loss

    def group(name: str, landmarks: np.ndarray, sigma: np.ndarray, limit: float) -> Keypoints:
        return Keypoints(name=name, table=setup.table, landmarks=landmarks, sigma=sigma, limit=limit)

    groups = [
        group("dense", members.of_map & ~members.direct, of_map * matches, loss / of_map),
        group("reference rays", members.direct, np.where(on_ray, RAY_SIGMA_PX, DIRECT_SIGMA_PX), np.inf),
        group("pose-only tie points", members.pose_only, thinned * pose_only, loss / thinned),
        group("sparse tie points", members.sparse, sparse, loss),
        group("control point keypoints", members.control, tracks.keypoint_sigma, loss),
    ]
    return [each for each in groups if each.landmarks.any()]


def _brightness(setup: Setup, reflectance: Reflectance, lit: np.ndarray, noise: Noise) -> Brightness:
    """n brightnesses that share an error count as one: sigma times the square root of n, and the loss with it."""
    shared = setup.correlation(noise.brightness_correlation_px)
    return Brightness(
        table=setup.table,
        reflectance=reflectance,
        used=lit,
        brightness=setup.table.tracks.brightness,
        sigma=noise.brightness_sigma * shared * setup.relative_sigma,
        limit=setup.options.brightness_loss / shared,
        gradients=setup.gradients,
    )


def smoothness_group(setup: Setup, landmarks: Landmarks, noise: Noise) -> Smoothness | None:
    """Between neighbours of `landmarks`; it loosens with the correlation of brightness.

    Raises InputError where the options ask for as many neighbours as there are landmarks, or more.
    """
    options, count = setup.options, setup.members.count
    if setup.reflectance is None or options.smooth_sigma_rad <= 0 or options.smooth_neighbours == 0:
        return None
    if options.smooth_neighbours >= count:
        raise InputError(
            f"--adjust.smooth-neighbours (smooth_neighbours=): {options.smooth_neighbours} neighbours of each, "
            f"and the map has {count} landmarks; give fewer, or a larger region"
        )
    looser = setup.correlation(noise.brightness_correlation_px) / BALANCED_CORRELATION_PX
    nearest = NEAREST_NEIGHBOUR * setup.scene.spacing
    pairs = neighbour_pairs(landmarks.position, count, options.smooth_neighbours, nearest)
    if setup.without_smooth_errors:
        bend = bend_between(pairs, landmarks.position, landmarks.normal)
        return Smoothness(pairs, BENT_SMOOTHNESS * options.smooth_sigma_rad * max(looser, 1.0), bend)
    least = DIRECT_SMOOTHNESS if setup.members.direct.any() else 1.0
    return Smoothness(pairs, options.smooth_sigma_rad * max(looser, least))


def altimetry_fit(setup: Setup, estimate: Estimate) -> AltimetryFit | None:
    """The altimeter's shots over an estimate; None without an altimeter."""
    if setup.priors.altimetry is None:
        return None
    return altimetry_at(setup.priors.altimetry, estimate, setup.members.count, setup.scene.spacing, setup.first_track)


def altimetry_factors(setup: Setup, estimate: Estimate) -> Altimetry | None:
    """The factors of the shots that lie over an estimate; None where there are none."""
    fit = altimetry_fit(setup, estimate)
    return None if fit is None else altimetry_group(fit, setup.first_track)


def neighbour_pairs(position: np.ndarray, mapped: int, count: int, nearest: float) -> Neighbours:
    """`count` neighbours of each of the map's landmarks, the first `mapped`, but for those nearer than `nearest`; tie
    points have none."""
    index, near = neighbours(position[:mapped], count, nearest)
    alone = ((0, len(position) - mapped), (0, 0))
    return build_neighbours(np.pad(index, alone), np.pad(near, alone))


def frame_factors(setup: Setup, estimate: Estimate) -> list[FactorGroup]:
    """The factors that determine the frame of the map: priors, control points, and the altimeter's shots over an
    estimate."""
    shots = altimetry_factors(setup, estimate)
    return [*_priors(setup), *([] if shots is None else [shots])]


def _priors(setup: Setup) -> list[FactorGroup]:
    scene, options, members, known = setup.scene, setup.options, setup.members, setup.priors
    landmarks, count = scene.landmarks, len(scene.landmarks)
    groups: list[FactorGroup] = []
    if known.pose_priors is not None:
        groups.append(known.pose_priors)
    elif known.control is None:
        groups.append(_gauge(scene, options, members))
    if known.known_poses is not None:
        groups.append(known.known_poses)
    if known.control is not None:
        which = np.flatnonzero(members.control)
        groups.append(ControlPoints(landmark=which, position=known.control.position, sigma=known.control.sigma))
    free = np.full(count, np.inf)
    position, normal, albedo = options.position_sigma_gsd, options.normal_sigma_rad, options.albedo_sigma
    if position is not None or normal is not None or albedo is not None:
        groups.append(
            LandmarkPriors(
                landmarks=landmarks,
                position_sigma=np.where(members.of_map, position * scene.gsd, np.inf) if position else free,
                normal_sigma=np.where(members.of_map, normal, np.inf) if normal else free,
                albedo_sigma=np.where(members.of_map, albedo * landmarks.albedo, np.inf) if albedo else free,
            )
        )
    if setup.reflectance is not None and options.reflectance_sigma > 0:
        groups.append(ReflectancePrior(sigma=options.reflectance_sigma))
    return groups


def _gauge(scene: Scene, options: AdjustOptions, members: Members) -> Gauge:
    central, view = _central_landmark(scene, members.count), scene.reference
    return Gauge(
        view=view,
        body_from_cam=scene.views.body_from_cam[view],
        rotation_sigma=options.pose_rotation_sigma_rad,
        center_sigma=options.pose_translation_sigma_gsd * scene.gsd,
        landmark=central,
        position=scene.landmarks.position[central],
        position_sigma=options.landmark_sigma_gsd * scene.gsd,
    )


def exposure_sigmas(scene: Scene, options: AdjustOptions) -> tuple[np.ndarray, np.ndarray]:
    """Stated standard deviations (K,) of scales about 1 and biases about 0."""
    count, model = len(scene.views), scene.reflectance
    level = float(np.median(scene.tracks.brightness[scene.tracks.lit])) if np.any(scene.tracks.lit) else 1.0
    calibrated = model is not None and not exposure_is_free(scene.brightness, model)
    scale = np.full(count, options.scale_sigma or (CALIBRATED_SCALE_SIGMA if calibrated else np.inf))
    if not calibrated:
        scale[scene.reference] = min(scale[scene.reference], FREE_SCALE_SIGMA)
    return scale, np.full(count, options.bias_sigma or BIAS_SIGMA[scene.brightness] * level)


def _central_landmark(scene: Scene, mapped: int) -> int:
    """The landmark of most observations among those nearest to the middle of the map."""
    pixel = scene.landmarks.pixel[:mapped]
    offset = np.linalg.norm(pixel - np.median(pixel, axis=0), axis=1)
    nearest = np.argsort(offset, kind="stable")[: max(1, len(offset) // 100)]
    return int(nearest[np.argmax(np.diff(scene.tracks.start)[nearest])])
