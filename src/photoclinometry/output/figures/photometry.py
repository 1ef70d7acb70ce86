"""A figure of reflectance models: phase curve, disk function, and what predictions of kept-out views miss."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from photoclinometry.evaluate.model_ranking import ModelFit, ModelRanking
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.robust import jackknife_sigma
from photoclinometry.output.figures.draw import panels, save, style

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Okabe and Ito's, which colour-blind readers can distinguish."""
CURVES = 3
"""Models whose curves are drawn: more hide each other."""
BINS, FEWEST_IN_BIN = 12, 30
"""Of the residuals by angle, and predictions that a bin's mean needs."""
BEYOND_DEG = 15.0
"""Range of the phase curve beyond the phases seen [degrees]."""
LIMB_DEG = 75.0
"""Greatest incidence and emission of the disk functions drawn [degrees]."""
_SEEN = {"color": "0.93", "lw": 0, "zorder": 0}


def draw_photometry(path: Path, ranking: ModelRanking) -> Path:
    """Six panels: errors, phase curves, disk functions, and residuals by incidence, emission and phase. PNG."""
    shown = ranking.fits[:CURVES]
    with style():
        figure, axes = panels(2, 3, 3.1, 0.72, (0.75, 0.75), (1.55, 0.15, 0.55, 0.35))
        _draw_errors(axes[0, 0], ranking)
        _draw_phase(axes[0, 1], shown)
        _draw_disk(axes[0, 2], shown)
        for column, (ax, name) in enumerate(zip(axes[1], ("incidence", "emission", "phase"), strict=True)):
            _draw_residuals(ax, shown, column)
            ax.set_xlabel(f"{name} [°]")
        axes[1, 0].set_ylabel("predicted - measured [%]")
        return save(figure, path)


def _draw_errors(ax: Axes, ranking: ModelRanking) -> None:
    """One bar for each model; hatched where kept-out views do not distinguish it from the best."""
    names = [fit.reflectance.name for fit in ranking.fits]
    for row, fit in enumerate(ranking.fits):
        hatch = "///" if ranking.is_as_good(fit) and row else ""
        ax.barh(row, fit.error_percent, color=COLOURS[row % len(COLOURS)], hatch=hatch, edgecolor="white")
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set_xlabel("error on kept-out views [%]")


def _draw_phase(ax: Axes, fits: Sequence[ModelFit]) -> None:
    """Phase functions, and their bands of one standard deviation by leaving parts of the views out."""
    least, most = fits[0].phases_seen_deg
    phase = np.linspace(max(0.0, least - BEYOND_DEG), min(180.0, most + BEYOND_DEG), 100)
    ax.axvspan(least, most, **_SEEN)
    middle = np.radians(0.5 * (least + most))

    def curve(model: Reflectance) -> np.ndarray:
        return model.phase_function(np.radians(phase)) / model.phase_function(np.array([middle]))

    for fit, colour in zip(fits, COLOURS, strict=False):
        line, sigma = curve(fit.reflectance), jackknife_sigma(np.array([curve(each) for each in fit.without_part]))
        ax.fill_between(phase, line - sigma, line + sigma, color=colour, alpha=0.25, lw=0)
        ax.plot(phase, line, color=colour, lw=1.2, label=fit.reflectance.name)
    ax.set_xlabel("phase [°]")
    ax.set_title("phase function, 1 amid those seen")
    ax.legend(frameon=False, fontsize=7)


def _draw_disk(ax: Axes, fits: Sequence[ModelFit]) -> None:
    """Brightness along the photometric equator, at the median phase, relative to that where both angles are equal."""
    phase = float(np.median(fits[0].predictions.angles_deg[:, 2]))
    longitude = np.linspace(phase - LIMB_DEG, LIMB_DEG, 100)
    mu0, mu = np.cos(np.radians(longitude - phase)), np.cos(np.radians(longitude))
    half = np.cos(np.radians(0.5 * phase))
    for fit, colour in zip(fits, COLOURS, strict=False):
        middle = float(fit.reflectance(half, half, np.radians(phase)))
        ax.plot(longitude, fit.reflectance(mu0, mu, np.radians(phase)) / middle, color=colour, lw=1.2)
    ax.axvline(0.5 * phase, color="0.8", lw=0.8, zorder=0)
    ax.set_xlabel("photometric longitude [°]")
    ax.set_title(f"across a sphere at phase {phase:.0f}°")


def _draw_residuals(ax: Axes, fits: Sequence[ModelFit], column: int) -> None:
    """Means by angle."""
    ax.axhline(0.0, color="0.6", lw=0.8)
    for fit, colour in zip(fits, COLOURS, strict=False):
        angle, residual = fit.predictions.angles_deg[:, column], 100.0 * fit.residual
        least, most = np.percentile(angle, [0.5, 99.5])
        edges = np.linspace(least, most, BINS + 1)
        place = np.digitize(angle, edges) - 1
        means = [
            (0.5 * (edges[k] + edges[k + 1]), residual[place == k].mean())
            for k in range(BINS)
            if np.count_nonzero(place == k) >= FEWEST_IN_BIN
        ]
        ax.plot(*np.array(means).reshape(-1, 2).T, color=colour, marker=".", lw=1.0)
