"""Matches of views under very different light, sought where an affine map of the whole picture predicts them.

Among the nearest descriptors of two views under Suns a quarter turn apart, one to ten in a hundred are right. The five
matches that a two-view geometry needs are then never all right at once. But a single match of SIFT keypoints gives a
similarity of the pictures, by its positions, scales and orientations, and the similarities of right matches agree (Lowe
2004, doi:10.1023/B:VISI.0000029664.99615.94, sec. 7.3). In a narrow field of view, the ground of one picture maps to
the other by nearly an affine map, which is fitted to them. Among the few keypoints near the position that it predicts,
the most similar one is mostly right (guided matching, Hartley and Zisserman 2004, sec. 11.6). Relief shifts neighbours
by the same amount: matches that disagree with their neighbours are dropped, and all keypoints are matched again near
the positions that their neighbours predict.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.sfm.keypoints import mutual_matches, unit_descriptors

LOOSE_RATIO, STRICT_RATIO = 0.9, 0.8
"""Limits of Lowe's ratio test among all keypoints, and among near ones. Where light differs, the latter limit would
leave only one in three of the right matches, too few to agree."""

TURN_RAD, STRETCH, APART = np.radians(30.0), np.log(2.0), 0.25
"""Largest differences of a match from the similarity of another: in orientation, in the logarithm of scale, and in
position, as a share of the distance between the two. Lowe's widths of bins."""

TRIED = 500
"""Matches whose similarities are tried, evenly chosen: where one in a hundred is right, five of these are."""

FEWEST_AGREEING = 4
"""Fewest matches for an affine map: three always agree."""

REACH = 0.03
"""Largest shift of keypoints by relief from the positions by the affine map, as a share of the picture's side. On sites
whose views differ by 10 to 45 degrees relief shifts the ground by 1 to 3 per cent."""

NARROWING = (3.0, 2.0, 1.0, 1.0)
"""Largest distances of matches from successively fitted affine maps, in REACH: foreshortening causes larger differences
from the first similarity than relief does."""

NEIGHBOURS = 12
"""Number of nearest matches whose median shift predicts the position of a keypoint; up to half of them may be wrong."""

AGREE_SHARE = 1.0 / 3.0
"""Largest distance of a match from the position that its neighbours predict at which it agrees with them, as a share of
the distance within which it was sought."""

FEWEST_ALIKE, FEWEST_ALIKE_AGAIN = 0.25, 0.15
"""Least share of the matches that agree with their neighbours: for positions by the affine map, and for those by
neighbours. The latter is less clear, since more candidates are admitted. Of wrong matches, spread evenly over the area
of the search, one in nine agrees. Of 270 pairs of views of sites lit from all sides, wrong maps had 0 to 0.23, but for
one of 0.26, and right ones 0.18 to 0.98, all but 15 of 200 more than 0.25."""

GROWTH, PASSES = 1.1, 6
"""Keypoints are matched again near the positions that their neighbours predict, while that multiplies the number of
matches by at least the first of these numbers. The second is the largest number of passes. On flat ground the second
pass ends it. Between two views of a body the matches spread from the part where the affine map holds: of 100 images of
a body of two lobes, 256 px wide, 81 register instead of 67 with one pass."""

ROWS_AT_ONCE = 2000
"""Descriptors of the first view that are compared with all of the second at a time: 80 MB for 10,000."""


@dataclass(frozen=True, kw_only=True)
class Described:
    """The keypoints of a picture."""

    keypoints: np.ndarray
    """(n, 4) x, y, scale [px], orientation [rad], as of `sift_keypoints`."""
    descriptors: np.ndarray
    """(n, 128) float32 of unit length."""

    @property
    def xy(self) -> np.ndarray:
        """(n, 2) float64."""
        return self.keypoints[:, :2].astype(float)


def described(keypoints: np.ndarray, descriptors: np.ndarray) -> Described:
    """From keypoints (n, 4) and uint8 descriptors (n, 128), as of `sift_keypoints`."""
    return Described(keypoints=keypoints, descriptors=unit_descriptors(descriptors))


def guided_matches(first: Described, second: Described, side_px: float) -> np.ndarray:
    """(m, 2) indices of keypoints that match; none where the pictures do not show the same ground, or this is not
    clear.

    side_px: of the second picture, the root of its area.
    """
    nothing, reach = np.empty((0, 2), int), REACH * side_px
    rough = _rough_map(first, second, reach)
    if rough is None:
        return nothing
    leads = _moved(rough, first.xy)
    near = _matches_near(first, second, leads, reach, STRICT_RATIO)
    agree = _agree_with_neighbours(first, second, near, leads, reach)
    if np.count_nonzero(agree) <= NEIGHBOURS or np.mean(agree) < FEWEST_ALIKE:
        return nothing
    return _grown(first, second, near[agree], leads, reach / 2.0)


def _grown(first: Described, second: Described, near: np.ndarray, rough: np.ndarray, reach: float) -> np.ndarray:
    """All keypoints matched near the positions that the matches (m, 2) around them predict, repeated while that gives
    more.

    rough: (n, 2) positions by the affine map, which holds only in a part of the picture where ground is round.
    """
    for _ in range(PASSES):
        shift = second.xy[near[:, 1]] - rough[near[:, 0]]
        leads = rough + _median_nearby(first.xy[near[:, 0]], shift, first.xy)
        found = _matches_near(first, second, leads, reach, LOOSE_RATIO)
        agree = _agree_with_neighbours(first, second, found, leads, reach)
        if np.count_nonzero(agree) < FEWEST_ALIKE_AGAIN * len(agree):
            return np.empty((0, 2), int)
        before, near = len(near), found[agree]
        if len(near) < GROWTH * before or len(near) <= NEIGHBOURS:
            break
    return near


