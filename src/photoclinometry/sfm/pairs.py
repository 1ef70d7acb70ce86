"""Choice of the pairs of views that are matched: each view with those most similar to it in a preview by a few
keypoints.

Matching a pair takes 0.1 to 0.2 s, and the number of pairs grows with the square of the number of views. Comparing the
largest keypoints alone, which are seen again most often, takes 4 ms (preemptive matching, Wu 2013, "Towards linear-time
incremental structure from motion", 3DV). The preview finds overlap and similar light together: views of other ground,
or under a different Sun, match little.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photoclinometry.sfm.keypoints import mutual_matches, unit_descriptors

PREVIEWED = 512
"""Largest keypoints of each view that are compared: enough to rank the pairs, a tenth of the default number."""

FEW_PARTNERS, RICH = 8, PREVIEWED // 5
"""Number of partners that suffices if the last of them still matches a fifth of the previewed keypoints: with a
thousand matches each, eight views constrain a ninth as well as twenty do. Views of bodies, whose eighth best pair has 7
to 25 matches, keep all their partners; at full size (29 views of one place) that pair has 137 to 275."""


def all_pairs(count: int) -> list[tuple[int, int]]:
    """(a, b) with b < a < count."""
    return [(a, b) for a in range(count) for b in range(a)]


def select_pairs(similarity: np.ndarray, partners: int) -> list[tuple[int, int]]:
    """Pairs of views of which one is among the `partners` most similar ones of the other; all pairs of fewer views.

    FEW_PARTNERS are enough for a view that matches all of them well (RICH). similarity: (K, K), as of
    `pair_similarities`; its diagonal is ignored.
    """
    count = len(similarity)
    similarity = np.where(np.eye(count, dtype=bool), -1, similarity)
    chosen = _most_alike(similarity, partners)
    if count > FEW_PARTNERS:
        rich = np.sort(similarity, axis=1)[:, -FEW_PARTNERS] >= RICH
        chosen[rich] &= _most_alike(similarity, FEW_PARTNERS)[rich]
    return [(a, b) for a, b in all_pairs(count) if chosen[a, b] or chosen[b, a]]


def pairs_between(places: Sequence[np.ndarray], similarity: np.ndarray, partners: int) -> list[tuple[int, int]]:
    """Pairs (a, b), b < a, that may join several models, and views that are in none.

    places: the views of each model; similarity: (K, K), as of `pair_similarities`. Views in none are paired with all
    others, views of a model with the `partners` most similar ones that are in no model with them.
    """
    count = len(similarity)
    together = np.zeros((count, count), bool)
    for views in places:
        together[np.ix_(views, views)] = True
    chosen = _most_alike(np.where(together, -1, similarity), partners) | ~np.diag(together)[:, None]
    return [(a, b) for a, b in all_pairs(count) if (chosen[a, b] or chosen[b, a]) and not together[a, b]]


def _most_alike(similarity: np.ndarray, partners: int) -> np.ndarray:
    """(K, K) bool: the `partners` most similar views of each, in its row."""
    chosen = np.zeros(similarity.shape, bool)
    np.put_along_axis(chosen, np.argsort(-similarity, axis=1, kind="stable")[:, :partners], True, axis=1)
    return chosen


def pair_similarities(keypoints: list[tuple[np.ndarray, np.ndarray]], max_ratio: float) -> np.ndarray:
    """(K, K) number of matches between the largest keypoints of two views: mutual nearest, by Lowe's ratio test.

    keypoints: for each view, keypoints (n, 4) and descriptors (n, 128), as of `sift_keypoints`.
    """
    previews = [_preview(*view) for view in keypoints]
    similarity = np.zeros((len(previews),) * 2, int)
    for a, b in all_pairs(len(previews)):
        similarity[a, b] = similarity[b, a] = _matches(previews[a], previews[b], max_ratio)
    return similarity


def _preview(keypoints: np.ndarray, descriptors: np.ndarray) -> np.ndarray:
    """(m, 128) unit descriptors of the largest keypoints."""
    largest = np.argsort(-keypoints[:, 2], kind="stable")[:PREVIEWED]
    return unit_descriptors(descriptors[largest])


def _matches(a: np.ndarray, b: np.ndarray, max_ratio: float) -> int:
    return len(mutual_matches(1.0 - a @ b.T, max_ratio)[0])
