"""Instant neural graphics primitives: a radiance field of hashed grids and a small network.

Mueller et al. (2022), ACM Transactions on Graphics 41(4), doi:10.1145/3528223.3530127, on the CPU. Samples lie evenly
between two planes around the run's surface, which takes the place of the paper's occupancy grid. Each view has a gain
and an offset of its own, trained with the field; a view that was held out gets them as every method that does not know
the light. Only the map's part of each image is trained.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.scene import Scene
from photoclinometry.rivals.adam import Adam
from photoclinometry.rivals.gaussians.train import EXPOSURE_RATE, HISTORY_EVERY
from photoclinometry.rivals.outcome import COVERED, Outcome, surface_map
from photoclinometry.rivals.problem import Problem
from photoclinometry.rivals.radiance.field import Parameters, draw, draw_back, first_parameters
from photoclinometry.rivals.radiance.hash_grid import resolutions
from photoclinometry.rivals.radiance.rays import Box, Crossings, joined

COARSEST = 16
"""Cells of the coarsest grid along the box (Mueller et al. 2022, Table 1)."""
FINEST_SPACING = 0.5
"""Cell of the finest grid over the landmarks' spacing: finer ground shows in no image."""
RATE = 1e-2
"""Adam's step (Mueller et al. 2022, section 4)."""
DECAYS = (0.9, 0.99)
"""Of Adam's moments (Mueller et al. 2022, section 4)."""
SLOWER, SLOWER_AFTER = 0.33, (2 / 3, 5 / 6)
"""Steps become smaller by this factor after each of these shares of the iterations (Mueller et al. 2022, 5.4)."""
WEIGHT_DECAY = 1e-6
"""Factor of the networks' squared weights in the loss (Mueller et al. 2022, section 4)."""
RAYS_AT_ONCE = 4096
"""Bounds the memory of a picture to some hundred megabytes."""


@dataclass(frozen=True, kw_only=True)
class NgpOptions(Ranged):
    """Instant-NGP."""

    iterations: Annotated[int, Range(least=1, most=1_000_000)] = 2000
    """Batches of rays that are learnt from. The paper has 30,000."""
    rays: Annotated[int, Range(least=1, most=100_000)] = 512
    """Pixels of a batch."""
    samples: Annotated[int, Range(least=2, most=1000)] = 48
    """Places along a ray."""
    levels: Annotated[int, Range(least=1, most=32)] = 12
    """Grids of different resolution."""
    table_log2: Annotated[int, Range(least=4, most=24)] = 16
    """Entries of a grid's table, as a power of 2."""


@dataclass(frozen=True)
class Field:
    """A trained field."""

    parameters: Parameters
    cells: np.ndarray
    """(L,) of its grids."""
    exposure: np.ndarray
    """(K, 2) gain and offset of each view."""
    history: tuple[float, ...]
    """Mean squared errors, each of HISTORY_EVERY iterations; of pictures of peak 1."""


def run_ngp(problem: Problem, options: NgpOptions | None = None, progress: Progress = no_progress) -> Outcome:
    """The predictions of a radiance field; its map has the depths of the reference view."""
    options = options or NgpOptions()
    box = Box.around(problem.scene)
    field = train(problem, box, options, progress)
    rendered, covered = [], []
    for k, image in enumerate(problem.images):
        mask = problem.footprint[k]
        row, col = np.nonzero(mask)
        seen, opaque, _ = _seen(field, box.rays(problem.views, k, _middles(row, col)), options.samples)
        gain, offset = field.exposure[k] if k < problem.train else (1.0, 0.0)
        whole, there = np.zeros(image.valid.shape), np.zeros(image.valid.shape, bool)
        whole[row, col], there[row, col] = problem.peak * (gain * seen + offset), opaque > COVERED
        rendered.append(whole)
        covered.append(there)
    scene = field_map(problem.scene, field, box, options.samples)
    return Outcome(
        name="ngp", rendered=rendered, covered=covered, knows_light=False, scene=scene, history=field.history
    )


