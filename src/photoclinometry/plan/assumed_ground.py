"""The ground that a plan assumes, and what views show of it.

It is natural relief of a stated RMS slope over the place's tangent plane. The forecast has its images, and begins at
the map of the ground as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.image import Image
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views
from photoclinometry.plan.exposures import exposed, ground_half_extent
from photoclinometry.plan.options import PlanOptions
from photoclinometry.plan.place import PlannedViews
from photoclinometry.simulate import albedo
from photoclinometry.simulate.hapke import BODIES as HAPKE_BODIES
from photoclinometry.simulate.photometry import Photometry, named_photometry
from photoclinometry.simulate.presets import background, young_landforms
from photoclinometry.simulate.raycast import Raycaster
from photoclinometry.simulate.surface import Surface
from photoclinometry.simulate.terrain import Grid, rms_slope
from photoclinometry.simulate.truth import Truth, truth_maps

SAMPLES_PER_PX = 2
"""Samples of the ground per pixel of the finest view, along each side: relief finer than pixels is noise of a map."""

_FRACTAL_SLOPE_DEG = 3.5
"""Slope between samples of the fractal part, before all is scaled: that of the simulator's old ground."""

_LARGEST_CRATER, _LARGEST_YOUNG = 0.5, 0.1
"""Diameters of the largest craters, worn and young, as shares of half the ground's side: they fit into it whole."""


@dataclass(frozen=True, kw_only=True)
class AssumedGround:
    """The assumed ground and what looks at it: `truth.views`, whose images are cut to the map."""

    tracer: Raycaster
    truth: Truth
    options: PlanOptions

    @property
    def photometry(self) -> Photometry:
        return self.truth.photometry

    @property
    def model_name(self) -> str:
        """Of its reflectance."""
        return self.photometry.name if isinstance(self.photometry, Reflectance) else "hapke"

    def image(self, views: Views, k: int) -> Image:
        """Of view k, whose image is cut to the map."""
        return exposed(self.tracer, views, k, self.photometry, self.options.detector, self.options.seed)

    def images(self, progress: Progress = no_progress) -> tuple[Image, ...]:
        """Of all views that look at it."""
        views, images = self.truth.views, []
        for k in range(len(views)):
            progress("images", k, len(views))
            images.append(self.image(views, k))
        progress("images", len(views), len(views))
        return tuple(images)


def assumed_ground(
    planned: PlannedViews,
    views: Views,
    half_side: float,
    reflectance: Reflectance,
    body: str | None,
    brightness: str,
    options: PlanOptions,
) -> AssumedGround:
    """The ground below the planned views.

    views: these, cut to a map of half the side `half_side` [m]. reflectance: of the run that is planned; the ground's,
    too, where the options name no other and none of Hapke is published for the body.
    """
    finest = min(s.gsd_m for s in planned.seen)
    extent = ground_half_extent(views, half_side)
    surface = representative_ground(extent, planned.gsd_m, finest, options.slope_deg, options.albedo, options.seed)
    truth = Truth(
        name="plan",
        body=body or "",
        surface=surface,
        views=views,
        psf_sigma_px=options.detector.psf_sigma_px,
        brightness=brightness,
        photometry=_photometry(options, body, reflectance),
    )
    return AssumedGround(tracer=Raycaster(surface), truth=truth, options=options)


def scene_at_truth(ground: AssumedGround, reference: int, reflectance: Reflectance) -> Scene:
    """The map of the ground as it is, every landmark projected into every image that has it."""
    views, side = ground.truth.views, ground.options.patch_px
    column, row = np.floor(views.project(reference, np.zeros((1, 3)))[0]).astype(int) - side // 2
    region = Region(row=int(row), col=int(column), height=side, width=side)
    maps = truth_maps(ground.truth, views.name[reference], region, ground.tracer)
    cells = np.argwhere(maps.hit)
    at = tuple(cells.T)
    landmarks = Landmarks(
        position=maps.position[at],
        normal=maps.normal_mean[at],
        albedo=maps.albedo_mean[at],
        pixel=(cells + (region.row, region.col)).astype(np.int32),
    )
    count, number = len(landmarks), len(views)
    keypoint = np.stack([views.project(k, landmarks.position) for k in range(number)], 1)
    tracks = Tracks.of_keypoints(
        np.arange(0, count * number + 1, number, dtype=np.int64),
        np.tile(np.arange(number, dtype=np.int32), count),
        keypoint.reshape(-1, 2),
        1.0,
    )
    return Scene(
        name="plan",
        body=ground.truth.body or None,
        brightness=ground.truth.brightness,
        reflectance=reflectance,
        views=views,
        landmarks=landmarks,
        tracks=tracks,
        reference=reference,
        region=region,
    )


def representative_ground(
    half_extent: float, gsd: float, finest_gsd: float, slope_deg: float, mean_albedo: float, seed: int
) -> Surface:
    """Fractal relief, craters and boulders over the square [-half_extent, half_extent]^2 [m], in the local frame.

    The recipe is the simulator's (`simulate/presets.py`), all heights scaled by one factor so that the RMS slope, of
    the gradient's length between points one gsd [m] apart, is the stated one. finest_gsd: of the finest view [m].
    """
    grid = Grid(finest_gsd / SAMPLES_PER_PX, math.ceil(half_extent * SAMPLES_PER_PX / finest_gsd))
    rng = np.random.default_rng([seed, 1])
    relief, log_albedo = background(
        grid, rng, slope_deg=_FRACTAL_SLOPE_DEG, longest=half_extent, largest_crater=_LARGEST_CRATER * half_extent
    )
    young_landforms(relief, log_albedo, grid, rng, _LARGEST_YOUNG * half_extent, half_extent)
    step = max(1, round(gsd / grid.spacing))
    along_axis = rms_slope(relief[::step, ::step], step * grid.spacing)
    relief *= np.float32(math.tan(math.radians(slope_deg)) / (math.sqrt(2.0) * along_axis))
    return Surface(
        relief, albedo.from_log(log_albedo, mean_albedo), grid.spacing, (float(grid.axis[0]), float(grid.axis[0]))
    )


def _photometry(options: PlanOptions, body: str | None, reflectance: Reflectance) -> Photometry:
    if options.ground != "auto":
        return named_photometry(options.ground, body or "")
    return HAPKE_BODIES.get((body or "").lower(), reflectance)
