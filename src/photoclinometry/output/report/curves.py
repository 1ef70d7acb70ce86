"""Figures of renderings beside real images, and of the estimate's convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.evaluate.metrics import psnr
from photoclinometry.model.scene import Image, Scene
from photoclinometry.output.report.draw import (
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

RENDERINGS = 6
"""Renderings in a report."""
_STRETCH_PERCENT = (0.5, 99.5)
"""Percentiles of brightness that are shown black and white."""
_TICKS = 12
"""Most labels on the axis of iterations."""


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
    """Cost by type of factor over the iterations, and the sum, on a logarithmic axis."""
    kinds = list(dict.fromkeys(kind for step in convergence for kind in step))
    steps = np.arange(len(convergence))
    cost = {kind: np.array([step.get(kind, np.nan) for step in convergence], float) for kind in kinds}
    with style():
        figure, grid = panels(1, 1, 5.2, 0.6, (0.0, 0.0), (0.7, 1.4, 0.5, 0.15))
        axes = grid[0, 0]
        total = np.nansum(list(cost.values()), axis=0)
        axes.plot(steps, total, color="black", lw=2.2, marker="o", ms=4, label="sum")
        for kind, values in cost.items():
            if (values > 0).any():
                axes.plot(steps, np.where(values > 0, values, np.nan), marker=".", lw=1.2, label=kind)
        axes.set_yscale("log")
        axes.set_xticks(steps[:: max(1, len(steps) // _TICKS)])
        axes.set_xlabel("iteration")
        axes.set_ylabel("cost [-]")
        axes.grid(alpha=0.25)
        axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
        return save(figure, path)