def _rough_map(first: Described, second: Described, reach: float) -> np.ndarray | None:
    """(3, 2) the affine map from the first picture to the second, of (x, y, 1), with which most matches agree within
    `reach` [px]."""
    one, other = _mutually_nearest(first, second)
    if len(one) < FEWEST_AGREEING:
        return None
    a, b = first.keypoints[one].astype(float), second.keypoints[other].astype(float)
    alike, agree = _agreeing_similarities(a, b, reach)
    best = int(np.argmax(agree.sum(axis=1)))
    chosen, found = agree[best], None
    for width in NARROWING:
        if np.count_nonzero(chosen) < FEWEST_AGREEING:
            return None
        found = np.linalg.lstsq(_homogeneous(a[chosen, :2]), b[chosen, :2], rcond=None)[0]
        off = np.linalg.norm(_moved(found, a[:, :2]) - b[:, :2], axis=1)
        chosen = alike[best] & (off < width * reach)
    return found if np.count_nonzero(chosen) >= FEWEST_AGREEING else None


def _agreeing_similarities(a: np.ndarray, b: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """(t, m) bool: whether matching keypoints a, b (m, 4) have the rotation and scale of those that are tried, and also
    lie at the positions that their similarities predict."""
    tried = np.arange(0, len(a), -(-len(a) // TRIED))
    stretch, turn = np.log(b[:, 2] / a[:, 2]), b[:, 3] - a[:, 3]
    turned = np.angle(np.exp(1j * (turn[tried, None] - turn)))
    alike = (np.abs(turned) < TURN_RAD) & (np.abs(stretch[tried, None] - stretch) < STRETCH)
    here, there = (each[:, 0] + 1j * each[:, 1] for each in (a, b))
    led = np.exp(stretch + 1j * turn)[tried, None] * (here - here[tried, None])
    off = np.abs(led - (there - there[tried, None]))
    return alike, alike & (off <= APART * np.abs(led) + reach)


def _mutually_nearest(first: Described, second: Described) -> tuple[np.ndarray, np.ndarray]:
    """Indices (m,) of keypoints of both whose descriptors are each other's nearest, by LOOSE_RATIO."""
    count, others = len(first.descriptors), len(second.descriptors)
    if count == 0 or others < 2:
        return np.empty(0, int), np.empty(0, int)
    found, least, row = [], np.full(others, np.inf), np.zeros(others, int)
    for start in range(0, count, ROWS_AT_ONCE):
        unlike = 1.0 - first.descriptors[start : start + ROWS_AT_ONCE] @ second.descriptors.T
        rows, columns = mutual_matches(unlike, LOOSE_RATIO)
        found.append((start + rows, columns))
        nearest = unlike.argmin(axis=0)
        value = unlike[nearest, np.arange(others)]
        row = np.where(value < least, start + nearest, row)
        least = np.minimum(value, least)
    rows, columns = (np.concatenate(part) for part in zip(*found, strict=True))
    mutual = row[columns] == rows
    return rows[mutual], columns[mutual]


def _matches_near(first: Described, second: Described, leads: np.ndarray, reach: float, max_ratio: float) -> np.ndarray:
    """(m, 2) keypoints whose descriptors are each other's nearest among those within `reach` [px] of `leads` (n, 2), by
    the ratio test."""
    from scipy.spatial import KDTree

    near = KDTree(leads).sparse_distance_matrix(KDTree(second.xy), reach, output_type="ndarray")
    one, other = near["i"], near["j"]
    unlike = 1.0 - np.einsum("nd,nd->n", first.descriptors[one], second.descriptors[other])
    order = np.lexsort((unlike, one))
    one, other, unlike = one[order], other[order], unlike[order]
    best = np.flatnonzero(np.diff(one, prepend=-1))
    following = np.minimum(best + 1, len(one) - 1)
    second_best = np.where((following > best) & (one[following] == one[best]), unlike[following], np.inf)
    least = np.full(len(second.keypoints), np.inf)
    np.minimum.at(least, other, unlike)
    kept = best[(unlike[best] <= least[other[best]]) & (unlike[best] < max_ratio**2 * second_best)]
    return np.stack([one[kept], other[kept]], axis=-1)


def _agree_with_neighbours(
    first: Described, second: Described, matches: np.ndarray, leads: np.ndarray, reach: float
) -> np.ndarray:
    """(m,) bool: matches (m, 2) whose shift from `leads` (n, 2) is that of the matches around them."""
    if len(matches) <= NEIGHBOURS:
        return np.zeros(len(matches), bool)
    xy, shift = first.xy[matches[:, 0]], second.xy[matches[:, 1]] - leads[matches[:, 0]]
    off = shift - _median_nearby(xy, shift, xy, without_itself=True)
    return np.linalg.norm(off, axis=1) < AGREE_SHARE * reach


def _median_nearby(xy: np.ndarray, values: np.ndarray, at: np.ndarray, *, without_itself: bool = False) -> np.ndarray:
    """(n, 2) the medians of values (m, 2) of the NEIGHBOURS points of xy (m, 2) nearest to points `at` (n, 2)."""
    from scipy.spatial import KDTree

    nearest = np.asarray(KDTree(xy).query(at, NEIGHBOURS + without_itself)[1])
    return np.median(values[nearest[:, int(without_itself) :]], axis=1)


def _moved(affine: np.ndarray, xy: np.ndarray) -> np.ndarray:
    return _homogeneous(xy) @ affine


def _homogeneous(xy: np.ndarray) -> np.ndarray:
    return np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
