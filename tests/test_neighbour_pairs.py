"""Which landmarks smoothness ties to each other."""

import numpy as np

from photoclinometry.adjust.groups import neighbour_pairs

SIDE = 8


def grid():
    """(64, 3) landmarks with a spacing of 1."""
    row, col = np.mgrid[:SIDE, :SIDE]
    return np.stack([col.ravel(), row.ravel(), np.zeros(SIDE * SIDE)], axis=-1).astype(float)


def pairs_of(position, nearest):
    found = neighbour_pairs(position, len(position), 4, nearest)
    return set(zip(found.source.tolist(), found.target.tolist(), strict=True))


def test_inner_landmarks_of_a_plane_have_the_four_beside_them():
    inner = 3 * SIDE + 3
    own = {target for source, target in pairs_of(grid(), 0.05) if source == inner}
    assert own == {inner - 1, inner + 1, inner - SIDE, inner + SIDE}


def test_a_landmark_that_a_match_put_upon_another_is_no_neighbour_of_it():
    """The direction between the two is that of the match's error. Both keep their other neighbours."""
    position, there, here = grid(), 3 * SIDE + 3, 3 * SIDE + 4
    position[here] = position[there] + [1e-3, 0.0, 2e-3]
    pairs, all_pairs = pairs_of(position, 0.05), pairs_of(position, 0.0)
    assert {(here, there), (there, here)} <= all_pairs
    assert all_pairs - pairs == {(here, there), (there, here)}


def test_tie_points_have_no_neighbours():
    found = neighbour_pairs(grid(), SIDE * SIDE - 10, 4, 0.05)
    assert found.source.max() < SIDE * SIDE - 10
    assert found.target.max() < SIDE * SIDE - 10
    assert len(found.start) == SIDE * SIDE + 1
