import math

import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.simulate.hapke import BODIES, Hapke, published_hapke
from printed_hapke import printed_radiance_factor

SMOOTH = Hapke(b=0.25, surge=1.6, surge_width=0.06, roughness_deg=0.0)


def geometry(count=2000, seed=0, steepest_deg=80.0):
    """mu0, mu and phase of Suns and cameras above level ground."""
    rng = np.random.default_rng(seed)
    i, e = rng.uniform(0.0, np.radians(steepest_deg), (2, count))
    psi = rng.uniform(0.0, np.pi, count)
    phase = np.arccos(np.cos(i) * np.cos(e) + np.sin(i) * np.sin(e) * np.cos(psi))
    return np.cos(i), np.cos(e), phase


@pytest.mark.parametrize("body", BODIES)
def test_agrees_with_the_printed_equations(body):
    model, rng = BODIES[body], np.random.default_rng(1)
    for _ in range(200):
        i, e = rng.uniform(0.02, 1.4, 2)
        psi, w = rng.uniform(0.01, 3.1), rng.uniform(0.02, 0.95)
        g = math.acos(math.cos(i) * math.cos(e) + math.sin(i) * math.sin(e) * math.cos(psi))
        expected = printed_radiance_factor(
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


# Values of the test suite of USGS ISIS (isis/src/base/objs/Hapke: unitTest.cpp and Hapke.truth, public domain),
# HapkeHen and HapkeLeg: w, b, c, B0, h, roughness [deg]; I/F at (i, e, g) = (0, 0, 0) and (45, 30, 60) degrees.
# HapkeLeg without Legendre terms scatters isotropically, b = 0.
ISIS = {
    "HapkeHen, isotropic and smooth": ((0.5, 0.0, 0.0, 0.0, 1.0, 0.0), 0.0965097, 0.0832883),
    "HapkeHen, backward lobe and rough": ((0.52, 0.213, 1.0, 1.0, 1.0, 30.0), 0.286048, 0.1342),
    "HapkeLeg, isotropic and rough": ((0.52, 0.0, 0.0, 1.0, 1.0, 30.0), 0.16145, 0.111525),
}


@pytest.mark.parametrize(("parameters", "overhead", "oblique"), ISIS.values(), ids=ISIS)
def test_agrees_with_the_values_published_with_isis(parameters, overhead, oblique):
    w, b, c, b0, h, roughness = parameters
    model = Hapke(b=b, c=c, surge=b0, surge_width=h, roughness_deg=roughness)
    mu0, mu, phase = np.cos(np.radians([45.0, 30.0, 60.0]))
    assert model.normal_albedo(w) == pytest.approx(overhead, rel=1e-5)
    assert model.from_single_scattering(w, mu0, mu, math.acos(phase)) == pytest.approx(oblique, rel=1e-5)


# Hapke (1984), Icarus 59, 41-59: what roughness leaves of the light of a whole dark planet, K(phase, roughness).
ROUGHNESS_DEG = (10, 20, 30, 40, 50, 60)
PUBLISHED_K = {
    2: (0.997, 0.991, 0.984, 0.974, 0.961, 0.943),
    5: (0.994, 0.981, 0.965, 0.944, 0.918, 0.881),
    20: (0.988, 0.957, 0.914, 0.861, 0.797, 0.715),
    60: (0.979, 0.911, 0.814, 0.698, 0.570, 0.438),
    90: (0.959, 0.827, 0.654, 0.487, 0.346, 0.231),
    120: (0.894, 0.617, 0.386, 0.243, 0.153, 0.094),
    150: (0.590, 0.244, 0.123, 0.069, 0.040, 0.023),
}


def planet(model, w, phase, nodes=120):
    """Integral of I/F mu over the lit and visible part of a sphere, over pi: its brightness as a disk's I/F."""
    x, weight = np.polynomial.legendre.leggauss(nodes)
    longitude = 0.5 * phase + 0.5 * (np.pi - phase) * x[:, None]
    latitude = 0.5 * np.pi * x
    mu, mu0 = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.cos(longitude - phase)
    light = model.from_single_scattering(w, mu0, mu, phase) * mu * np.cos(latitude)
    return weight @ light @ weight * 0.25 * (np.pi - phase)


@pytest.mark.parametrize("phase_deg", PUBLISHED_K)
def test_roughness_dims_a_planet_as_in_hapke_s_table(phase_deg):
    dark, smooth = 1e-4, {"b": 0.0, "surge": 0.0, "surge_width": 1.0}
    without = planet(Hapke(**smooth, roughness_deg=0.0), dark, np.radians(phase_deg))
    found = [planet(Hapke(**smooth, roughness_deg=t), dark, np.radians(phase_deg)) / without for t in ROUGHNESS_DEG]
    np.testing.assert_allclose(found, PUBLISHED_K[phase_deg], rtol=4e-3, atol=1e-3)  # three figures, by quadrature


def test_a_smooth_planet_has_the_geometric_albedo_of_hapke_s_closed_form():
    """r0 / 2 + r0^2 / 6 + w / 8 ((1 + B0) P(0) - 1), r0 = (1 - gamma) / (1 + gamma): Hapke (1981), J. Geophys.
    Res. 86, 3039-3054, who integrates an approximation of H."""
    for w in (0.14, 0.5, 0.9):
        gamma = math.sqrt(1 - w)
        r0 = (1 - gamma) / (1 + gamma)
        opposition = (1 + SMOOTH.surge) * (1 + SMOOTH.b) / (1 - SMOOTH.b) ** 2
        assert planet(SMOOTH, w, 0.0) == pytest.approx(r0 / 2 + r0**2 / 6 + w / 8 * (opposition - 1), rel=0.01)


def test_multiple_scattering_is_that_of_radiative_transfer_within_four_percent():
    """Chandrasekhar's H for isotropic scattering, 1 / H = gamma + w / 2 integral of x H(x) / (mu + x), iterated.
    The approximation's H is within 4.1 % of it (abstract of "Recalculation of the isotropic H functions", Icarus 109,
    313, 1994); at mu0 = mu, I/F = w H^2 / 8."""
    x, weight = np.polynomial.legendre.leggauss(64)
    x, weight = 0.5 + 0.5 * x, 0.5 * weight
    isotropic = Hapke(b=0.0, surge=0.0, surge_width=1.0, roughness_deg=0.0)
    worst = 0.0
    for w in (0.1, 0.5, 0.9, 0.99):
        h = np.ones(64)
        for _ in range(400):
            h = 1.0 / (math.sqrt(1 - w) + 0.5 * w * (weight * x * h / (x[:, None] + x)).sum(1))
        found = np.sqrt(8.0 / w * isotropic.from_single_scattering(w, x, x, 0.3))
        worst = max(worst, np.abs(found / h - 1.0).max())
    assert 0.02 < worst < 0.041


def hemispherical(model, w, mu0, nodes=60):
    """The share of light of incidence cosine mu0 that is scattered: integral of I/F mu over directions / (pi mu0)."""
    x, weight = np.polynomial.legendre.leggauss(nodes)
    mu, psi = (0.5 + 0.5 * x)[:, None], 0.5 * np.pi * (1 + x)
    cosine = mu0 * mu + math.sqrt(1 - mu0 * mu0) * np.sqrt(1 - mu * mu) * np.cos(psi)
    out = model.from_single_scattering(w, mu0, mu, np.arccos(np.clip(cosine, -1, 1)))
    return 0.5 * weight @ (out * mu) @ weight / mu0


@pytest.mark.parametrize("model", [SMOOTH, *BODIES.values()], ids=["smooth", *BODIES])
def test_is_reciprocal(model):
    """Helmholtz: swapping Sun and camera keeps brightness per unit of incident light."""
    mu0, mu, phase = geometry()
    forth = model.from_single_scattering(0.4, mu0, mu, phase) / mu0
    back = model.from_single_scattering(0.4, mu, mu0, phase) / mu
    np.testing.assert_allclose(forth, back, rtol=1e-12)


@pytest.mark.parametrize("model", BODIES.values(), ids=BODIES)
def test_reflects_no_more_light_than_comes_in(model):
    """Even where particles absorb one photon in a hundred; the surge takes nothing from other phases and adds 2 %."""
    for i in np.radians([5.0, 40.0, 70.0]):
        assert 0.5 < hemispherical(model, 0.99, math.cos(i)) < 1.02


@pytest.mark.parametrize("body", BODIES)
def test_normal_albedo_and_single_scattering_albedo_are_inverse(body):
    albedo = np.linspace(0.005, 0.7, 300)
    model = published_hapke(body)
    np.testing.assert_allclose(model.normal_albedo(model.single_scattering_albedo(albedo)), albedo, atol=1e-6)
    np.testing.assert_allclose(model.radiance_factor(albedo, 1.0, 1.0, 0.0), albedo, atol=1e-6)


@pytest.mark.parametrize(
    ("body", "w", "geometric", "bond"),
    [
        ("vesta", 0.50, (0.38, 0.04), (0.20, 0.02)),  # Li et al. (2013), Icarus 226, 1252, 554 nm
        ("ceres", 0.14, (0.094, 0.007), (0.037, 0.002)),  # Ciarniello et al. (2017); Li et al. (2019), Icarus 322, 144
    ],
)
def test_published_parameters_give_the_published_albedos_of_the_planets(body, w, geometric, bond):
    """Of the whole sphere, within two standard deviations: brightness at zero phase, and all light scattered, which
    is 2 times the integral of brightness times sin(phase)."""
    x, weight = np.polynomial.legendre.leggauss(24)
    phase = 0.5 * np.pi * (1 + x)
    brightness = np.array([planet(published_hapke(body), w, p, nodes=40) for p in phase])
    assert planet(published_hapke(body), w, 0.0) == pytest.approx(geometric[0], abs=geometric[1])
    assert np.pi * weight @ (brightness * np.sin(phase)) == pytest.approx(bond[0], abs=2 * bond[1])


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
