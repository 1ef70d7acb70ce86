"""The images of a run as the viewer compares them with renderings: each view's neighbourhood of the map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from photoclinometry.model.image import Image
from photoclinometry.model.scene import Views
from photoclinometry.output.viewer.arrays import packed

LEVELS = 255
"""Steps from zero to the greatest brightness of a picture: off by 0.2 % of it at most, less than most images' noise."""
_AROUND = 0.03
"""Margin about the map, as a share of its width and height in the image."""
_MOST_PIXELS = 9_000_000
"""Of all pictures together; of more, blocks of pixels are averaged, so that these stay below some 8 MB."""


def pictures(views: Views, points: np.ndarray, images: Sequence[Image]) -> list[dict[str, Any] | None]:
    """One entry per view: place in the image [px], pixels per cell, and brightness; None where there is no image.

    points: (n, 3) of the ground that is shown.
    """
    by_name = {image.name: image for image in images}
    windows = [neighbourhood(views, k, points) if name in by_name else None for k, name in enumerate(views.name)]
    total = sum((w[1] - w[0]) * (w[3] - w[2]) for w in windows if w is not None)
    block = max(1, math.ceil(math.sqrt(total / _MOST_PIXELS)))
    return [
        None if window is None else _picture(by_name[name], window, block)
        for name, window in zip(views.name, windows, strict=True)
    ]


def neighbourhood(views: Views, view: int, points: np.ndarray) -> tuple[int, int, int, int] | None:
    """First and end row, first and end column of points with a margin in a view; None where they are outside."""
    camera = views.cameras[view]
    pixel = views.project(view, points)
    if not np.isfinite(pixel).all():
        return None
    low, high = pixel.min(axis=0), pixel.max(axis=0)
    margin = _AROUND * (high - low)
    first = np.maximum(np.floor(low - margin), 0).astype(int)
    end = np.minimum(np.ceil(high + margin), [camera.width, camera.height]).astype(int)
    if (end <= first).any():
        return None
    return int(first[1]), int(end[1]), int(first[0]), int(end[0])


def _picture(image: Image, window: tuple[int, int, int, int], block: int) -> dict[str, Any] | None:
    """The window of an image, blocks of `block` x `block` pixels averaged over those that are valid."""
    top, bottom, left, right = window
    rows, cols = (bottom - top) // block, (right - left) // block
    if rows == 0 or cols == 0:
        return None
    part = np.s_[top : top + rows * block, left : left + cols * block]
    valid = image.valid[part].reshape(rows, block, cols, block)
    bright = np.where(valid, image.brightness[part].reshape(rows, block, cols, block), 0.0)
    count = valid.sum(axis=(1, 3))
    values = np.where(count > 0, bright.sum(axis=(1, 3)) / np.maximum(count, 1), np.nan)
    peak = float(np.abs(values[count > 0]).max(initial=0.0))
    return {
        "row": top,
        "col": left,
        "rows": rows,
        "cols": cols,
        "block": block,
        "brightness": packed(values.ravel(), peak / LEVELS if peak > 0 else 1.0),
    }