def train(problem: Problem, box: Box, options: NgpOptions, progress: Progress = no_progress) -> Field:
    """The field that explains the views that the run has used best; the problem's peak is 1 in it."""
    rng = np.random.default_rng(0)
    parts, values, views = [], [], []
    for k in range(problem.train):
        row, col = np.nonzero(problem.footprint[k])
        parts.append(box.rays(problem.views, k, _middles(row, col)))
        values.append(problem.images[k].brightness[row, col].astype(float) / problem.peak)
        views.append(np.full(len(row), k))
    rays, value, view = joined(parts), np.concatenate(values), np.concatenate(views)
    finest = max(COARSEST, round(box.side / (FINEST_SPACING * problem.scene.spacing)))
    cells = resolutions(options.levels, COARSEST, finest)
    parameters = first_parameters(rng, options.levels, 2**options.table_log2)
    exposure = np.tile([1.0, 0.0], (problem.train, 1))
    adam, exposed = Adam(parameters, DECAYS), Adam({"exposure": exposure}, DECAYS)
    history, losses = [], []
    for n in range(options.iterations):
        chosen = rng.integers(len(value), size=options.rays)
        jitter = rng.random((len(chosen), options.samples))
        batch = rays[chosen].sampled((np.arange(options.samples) + jitter) / options.samples)
        drawn, of_view = draw(parameters, cells, batch), view[chosen]
        gain, offset = exposure[of_view].T
        error = gain * drawn.brightness + offset - value[chosen]
        losses.append(float(np.mean(error**2)))
        by_value = 2.0 * error / len(error)
        by = draw_back(parameters, cells, batch, drawn, by_value * gain)
        slower = SLOWER ** sum(n >= share * options.iterations for share in SLOWER_AFTER)
        parameters = _stepped(parameters, by, adam, slower * RATE)
        by_exposure = np.stack(
            [np.bincount(of_view, each, problem.train) for each in (by_value * drawn.brightness, by_value)], -1
        )
        change = exposed.step({"exposure": by_exposure}, {"exposure": slower * EXPOSURE_RATE})
        exposure = exposure - change["exposure"]
        if len(losses) == HISTORY_EVERY or n + 1 == options.iterations:
            history.append(float(np.mean(losses)))
            losses = []
            progress("ngp", n + 1, options.iterations)
    return Field(parameters, cells, exposure, tuple(history))


def _stepped(parameters: Parameters, by: Parameters, adam: Adam, rate: float) -> Parameters:
    """The parameters after a step of Adam; networks are held small."""
    held = {
        name: gradient if name == "table" else gradient + 2.0 * WEIGHT_DECAY * parameters[name]
        for name, gradient in by.items()
    }
    change = adam.step(held, dict.fromkeys(held, rate))
    return {name: (values - change[name]).astype(np.float32) for name, values in parameters.items()}


def _middles(row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """Middles of pixels (n, 2), x and y."""
    return np.stack([col, row], -1) + 0.5


def _seen(field: Field, rays: Crossings, samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) brightness that rays see, share of their light that does not pass through, and mean distance of what they
    see [sides of the box], NaN of nothing."""
    found = []
    for first in range(0, len(rays.enter), RAYS_AT_ONCE):
        part = rays[slice(first, first + RAYS_AT_ONCE)]
        share = np.broadcast_to((np.arange(samples) + 0.5) / samples, (len(part.enter), samples))
        drawn = draw(field.parameters, field.cells, part.sampled(share))
        opaque = drawn.weight.sum(1)
        along = np.sum(drawn.weight * part.distances(share), 1)
        distance = np.divide(along, opaque, out=np.full(len(along), np.nan), where=opaque > 0)
        found.append((drawn.brightness, opaque, distance))
    if not found:
        return np.empty(0), np.empty(0), np.empty(0)
    brightness, opaque, distance = (np.concatenate(each) for each in zip(*found, strict=True))
    return brightness, opaque, distance


def field_map(scene: Scene, field: Field, box: Box, samples: int) -> Scene:
    """The map that a field is: mean depths at the reference's pixels, and the normals of that surface."""
    k, pixel = scene.reference, scene.landmarks.pixel
    rays = box.rays(scene.views, k, _middles(pixel[:, 0], pixel[:, 1]))
    _, opaque, distance = _seen(field, rays, samples)
    position = box.frame(box.side * (rays.center + distance[:, None] * rays.direction))
    return surface_map(scene, np.where(opaque[:, None] > COVERED, position, np.nan))
