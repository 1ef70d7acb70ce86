import math

import numpy as np
import pytest

from photoclinometry.errors import InputError
from photoclinometry.simulate.hapke import BODIES, Hapke, published_hapke

SMOOTH = Hapke(b=0.25, surge=1.6, surge_width=0.06, roughness_deg=0.0)


def geometry(count=2000, seed=0, steepest_deg=80.0):
    """mu0, mu and phase of Suns and cameras above level ground."""
    rng = np.random.default_rng(seed)
    i, e = rng.uniform(0.0, np.radians(steepest_deg), (2, count))
    psi = rng.uniform(0.0, np.pi, count)
    phase = np.arccos(np.cos(i) * np.cos(e) + np.sin(i) * np.sin(e) * np.cos(psi))
    return np.cos(i), np.cos(e), phase


def reference(w, i, e, psi, b, c, b0, h, theta):
    """Hapke's equations once more, by angles instead of cosines, as printed in Hapke (1984, 1993)."""
    g = math.acos(math.cos(i) * math.cos(e) + math.sin(i) * math.sin(e) * math.cos(psi))
    t = math.tan(theta)
    chi = (1 + math.pi * t**2) ** -0.5

    def e1(x):
        return math.exp(-2 / (math.pi * t * math.tan(x)))

    def e2(x):
        return math.exp(-1 / (math.pi * t**2 * math.tan(x) ** 2))

    def eta(x):
        return chi * (math.cos(x) + math.sin(x) * t * e2(x) / (2 - e1(x)))

    f = math.exp(-2 * math.tan(psi / 2))
    s2 = math.sin(psi / 2) ** 2
    small, large = min(i, e), max(i, e)
    below = 2 - e1(large) - psi / math.pi * e1(small)
    eff_small = chi * (math.cos(small) + math.sin(small) * t * (math.cos(psi) * e2(large) + s2 * e2(small)) / below)
    eff_large = chi * (math.cos(large) + math.sin(large) * t * (e2(large) - s2 * e2(small)) / below)
    mu0e, mue = (eff_small, eff_large) if i <= e else (eff_large, eff_small)
    shadowing = mue / eta(e) * math.cos(i) / eta(i) * chi / (1 - f + f * chi * math.cos(small) / eta(small))
    gamma = math.sqrt(1 - w)

    def big_h(x):
        return (1 + 2 * x) / (1 + 2 * x * gamma)

    def lobe(sign):
        return (1 - b * b) / (1 - sign * 2 * b * math.cos(g) + b * b) ** 1.5

    p = (1 + c) / 2 * lobe(1) + (1 - c) / 2 * lobe(-1)
    surge = b0 / (1 + math.tan(g / 2) / h)
    r = w / (4 * math.pi) * mu0e / (mu0e + mue) * ((1 + surge) * p + big_h(mu0e) * big_h(mue) - 1)
    return math.pi * r * shadowing


@pytest.mark.parametrize("body", BODIES)
def test_agrees_with_the_printed_equations(body):
    model, rng = BODIES[body], np.random.default_rng(1)
    for _ in range(200):
        i, e = rng.uniform(0.02, 1.4, 2)
        psi, w = rng.uniform(0.01, 3.1), rng.uniform(0.02, 0.95)
        g = math.acos(math.cos(i) * math.cos(e) + math.sin(i) * math.sin(e) * math.cos(psi))
        expected = reference(
            w, i, e, psi, model.b, model.c, model.surge, model.surge_width, math.radians(model.roughness_deg)
        )
        found = model.from_single_scattering(w, math.cos(i), math.cos(e), g)
        assert found == pytest.approx(expected, rel=1e-6)


def test_hand_computed_value_at_zero_phase():
    """w = 0.5, b = 0.25, B0 = 1.6: P(0) = 0.9375 / 0.75^3, H = 3 / (1 + sqrt(2)), so I/F = 0.3951."""
    p, h = 0.9375 / 0.421875, 3.0 / (1.0 + math.sqrt(2.0))
    by_hand = 0.5 / 8.0 * (2.6 * p + h * h - 1.0)
    assert by_hand == pytest.approx(0.3951, abs=1e-4)
    assert SMOOTH.normal_albedo(0.5) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.parametrize("model", [SMOOTH, *BODIES.values()], ids=["smooth", *BODIES])
def test_is_reciprocal(model):
    """Helmholtz: swapping Sun and camera keeps brightness per unit of incident light."""
    mu0, mu, phase = geometry()
    forth = model.from_single_scattering(0.4, mu0, mu, phase) / mu0
    back = model.from_single_scattering(0.4, mu, mu0, phase) / mu
    np.testing.assert_allclose(forth, back, rtol=1e-12)


@pytest.mark.parametrize("model", BODIES.values(), ids=BODIES)
def test_reflects_no_more_light_than_comes_in(model):
    """The hemispherical albedo of a nearly conservative surface: integral of I/F mu / (pi mu0) over emission."""
    rng = np.random.default_rng(2)
    for i in np.radians([5.0, 40.0, 70.0]):
        e, psi = np.arccos(rng.random(20_000)), rng.uniform(0, np.pi, 20_000)
        phase = np.arccos(np.clip(np.cos(i) * np.cos(e) + np.sin(i) * np.sin(e) * np.cos(psi), -1, 1))
        out = model.from_single_scattering(0.99, np.cos(i), np.cos(e), phase)
        assert 0.5 < 2.0 * np.mean(out * np.cos(e)) / np.cos(i) < 1.02


@pytest.mark.parametrize("body", BODIES)
def test_normal_albedo_and_single_scattering_albedo_are_inverse(body):
    albedo = np.linspace(0.005, 0.7, 300)
    model = published_hapke(body)
    np.testing.assert_allclose(model.normal_albedo(model.single_scattering_albedo(albedo)), albedo, atol=1e-6)
    np.testing.assert_allclose(model.radiance_factor(albedo, 1.0, 1.0, 0.0), albedo, atol=1e-6)


def test_published_parameters_give_the_published_geometric_albedos():
    """A flat surface's normal albedo; 0.36 at 700 nm for Vesta (Li et al. 2012), 0.094 for Ceres."""
    assert published_hapke("vesta").normal_albedo(0.50) == pytest.approx(0.38, abs=0.04)
    assert published_hapke("ceres").normal_albedo(0.14) == pytest.approx(0.094, abs=0.007)


def test_edges_are_finite_and_dark_where_unlit_or_unseen():
    for model in (SMOOTH, published_hapke("ceres")):
        assert model.from_single_scattering(0.3, -0.1, 0.5, 1.0) == 0
        assert model.from_single_scattering(0.3, 0.5, 0.0, 1.0) == 0
        for mu0, mu, phase in ((1.0, 1.0, 0.0), (1e-6, 1e-6, 0.0), (1e-6, 1e-6, math.pi), (1.0, 1e-9, 1.57)):
            assert np.isfinite(model.from_single_scattering(0.3, mu0, mu, phase))


def test_albedos_out_of_reach_are_refused():
    with pytest.raises(InputError, match="lower the albedo"):
        published_hapke("ceres").single_scattering_albedo(np.array([0.1, 3.0]))
    with pytest.raises(InputError, match="known: vesta, ceres"):
        published_hapke("bennu")
