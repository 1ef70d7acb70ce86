"""What a study consists of: site x model x lighting x seed, as a list of cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import ModelName, model_named
from photoclinometry.pipeline.run import RunOptions
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.presets import named_preset

MODELS = ("akimov", "mcewen", "akimov+", "lunar-lambert", "minnaert")
"""The paper's five, in the order of its tables."""
MATCHED = "matched"
GEOMETRY = "none"
"""The model of a run without photometry: dense structure from motion."""


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """Which sites are simulated, and how they are mapped. Every combination is one cell."""

    presets: tuple[str, ...] = ("cornelia", "ahuna", "ikapati")
    """Places: cornelia, ahuna, ikapati, demo."""
    models: tuple[ModelName, ...] = MODELS
    """Reflectance models to map with."""
    surfaces: tuple[str, ...] = (MATCHED, "hapke")
    """Reflectance of the simulated ground: "matched" is the model that it is then mapped with; or one for all."""
    lightings: tuple[str, ...] = ("moderate",)
    """moderate, strong."""
    seeds: tuple[int, ...] = (0,)
    """Tables give the mean over these, and the standard deviation."""
    hold_out_every: int = 10
    """One view in so many is held out of the maps, which are measured on it; 0 holds out none."""
    geometry_alone: bool = True
    """Also map without photometry, to compare heights with."""
    views: int | None = None
    """Images of each site; the preset's number by default."""
    image_size: int | None = None
    """Width and height of the images [px]; the preset's by default."""
    region_size: int | None = None
    """Width and height of the maps [px]; the preset's by default."""
    run: RunOptions = field(default_factory=RunOptions)
    """How the maps are made; reflectance and hold_out are the study's."""

    def __post_init__(self):
        for name in ("presets", "models", "surfaces", "lightings", "seeds"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise InputError(f"a study needs {name}, each once, got {list(values)}")
        for model in self.models:
            model_named(model)
        if self.hold_out_every < 0 or self.hold_out_every == 1:
            raise InputError(f"hold_out_every must be 0 or at least 2, got {self.hold_out_every}")
        cells(self)  # what the simulator refuses is refused before anything is simulated

    @property
    def shown(self) -> str:
        """The model that maps and heights are drawn of."""
        return "lunar-lambert" if "lunar-lambert" in self.models else self.models[-1]


@dataclass(frozen=True)
class Cell:
    """One run of a study."""

    surface: str
    """As the study names it: "matched", or the ground's model."""
    simulation: SimulationOptions
    model: str
    """What it is mapped with; "none" for geometry alone."""
    hold_out: tuple[str, ...]

    @property
    def site(self) -> str:
        """Name of the simulated site; cells that share it share its folder."""
        s = self.simulation
        return f"{s.preset}-{s.lighting}-{s.reflectance}-{s.seed}"

    @property
    def group(self) -> tuple[str, str, str]:
        """What a row of a table is: preset, lighting, surface; seeds are averaged over."""
        return self.simulation.preset, self.simulation.lighting, self.surface

    @property
    def name(self) -> str:
        """Path of the cell's results below the study's folders."""
        s = self.simulation
        return f"{s.preset}-{s.lighting}-{self.surface}-{s.seed}/{self.model}"

    def run_options(self, options: StudyOptions) -> RunOptions:
        return replace(options.run, reflectance=self.model, hold_out=self.hold_out)


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
    own = options.shown if model == GEOMETRY else model
    simulation = SimulationOptions(
        preset=preset,
        lighting=lighting,
        seed=seed,
        reflectance=own if surface == MATCHED else surface,
        views=options.views,
        image_size=options.image_size,
        region_size=options.region_size,
    )
    count = options.views or named_preset(preset).views
    return Cell(surface, simulation, model, _held_out([f"images/{k:03d}.fits" for k in range(count)], options))


def _held_out(names: Sequence[str], options: StudyOptions) -> tuple[str, ...]:
    """Every so-manieth view, from the middle of the first such group."""
    every = options.hold_out_every
    return tuple(names[every // 2 :: every]) if every else ()
