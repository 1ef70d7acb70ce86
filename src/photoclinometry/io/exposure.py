"""What one exposure shows: where it is dark sky, and whether it shows anything at all."""

from __future__ import annotations

import numpy as np

from photoclinometry.scene import Image


def off_body_mask(image: Image) -> np.ndarray:
    """(h, w) bool: dark sky. All False where the image shows none.

    Sky is what is as dark as the darkest part of the image's edge and connected to the edge, and makes up at
    least 0.5 % of the image. A shadow is sky only if it reaches the edge or the sky: nothing in one image
    can tell the two apart there, and neither has a brightness worth measuring.
    """
    import cv2

    nothing = np.zeros(image.valid.shape, bool)
    if image.valid.sum() < 100:
        return nothing
    dark, bright = np.percentile(image.brightness[image.valid], [0.1, 99.0])
    ceiling = dark + 0.1 * (bright - dark)
    edge = np.ones(image.valid.shape, bool)
    edge[2:-2, 2:-2] = False
    samples = image.brightness[edge & image.valid]
    samples = samples[samples < ceiling]
    if len(samples) < 20:
        return nothing

    # The level and noise of the sky, from the dark part of the edge.
    level = np.median(samples)
    noise = 1.4826 * np.median(np.abs(samples - level))
    threshold = min(level + max(5.0 * noise, 0.01 * (bright - dark)), ceiling)
    candidate = ((image.brightness <= threshold) | ~image.valid).astype(np.uint8)
    candidate = cv2.morphologyEx(candidate, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))

    # Large pieces that touch the edge.
    count, label, statistics, _ = cv2.connectedComponentsWithStats(candidate, connectivity=4)
    label = np.asarray(label, np.int64)
    large = statistics[:, cv2.CC_STAT_AREA] >= 0.005 * image.valid.size
    touching = np.zeros(count, bool)
    touching[np.unique(label[edge])] = True
    keep = large & touching
    keep[0] = False
    return keep[label] & image.valid


def shows_nothing(image: Image) -> bool:
    """Whether the image is constant, or white noise about a constant.

    Means over blocks of 8 x 8 pixels then spread over no more than their standard error allows.
    """
    seen = image.brightness[image.valid]
    if seen.min() == seen.max():
        return True
    low, high = np.percentile(seen, [0.1, 99.9])
    clipped = np.where(image.valid, np.clip(image.brightness, low, high), np.median(seen))
    height, width = (n // 8 * 8 for n in clipped.shape)
    if height * width == 0:
        return False
    noise = np.std(np.diff(clipped, axis=1)) / np.sqrt(2.0)
    means = clipped[:height, :width].reshape(height // 8, 8, width // 8, 8).mean((1, 3))
    return bool(np.ptp(means) <= 12.0 * noise / 8.0)
