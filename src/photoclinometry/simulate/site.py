"""A simulated site on disk: images, `site.toml`, and the truth. The same options give the same bytes."""

from __future__ import annotations

import logging
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.altimetry_csv import write_altimetry
from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.io.images import write_fits, write_png
from photoclinometry.io.output_folder import check_output_folder
from photoclinometry.io.site import (
    RegionRequest,
    Site,
    SiteView,
    write_site,
)
from photoclinometry.model.bodies import MEAN_RADIUS_M
from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Similarity
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.scene import Views
from photoclinometry.model.warning import warn
from photoclinometry.simulate.altimetry import altimeter_tracks
from photoclinometry.simulate.bodies.place import body_place
from photoclinometry.simulate.camera_model import expose, hot_pixel_charge, pixel_average
from photoclinometry.simulate.given import given_relief
from photoclinometry.simulate.observe import radiance
from photoclinometry.simulate.options import SimulationOptions, body_preset, chosen_preset
from photoclinometry.simulate.photometry import named_photometry
from photoclinometry.simulate.place import SimulatedPlace
from photoclinometry.simulate.presets import Preset, build_surface, surface_of_relief
from photoclinometry.simulate.raycast import Raycaster
from photoclinometry.simulate.surface import Surface
from photoclinometry.simulate.terrain import Grid
from photoclinometry.simulate.truth import Truth
from photoclinometry.simulate.truth_file import write_truth
from photoclinometry.simulate.views import Stream, draw_views, half_extent, pose_priors, stream

log = logging.getLogger(__name__)

OPTIONS_FILE = "simulation.toml"
"""The options; `simulate_site` overwrites only folders that hold this file."""
_FLAT_RADIUS = 1e3
"""Radius, in distances of the camera, of a sphere that is as good as a plane."""


def simulate_site(
    options: SimulationOptions,
    out_folder: Path | str,
    progress: Progress = no_progress,
    overwrite: bool = False,
) -> Path:
    """Writes images/, site.toml, truth.h5, of a body truth.ply, with --altimetry altimetry.csv, and simulation.toml.

    Returns the path of site.toml.

    The folder appears whole, at the end, or not at all. Raises RunFolderError if it is not empty, unless it holds a
    simulated site and `overwrite` is set.
    """
    out_folder = Path(out_folder)
    check_site_folder(out_folder, overwrite)
    progress("terrain", 0, 1)
    preset = body_preset(options)
    place = ground_place(options) if preset is None else body_place(options, preset)
    with atomic_path(out_folder) as folder:
        (folder / "images").mkdir(parents=True)
        views = _write_images(folder, place, options, progress)
        progress("truth", len(views), len(views))
        place.write_truth(folder, views)
        if place.altimetry is not None:
            write_altimetry(folder / "altimetry.csv", place.altimetry)
        write_site(folder / "site.toml", _site(folder, options, place, views))
        _write_options(folder / OPTIONS_FILE, options, place.settings)
    log.info("simulated %d views of %s in %s", len(views), place.name, out_folder)
    return out_folder / "site.toml"


def _write_images(folder: Path, place: SimulatedPlace, options: SimulationOptions, report: Progress) -> Views:
    """Writes all images; returns the views with the scales and biases of their brightness."""
    views, camera = place.views, place.views.cameras[0]
    hot = hot_pixel_charge((camera.height, camera.width), options.detector, stream(options, Stream.HOT_PIXELS))
    scale, bias = np.ones(len(views)), np.zeros(len(views))
    for k, name in enumerate(views.name):
        report("images", k, len(views))
        image = _radiance_image(place, k, options)
        exposure = expose(image, options.detector, stream(options, Stream.EXPOSURE, k), hot, place.shows_sky)
        if options.brightness == "iof":
            write_fits(folder / name, exposure.iof)
        else:
            write_png(folder / name, exposure.uint16)
            scale[k], bias[k] = exposure.gain, exposure.offset
    return replace(views, scale=scale, bias=bias)


def check_site_folder(folder: Path, overwrite: bool) -> None:
    """Raises RunFolderError if `simulate_site` must not write there."""
    check_output_folder(folder, "simulated site", OPTIONS_FILE, overwrite=overwrite)


