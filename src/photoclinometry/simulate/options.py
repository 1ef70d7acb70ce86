"""Options of a simulation, and the camera and preset that follow from them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from photoclinometry.io.site import MIN_VIEWS
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import METRES
from photoclinometry.model.ranges import Pinhole, Range, Ranged
from photoclinometry.model.reflectance import ModelName
from photoclinometry.simulate.bodies.presets import BODIES, BodyPreset
from photoclinometry.simulate.camera_model import Detector
from photoclinometry.simulate.photometry import named_photometry
from photoclinometry.simulate.presets import PRESETS, Preset, named_preset
from photoclinometry.simulate.trajectory import named_lighting

SMALLEST_IMAGE_PX = 32
"""Smaller images hold no keypoints."""
_MAX_SUPERSAMPLING = 8
"""64 rays per pixel; more only cost time."""
_LARGEST_GSD = 1e6
"""Larger ground sample distances are mistakes of the unit [m]."""
_BODY_OF_SHAPES = "potato"
"""The preset of shapes from files: most asteroids are elongated and cratered."""
_LARGEST_EMISSION_DEG = 60
"""At larger emission angles images see past the edge of the ground."""


@dataclass(frozen=True, kw_only=True)
class SimulationOptions(Ranged):
    """The site to simulate. An option that is None is taken from the preset."""

    preset: str = "demo"
    """demo (5-km crater, small), cornelia (15-km crater on Vesta), ahuna (dome and crater on Ceres) or
    ikapati (part of a 50-km ridged crater on Ceres), or a whole body: topshape (spinning top of rubble), bilobed
    (contact binary) or potato (elongated, with a saddle)."""
    lighting: str = "moderate"
    """Range of the Sun's azimuth and incidence [degrees]: moderate (25; 30 to 60), strong (90; 25 to 70) or harsh (360;
    25 to 80). Whole bodies spin below a Sun that stands still, at phase angles of 12 to 75 degrees; lighting is of
    places alone."""
    seed: Annotated[int, Range(least=0, most=2**31 - 1)] = 0
    """Seed of all random numbers."""
    views: Annotated[int | None, Range(least=MIN_VIEWS, most=1_000_000)] = None
    """Number of images, 3 or more; by default the preset's."""
    image_size: Annotated[int | None, Range(least=SMALLEST_IMAGE_PX, most=65535)] = None
    """Width and height of the images [px]; by default the preset's."""
    image_height: Annotated[int | None, Range(least=SMALLEST_IMAGE_PX, most=65535)] = None
    """Height of the images [px]; by default the width."""
    intrinsics: Pinhole | None = None
    """fx fy cx cy [px]; by default those of Dawn's camera, centred. The distance to the ground follows from the focal
    length and the ground sample distance. The boresight, at (cx, cy), points at the site."""
    surface: Path | None = None
    """File with the ground: a mesh (PLY, OBJ) or a projected terrain model (GeoTIFF). The preset then gives the camera,
    the number of views, and the body with its reflectance and mean albedo."""
    shape: Path | None = None
    """File with the shape of a whole body: a closed mesh (OBJ, PLY) with its origin inside and z along its axis. It is
    refined, and gets the relief of the preset, topshape, bilobed or potato (by default the latter), with its camera,
    number of views, reflectance and mean albedo."""
    surface_unit: Literal["m", "km"] = "m"
    """Unit of a mesh's coordinates, and of a terrain model's heights."""
    surface_center: Annotated[tuple[float, ...] | None, Range()] = None
    """Point of the surface that the cameras look at: x y z in a mesh's coordinates, easting northing [m] on a map; by
    default the middle. Closed shapes need it."""
    gsd: Annotated[float | None, Range(above=0, below=_LARGEST_GSD)] = None
    """Ground sample distance of all images of ground from a file [m]; by default the preset's finest. Of a whole body
    that of close-ups; by default images of the whole body are filled by it to three quarters."""
    region_size: Annotated[int | None, Range(least=2, most=65535)] = None
    """Width and height of the region to map [px]; by default the preset's, or half the image."""
    supersampling: Annotated[int, Range(least=1, most=_MAX_SUPERSAMPLING)] = 2
    """Rays per pixel, along each side."""
    reflectance: ModelName = "lunar-lambert"
    """Reflectance model of the ground, with the body's published parameters."""
    brightness: str = "iof"
    """iof (calibrated, FITS) or dn (16-bit PNG; gain and offset differ between images)."""
    max_emission_deg: Annotated[float, Range(least=0, most=_LARGEST_EMISSION_DEG)] = 25.0
    """Greatest emission angle of the boresights on level ground [degrees]."""
    pointing_jitter_px: Annotated[float, Range(least=0)] = 15.0
    """Standard deviation by which boresights miss the site's centre [px]."""
    sun_sigma_deg: Annotated[float, Range(above=0, most=180)] = 0.0573
    """Standard deviation of the error that each Sun direction in site.toml has of its own [degrees]."""
    sun_common_sigma_deg: Annotated[float, Range(least=0, most=180)] = 0.0
    """Standard deviation, about each axis of the camera, of one rotation by which all Sun directions in site.toml are
    off [degrees]."""
    pose_sigma: Annotated[tuple[float, float] | None, Range(above=0)] = None
    """Write pose priors with these standard deviations: attitudes about each axis [degrees], camera centres along each
    axis [m]. By default there are no priors."""
    pose_common_sigma: Annotated[tuple[float, float] | None, Range(least=0)] = None
    """In addition, of the common rotation of the cameras [degrees] and the common shift [m] of all pose priors."""
    altimetry: Annotated[tuple[float, float] | None, Range(above=0)] = None
    """Write altimetry.csv, eight tracks of a laser altimeter, with these standard deviations: of each shot's height,
    and of the shift of each track along each axis [m]. By default there is none. Of places alone."""
    detector: Detector = field(default_factory=Detector)
    """The camera's optics and noise."""

    def __post_init__(self):
        super().__post_init__()
        preset = body_preset(self) or named_preset(self.preset)
        named_lighting(self.lighting)
        named_photometry(self.reflectance, preset.body)
        if self.surface_unit not in METRES:
            raise InputError(f'surface_unit must be "m" or "km", got {self.surface_unit!r}')
        if self.brightness not in ("iof", "dn"):
            raise InputError(f'brightness must be "iof" or "dn", got {self.brightness!r}')
        if isinstance(preset, BodyPreset):
            _check_whole_body(self)
        elif self.surface is None and (self.gsd, self.surface_center) != (None, None):
            raise InputError("--gsd and --surface-center go with --surface; presets have theirs")
        if self.pose_common_sigma is not None and self.pose_sigma is None:
            raise InputError("--pose-common-sigma goes with --pose-sigma, of the pose priors that have it in common")
        camera = simulated_camera(self, preset)
        if not all(0 <= c <= size for c, size in zip(camera.principal_px, (camera.width, camera.height), strict=True)):
            raise InputError(
                f"the boresight (cx, cy) = {camera.principal_px} lies outside of the {camera.width} x {camera.height} "
                "image; the order of intrinsics is fx fy cx cy"
            )


