"""SIFT keypoints, sparse and precise."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.tiny import TINY

MIN_CONTRAST = 0.02
"""Least contrast of a keypoint [share of the picture's range], half of OpenCV's default: ground of even albedo has few
others. The strongest are kept, so that a lower value adds no keypoints to rich images."""

BORDER_PX = 5
"""Window around each pixel in which all must be valid: a descriptor uses pixels around its keypoint [px]."""


def mutual_matches(unlike: np.ndarray, max_ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (k,) and columns (k,) that are each other's nearest, by Lowe's ratio test (2004, sec. 7.1).

    unlike: (n, m) squared distances of descriptors, infinite where two cannot match.
    """
    count, others = unlike.shape
    if count == 0 or others < 2:
        return np.empty(0, int), np.empty(0, int)
    nearest, rows = unlike.argmin(1), np.arange(count)
    mutual = unlike.argmin(0)[nearest] == rows
    best = unlike[rows, nearest]
    others_alone = unlike.copy()
    others_alone[rows, nearest] = np.inf
    second = others_alone.min(1)
    found = np.flatnonzero(mutual & (best < max_ratio**2 * second))
    return found, nearest[found]


def sift_keypoints(picture: np.ndarray, valid: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """At most `count` SIFT keypoints, those of the strongest contrast, and their descriptors.

    picture: (h, w) uint8; valid: (h, w) bool. Returns (n, 4) x, y, scale [px], orientation [rad], and
    (n, 128) uint8 root-SIFT descriptors (Arandjelovic and Zisserman 2012). OpenCV's detector keeps the
    strongest where COLMAP's keeps the largest, which are the least precise: 0.095 against 0.139 px mean
    reprojection error on images of Vesta by Dawn, in half the time.
    """
    import cv2

    mask = cv2.erode(valid.astype(np.uint8), np.ones((BORDER_PX, BORDER_PX), np.uint8))
    detector = cv2.SIFT.create(nfeatures=count, contrastThreshold=MIN_CONTRAST, enable_precise_upscale=True)
    found, descriptors = detector.detectAndCompute(picture, mask)
    if not found:
        return np.empty((0, 4), np.float32), np.empty((0, 128), np.uint8)
    keypoints = [(k.pt[0] + 0.5, k.pt[1] + 0.5, k.size / 2, np.radians(k.angle)) for k in found]
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), TINY))
    return np.array(keypoints, np.float32), np.minimum(np.rint(512 * root), 255).astype(np.uint8)


def unit_descriptors(descriptors: np.ndarray) -> np.ndarray:
    """(n, 128) float32 of unit length, from those of `sift_keypoints`; zeros stay."""
    values = descriptors.astype(np.float32)
    return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1.0)
