"""The figures of a study, after the paper's Figs. 8, 9, 11, 13 and 14, with the truth instead of its baselines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from photoclinometry.evaluate.compare import Comparison
from photoclinometry.evaluate.evaluate import landmark_photometric_error
from photoclinometry.model.reflectance import published
from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.draw import (
    add_bar,
    bare,
    colour_map,
    limits,
    panels,
    save,
    set_missing,
    show_map,
    style,
    symmetric_limits,
)
from photoclinometry.output.figures.maps import normal_colours
from photoclinometry.output.report.maps import draw_relit
from photoclinometry.rivals.compare import RIVALS_FIGURE
from photoclinometry.study.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COUNTERPART = {"akimov": "akimov+", "mcewen": "lunar-lambert"}
"""For models without a phase function, the paper's model with the same disk function and one."""
_ERROR_PERCENT = 98.0
"""Percentile of errors at which a colour scale ends."""
_WHOLE_ROW = 0.9
"""Share of landmarks in a row from which a scan along it is shown."""
CELL_FIGURES = (
    ("errors.png", "Fig. 8: errors of albedo, normals and surface against truth."),
    ("map.png", "Fig. 9: albedo, normals (bright: facing up, orange: right, blue: left), photometric error."),
    ("relit.png", "Fig. 13: the map under other Suns."),
    (RIVALS_FIGURE, "The run and its rivals: a view used and one held out, predictions, and differences."),
)


def draw_cell(folder: Path, scene: Scene, found: Comparison) -> None:
    """The figures of one run (`CELL_FIGURES`), but for that of its rivals."""
    draw_errors(folder / "errors.png", found)
    if scene.reflectance is not None:
        draw_map(folder / "map.png", scene)
        draw_relit(folder / "relit.png", scene)


_Panel = tuple[str, str, np.ndarray, str, tuple[float, float] | None]
"""Title, unit, values, colours and limits of one map."""


def draw_errors(path: Path, found: Comparison) -> Path:
    """Errors of albedo, normals and surface against the truth, side by side (Fig. 8)."""
    scene = found.aligned
    distance = scene.grid(found.errors["surface_distance_m"])
    shown: list[_Panel] = [("Normal error", "degrees", scene.grid(found.errors["normal_error_deg"]), "magma", None)]
    shown.append(("Distance to the true surface", "m", distance, "RdBu_r", symmetric_limits(distance, _ERROR_PERCENT)))
    if "albedo_error_percent" in found.errors:
        shown.insert(0, ("Albedo error", "%", scene.grid(found.errors["albedo_error_percent"]), "magma", None))
    with style():
        aspect = scene.region.height / scene.region.width
        figure, axes = panels(1, len(shown), 3.2, aspect, (1.65, 0.0), (0.6, 1.0, 0.5, 0.3))
        set_missing(axes)
        for panel, (title, unit, values, cmap, clim) in zip(axes[0], shown, strict=True):
            clim = limits(values, high=_ERROR_PERCENT, zero=True) if clim is None else clim
            show_map(panel, values, scene.region, title, label=unit, cmap=cmap, clim=clim)
        return save(figure, path)


def draw_map(path: Path, scene: Scene) -> Path:
    """Albedo, normals and photometric error (Fig. 9)."""
    percent = 100.0 * scene.grid(landmark_photometric_error(scene))
    with style():
        aspect = scene.region.height / scene.region.width
        figure, axes = panels(1, 3, 3.2, aspect, (1.65, 0.0), (0.6, 1.0, 0.5, 0.3))
        set_missing(axes)
        label = "normal albedo" if scene.brightness == "iof" else "relative albedo"
        show_map(axes[0, 0], scene.grid(scene.landmarks.albedo), scene.region, "Albedo", label=label)
        show_map(axes[0, 1], normal_colours(scene), scene.region, "Normals")
        clim = limits(percent, high=_ERROR_PERCENT, zero=True)
        title = "Photometric error (Eq. 39)"
        show_map(axes[0, 2], percent, scene.region, title, label="%", cmap="magma", clim=clim)
        return save(figure, path)


