"""Shifts between a relit maplet and the images on its surface, by correlation, to a fraction of a pixel."""

from __future__ import annotations

import itertools

import numpy as np

from photoclinometry.model.sampling import filled_from_nearest, sample

SUBPIXEL_STEPS = 3
"""Gauss-Newton steps from the whole shift; each leaves a few per cent of what it finds."""
LEAST_SHARE = 0.7
"""A window with less than this share of its cells lit in both pictures is not correlated [-]."""


def correlation_shifts(
    template: np.ndarray, image: np.ndarray, cell: np.ndarray, window: int, reach: int, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Positions in the image of the template around given cells: shifts (n, 2) [cells, down and across], (n,) bool.

    The whole shift has the largest normalised correlation of windows (Gaskell et al. 2008), of all up to `reach`; the
    fraction is that of least squares, image(x + s) = gain template(x) + offset, which is the same maximum.

    template, image: (h, w), NaN where there is nothing to compare; cell: (n, 2) row and column; window: cells across,
    odd; least: correlation that counts as a match. False (and 0): less correlation, too few cells, or a shift beyond
    the search.
    """
    whole, best = _whole_shifts(template, image, cell, window, reach)
    good = best > least
    if not good.any():
        return np.zeros((len(cell), 2)), good
    shift, determined = _fractions(template, image, cell[good], window, whole[good])
    near = determined & (np.abs(shift - whole[good]) < 1.0).all(-1)
    found = np.zeros((len(cell), 2))
    found[np.flatnonzero(good)[near]] = shift[near]
    good[good] = near
    return found, good


def _whole_shifts(
    template: np.ndarray, image: np.ndarray, cell: np.ndarray, window: int, reach: int
) -> tuple[np.ndarray, np.ndarray]:
    """Whole shifts (n, 2) of the largest normalised correlation, and that (n,); -1 where too few cells are known."""
    from scipy.ndimage import uniform_filter

    shifts = list(itertools.product(range(-reach, reach + 1), repeat=2))
    found = np.empty((len(shifts), len(cell)))
    row, col = cell.T
    for n, (down, across) in enumerate(shifts):
        moved = _moved(image, down, across)
        both = np.isfinite(template) & np.isfinite(moved)
        t, m = np.where(both, template, 0.0), np.where(both, moved, 0.0)
        sums = (both.astype(float), t, m, t * t, m * m, t * m)
        share, st, sm, tt, mm, tm = (uniform_filter(x, window, mode="constant")[row, col] for x in sums)
        weight = np.maximum(share, 1e-12)
        t_mean, m_mean = st / weight, sm / weight
        t_var, m_var = tt / weight - t_mean**2, mm / weight - m_mean**2
        varied = (t_var > 1e-12 * t_mean**2) & (m_var > 1e-12 * m_mean**2)
        size = np.sqrt(np.where(varied, t_var * m_var, 1.0))
        found[n] = np.where((share > LEAST_SHARE) & varied, (tm / weight - t_mean * m_mean) / size, -1.0)
    return np.array(shifts, float)[found.argmax(0)], found.max(0)


def _moved(values: np.ndarray, down: int, across: int) -> np.ndarray:
    """values[r + down, c + across] at (r, c); NaN from beyond the edges."""
    height, width = values.shape
    rows, cols = np.arange(height) + down, np.arange(width) + across
    inside = ((rows >= 0) & (rows < height))[:, None] & ((cols >= 0) & (cols < width))[None]
    taken = values[np.clip(rows, 0, height - 1)[:, None], np.clip(cols, 0, width - 1)[None]]
    return np.where(inside, taken, np.nan)


def _fractions(
    template: np.ndarray, image: np.ndarray, cell: np.ndarray, window: int, whole: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shifts (n, 2) of least squares over windows, from whole ones, and (n,) bool: the window's relief fixes them."""
    half, (height, width) = window // 2, image.shape
    offset = np.stack(np.meshgrid(np.arange(-half, half + 1), np.arange(-half, half + 1), indexing="ij"), -1)
    at = cell[:, None] + offset.reshape(1, -1, 2)
    inside = (at >= 0).all(-1) & (at < (height, width)).all(-1)
    row, col = np.clip(at, 0, (height - 1, width - 1)).transpose(2, 0, 1)
    t = np.where(inside, template[row, col], np.nan)
    known = np.isfinite(image)
    filled = filled_from_nearest(np.where(known, image, 0.0), known)
    layers = np.stack([filled, *np.gradient(filled), known.astype(float)], -1)
    shift, determined = whole.copy(), np.ones(len(cell), bool)
    for _ in range(SUBPIXEL_STEPS):
        xy = (at + shift[:, None])[..., ::-1] + 0.5
        value = sample(layers[..., :1], xy)[..., 0]
        slope, there = sample(layers[..., 1:3], xy, order=1), sample(layers[..., 3], xy, order=1) > 0.999
        weight = (np.isfinite(t) & there).astype(float)
        level = np.where(weight > 0, t, 0.0)
        system = np.concatenate([slope, -level[..., None], -np.ones_like(level)[..., None]], -1) * weight[..., None]
        scale = np.linalg.norm(system, axis=1, keepdims=True)
        determined &= (scale > 0).all((1, 2))
        system = system / np.where(scale > 0, scale, 1.0)
        normal = np.einsum("nwi,nwj->nij", system, system)
        determined &= np.linalg.cond(normal) < 1e8
        right = -np.einsum("nwi,nw->ni", system, value * weight)
        normal = np.where(determined[:, None, None], normal, np.eye(4))
        step = np.linalg.solve(normal, right[..., None])[..., :2, 0] / np.where(scale > 0, scale, 1.0)[:, 0, :2]
        shift = np.where(determined[:, None], shift + np.clip(step, -1.0, 1.0), shift)
    return shift, determined
