"""A whole simulated site on disk: images, `site.toml`, and the truth behind them.

Same options, same bytes. Every part draws from its own random stream, so that the same seed under another
lighting or photometry shows the same ground from the same places.
"""

from __future__ import annotations

import logging
import math
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.io.images import write_fits, write_png
from photoclinometry.io.site import (
    RegionRequest,
    Site,
    SiteView,
    write_site,
)
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp
from photoclinometry.model.pose_prior import (
    PosePrior,
)
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.scene import Camera, Views
from photoclinometry.simulate.camera_model import Detector, expose, hot_pixel_charge, pixel_average
from photoclinometry.simulate.given import METRES, given_relief
from photoclinometry.simulate.observe import radiance
from photoclinometry.simulate.photometry import named_photometry
from photoclinometry.simulate.presets import BODY_RADIUS, Preset, build_surface, named_preset, surface_of_relief
from photoclinometry.simulate.raycast import Raycaster
from photoclinometry.simulate.surface import Surface
from photoclinometry.simulate.terrain import Grid
from photoclinometry.simulate.trajectory import (
    draw_poses,
    draw_suns,
    ground_half_extent,
    measure_suns,
    named_lighting,
)
from photoclinometry.simulate.truth import Truth
from photoclinometry.simulate.truth_file import write_truth

log = logging.getLogger(__name__)

OPTIONS_FILE = "simulation.toml"
"""Marks a folder as written by `simulate_site`."""


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """What to simulate. The preset decides wherever a value is None."""

    preset: str = "demo"
    """demo (5-km crater, small), cornelia (15-km crater on Vesta), ahuna (dome and crater on Ceres) or
    ikapati (part of a 50-km ridged crater on Ceres)."""
    lighting: str = "moderate"
    """moderate (Sun's azimuth within 25 degrees, incidence 30 to 60), strong (90 degrees, 25 to 70) or harsh (all
    round, 25 to 80)."""
    seed: int = 0
    """Everything random follows from it."""
    views: int | None = None
    """Number of images, 3 or more."""
    image_size: int | None = None
    """Width and height of the images [px]."""
    image_height: int | None = None
    """Height of the images [px], where they are not square."""
    intrinsics: tuple[float, float, float, float] | None = None
    """fx fy cx cy [px]; by default those of Dawn's camera, about the middle. The distance follows from the ground
    sample distance, and the boresight, at (cx, cy), is what points at the site."""
    surface: Path | None = None
    """Ground of your own: a mesh (PLY, OBJ) or a projected terrain model (GeoTIFF). The preset then gives the camera,
    the number of views and the body, for its reflectance and mean albedo."""
    surface_unit: Literal["m", "km"] = "m"
    """Unit of a mesh's coordinates, and of a terrain model's heights."""
    surface_center: tuple[float, ...] | None = None
    """Point of the surface that the cameras look at: x y z in a mesh's coordinates, easting northing [m] on a map; by
    default the middle. Closed shapes need it."""
    gsd: float | None = None
    """Ground sample distance [m] of all images of your own ground; by default the preset's finest."""
    region_size: int | None = None
    """Width and height of the region to map [px]."""
    supersampling: int = 2
    """Rays per pixel, along each side."""
    reflectance: str = "lunar-lambert"
    """lunar-lambert, akimov, akimov+, mcewen, minnaert or hapke; with the body's published parameters."""
    brightness: str = "iof"
    """iof (calibrated, FITS) or dn (16-bit PNG; gain and offset differ by image)."""
    max_emission_deg: float = 25.0
    """Greatest emission angle of the boresights on level ground."""
    pointing_jitter_px: float = 15.0
    """Boresights miss the site's centre by this standard deviation."""
    sun_sigma_deg: float = 0.0573
    """Standard deviation of the Sun directions in site.toml."""
    pose_sigma: tuple[float, float] | None = None
    """Write pose priors: attitudes off by (degrees) about each axis, camera centres by (metres) along each; left out by
    default."""
    detector: Detector = field(default_factory=Detector)
    """The camera's optics and noise."""

    def __post_init__(self):
        preset = named_preset(self.preset)
        named_lighting(self.lighting)
        named_photometry(self.reflectance, preset.body)
        if self.surface_unit not in METRES:
            raise InputError(f'surface_unit must be "m" or "km", got {self.surface_unit!r}')
        if self.brightness not in ("iof", "dn"):
            raise InputError(f'brightness must be "iof" or "dn", got {self.brightness!r}')
        if self.seed < 0:
            raise InputError(f"the seed must not be negative, got {self.seed}")
        if self.surface is None and (self.gsd, self.surface_center) != (None, None):
            raise InputError("--gsd and --surface-center go with --surface; the presets have their own")
        if self.gsd is not None and not 0 < self.gsd < 1e6:
            raise InputError(f"gsd must be positive [m], got {self.gsd}")
        if self.views is not None and self.views < 3:
            raise InputError(f"a site needs at least 3 views, got {self.views}")
        if not 1 <= self.supersampling <= 8:
            raise InputError(f"supersampling must be 1 to 8, got {self.supersampling}")
        camera = _camera(self, preset)
        if min(camera.width, camera.height) < 32:
            raise InputError(f"images must be at least 32 px wide and high, got {camera.width} x {camera.height}")
        if not all(0 <= c <= size for c, size in zip(camera.principal_px, (camera.width, camera.height), strict=True)):
            raise InputError(
                f"the boresight (cx, cy) = {camera.principal_px} lies outside of the {camera.width} x {camera.height} "
                "image that points with it; the order of intrinsics is fx fy cx cy"
            )
        if not 0 <= self.max_emission_deg <= 60:
            raise InputError(f"max_emission_deg must be 0 to 60, got {self.max_emission_deg}")


