"""The figures of every method on the same pixels of the same images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photoclinometry.evaluate.compare import evaluate_against_map, evaluate_against_truth
from photoclinometry.evaluate.metrics import psnr
from photoclinometry.io.reference import Reference
from photoclinometry.model.image import Image
from photoclinometry.model.scene import Scene
from photoclinometry.rivals.outcome import Outcome
from photoclinometry.rivals.problem import Problem
from photoclinometry.rivals.ssim import ssim
from photoclinometry.simulate.truth import Truth

EDGE_PX = 2
"""Pixels within this of the map's edge are not compared: there a splat has neighbours on one side alone."""

MAP_FIGURES = ("surface_distance_mean_gsd", "normal_error_mean_deg", "albedo_error_mean_percent")
"""Figures of `phomo evaluate` that a method has of its map."""


def common_masks(problem: Problem, outcomes: Sequence[Outcome]) -> list[np.ndarray]:
    """(K + H,) of (height, width) bool: pixels of each image that the run's map and all methods cover."""
    from scipy.ndimage import binary_erosion

    masks = []
    for k, footprint in enumerate(problem.footprint):
        inner = binary_erosion(footprint, iterations=EDGE_PX)
        masks.append(np.logical_and.reduce([inner, *(outcome.covered[k] for outcome in outcomes)]))
    return masks


def exposed(outcome: Outcome, view: int, image: Image, mask: np.ndarray) -> np.ndarray:
    """The prediction (height, width) of a view; of methods that do not know the light, after the gain and offset of
    least squares on the image itself."""
    rendered = outcome.rendered[view]
    if outcome.knows_light or np.count_nonzero(mask) < 2 or np.ptp(rendered[mask]) == 0:
        return rendered
    gain, offset = np.polyfit(rendered[mask], image.brightness[mask].astype(float), 1)
    return gain * rendered + offset


def image_figures(problem: Problem, outcome: Outcome, masks: Sequence[np.ndarray]) -> dict[str, float]:
    """PSNR (Eq. 40), SSIM and error of views of a method, means over the views used and over those held out.

    The error of a view is the RMS residual of its pixels over their mean brightness, as Eq. 39 is of a landmark's
    observations. coverage: share of the map's pixels that the method covers.
    """
    parts = {"": slice(0, problem.train), "_held_out": slice(problem.train, None)}
    rows = [_view_figures(problem, outcome, k, mask) for k, mask in enumerate(masks)]
    found: dict[str, float] = {}
    for name, part in parts.items():
        for key in ("psnr{}_mean_db", "ssim{}_mean", "view_error{}_mean_percent"):
            values = [row[key] for row in rows[part] if np.isfinite(row[key])]
            if values:
                found[key.format(name)] = float(np.mean(values))
    seen = sum(int((f & c).sum()) for f, c in zip(problem.footprint, outcome.covered, strict=True))
    return found | {"coverage_percent": 100.0 * seen / max(1, sum(int(f.sum()) for f in problem.footprint))}


def _view_figures(problem: Problem, outcome: Outcome, k: int, mask: np.ndarray) -> dict[str, float]:
    image = problem.images[k]
    brightness = image.brightness.astype(float)
    peak = float(brightness[image.valid].max())
    rendered = exposed(outcome, k, image, mask)
    rms = np.sqrt(np.mean((rendered[mask] - brightness[mask]) ** 2)) if mask.any() else np.nan
    return {
        "psnr{}_mean_db": psnr(brightness, rendered, mask, peak),
        "ssim{}_mean": ssim(rendered / peak, brightness / peak, mask),
        "view_error{}_mean_percent": 100.0 * float(rms / brightness[mask].mean()) if mask.any() else np.nan,
    }


def map_figures(scene: Scene | None, truth: Truth | None, reference: Reference | None, unit: str) -> dict[str, float]:
    """`MAP_FIGURES` of a method's map against the truth or another map; empty without a map, or either."""
    if scene is None or (truth is None and reference is None):
        return {}
    if truth is not None:
        metrics = evaluate_against_truth(scene, truth).metrics
    else:
        assert reference is not None
        metrics = evaluate_against_map(
            scene, reference.surface, names=reference.names, body_from_cam=reference.body_from_cam, unit=unit
        ).metrics
    return {key: metrics[key] for key in MAP_FIGURES if key in metrics}
