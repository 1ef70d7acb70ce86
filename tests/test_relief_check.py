"""Relief beside parallax, and Suns that the estimate has moved."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import so3_exp
from photoclinometry.model.warning import collected_warnings
from photoclinometry.pipeline.moved_suns import warn_of_suns
from photoclinometry.pipeline.relief_check import ReliefCheck, relief_by_parallax, warn_of_relief
from scenes import synthetic_scene


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=60, views=5)


def flattened(scene, factor):
    """Heights times a factor."""
    position = scene.landmarks.position * [1.0, 1.0, factor]
    return replace(scene, landmarks=replace(scene.landmarks, position=position))


def matched(scene, noise_gsd=0.0, seed=0):
    """Positions as matches give them, in a frame of their own, and pixels, in another order, some missing."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(scene.landmarks))[:-200]
    noisy = scene.landmarks.position + noise_gsd * scene.gsd * rng.normal(size=(len(scene.landmarks), 3))
    moved = 3.0 * noisy @ so3_exp(np.array([0.3, -0.4, 0.5])).T + [100.0, 200.0, 300.0]
    return moved[order], scene.landmarks.pixel[order]


@pytest.mark.parametrize("factor", [1.0, 0.8, 1.3])
def test_relief_over_that_of_parallax_is_the_factor_of_the_heights(scene, factor):
    check = relief_by_parallax(flattened(scene, factor), *matched(scene))
    assert check.ratio == pytest.approx(factor, rel=0.02)


def test_noise_of_matches_neither_shrinks_the_relief_nor_hides_in_the_sigma(scene):
    """With noise of half a GSD the mean of 20 draws is 1; their scatter is as stated, to a factor of two."""
    checks = [relief_by_parallax(scene, *matched(scene, 0.5, seed), correlation_px=1.0) for seed in range(20)]
    ratios = np.array([check.ratio for check in checks])
    stated = np.sqrt(np.mean([check.sigma**2 for check in checks]))
    assert abs(ratios.mean() - 1.0) < 4.0 * ratios.std() / np.sqrt(20)
    assert 0.5 < stated / ratios.std() < 2.0


def test_where_matches_err_alike_a_small_map_says_less(scene):
    checks = [relief_by_parallax(scene, *matched(scene, 0.5), correlation_px=side) for side in (1.0, 5.0, 30.0)]
    assert checks[0].sigma < checks[1].sigma < checks[2].sigma
    assert checks[0].ratio == checks[2].ratio


def test_few_shared_points_say_nothing(scene):
    position, pixel = matched(scene)
    assert relief_by_parallax(scene, position[:50], pixel[:50]) is None


def test_relief_that_contradicts_parallax_is_warned_of_and_far_off_not_trusted():
    with collected_warnings() as warned:
        for check in (None, ReliefCheck(0.97, 0.001), ReliefCheck(0.8, 0.1), ReliefCheck(0.9, 0.01)):
            warn_of_relief(check)
    assert [warning.code for warning in warned] == ["relief-contradicts"]
    assert "0.90" in warned[0].words


def test_suns_that_move_alike_or_alone_are_named(scene):
    views = replace(scene.views, sun_sigma=np.full(5, 1e-3), sun_common_sigma=np.full(5, 1e-2))

    def codes(moved):
        with collected_warnings() as warned:
            warn_of_suns(replace(scene, views=moved))
        return [(warning.code, warning.view) for warning in warned]

    assert codes(views) == []
    turned = replace(views, sun_measured=views.sun_measured @ so3_exp(np.array([0.08, 0.0, 0.0])).T)
    assert codes(turned) == [("suns-moved", "")]
    one = views.sun_measured.copy()
    one[2] = one[2] @ so3_exp(np.array([0.03, 0.0, 0.0])).T
    alone = replace(views, sun_measured=one, sun_common_sigma=np.zeros(5))
    assert codes(alone) == [("suns-moved", views.name[2])]
    one[2] = views.sun_measured[2] @ so3_exp(np.array([0.012, 0.0, 0.0])).T
    assert codes(replace(alone, sun_measured=one)) == [], "half a degree is what a reflectance model makes"
