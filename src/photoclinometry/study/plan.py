"""The cells of a study: every combination of place, lighting, ground, seed and model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

from photoclinometry.io.site import MIN_VIEWS
from photoclinometry.model.errors import InputError
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.reflectance import ModelOrAuto, model_named
from photoclinometry.pipeline.run import RunOptions
from photoclinometry.rivals.compare import Method, RivalOptions
from photoclinometry.simulate.options import SMALLEST_IMAGE_PX, SimulationOptions
from photoclinometry.simulate.presets import named_preset

MODELS = ("akimov", "mcewen", "akimov+", "lunar-lambert", "minnaert")
"""The paper's five, in the order of its tables."""
MATCHED = "matched"
"""Ground with the reflectance model that it is mapped with."""
AUTO = "auto"
"""The model that each run chooses by views kept out."""
GEOMETRY = "none"
"""The model of a run without photometry: dense structure from motion."""


@dataclass(frozen=True, kw_only=True)
class StudyOptions(Ranged):
    """The sites to simulate, and the models to map them with. Every combination is one cell."""

    presets: tuple[str, ...] = ("cornelia", "ahuna", "ikapati")
    """Places: cornelia, ahuna, ikapati, demo."""
    models: tuple[ModelOrAuto, ...] = MODELS
    """Reflectance models to map with; "auto": the one that each run chooses, on surfaces that name a model."""
    surfaces: tuple[str, ...] = (MATCHED, "hapke")
    """Reflectance of the simulated ground: "matched" (the model that it is mapped with), or a model for all."""
    lightings: tuple[str, ...] = ("moderate",)
    """Lightings: moderate, strong, harsh."""
    seeds: Annotated[tuple[int, ...], Range(least=0, most=2**31 - 1)] = (0,)
    """Seeds of the sites; tables give mean and standard deviation over them."""
    hold_out_every: Annotated[int, Range(least=2, most=1_000_000, also=(0,))] = 10
    """Hold one view in this many out of the maps, to measure them on it; 0 holds out none."""
    geometry_alone: bool = True
    """Also map without photometry, to compare heights."""
    views: Annotated[int | None, Range(least=MIN_VIEWS, most=1_000_000)] = None
    """Images of each site; the preset's number by default."""
    image_size: Annotated[int | None, Range(least=SMALLEST_IMAGE_PX, most=65535)] = None
    """Width and height of the images [px]; the preset's by default."""
    region_size: Annotated[int | None, Range(least=2, most=65535)] = None
    """Width and height of the maps [px]; the preset's by default."""
    rivals: tuple[Method, ...] = ()
    """Other published methods to map each site with, beside lunar-lambert (or the last of the models): spc, mvs, splat,
    splat-reflectance, ngp. As `phomo rivals`."""
    run: RunOptions = field(default_factory=RunOptions)
    """Options of the runs; `reflectance` and `hold_out` are set by the study."""
    rival: RivalOptions = field(default_factory=RivalOptions)
    """Options of the rivals."""

    def __post_init__(self):
        super().__post_init__()
        for name in ("presets", "models", "surfaces", "lightings", "seeds"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise InputError(f"a study needs {name}, each once, got {list(values)}")
        if len(set(self.rivals)) < len(self.rivals):
            raise InputError(f"a study needs rivals each once, got {list(self.rivals)}")
        for model in self.models:
            if model != AUTO:
                model_named(model)
        if AUTO in self.models and MATCHED in self.surfaces:
            raise InputError(f"{AUTO!r} among the models needs surfaces that name a model, got {list(self.surfaces)}")
        cells(self)  # raises InputError for options that the simulator refuses

    @property
    def shown(self) -> str:
        """The model whose maps and heights are drawn."""
        return "lunar-lambert" if "lunar-lambert" in self.models else self.models[-1]


@dataclass(frozen=True)
class Cell:
    """One run of a study."""

    surface: str
    """The ground: "matched", or its model."""
    simulation: SimulationOptions
    model: str
    """The model to map with; "none" for geometry alone."""
    hold_out: tuple[str, ...]

    @property
    def site(self) -> str:
        """Name of the simulated site, whose folder several cells share."""
        s = self.simulation
        return f"{s.preset}-{s.lighting}-{s.reflectance}-{s.seed}"

    @property
    def group(self) -> tuple[str, str, str]:
        """The row of the tables: preset, lighting, surface. Seeds are averaged."""
        return self.simulation.preset, self.simulation.lighting, self.surface

    @property
    def name(self) -> str:
        """Path of the cell's results below the study's folders."""
        s = self.simulation
        return f"{s.preset}-{s.lighting}-{self.surface}-{s.seed}/{self.model}"

    def run_options(self, options: StudyOptions) -> RunOptions:
        """The options of the cell's run."""
        return replace(options.run, reflectance=self.model, hold_out=self.hold_out)  # pyright: ignore[reportArgumentType]


def cells(options: StudyOptions) -> list[Cell]:
    """All cells, those of one site together, geometry alone after the models. Raises InputError."""
    found = []
    for preset in options.presets:
        for lighting in options.lightings:
            for seed in options.seeds:
                for surface in options.surfaces:
                    models = options.models + ((GEOMETRY,) if options.geometry_alone else ())
                    found += [_cell(options, preset, lighting, seed, surface, model) for model in models]
    return sorted(found, key=lambda cell: cell.site)


def _cell(options: StudyOptions, preset: str, lighting: str, seed: int, surface: str, model: str) -> Cell:
    matched = options.shown if model == GEOMETRY else model
    simulation = SimulationOptions(
        preset=preset,
        lighting=lighting,
        seed=seed,
        reflectance=matched if surface == MATCHED else surface,
        views=options.views,
        image_size=options.image_size,
        region_size=options.region_size,
    )
    count = options.views or named_preset(preset).views
    held_out = _held_out([f"images/{k:03d}.fits" for k in range(count)], options)
    _check_enough_views(held_out, count, options)
    return Cell(surface, simulation, model, held_out)


def _held_out(names: Sequence[str], options: StudyOptions) -> tuple[str, ...]:
    """Every `hold_out_every`-th view, beginning in the middle of the first interval."""
    every = options.hold_out_every
    held = tuple(names[every // 2 :: every]) if every else ()
    if len(names) - len(held) < MIN_VIEWS:
        raise InputError(
            f"--hold-out-every {every} leaves {len(names) - len(held)} of {len(names)} views, at least {MIN_VIEWS} "
            "must remain to be mapped; give a larger number, 0, or more --views"
        )
    return held


def _check_enough_views(held_out: Sequence[str], views: int, options: StudyOptions) -> None:
    """Raises InputError where no landmark of a site can be in as many views as the runs ask for."""
    mapped = views - len(held_out)
    fewest = options.run.densify.views_needed(mapped)
    if mapped < fewest:
        raise InputError(
            f"{mapped} views of each site are to be mapped, but landmarks are to be in {fewest} views at least; give "
            f"more --views, or --run.densify.min-views {mapped}"
        )
