"""Guided matching: right matches among nine times as many wrong ones, none where there is nothing in common."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.errors import ReconstructionError
from photoclinometry.sfm import reconstruct, reconstruct_sparse
from photoclinometry.sfm.guided_matching import (
    LOOSE_RATIO,
    ROWS_AT_ONCE,
    Described,
    described,
    guided_matches,
)
from photoclinometry.sfm.keypoints import mutual_matches
from sparse_views import CAMERA, OPTIONS, lit_site, rotation_errors_deg

SIDE = 300.0
COUNT = 1200
TURN, STRETCH = np.radians(70.0), 1.3
FORESHORTENED = np.array([[1.0, 0.1], [0.0, 0.8]])
"""What emission does to a picture, beside turn and stretch."""


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def like(rng, descriptors, cosine):
    """Unit descriptors with this cosine to the given ones."""
    other = rng.normal(size=descriptors.shape)
    other = unit(other - np.sum(other * descriptors, -1, keepdims=True) * descriptors)
    return cosine * descriptors + np.sqrt(1.0 - cosine**2) * other


def ground_in_second(xy):
    """Where the ground at xy (n, 2) of the first picture is in the second: an affine map, and what relief shifts."""
    cosine, sine = STRETCH * np.cos(TURN), STRETCH * np.sin(TURN)
    relief = 4.0 * np.sin(2.0 * np.pi * xy[:, :1] / 150.0) * [1.0, 0.5]
    return (xy - SIDE / 2.0) @ FORESHORTENED.T @ np.array([[cosine, sine], [-sine, cosine]]) + SIDE / 2.0 + relief


def pictures(seed=0, *, in_common=True):
    """Keypoints of two pictures, those of the same ground first and in the same order.

    Of nine tenths of the first, the most alike in the second lies anywhere.
    """
    rng = np.random.default_rng(seed)
    xy, own = rng.uniform(0.0, SIDE, (COUNT, 2)), unit(rng.normal(size=(COUNT, 128)))
    angle = rng.uniform(-np.pi, np.pi, COUNT)
    first = np.column_stack([xy, np.full(COUNT, 2.0), angle])
    there = ground_in_second(xy) + 0.3 * rng.normal(size=(COUNT, 2))
    same = np.column_stack([there, np.full(COUNT, 2.0 * STRETCH), angle + TURN + 0.1 * rng.normal(size=COUNT)])
    decoys = COUNT * 9 // 10
    elsewhere = np.column_stack(
        [rng.uniform(0.0, SIDE, (decoys, 2)), np.full(decoys, 2.0), rng.uniform(-np.pi, np.pi, decoys)]
    )
    alike = like(rng, own, 0.8) if in_common else unit(rng.normal(size=own.shape))
    second = np.concatenate([same, elsewhere]), np.concatenate([alike, like(rng, own[:decoys], 0.9)])
    return Described(keypoints=first, descriptors=own.astype(np.float32)), Described(
        keypoints=second[0], descriptors=second[1].astype(np.float32)
    )


def share_right(matches):
    return np.mean(matches[:, 0] == matches[:, 1])


def test_right_matches_are_found_among_nine_times_as_many_wrong_ones():
    first, second = pictures()
    nearest = np.stack(mutual_matches(1.0 - first.descriptors @ second.descriptors.T, LOOSE_RATIO), axis=-1)
    assert share_right(nearest) < 0.15
    found = guided_matches(first, second, SIDE)
    assert len(found) > 0.8 * COUNT
    assert share_right(found) > 0.97


def test_matches_are_those_of_the_other_picture_too():
    """From the second to the first: turned, stretched and shifted the other way."""
    first, second = pictures(1)
    found = guided_matches(second, first, SIDE)
    assert len(found) > 0.6 * COUNT
    assert share_right(found) > 0.97


@pytest.mark.parametrize("seed", range(5))
def test_pictures_of_different_ground_do_not_match(seed):
    first, second = pictures(seed, in_common=False)
    assert len(guided_matches(first, second, SIDE)) == 0


def test_more_keypoints_than_are_compared_at_a_time_match_alike(monkeypatch):
    first, second = pictures()
    assert ROWS_AT_ONCE > COUNT
    whole = guided_matches(first, second, SIDE)
    monkeypatch.setattr("photoclinometry.sfm.guided_matching.ROWS_AT_ONCE", 77)
    np.testing.assert_array_equal(guided_matches(first, second, SIDE), whole)


def test_pictures_of_hardly_any_keypoints_do_not_match():
    first, second = pictures()
    few = described(np.array(first.keypoints[:3], np.float32), np.full((3, 128), 9, np.uint8))
    none = described(np.empty((0, 4), np.float32), np.empty((0, 128), np.uint8))
    for one, other in [(few, second), (second, few), (none, second), (second, none), (none, none)]:
        assert guided_matches(one, other, SIDE).shape == (0, 2)


def test_descriptors_are_made_unit_vectors():
    made = described(np.zeros((2, 4), np.float32), np.array([[3, 4, *126 * [0]], 128 * [0]], np.uint8))
    np.testing.assert_allclose(np.linalg.norm(made.descriptors, axis=1), [1.0, 0.0], rtol=1e-6)


def test_views_lit_from_all_sides_register(tmp_path):
    """Suns a fifth of a turn apart: neither brightness nor keypoints of the relief alone match a single pair."""
    images, suns, poses = lit_site([0, 72, 144, 216, 288])
    options = replace(OPTIONS, threads=1)
    with pytest.raises(ReconstructionError, match="0 of 5 views registered"):
        reconstruct_sparse(images, [CAMERA] * 5, tmp_path / "a", options)
    found = reconstruct_sparse(images, [CAMERA] * 5, tmp_path / "b", options, sun_in_cam=suns)
    assert found.registered.all()
    assert len(found.points) > 200
    assert rotation_errors_deg(found.body_from_cam, poses).max() < 1.5
    assert set(found.how_brought_in()) == set(range(5))


def test_nothing_is_mapped_again_where_guidance_finds_nothing(tmp_path, monkeypatch):
    """An image of another place is matched by guidance in vain; the model of the others stays."""
    images, suns, _ = lit_site([20, 25, 30])
    strangers, their_suns, _ = lit_site([22], seed=7, prefix="b")
    trials = []
    mapped = reconstruct.map_views

    def counted(*args, all_trials=False):
        trials.append(all_trials)
        return mapped(*args, all_trials=all_trials)

    monkeypatch.setattr(reconstruct, "map_views", counted)
    options = replace(OPTIONS, threads=1)
    found = reconstruct_sparse(
        images + strangers, [CAMERA] * 4, tmp_path, options, sun_in_cam=np.concatenate([suns, their_suns])
    )
    assert found.registered.tolist() == [True] * 3 + [False]
    assert trials == [False, False]
