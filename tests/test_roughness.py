"""Hapke's roughness: its gradient, and what it becomes where nothing is rough or all is in one plane."""

import numpy as np
import pytest

from jacobians import numerical_jacobian
from photoclinometry.model.reflectance.roughness import roughness_correction


def arguments(count, seed=0):
    """mu0, mu, phase, theta: away from kinks, which are where both directions are equally steep or in one plane."""
    rng = np.random.default_rng(seed)
    i, e, psi, theta = rng.uniform([0.05, 0.05, 0.2, 0.05], [1.4, 1.4, 2.9, 0.8], (count, 4)).T
    apart = abs(i - e) > 1e-3
    phase = np.arccos(np.cos(i) * np.cos(e) + np.sin(i) * np.sin(e) * np.cos(psi))
    return np.column_stack((np.cos(i), np.cos(e), phase, theta))[apart]


def test_gradient_matches_differences():
    for at in arguments(300):
        _, _, _, by_mu0e, by_mue, by_shadowing = roughness_correction(*at)
        numeric = numerical_jacobian(lambda x, at=at: np.array(roughness_correction(*(at + x))[:3]), 4, 1e-6)
        np.testing.assert_allclose([by_mu0e, by_mue, by_shadowing], numeric, rtol=1e-6, atol=1e-8)


def test_gradient_across_the_exchange_of_sun_and_camera():
    """Effective cosines change places with the directions; shadowing keeps the order of illumination and view."""
    for mu0, mu, phase, theta in arguments(50):
        there, back = roughness_correction(mu0, mu, phase, theta), roughness_correction(mu, mu0, phase, theta)
        assert there[0] == pytest.approx(back[1], rel=1e-12)
        assert np.array(there[3])[[1, 0, 2, 3]] == pytest.approx(np.array(back[4]), rel=1e-9, abs=1e-12)


def test_nothing_changes_of_smooth_ground():
    assert roughness_correction(0.6, 0.7, 0.8, 0.0)[:3] == (0.6, 0.7, 1.0)
    almost = roughness_correction(0.6, 0.7, 0.8, 1e-3)
    assert almost[:3] == pytest.approx((0.6, 0.7, 1.0), abs=1e-4)
    assert almost[3][:3] == pytest.approx((1.0, 0.0, 0.0), abs=1e-4)


@pytest.mark.parametrize(("mu0", "mu", "phase"), [(1.0, 1.0, 0.0), (0.8, 0.8, 0.0), (1.0, 0.5, np.arccos(0.5))])
def test_derivatives_are_finite_in_one_plane(mu0, mu, phase):
    assert all(np.all(np.isfinite(part)) for part in roughness_correction(mu0, mu, phase, 0.3))


def test_effective_cosines_are_above_zero_also_near_the_horizon():
    rng = np.random.default_rng(1)
    for mu0, mu in 10 ** rng.uniform(-6.0, 0.0, (2000, 2)):
        cos_psi = np.cos(rng.uniform(0.0, np.pi))
        phase = np.arccos(mu0 * mu + np.sqrt((1 - mu0**2) * (1 - mu**2)) * cos_psi)
        mu0e, mue, shadowing, *gradients = roughness_correction(mu0, mu, phase, rng.uniform(0.01, 1.5))
        assert min(mu0e, mue, shadowing) > 0.0
        assert np.all(np.isfinite(gradients))
