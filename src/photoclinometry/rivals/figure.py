"""The figure of a comparison: images, the prediction of each method, and the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photoclinometry.evaluate.metrics import psnr
from photoclinometry.model.image import Image
from photoclinometry.output.figures.draw import add_bar, bare, colour_map, limits, panels, save, style, symmetric_limits
from photoclinometry.rivals.measure import exposed
from photoclinometry.rivals.outcome import Outcome
from photoclinometry.rivals.problem import Problem

DIFFERENCE_PERCENT = 99.0
"""Percentile of the absolute differences of a view, over all methods, at which their colours end."""


def draw_comparison(path: Path, problem: Problem, outcomes: Sequence[Outcome], masks: Sequence[np.ndarray]) -> Path:
    """One view used and, where there is one, one held out: the image and the predictions, and below the differences.

    Of the views the one in the middle by the first method's PSNR is shown.
    """
    chosen = [_middle(problem, outcomes[0], masks, 0, problem.train)]
    if problem.held_out is not None:
        chosen.append(_middle(problem, outcomes[0], masks, problem.train, len(masks)))
    corners = [_box(masks[k]) for k in chosen]
    aspect = max((box[0].stop - box[0].start) / (box[1].stop - box[1].start) for box in corners)
    with style():
        rows, cols = 2 * len(chosen), 1 + len(outcomes)
        figure, axes = panels(rows, cols, 1.75, aspect, (0.12, 0.28), (0.2, 0.95, 0.1, 0.4))
        for n, (k, box) in enumerate(zip(chosen, corners, strict=True)):
            _draw_view(axes[2 * n : 2 * n + 2], problem, outcomes, k, masks[k], box)
        return save(figure, path)


def _draw_view(
    axes: np.ndarray,
    problem: Problem,
    outcomes: Sequence[Outcome],
    k: int,
    mask: np.ndarray,
    box: tuple[slice, slice],
) -> None:
    """Two rows of panels (2, 1 + n): predictions and differences of one view, cut out at `box`."""
    image = problem.images[k]
    brightness, peak = image.brightness.astype(float), float(image.brightness[image.valid].max())
    pictures = [exposed(outcome, k, image, mask) for outcome in outcomes]
    low, high = limits(np.where(mask, brightness, np.nan), 0.5, 99.5)
    under, over = symmetric_limits((np.stack(pictures) - brightness)[:, mask], DIFFERENCE_PERCENT)
    what = "used" if k < problem.train else "held out"
    shown: list[tuple[str, np.ndarray, np.ndarray | None]] = [(f"{Path(image.name).name}, {what}", brightness, None)]
    for outcome, picture in zip(outcomes, pictures, strict=True):
        title = f"{outcome.name}: {psnr(brightness, picture, mask, peak):.1f} dB"
        shown.append((title, picture, picture - brightness))
    grey, difference = None, None
    for column, (title, picture, off) in enumerate(shown):
        seen = np.ma.masked_invalid(np.where(mask, picture, np.nan)[box])
        grey = bare(axes[0, column], title).imshow(seen, cmap=colour_map("gray"), vmin=low, vmax=high)
        axes[0, column].title.set_fontsize(7.5)
        if off is None:
            bare(axes[1, column]).axis("off")
            continue
        seen = np.ma.masked_invalid(np.where(mask, off, np.nan)[box])
        difference = bare(axes[1, column]).imshow(seen, cmap=colour_map("RdBu_r"), vmin=under, vmax=over)
    axes[1, 0].text(0.98, 0.5, "prediction\nminus image", transform=axes[1, 0].transAxes, ha="right", va="center")
    unit = "I/F" if problem.scene.brightness == "iof" else "DN"
    add_bar(axes[0, -1], grey, brightness[mask], unit)
    add_bar(axes[1, -1], difference, np.concatenate([(p - brightness)[mask] for p in pictures]), unit)


def _middle(problem: Problem, outcome: Outcome, masks: Sequence[np.ndarray], start: int, stop: int) -> int:
    """Of the views from `start` up to `stop`, the one with the median PSNR."""
    found = []
    for k in range(start, stop):
        image: Image = problem.images[k]
        peak = float(image.brightness[image.valid].max())
        found.append(psnr(image.brightness.astype(float), exposed(outcome, k, image, masks[k]), masks[k], peak))
    return start + int(np.argsort(np.nan_to_num(found))[len(found) // 2])


def _box(mask: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns of a mask that hold anything; all of them if it is empty."""
    if not mask.any():
        return slice(0, mask.shape[0]), slice(0, mask.shape[1])
    rows, cols = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(cols[0]), int(cols[-1]) + 1)
