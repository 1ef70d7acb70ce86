"""The places that can be simulated: body, distances of the camera, and surface.

The recipes of the surfaces are chosen by eye, so that images look like Dawn's; nothing in the estimate depends on them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.bodies import MEAN_RADIUS_M
from photoclinometry.model.errors import InputError
from photoclinometry.simulate import albedo, features, terrain
from photoclinometry.simulate.features import CraterShape
from photoclinometry.simulate.surface import Surface, sphere_drop
from photoclinometry.simulate.terrain import Grid

_FOCAL_PX = 10714.0
"""Dawn Framing Camera: 150 mm focal length, 14 um pixels."""


@dataclass(frozen=True, kw_only=True)
class Preset:
    """A place to simulate. Options of a simulation may override the number and size of the images."""

    body: str
    gsd: tuple[float, ...]
    """Ground sample distances [m], assigned to the views in turn. The greatest emission angle is proportional to
    finest / gsd: from higher up the camera tilts less."""
    views: int
    image_size: int
    """Width and height [px]."""
    region_px: int
    """Width and height of the region to map [px]."""
    focal_px: float = _FOCAL_PX
    sample: float
    """Spacing of the surface's samples [m]."""
    build: Callable[[Grid, np.random.Generator], tuple[np.ndarray, np.ndarray]]
    """Relief [m] without the body's curvature, and log albedo (relative), both (n, m) float32."""
    mean_albedo: float


def build_surface(preset: Preset, half_extent: float, seed: int) -> Surface:
    """The surface of a preset over [-half_extent, half_extent]^2 [m]; the same seed gives the same surface."""
    grid = Grid(preset.sample, math.ceil(half_extent / preset.sample))
    relief, log_albedo = preset.build(grid, np.random.default_rng([seed, 1]))
    normal_albedo = albedo.from_log(log_albedo, preset.mean_albedo)
    del log_albedo
    axis = grid.axis
    for i, y in enumerate(axis):
        relief[i] += sphere_drop(axis, np.full_like(axis, y), MEAN_RADIUS_M[preset.body])
    return surface_of_relief(relief, normal_albedo, grid, preset.mean_albedo, seed)


def surface_of_relief(
    relief: np.ndarray, normal_albedo: np.ndarray | None, grid: Grid, mean: float, seed: int
) -> Surface:
    """Given heights (n, n) with their albedo (n, n); if None, a mottled one with dark patches and given mean."""
    if normal_albedo is None:
        rng, everywhere = np.random.default_rng([seed, 1]), np.ones(grid.shape, np.float32)
        log_albedo = albedo.mottling(grid, rng, 0.12, grid.half_extent)
        log_albedo += albedo.deposits(grid, rng, -0.3, 40.0 * grid.spacing, 0.10, 0.12, everywhere)
        normal_albedo = albedo.from_log(log_albedo, mean)
    return Surface(relief, normal_albedo, grid.spacing, (float(grid.axis[0]), float(grid.axis[0])))


def named_preset(name: str) -> Preset:
    """The preset of that name. Raises InputError for others."""
    if name not in PRESETS:
        raise InputError(f"no preset {name!r}; known: {', '.join(PRESETS)}")
    return PRESETS[name]


def background(
    grid: Grid,
    rng: np.random.Generator,
    *,
    slope_deg: float,
    longest: float,
    largest_crater: float,
    crater_density: float = 0.06,
) -> tuple[np.ndarray, np.ndarray]:
    """Old ground: fractal relief of a given slope between samples, worn craters, mottled albedo."""
    relief = terrain.fractal_noise(grid, rng, 0.9, longest, 2.8 * grid.spacing)
    relief *= np.float32(math.tan(math.radians(slope_deg)) / terrain.rms_slope(relief, grid.spacing))
    log_albedo = albedo.mottling(grid, rng, 0.09, longest)
    old = terrain.crater_population(
        grid,
        rng,
        density=crater_density,
        smallest=5.0 * grid.spacing,
        largest=largest_crater,
        freshest=0.15,
        fresh_brightening=0.15,
    )
    terrain.stamp(relief, log_albedo, grid, old)
    return relief, log_albedo


def young_landforms(
    relief: np.ndarray,
    log_albedo: np.ndarray,
    grid: Grid,
    rng: np.random.Generator,
    largest: float,
    boulder_spread: float,
) -> None:
    """Lets steep ground slide, then adds young small craters and boulders, in place."""
    terrain.settle(relief, grid.spacing)
    young = terrain.crater_population(
        grid, rng, density=0.012, smallest=4.0 * grid.spacing, largest=largest, fresh_brightening=0.3
    )
    terrain.stamp(relief, log_albedo, grid, young)
    area = (boulder_spread / grid.spacing) ** 2
    boulders = terrain.boulder_field(
        rng,
        count=int(3e-3 * area),
        spread=boulder_spread,
        smallest=2.0 * grid.spacing,
        largest=6.0 * grid.spacing,
    )
    terrain.stamp(relief, log_albedo, grid, boulders)


