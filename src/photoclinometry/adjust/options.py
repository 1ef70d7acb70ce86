"""Options of the joint estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from photoclinometry.adjust.solve.solver import SolverOptions
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.reflectance import GRAZING_DEG
from photoclinometry.model.robust import HUBER_LIMIT


@dataclass(frozen=True, kw_only=True)
class AdjustOptions(Ranged):
    """Noise, gates, losses and priors of the joint estimate."""

    keypoint_sigma_px: Annotated[float | None, Range(above=0)] = None
    """Keypoint noise of every observation [px]; left out, each keypoint's own, times a factor from the residuals."""
    brightness_sigma: Annotated[float | None, Range(above=0)] = None
    """Brightness noise, in the images' brightness; left out, estimated from the residuals."""
    keypoint_correlation_px: Annotated[float | None, Range(least=1)] = None
    """Side of the square of landmarks that share their keypoints' errors [px]: matches are found over windows. As many
    observations count as one: each one's sigma is multiplied by this. 1 for independent errors; left out, estimated
    from the residuals."""
    brightness_correlation_px: Annotated[float | None, Range(least=1)] = None
    """Likewise for brightness: images are blurred and sampled between pixels, and errors of a reflectance model are the
    same on neighbouring ground. Given, the priors on Suns, scales and biases are as stated; left out, they count for
    more where brightness pulls views too far from them."""
    keypoint_sigma_factor: Annotated[float, Range(above=0)] = 1.0
    """Factor on the measured standard deviations of all keypoints, for maps that are to be matched again (see
    `pipeline.options.RelightOptions`)."""
    smooth_sigma_rad: Annotated[float, Range(least=0)] = 0.2
    """Smoothness: spread of the angle between a neighbour's direction and the tangent plane [rad]. Zero: none.
    It grows with the correlation of brightness beyond 3 px, so that shading keeps its weight against it."""
    smooth_neighbours: Annotated[int, Range(least=0, most=1000)] = 4
    """Neighbours per landmark in the smoothness factors."""
    max_incidence_deg: Annotated[float, Range(above=0, most=90)] = GRAZING_DEG
    """Brightness is not used where the Sun is lower than this."""
    max_emission_deg: Annotated[float, Range(above=0, most=90)] = GRAZING_DEG
    """Brightness is not used where the camera is lower than this."""
    keypoint_loss: Annotated[float, Range(above=0, infinite=True)] = HUBER_LIMIT
    """Huber limit of keypoints, in standard deviations of one; inf for least squares."""
    brightness_loss: Annotated[float, Range(above=0, infinite=True)] = HUBER_LIMIT
    """Huber limit of brightness, in standard deviations of one; inf for least squares."""
    pose_rotation_sigma_rad: Annotated[float, Range(above=0)] = 1e-4
    """Gauge: prior on the reference view's rotation [rad]."""
    pose_translation_sigma_gsd: Annotated[float, Range(above=0)] = 1e-2
    """Gauge: prior on the reference view's position [GSD]."""
    landmark_sigma_gsd: Annotated[float, Range(above=0)] = 1e-2
    """Gauge: prior on the position of one central landmark, which fixes the scale [GSD]."""
    scale_sigma: Annotated[float | None, Range(above=0)] = None
    """Prior on the images' brightness scales about 1. Left out: their measured scatter, 0.01 at most, for I/F with a
    phase function; else none but on the reference view, whose scale is 1."""
    bias_sigma: Annotated[float | None, Range(above=0)] = None
    """Prior on the images' brightness biases about 0. Left out: 1e-3 of the median brightness for I/F, else a tenth."""
    position_sigma_gsd: Annotated[float | None, Range(above=0)] = None
    """Prior on every landmark's position about its start [GSD]; left out, free."""
    normal_sigma_rad: Annotated[float | None, Range(above=0)] = None
    """Prior on every landmark's normal about its start [rad]; left out, free."""
    albedo_sigma: Annotated[float | None, Range(above=0)] = None
    """Relative prior on every landmark's albedo about its start; left out, free."""
    reflectance_sigma: Annotated[float, Range(least=0)] = 0.05
    """Prior on the reflectance's parameters about those given, which are estimated too: published ones are means over a
    body, and no disk function is quite the ground's. Relative for the phase weighting and phase coefficients; a
    parameter with a standard deviation of its own has that at 0.05, and in proportion. 0 holds all."""
    uncertainty: bool = True
    """Find the covariance of every view and landmark after the last reweighting iteration."""
    max_reweightings: Annotated[int, Range(least=1, most=100)] = 4
    """Reweighting iterations at most: of choosing brightness, minimizing and measuring the noise."""
    solver: SolverOptions = field(default_factory=SolverOptions)