def ground_place(options: SimulationOptions) -> SimulatedPlace:
    """The place of a preset, or of ground from a file, and the views of it. Raises InputError."""
    preset = chosen_preset(options)
    cameras, views = draw_views(options, preset)
    surface, frame = _surface(options, preset, cameras[0])
    truth = Truth(
        name=options.surface.stem if options.surface else options.preset,
        body=preset.body,
        surface=surface,
        views=views,
        psf_sigma_px=options.detector.psf_sigma_px,
        brightness=options.brightness,
        photometry=named_photometry(options.reflectance, preset.body),
    )
    size = options.region_size or min(preset.region_px, min(cameras[0].width, cameras[0].height) // 2)
    gsd, altimetry = min(preset.gsd), None
    if options.altimetry is not None:
        rng = stream(options, Stream.ALTIMETRY)
        altimetry = altimeter_tracks(surface, size * gsd, gsd, options.altimetry, rng)
    return SimulatedPlace(
        name=truth.name,
        body=truth.body,
        tracer=Raycaster(surface),
        photometry=truth.photometry,
        views=views,
        write_truth=lambda folder, views: write_truth(folder / "truth.h5", replace(truth, views=views)),
        region=RegionRequest(size_px=(size, size)),
        altimetry=altimetry,
        settings={} if frame is None else {"body_from_surface_file": _similarity(frame)},
    )


def _surface(options: SimulationOptions, preset: Preset, camera: Camera) -> tuple[Surface, Similarity | None]:
    """The ground, and for ground from a file the transform from the file's coordinates to B."""
    if options.surface is None:
        return build_surface(
            preset, half_extent(options, preset, camera, MEAN_RADIUS_M[preset.body]), options.seed
        ), None
    level = _FLAT_RADIUS * max(preset.gsd) * preset.focal_px
    grid = Grid(preset.sample, math.ceil(half_extent(options, preset, camera, level) / preset.sample))
    given = given_relief(options.surface, grid, min(preset.gsd), options.surface_unit, options.surface_center)
    return surface_of_relief(given.height, given.albedo, grid, preset.mean_albedo, options.seed), given.body_from_file


def _radiance_image(place: SimulatedPlace, k: int, options: SimulationOptions) -> np.ndarray:
    """(h, w) I/F of view k behind optics and pixels, without noise."""
    margin, views = options.detector.margin_px, place.views
    fine, complete = radiance(
        place.tracer,
        views.cameras[k],
        views.body_from_cam[k],
        views.sun[k],
        place.photometry,
        options.supersampling,
        margin,
    )
    if not complete and not place.shows_sky:
        name = views.name[k]
        warn(log, "view-past-edge", "%s sees past the edge of the simulated ground; it is dark there", name, view=name)
    angle = stream(options, Stream.SMEAR, k).uniform(0.0, np.pi)
    smear = (options.detector.smear_px * np.cos(angle), options.detector.smear_px * np.sin(angle))
    return pixel_average(fine, options.supersampling, margin, options.detector.psf_sigma_px, smear)


def _site(folder: Path, options: SimulationOptions, place: SimulatedPlace, views: Views) -> Site:
    priors = pose_priors(options, views.body_from_cam)
    return Site(
        name=place.name,
        body=place.body,
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
        region=place.region,
        path=folder / "site.toml",
        body_radius_m=place.body_radius_m,
        sun_common_sigma_rad=float(np.radians(options.sun_common_sigma_deg)),
    )


def _write_options(path: Path, options: SimulationOptions, settings: dict[str, Any]) -> None:
    import tomli_w

    values: dict[str, Any] = {key: value for key, value in asdict(options).items() if value is not None}
    values |= {key: str(values[key]) for key in ("surface", "shape") if key in values}
    write_text(path, tomli_w.dumps(values | settings))


def _similarity(body_from_file: Similarity) -> dict[str, Any]:
    return {
        "scale": body_from_file.scale,
        "rotation": body_from_file.rotation.tolist(),
        "translation": body_from_file.translation.tolist(),
    }