def _check_whole_body(options: SimulationOptions) -> None:
    """Raises InputError for options of places, which would be ignored."""
    if options.surface is not None:
        raise InputError("--surface is ground of a place; give --shape for a whole body, or another preset")
    if options.altimetry is not None:
        raise InputError("--altimetry is of places; leave it out for a whole body")
    if (options.surface_center, options.region_size) != (None, None):
        raise InputError("--surface-center and --region-size choose a place; images of a whole body have none")
    if options.lighting != SimulationOptions.lighting or options.max_emission_deg != SimulationOptions.max_emission_deg:
        raise InputError("--lighting and --max-emission-deg are of places; stations see a whole body as it spins")


def body_preset(options: SimulationOptions) -> BodyPreset | None:
    """The preset of a whole body; None where a place is simulated. Raises InputError."""
    if options.preset in BODIES:
        return BODIES[options.preset]
    if options.preset not in PRESETS:
        raise InputError(f"no preset {options.preset!r}; known: {', '.join([*PRESETS, *BODIES])}")
    if options.shape is None:
        return None
    if options.preset != SimulationOptions.preset:
        raise InputError(f"--shape goes with --preset {' or '.join(BODIES)}, got {options.preset}")
    return BODIES[_BODY_OF_SHAPES]


def simulated_camera(options: SimulationOptions, preset: Preset | BodyPreset) -> Camera:
    """The camera of all views."""
    width = options.image_size or preset.image_size
    height = options.image_height or width
    return Camera(
        "PINHOLE",
        width,
        height,
        options.intrinsics or (preset.focal_px, preset.focal_px, 0.5 * width, 0.5 * height),
    )


def chosen_preset(options: SimulationOptions) -> Preset:
    """The preset, with the focal length and the ground sample distance of the options, if they are given."""
    preset = named_preset(options.preset)
    if options.intrinsics is not None:
        preset = replace(preset, focal_px=0.5 * (options.intrinsics[0] + options.intrinsics[1]))
    if options.surface is None:
        return preset
    gsd = options.gsd or min(preset.gsd)
    return replace(preset, gsd=(gsd,), sample=0.5 * gsd)
