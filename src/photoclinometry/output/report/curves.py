"""Figures of renderings beside real images, and of the estimate's convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from photoclinometry.evaluate.metrics import psnr
from photoclinometry.model.image import Image
from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.draw import (
    add_bar,
    bare,
    colour_map,
    limits,
    panels,
    save,
    style,
    symmetric_limits,
)
from photoclinometry.photometry.render import render_view

if TYPE_CHECKING:
    from photoclinometry.adjust import Iteration

RENDERINGS = 6
"""Renderings in a report."""
_STRETCH_PERCENT = (0.5, 99.5)
"""Percentiles of brightness that are shown black and white."""
_TICKS = 12
"""Most labels on the axis of steps."""
REWEIGHTING = "reweighting iteration"
"""Name of the number of the reweighting iteration among the costs of a step."""
CONVERGENCE = (
    "Cost by type of factor. Between two reweighting iterations (shaded in turn) the noise is measured anew, so that "
    "costs can be compared within one only; there the sum falls and levels out."
)
"""Caption of the figure of convergence."""
_WIDE = 0.2
"""Share of the axis that a reweighting iteration needs for its name to be written in full."""


def choose_views(scene: Scene, rows: Sequence[Mapping[str, Any]], count: int = RENDERINGS) -> list[int]:
    """View indices evenly spaced from the best to the worst PSNR, so that the choice is typical."""
    quality = {row["name"]: row["psnr_db"] for row in rows if "psnr_db" in row}
    known = [k for k, name in enumerate(scene.views.name) if name in quality]
    ranked = sorted(known, key=lambda k: -quality[scene.views.name[k]])
    picks = np.unique(np.linspace(0, len(ranked) - 1, min(count, len(ranked))).round().astype(int))
    return [ranked[i] for i in picks]


def draw_rendering(path: Path, scene: Scene, view: int, image: Image) -> Path:
    """Real image, rendering and their difference, cropped to the map, with the PSNR (Eq. 40)."""
    rendered, mask = render_view(scene, view, cast_shadows=True)
    mask &= image.valid
    rows, cols = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    window = slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)
    quality = psnr(image.brightness, rendered, mask, float(image.brightness[image.valid].max()))
    real = np.where(image.valid, image.brightness, np.nan)[window]
    drawn = np.where(mask, rendered, np.nan)[window]
    clim = limits(np.where(mask[window], real, np.nan), *_STRETCH_PERCENT)
    percent = 100.0 * (drawn - real) / np.nanmean(np.where(mask[window], real, np.nan))
    unit = "I/F" if scene.brightness == "iof" else "DN"
    with style():
        aspect = real.shape[0] / real.shape[1]
        figure, axes = panels(1, 3, 3.2, aspect, (0.85, 0.0), (0.05, 0.95, 0.1, 0.3))
        left, middle, right = axes[0]
        shown = bare(left, f"real: {scene.views.name[view]}").imshow(
            real, cmap=colour_map("gray"), vmin=clim[0], vmax=clim[1]
        )
        add_bar(left, shown, real, unit)
        shown = bare(middle, f"rendered: PSNR {quality:.2f} dB").imshow(
            drawn, cmap=colour_map("gray"), vmin=clim[0], vmax=clim[1]
        )
        add_bar(middle, shown, drawn, unit)
        low, high = symmetric_limits(percent)
        shown = bare(right, "rendered - real").imshow(percent, cmap=colour_map("RdBu_r"), vmin=low, vmax=high)
        add_bar(right, shown, percent, "% of mean brightness")
        return save(figure, path)


def draw_renderings(
    folder: Path, scene: Scene, images: Mapping[str, Image], rows: Sequence[Mapping[str, Any]]
) -> list[tuple[str, str]]:
    """Up to RENDERINGS views as files: (file name, caption) of each, best PSNR first."""
    figures = []
    for view in choose_views(scene, rows):
        name = scene.views.name[view]
        file = f"rendering_{view:03d}.png"
        draw_rendering(folder / file, scene, view, images[name])
        figures.append((file, f"{name}: real, rendered, and the difference."))
    return figures


def draw_convergence(path: Path, convergence: Sequence[Mapping[str, float]]) -> Path:
    """Cost by type of factor over the steps, and the sum, on a logarithmic axis, by reweighting iteration.

    Between these the noise is measured anew. Costs are squared residuals in units of the noise, so that those of two
    cannot be compared: lines end with their reweighting iteration, and every second one is shaded.
    """
    kinds = list(dict.fromkeys(kind for step in convergence for kind in step if kind != REWEIGHTING))
    steps = np.arange(len(convergence))
    cost = {kind: np.array([step.get(kind, np.nan) for step in convergence], float) for kind in kinds}
    with style():
        figure, grid = panels(1, 1, 5.2, 0.6, (0.0, 0.0), (0.7, 1.8, 0.5, 0.3))
        axes = grid[0, 0]
        total = np.nansum(list(cost.values()), axis=0)
        reweightings = split_reweightings([step.get(REWEIGHTING) for step in convergence], total)
        for number, (first, end) in enumerate(reweightings, 1):
            part = slice(first, end)
            axes.set_prop_cycle(None)
            axes.plot(steps[part], total[part], color="black", lw=2.2, marker="o", ms=4, label=_once("sum", number))
            for kind, values in cost.items():
                if (values > 0).any():
                    shown = np.where(values > 0, values, np.nan)[part]
                    axes.plot(steps[part], shown, marker=".", lw=1.2, label=_once(kind, number))
            axes.axvspan(first - 0.5, end - 0.5, color="0.5", alpha=0.15 * (number % 2), lw=0)
            middle = 0.5 * (first + end - 1)
            name = f"{REWEIGHTING} {number}" if end - first >= _WIDE * len(steps) else f"{number}"
            axes.annotate(name, (middle, 1.02), xycoords=("data", "axes fraction"), ha="center", fontsize="small")
        axes.set_yscale("log")
        axes.set_xlim(-0.5, len(steps) - 0.5)
        axes.set_xticks(steps[:: max(1, len(steps) // _TICKS)])
        axes.set_xlabel("step")
        axes.set_ylabel("cost, in units of the noise [-]")
        axes.grid(alpha=0.25)
        axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
        return save(figure, path)


def cost_by_reweighting(log: Sequence[Iteration]) -> list[dict[str, float]]:
    """The cost of each accepted step by type of factor, with the number of its reweighting iteration, from 1, as
    `REWEIGHTING`.

    The log of each begins with its start, at which nothing has moved and nothing was solved.
    """
    rows, number = [], 0
    for step in log:
        number += step.cg_iterations == 0 and step.position_step == 0.0
        if step.accepted:
            rows.append({**step.cost, REWEIGHTING: float(max(number, 1))})
    return rows


def split_reweightings(numbers: Sequence[float | None], total: np.ndarray) -> list[tuple[int, int]]:
    """First step of each reweighting iteration, and the first after it, from their numbers (n,).

    Where these are not known, from the cost (n,): no accepted step raises it, so that a rise is another one.
    """
    known = [number for number in numbers if number is not None]
    new = np.diff(known) > 0 if len(known) == len(total) else np.diff(total) > 0
    starts = [0, *(np.flatnonzero(new) + 1).tolist()]
    return list(zip(starts, [*starts[1:], len(total)], strict=True))


def _once(label: str, number: int) -> str:
    """A label for the legend, which has that of the first reweighting iteration alone."""
    return label if number == 1 else f"_{label}"
