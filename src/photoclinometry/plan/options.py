"""The assumptions of a plan about the ground, the camera and the run, and the candidates that it compares."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.reflectance import ModelChoice
from photoclinometry.simulate.camera_model import Detector

Elevation = Annotated[float, Range(above=0, most=90)]
Emission = Annotated[float, Range(least=0, below=90)]


@dataclass(frozen=True, kw_only=True)
class CandidateOptions(Ranged):
    """The candidates for one more image. Azimuths count clockwise from north."""

    table: Path | None = None
    """A table of poses and Suns (CSV) whose lines are the candidates, in place of directions."""
    sun_azimuths: Annotated[int, Range(least=0, most=72)] = 8
    """Suns tried around the horizon, all with the camera of the reference view. 0: none."""
    sun_elevations_deg: tuple[Elevation, ...] = (20.0, 45.0)
    """Elevations of these Suns [degrees]."""
    view_azimuths: Annotated[int, Range(least=0, most=72)] = 6
    """Cameras tried around the place, all under the Sun of the reference view. 0: none."""
    emissions_deg: tuple[Emission, ...] = (20.0, 45.0)
    """Emission angles of these cameras [degrees]."""


@dataclass(frozen=True, kw_only=True)
class PlanOptions(Ranged):
    """Everything that shapes a plan. The assumed slope matters most: sigmas follow it."""

    at: Annotated[tuple[float, float] | None, Range()] = None
    """Longitude, eastward, and planetocentric latitude of the place [degrees]. Default: where the middle of the site's
    region, or the boresight of the first view, meets the body's ellipsoid."""
    radii_m: Annotated[tuple[float, ...] | None, Range(above=0)] = None
    """The body's radius, its equatorial and polar radius, or its three semi-axes [m]. Default: the body's."""
    point: Annotated[tuple[float, float, float] | None, Range()] = None
    """In place of --at: a point in the frame of the poses [m], on a plane. No ellipsoid is needed."""
    normal: Annotated[tuple[float, float, float] | None, Range()] = None
    """Upward normal of that plane. Default: the mean direction towards the cameras."""
    slope_deg: Annotated[float, Range(above=0, most=35)] = 15.0
    """Assumed RMS slope of the ground from one landmark to the next [degrees]."""
    albedo: Annotated[float, Range(above=0, most=1)] = 0.1
    """Assumed mean normal albedo. Exposures follow it, so that it hardly matters."""
    ground: str = "auto"
    """Reflectance of the ground. auto: hapke where it is published for the body, so that the sigmas contain what the
    errors of the run's model; else the run's own model. Or a model's name."""
    reflectance: ModelChoice = "auto"
    """Reflectance model of the run, as of `phomo run`."""
    patch_px: Annotated[int, Range(least=24, most=128)] = 48
    """Side of the representative map, in the middle of the region [reference px]: its square of landmarks."""
    region_px: Annotated[int, Range(least=24, most=65535)] | None = None
    """Side of the region [reference px]; by default the site's, or as much as the reference view has, 400 at most."""
    min_views: Annotated[int | None, Range(least=3, most=1_000_000)] = None
    """Views in which a landmark must be observed, as `--densify.min-views` of `phomo run`; left out, half of them, 3 at
    least and 6 at most."""
    tie_points: Annotated[int, Range(least=0, most=20_000)] = 1000
    """Sparse tie points over the whole reference image. Of simulated images of 256 x
    256 pixels, structure from motion finds 850 to 1500."""
    tie_point_sigma_px: Annotated[float, Range(above=0)] = 0.2
    """Their noise [px]: mean reprojection errors of SIFT keypoints are 0.15 to 0.25 px."""
    pose_priors: bool = True
    """State positions in the frame of the pose priors, too, where three views or more have such."""
    seed: Annotated[int, Range(least=0, most=2**31 - 1)] = 0
    """Seed of the assumed ground and of the noise."""
    kind: Literal["normal", "albedo", "height"] = "normal"
    """The quantity by which candidates are ranked: the mean sigma of normals, of albedos or of heights."""
    candidates: CandidateOptions = field(default_factory=CandidateOptions)
    detector: Detector = field(default_factory=Detector)