def simulate_site(
    options: SimulationOptions,
    out_folder: Path | str,
    progress: Progress | None = None,
    overwrite: bool = False,
) -> Path:
    """Writes images/, site.toml, truth.h5 and simulation.toml; returns the path of site.toml.

    The folder appears whole, at the end, or not at all. Raises InputError if there is something in it
    already, unless that was simulated, too, and `overwrite` is set.
    """
    out_folder = Path(out_folder)
    check_output_folder(out_folder, overwrite)
    report = progress or no_progress
    preset = _preset(options)
    cameras, views = draw_views(options, preset)
    report("terrain", 0, len(cameras))
    surface, frame = _surface(options, preset, cameras[0])
    raycaster = Raycaster(surface)
    photometry = named_photometry(options.reflectance, preset.body)
    hot = hot_pixel_charge((cameras[0].height, cameras[0].width), options.detector, _stream(options, _HOT_PIXELS))
    with atomic_path(out_folder) as folder:
        (folder / "images").mkdir(parents=True)
        scale, bias = np.ones(len(views)), np.zeros(len(views))
        for k, name in enumerate(views.name):
            report("images", k, len(views))
            image = _radiance_image(raycaster, views, k, photometry, options)
            exposure = expose(image, options.detector, _stream(options, _EXPOSURE, k), hot)
            if options.brightness == "iof":
                write_fits(folder / name, exposure.iof)
            else:
                write_png(folder / name, exposure.uint16)
                scale[k], bias[k] = exposure.gain, exposure.offset
        report("truth", len(views), len(views))
        views = replace(views, scale=scale, bias=bias)
        truth = Truth(
            name=_name(options),
            body=preset.body,
            surface=surface,
            views=views,
            psf_sigma_px=options.detector.psf_sigma_px,
            brightness=options.brightness,
            photometry=photometry,
        )
        write_truth(folder / "truth.h5", truth)
        write_site(folder / "site.toml", _site(folder, options, preset, views))
        _write_options(folder / OPTIONS_FILE, options, frame)
    log.info("simulated %d views of %s in %s", len(views), _name(options), out_folder)
    return out_folder / "site.toml"


def check_output_folder(folder: Path, overwrite: bool) -> None:
    """Raises InputError if writing there would destroy something."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"{folder}: is a file; choose a folder for the simulated site")
    if not any(folder.iterdir()):
        return
    if not (folder / OPTIONS_FILE).is_file():
        raise InputError(f"{folder}: is not empty and was not simulated; choose another folder")
    if not overwrite:
        raise InputError(f"{folder}: a simulated site is there already; pass --overwrite, or choose another folder")


_POSES, _SUNS, _SUN_NOISE, _POSE_NOISE, _HOT_PIXELS, _EXPOSURE, _SMEAR = range(2, 9)


def _stream(options: SimulationOptions, *purpose: int) -> np.random.Generator:
    return np.random.default_rng([options.seed, *purpose])


def _name(options: SimulationOptions) -> str:
    return options.surface.stem if options.surface else options.preset


def _camera(options: SimulationOptions, preset: Preset) -> Camera:
    width = options.image_size or preset.image_size
    height = options.image_height or width
    return Camera(
        "PINHOLE",
        width,
        height,
        options.intrinsics or (preset.focal_px, preset.focal_px, 0.5 * width, 0.5 * height),
    )


def _preset(options: SimulationOptions) -> Preset:
    """The preset, with a given camera's focal length and the ground sample distance of a given surface."""
    preset = named_preset(options.preset)
    if options.intrinsics is not None:
        preset = replace(preset, focal_px=0.5 * (options.intrinsics[0] + options.intrinsics[1]))
    if options.surface is None:
        return preset
    gsd = options.gsd or min(preset.gsd)
    return replace(preset, gsd=(gsd,), sample=0.5 * gsd)


def _surface(options: SimulationOptions, preset: Preset, camera: Camera) -> tuple[Surface, Similarity | None]:
    """The ground, and where it comes from a file, B from the file's coordinates."""
    if options.surface is None:
        return build_surface(
            preset, _half_extent(options, preset, camera, BODY_RADIUS[preset.body]), options.seed
        ), None
    level = 1e3 * max(preset.gsd) * preset.focal_px  # as good as a plane
    grid = Grid(preset.sample, math.ceil(_half_extent(options, preset, camera, level) / preset.sample))
    given = given_relief(options.surface, grid, min(preset.gsd), options.surface_unit, options.surface_center)
    return surface_of_relief(given.height, given.albedo, grid, preset.mean_albedo, options.seed), given.body_from_file