def draw_heights(path: Path, without: Record, with_it: Record) -> Path:
    """True heights, height errors without and with photometry, and a scan along one row (Fig. 11).

    The scan is along the row with the largest relief. Gaps are landmarks missing in either map.
    """
    truth, records = with_it.arrays["true_height"], (without, with_it)
    errors = [record.arrays["height"] - record.arrays["true_height"] for record in records]
    titles = ("Height error, geometry alone", f"Height error, {with_it.cell.model}")
    row = scan_row(truth)
    with style():
        aspect = truth.shape[0] / truth.shape[1]
        height = 3.2 * float(np.clip(aspect, 0.3, 2.0))
        figure, axes = panels(1, 3, 3.2, aspect, (1.05, 0.0), (0.65, 0.85, 3.9, 0.3))
        shown = bare(axes[0, 0], "True height").imshow(truth - np.nanmin(truth), cmap=colour_map("viridis"))
        add_bar(axes[0, 0], shown, truth - np.nanmin(truth), "m")
        low, high = symmetric_limits(np.stack([np.ravel(errors[0])]), _ERROR_PERCENT)
        for panel, title, error in zip(axes[0, 1:], titles, errors, strict=True):
            mean = f"{title}: mean {np.nanmean(np.abs(error)):.2f} m"
            shown = bare(panel, mean).imshow(error, cmap=colour_map("RdBu_r"), vmin=low, vmax=high)
            add_bar(panel, shown, error, "m")
        for panel in axes[0]:
            panel.axhline(row, color="black", lw=0.8, ls="--")
        _draw_scan(figure, 0.3 + height, truth, records, errors, row)
        return save(figure, path)


def _draw_scan(
    figure: Figure,
    top: float,
    truth: np.ndarray,
    records: Sequence[Record],
    errors: Sequence[np.ndarray],
    row: int,
) -> None:
    """Heights and their errors along a row, from `top` inches below the figure's upper edge."""
    width, full = figure.get_size_inches()
    along = np.arange(truth.shape[1]) * float(records[1].arrays["spacing"]) / 1000.0
    names = ("geometry alone", records[1].cell.model)
    for place, (high, label) in enumerate(((1.55, "height [m]"), (1.2, "error [m]"))):
        bottom = full - top - 0.45 - 1.55 - place * (1.2 + 0.15)
        axes = figure.add_axes((0.65 / width, bottom / full, 1.0 - 1.5 / width, high / full))
        base = np.nanmin(truth)
        for name, record, error, colour in zip(names, records, errors, ("tab:orange", "tab:blue"), strict=True):
            values = error[row] if place else record.arrays["height"][row] - base
            axes.plot(along, values, lw=1.2, color=colour, label=name)
        axes.plot(along, 0.0 * along if place else truth[row] - base, lw=1.0, color="black", label="truth")
        axes.set_ylabel(label)
        axes.set_xlim(along[0], along[-1])
        if place:
            axes.set_xlabel("along the dashed row [km]")
        else:
            axes.set_xticklabels([])
            axes.legend(frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 0.98))


def scan_row(height: np.ndarray) -> int:
    """The row of heights (h, w) with the greatest relief, among the rows with at least nine tenths of the landmarks."""
    present = np.isfinite(height)
    whole = present.mean(1) >= min(_WHOLE_ROW, present.mean(1).max())
    relief = np.where(present, height, -np.inf).max(1) - np.where(present, height, np.inf).min(1)
    relief[~whole] = -np.inf
    return int(relief.argmax())


def draw_scales(path: Path, records: Sequence[Record], body: str) -> Path:
    """Scale of every image against its phase angle, for models without a phase function (Fig. 14).

    The line is the published phase function of each model's COUNTERPART, or a constant if the ground was simulated
    without a phase function. The scales share a factor with the albedos, which is chosen so that their median lies on
    the line.
    """
    with style():
        figure, axes = panels(1, len(records), 3.6, 0.75, (0.75, 0.0), (0.65, 0.15, 0.5, 0.3))
        for panel, record in zip(axes[0], records, strict=True):
            phase, scale = np.asarray(record.arrays["phase"]), np.asarray(record.arrays["scale"])
            angle = np.linspace(0.9 * phase.min(), 1.05 * phase.max(), 100)
            panel.set_title(f"{record.cell.model}: scale of each image")
            curve, name = _expected_scale(record, body)
            scale = scale * np.median(curve(phase) / scale)
            panel.plot(np.degrees(angle), curve(angle), color="black", label=name)
            panel.set_ylim(0.8 * min(scale.min(), curve(angle).min()), 1.3 * max(scale.max(), curve(angle).max()))
            panel.legend(frameon=False, loc="upper right")
            panel.plot(np.degrees(phase), scale, "o", ms=4, color="tab:blue")
            panel.set_xlabel("phase angle [degrees]")
        axes[0, 0].set_ylabel("scale, common factor removed [-]")
        return save(figure, path)


def _expected_scale(record: Record, body: str) -> tuple[Callable[[np.ndarray], np.ndarray], str]:
    """The expected scale as a function of phase [rad], and its name."""
    ground = record.cell.simulation.reflectance
    if ground in COUNTERPART:
        return np.ones_like, f"the {ground} ground has no phase function"
    counterpart = COUNTERPART[record.cell.model]
    return published(counterpart, body).phase_function, f"phase function of {counterpart}"
