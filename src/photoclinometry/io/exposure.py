"""What one exposure shows: where it is dark sky, and whether it shows anything at all."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.scene import Image


def off_body_mask(image: Image) -> np.ndarray:
    """(h, w) bool: dark sky. All False where the image shows none.

    Sky is as dark as the darkest part of the image's edge, reaches the edge, makes up at least 0.5 % of the
    image, and is a plateau: a dark spot of ground would rise gently at its rim and show texture. A shadow is
    taken for sky only if it reaches the edge or the sky: nothing in one image can tell the two apart there,
    and neither has a brightness worth measuring.
    """
    import cv2

    sky = np.zeros(image.valid.shape, bool)
    if image.valid.sum() < 100:
        return sky
    dark, bright = np.percentile(image.brightness[image.valid], [0.1, 99.0])
    contrast = bright - dark
    edge = np.ones(image.valid.shape, bool)
    edge[2:-2, 2:-2] = False
    samples = image.brightness[edge & image.valid]
    samples = samples[samples < dark + 0.1 * contrast]
    if len(samples) < 20:
        return sky

    # The level and noise of the sky, from the dark part of the edge.
    level = np.median(samples)
    noise = 1.4826 * np.median(np.abs(samples - level))
    tolerance = min(max(5.0 * noise, 0.01 * contrast), 0.1 * contrast)
    candidate = ((image.brightness <= level + tolerance) | ~image.valid).astype(np.uint8)
    candidate = cv2.morphologyEx(candidate, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))

    # Large pieces that touch the edge and are plateaus.
    count, label, statistics, _ = cv2.connectedComponentsWithStats(candidate, connectivity=4)
    label = np.asarray(label)
    for piece in np.intersect1d(label[edge], np.arange(1, count)):
        area = statistics[piece, cv2.CC_STAT_AREA]
        inside = (label == piece) & image.valid
        if area >= 0.005 * inside.size and _is_plateau(image, inside, level + tolerance, tolerance, contrast):
            sky |= inside
    return sky


def _is_plateau(image: Image, inside: np.ndarray, top: float, tolerance: float, contrast: float) -> bool:
    """Whether the pixels `inside` (h, w), all below `top`, are flat with a steep rim.

    Flat: their spread is white noise or below 0.5 % of the contrast. Steep: around them, few pixels are only a
    little brighter (a gentle valley has about as many up to 2 tolerances above as below).
    """
    import cv2

    reach = max(5.0, 0.5 * np.sqrt(inside.sum()))
    near = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, 3) < reach
    rim = near & ~inside & image.valid & (image.brightness > top) & (image.brightness <= top + 2.0 * tolerance)
    if rim.sum() > 0.3 * inside.sum():
        return False
    core = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8)) == 1
    pair = core[:, 1:] & core[:, :-1]
    if pair.sum() < 20:
        return False
    spread = np.std(image.brightness[core])
    white = np.std((image.brightness[:, 1:] - image.brightness[:, :-1])[pair]) / np.sqrt(2.0)
    return bool(spread <= max(1.5 * white, 0.005 * contrast))


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