def draw_views(options: SimulationOptions, preset: Preset) -> tuple[tuple[Camera, ...], Views]:
    """The cameras and the true views of a site, with Suns as measured; scale 1 and bias 0."""
    count, camera = options.views or preset.views, _camera(options, preset)
    gsd = np.array([preset.gsd[k % len(preset.gsd)] for k in range(count)])
    poses = draw_poses(
        _stream(options, _POSES),
        gsd * preset.focal_px,
        camera,
        _max_emission(options, preset, gsd),
        options.pointing_jitter_px,
    )
    sun = draw_suns(_stream(options, _SUNS), count, named_lighting(options.lighting))
    sigma = np.radians(options.sun_sigma_deg)
    suffix = "fits" if options.brightness == "iof" else "png"
    cameras = (camera,) * count
    return cameras, Views(
        name=tuple(f"images/{k:03d}.{suffix}" for k in range(count)),
        cameras=cameras,
        body_from_cam=poses,
        sun=sun,
        scale=np.ones(count),
        bias=np.zeros(count),
        sun_measured=measure_suns(_stream(options, _SUN_NOISE), sun, poses, sigma),
        sun_sigma=np.full(count, sigma),
    )


def _max_emission(options: SimulationOptions, preset: Preset, gsd: np.ndarray) -> np.ndarray:
    """Greatest emission angle [rad] of views with the given ground sample distances."""
    return np.radians(options.max_emission_deg) * min(preset.gsd) / gsd


def _half_extent(options: SimulationOptions, preset: Preset, camera: Camera, radius: float) -> float:
    """Half the width of the square of ground [m] that the views of any seed may see of a sphere."""
    return max(
        ground_half_extent(
            camera,
            gsd * preset.focal_px,
            float(_max_emission(options, preset, np.array(gsd))),
            options.pointing_jitter_px,
            radius,
        )
        for gsd in set(preset.gsd)
    )


def _radiance_image(raycaster: Raycaster, views: Views, k: int, photometry, options) -> np.ndarray:
    """(h, w) I/F of view k behind optics and pixels, without noise."""
    margin = options.detector.margin_px
    fine, complete = radiance(
        raycaster,
        views.cameras[k],
        views.body_from_cam[k],
        views.sun[k],
        photometry,
        options.supersampling,
        margin,
    )
    if not complete:
        log.warning("%s sees past the edge of the simulated ground; it is dark there", views.name[k])
    angle = _stream(options, _SMEAR, k).uniform(0.0, np.pi)
    smear = (options.detector.smear_px * np.cos(angle), options.detector.smear_px * np.sin(angle))
    return pixel_average(fine, options.supersampling, margin, options.detector.psf_sigma_px, smear)


def _site(folder: Path, options: SimulationOptions, preset: Preset, views: Views) -> Site:
    size = options.region_size or min(preset.region_px, min(views.cameras[0].width, views.cameras[0].height) // 2)
    priors = pose_priors(options, views.body_from_cam)
    return Site(
        name=_name(options),
        body=preset.body,
        brightness=options.brightness,
        views=tuple(
            SiteView(
                name=views.name[k],
                image=folder / views.name[k],
                camera=views.cameras[k],
                sun=views.sun_measured[k],
                sun_sigma_rad=float(views.sun_sigma[k]),
                pose_prior=priors[k],
            )
            for k in range(len(views))
        ),
        region=RegionRequest(size_px=(size, size)),
        path=folder / "site.toml",
    )


def pose_priors(options: SimulationOptions, body_from_cam: Rigid) -> list[PosePrior | None]:
    """Poses as a navigation team would give them, off by the standard deviations they state."""
    count = len(body_from_cam)
    if options.pose_sigma is None:
        return [None] * count
    rotation, translation = float(np.radians(options.pose_sigma[0])), float(options.pose_sigma[1])
    rng = _stream(options, _POSE_NOISE)
    turn = so3_exp(rotation * rng.standard_normal((count, 3)))
    shift = translation * rng.standard_normal((count, 3))
    # Of the camera's centre, wherever it points: an attitude that is off moves nothing.
    noisy = Rigid(body_from_cam.rotation @ turn, body_from_cam.translation + shift).inverse()
    return [PosePrior(noisy[k], rotation, translation) for k in range(count)]


def _write_options(path: Path, options: SimulationOptions, body_from_file: Similarity | None) -> None:
    import tomli_w

    values: dict[str, Any] = {key: value for key, value in asdict(options).items() if value is not None}
    if options.surface is not None:
        values["surface"] = str(options.surface)
    if body_from_file is not None:
        values["body_from_surface_file"] = {
            "scale": body_from_file.scale,
            "rotation": body_from_file.rotation.tolist(),
            "translation": body_from_file.translation.tolist(),
        }
    write_text(path, tomli_w.dumps(values))
