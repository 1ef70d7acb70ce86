"""Pairs to match: the most similar views; no view fails to register because of it."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.sfm import reconstruct_sparse
from photoclinometry.sfm.keypoints import sift_keypoints
from photoclinometry.sfm.pairs import (
    FEW_PARTNERS,
    PREVIEWED,
    RICH,
    all_pairs,
    pair_similarities,
    pairs_between,
    select_pairs,
)
from photoclinometry.sfm.pictures import brightness_picture
from sparse_views import CAMERA, OPTIONS, lit_site, painted_site, rotation_errors_deg

SIMILARITY = np.array([[0, 9, 8, 1], [9, 0, 2, 7], [8, 2, 0, 0], [1, 7, 0, 0]])


def test_each_view_is_matched_with_those_most_like_it():
    """With one partner each: 0 and 1 choose each other, 2 chooses 0, 3 chooses 1."""
    assert select_pairs(SIMILARITY, 1) == [(1, 0), (2, 0), (3, 1)]
    assert select_pairs(SIMILARITY + 99 * np.eye(4, dtype=int), 1) == [(1, 0), (2, 0), (3, 1)]


def test_few_views_are_all_matched():
    assert select_pairs(SIMILARITY, 3) == select_pairs(SIMILARITY, 20) == all_pairs(4)
    assert len(all_pairs(4)) == 6


@pytest.mark.parametrize(("eighth", "partners"), [(RICH, FEW_PARTNERS), (RICH - 1, 10)])
def test_eight_partners_are_enough_for_a_view_that_matches_them_well(eighth, partners):
    """View 0 is chosen by none of the others, and chooses eight where its eighth best match is good, else ten."""
    similarity = np.full((12, 12), RICH - 1)
    similarity[1:, 0] = -1
    similarity[0, 1:FEW_PARTNERS] = RICH + 5
    similarity[0, FEW_PARTNERS] = eighth
    pairs = select_pairs(similarity, 10)
    assert sum(0 in pair for pair in pairs) == partners
    assert [pair for pair in pairs if 0 not in pair] == [pair for pair in all_pairs(12) if 0 not in pair]


def test_models_are_paired_by_their_most_similar_views_and_lone_views_with_all():
    """Models of views 0, 1 and of 2, 3; 4 is in none. Of the other model 2 is most like 0, 3 most like 1."""
    similarity = np.zeros((5, 5), int)
    similarity[:4, :4] = SIMILARITY
    places = [np.array([0, 1]), np.array([2, 3])]
    lone = [(4, 0), (4, 1), (4, 2), (4, 3)]
    assert pairs_between(places, similarity, 1) == [(2, 0), (3, 1), *lone]
    assert pairs_between(places, similarity, 2) == [(2, 0), (2, 1), (3, 0), (3, 1), *lone]
    assert pairs_between([np.arange(4)], similarity, 1) == lone
    assert pairs_between([np.arange(5)], similarity, 1) == []


def test_likeness_counts_matching_descriptors():
    """Of a view that has 30 descriptors in common with another, the others drawn at random."""
    rng = np.random.default_rng(0)

    def view(descriptors):
        return np.zeros((len(descriptors), 4), np.float32), descriptors

    own = rng.integers(0, 90, (80, 128), np.uint8)
    other = np.concatenate([rng.integers(0, 90, (50, 128), np.uint8), own[:30]])
    nothing = np.zeros((0, 128), np.uint8)
    similarity = pair_similarities([view(own), view(other), view(nothing)], 0.8)
    np.testing.assert_array_equal(similarity, [[0, 30, 0], [30, 0, 0], [0, 0, 0]])


def test_only_the_largest_keypoints_are_compared():
    rng = np.random.default_rng(1)
    descriptors = rng.integers(0, 90, (PREVIEWED + 40, 128), np.uint8)
    keypoints = np.zeros((len(descriptors), 4), np.float32)
    keypoints[40:, 2] = 3.0
    assert pair_similarities([(keypoints, descriptors)] * 2, 0.8)[0, 1] == PREVIEWED


@pytest.fixture(scope="module")
def two_places():
    return painted_site(count=5)[0] + painted_site(count=3, seed=7, prefix="b")[0]


def test_views_of_one_place_look_more_alike_than_those_of_two(two_places):
    similarity = pair_similarities([sift_keypoints(brightness_picture(i), i.valid, 1500) for i in two_places], 0.8)
    same = np.equal.outer(np.arange(8) < 5, np.arange(8) < 5) & ~np.eye(8, dtype=bool)
    other = similarity[np.arange(8) < 5][:, 5:]
    assert similarity[same].min() > 5 * max(other.max(), 1)


def test_few_partners_lose_no_view(tmp_path, caplog):
    images, true = painted_site(count=6)
    with caplog.at_level(logging.INFO):
        found = reconstruct_sparse(images, [CAMERA] * 6, tmp_path, replace(OPTIONS, partners=2))
    assert "9 of 9 pairs match" in caplog.text  # of 15
    assert found.registered.all()
    assert rotation_errors_deg(found.body_from_cam, true).max() < 0.3


def test_views_of_two_models_are_matched_with_each_other(tmp_path, caplog):
    """Two Suns, three views under each: a view's two partners have its own Sun, and no pair links the two groups."""
    images, _, true = lit_site([20, 22, 24, 42, 44, 46])
    with caplog.at_level(logging.INFO):
        found = reconstruct_sparse(images, [CAMERA] * 6, tmp_path, replace(OPTIONS, partners=2))
    assert "6 of 6 pairs match" in caplog.text
    assert "2 models; 8 more pairs of views are matched" in caplog.text
    assert found.registered.all()
    assert rotation_errors_deg(found.body_from_cam, true).max() < 0.5
