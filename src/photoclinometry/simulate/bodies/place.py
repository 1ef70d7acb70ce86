"""A whole body and the views of a mission to it, from the options of a simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from photoclinometry.io.meshes.ply import write_mesh_ply
from photoclinometry.model.geometry import METRES
from photoclinometry.model.scene import Views
from photoclinometry.simulate.bodies.build import build_body, given_shape, preset_shape
from photoclinometry.simulate.bodies.orbits import draw_mission, finest_gsd
from photoclinometry.simulate.bodies.presets import BodyPreset
from photoclinometry.simulate.bodies.surface import BodyRaycaster
from photoclinometry.simulate.bodies.truth import BodyTruth, write_body_truth
from photoclinometry.simulate.options import SimulationOptions, simulated_camera
from photoclinometry.simulate.photometry import named_photometry
from photoclinometry.simulate.place import SimulatedPlace
from photoclinometry.simulate.views import Stream, measured_views, stream

_SPACING_GSD = 0.5
"""Spacing of the vertices [ground samples of close-ups], as of places."""


def body_place(options: SimulationOptions, preset: BodyPreset) -> SimulatedPlace:
    """The body with its relief, and the views of it. Raises InputError."""
    camera = simulated_camera(options, preset)
    focal = sum(camera.focal_px) / 2.0
    unit_scale = METRES[options.surface_unit]
    shape = preset_shape(preset) if options.shape is None else given_shape(options.shape, unit_scale)
    gsd = options.gsd or finest_gsd(shape.reach, min(camera.width, camera.height))
    surface = build_body(shape, preset, _SPACING_GSD * gsd, options.seed)
    poses, suns = draw_mission(
        stream(options, Stream.POSES),
        options.views or preset.views,
        gsd,
        focal,
        shape.vertices,
        options.pointing_jitter_px,
    )
    truth = BodyTruth(
        name=options.preset if options.shape is None else options.shape.stem,
        body=preset.body,
        views=measured_views(options, camera, poses, suns),
        psf_sigma_px=options.detector.psf_sigma_px,
        brightness=options.brightness,
        photometry=named_photometry(options.reflectance, preset.body),
        surface=surface,
        gsd=gsd,
    )

    def write_truth(folder: Path, views: Views) -> None:
        write_body_truth(folder / "truth.h5", replace(truth, views=views))
        write_mesh_ply(folder / "truth.ply", surface.vertices, surface.faces, surface.albedo)

    return SimulatedPlace(
        name=truth.name,
        body=truth.body,
        tracer=BodyRaycaster(surface),
        photometry=truth.photometry,
        views=truth.views,
        write_truth=write_truth,
        body_radius_m=surface.mean_radius,
        shows_sky=True,
        settings={"close_up_gsd_m": gsd},
    )