def _near(grid: Grid, center: tuple[float, float], radius: float, inner: float, outer: float) -> np.ndarray:
    """(n, m) 1 within `inner` radii of a centre, 0 beyond `outer` radii."""
    r, _ = features.polar(grid, center)
    return (1.0 - features.smooth_step(r / radius, inner, outer)).astype(np.float32)


def _paint(
    relief: np.ndarray,
    log_albedo: np.ndarray,
    grid: Grid,
    rng: np.random.Generator,
    near: np.ndarray,
    size: float,
    contrast: float = 1.0,
) -> None:
    """Dark and bright deposits around the big feature and streaks down all steep slopes, in place."""
    log_albedo += albedo.deposits(grid, rng, -0.3 * contrast, size, 0.10, 0.12, near)
    log_albedo += albedo.deposits(grid, rng, 0.25 * contrast, 0.7 * size, 0.08, 0.6, near)
    log_albedo += albedo.slope_streaks(relief, grid, rng, 0.10 * contrast, 0.5 * size)


def _fresh_crater(
    grid: Grid, rng: np.random.Generator, diameter: float, longest: float
) -> tuple[np.ndarray, np.ndarray]:
    relief, log_albedo = background(grid, rng, slope_deg=3.5, longest=longest, largest_crater=0.8 * diameter)
    crater, survives = features.large_crater(grid, rng, CraterShape(diameter=diameter, depth=0.19, gullies=0.0025))
    relief = relief * survives + crater
    young_landforms(relief, log_albedo, grid, rng, 0.05 * diameter, diameter)
    _paint(relief, log_albedo, grid, rng, _near(grid, (0.0, 0.0), 0.5 * diameter, 0.9, 2.2), 0.2 * diameter)
    return relief, log_albedo


def _cornelia(grid: Grid, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return _fresh_crater(grid, rng, 15_000.0, 30_000.0)


def _demo(grid: Grid, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return _fresh_crater(grid, rng, 5_500.0, 12_000.0)


def _ahuna(grid: Grid, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    relief, log_albedo = background(grid, rng, slope_deg=3.5, longest=60e3, largest_crater=20e3)
    shape = CraterShape(diameter=17e3, center=(17e3, 9e3), depth=0.14, floor=0.35, gullies=0.003, rim_softness=0.06)
    crater, survives = features.large_crater(grid, rng, shape)
    relief = relief * survives + crater
    mountain, survives = features.dome(grid, rng, height=4e3, base=18e3)
    relief = relief * survives + mountain
    young_landforms(relief, log_albedo, grid, rng, 1.5e3, 15e3)
    near = np.maximum(_near(grid, (0.0, 0.0), 9e3, 0.9, 1.6), _near(grid, (17e3, 9e3), 8.5e3, 0.9, 1.5))
    _paint(relief, log_albedo, grid, rng, near, 4e3, contrast=0.8)
    return relief, log_albedo


def _ikapati(grid: Grid, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    relief, log_albedo = background(grid, rng, slope_deg=3.5, longest=90e3, largest_crater=40e3)
    center = (13e3, -8e3)
    shape = CraterShape(diameter=50e3, center=center, depth=0.085, floor=0.5, gullies=0.0015, terraces=0.005, peak=0.02)
    crater, survives = features.large_crater(grid, rng, shape)
    relief = relief * survives + crater
    undulation = terrain.fractal_noise(grid, rng, 1.0, 25e3, 2e3)
    floor = _near(grid, center, 25e3, 0.45, 0.7)
    for height, wavelength, azimuth in ((260.0, 3.6e3, 0.6), (120.0, 1.7e3, 1.0)):
        relief += features.ridges(
            grid,
            rng,
            height=height,
            wavelength=wavelength,
            azimuth=azimuth,
            within=floor,
            undulation=undulation,
        )
    young_landforms(relief, log_albedo, grid, rng, 2.5e3, 25e3)
    _paint(relief, log_albedo, grid, rng, _near(grid, center, 25e3, 0.9, 1.6), 6e3, contrast=0.8)
    return relief, log_albedo


PRESETS = {
    "demo": Preset(
        body="vesta",
        gsd=(60.0,),
        views=14,
        image_size=512,
        region_px=160,
        sample=30.0,
        build=_demo,
        mean_albedo=0.36,
    ),
    "cornelia": Preset(
        body="vesta",
        gsd=(60.0,),
        views=29,
        image_size=1024,
        region_px=400,
        sample=30.0,
        build=_cornelia,
        mean_albedo=0.36,
    ),
    "ahuna": Preset(
        body="ceres",
        gsd=(140.0,),
        views=32,
        image_size=1024,
        region_px=400,
        sample=70.0,
        build=_ahuna,
        mean_albedo=0.094,
    ),
    "ikapati": Preset(
        body="ceres",
        gsd=(140.0, 140.0, 300.0),
        views=38,
        image_size=1024,
        region_px=400,
        sample=100.0,
        build=_ikapati,
        mean_albedo=0.094,
    ),
}
