"""Laws and hand-computed values of the reflectance models."""

import numpy as np
import pytest

from jacobians import numerical_jacobian
from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import (
    DEG,
    Reflectance,
    photometric_angles,
    photometric_function,
    photometric_parameters,
    published,
    starting_model,
)
from photoclinometry.model.reflectance import (
    MODELS as REGISTERED,
)
from test_simulate_hapke import reference as printed

MODELS = {f"{name}-{body}": starting_model(name, body) for name in REGISTERED for body in ("vesta", "ceres")}
each_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
SMOOTH = {name: model for name, model in MODELS.items() if model.name != "hapke"}


def directions(phase, count, seed=0, lowest=0.05):
    """mu0 and mu of random normals that are lit and seen, for a Sun `phase` away from the camera at +z."""
    normal = np.random.default_rng(seed).normal(size=(20 * count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    mu0, mu = normal @ [np.sin(phase), 0, np.cos(phase)], normal[:, 2]
    keep = np.flatnonzero((mu0 > lowest) & (mu > lowest))[:count]
    return mu0[keep], mu[keep]


def from_the_paper(model, mu0, mu, phase):
    """Eqs. 20-28 as printed (with beta for eta), independent of the package's own arrangement of them."""
    if model.name == "hapke":
        return hapke_as_printed(model, mu0, mu, phase)
    w0, w1, *coefficients = model.values or (0.0, 0.0)
    if model.name in ("akimov", "akimov+"):
        gamma = np.arctan((mu0 / mu - np.cos(phase)) / np.sin(phase))
        beta = np.arccos(np.clip(mu / np.cos(gamma), -1, 1))
        g = 1.0 if model.name == "akimov" else w0 + w1 * phase
        d = np.cos(phase / 2) * np.cos(np.pi / (np.pi - phase) * (gamma - phase / 2)) / np.cos(gamma)
        d *= np.cos(beta) ** (g * phase / (np.pi - phase))
    elif model.name.startswith("minnaert"):
        g = w0 + w1 * phase
        d = mu0**g * mu ** (g - 1)
    else:
        g = np.exp(-np.degrees(phase) / 60) if model.name == "mcewen" else w0 + w1 * phase
        d = (1 - g) * mu0 + g * 2 * mu0 / (mu0 + mu)
    if model.name == "minnaert-magnitudes":
        beta, gamma, delta = coefficients
        return d * 10 ** (-0.4 * (beta * phase + gamma * phase**2 + delta * phase**3))
    return d * (1 + sum(c * phase**i for i, c in enumerate(coefficients, 1)))


def hapke_as_printed(model, mu0, mu, phase):
    """By angles, and over what it gives where everything is overhead."""
    w, theta, *others = model.values
    i, e = np.arccos(mu0), np.arccos(mu)
    psi = np.arccos(np.clip((np.cos(phase) - mu0 * mu) / (np.sin(i) * np.sin(e)), -1, 1))
    values = [printed(w, *angles, *others, theta) for angles in zip(i, e, psi, strict=True)]
    return np.array(values) / printed(w, 1e-9, 1e-9, 0.0, *others, theta)


@each_model
def test_equals_the_equations_of_the_paper(model):
    for phase in (0.01, 0.3, 1.0, 1.8):
        mu0, mu = directions(phase, 200)
        np.testing.assert_allclose(model(mu0, mu, phase), from_the_paper(model, mu0, mu, phase), rtol=1e-9)


@each_model
def test_is_reciprocal(model):
    """Helmholtz: swapping Sun and camera keeps brightness per unit of incident light."""
    for phase in (0.0, 1e-4, 0.3, 1.2):
        mu0, mu = directions(phase, 500)
        np.testing.assert_allclose(model(mu0, mu, phase) / mu0, model(mu, mu0, phase) / mu, rtol=1e-6)


@each_model
@pytest.mark.parametrize("incidence_deg", [0, 30, 60, 80, 88])
def test_reflects_no_more_light_than_comes_in(model, incidence_deg):
    """The integral of I/F mu / (pi mu0) over all directions, from ground of normal albedo 0.55, Vesta's brightest.

    Models without a phase function come close to all of it at grazing incidence, the others reflect less than 0.4;
    Hapke's, whose surge makes normal albedos large, reflect least.
    """
    x, weight = np.polynomial.legendre.leggauss(80)
    mu0, mu, azimuth = np.cos(np.radians(incidence_deg)), 0.5 * (1 + x)[:, None], 0.5 * np.pi * (1 + x)
    cosine = mu0 * mu + np.sqrt(1 - mu0 * mu0) * np.sqrt(1 - mu * mu) * np.cos(azimuth)
    out = 0.55 * model(mu0, mu, np.arccos(np.clip(cosine, -1, 1)))
    scattered = 0.5 * weight @ (out * mu) @ weight / mu0
    least = 0.1 if model.name in ("hapke", "minnaert-magnitudes") else 0.2
    assert least < scattered < (0.4 if model.values else 0.96)


@each_model
def test_is_one_where_everything_is_overhead(model):
    assert model(1.0, 1.0, 0.0) == pytest.approx(1.0, abs=1e-12)


@each_model
def test_is_zero_where_unlit_or_unseen(model):
    assert np.all(model([-0.1, 0.0, 0.5, 0.5], [0.5, 0.5, 0.0, -0.1], 0.5) == 0)


@pytest.mark.parametrize("model", SMOOTH.values(), ids=SMOOTH)
@pytest.mark.parametrize("phase", [1e-3, 0.02, 0.5, 1.5, 2.5], ids="phase={}".format)
def test_partial_derivatives_match_differences(model, phase):
    """Also near zero phase and at grazing incidence and emission."""
    for mu0, mu in zip(*directions(phase, 40, lowest=5e-3), strict=True):
        at, analytic = np.array([mu0, mu, phase]), photometric_function(model.packed, mu0, mu, phase)[1:]
        for axis, expected in zip(np.eye(3), analytic, strict=True):
            h = 1e-4 * abs(at @ axis)
            values = [photometric_function(model.packed, *(at + k * h * axis))[0] for k in (-2, -1, 1, 2)]
            numeric = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
            assert expected == pytest.approx(numeric, rel=2e-5, abs=2e-6)


@pytest.mark.parametrize("body", ["vesta", "ceres"])
def test_partial_derivatives_of_hapke_match_differences(body):
    """It has a kink where Sun and camera are on one side of the ground or on opposite ones: away from these."""
    model, rng = published("hapke", body), np.random.default_rng(0)
    for i, e, psi in rng.uniform([0.05, 0.05, 0.3], [1.4, 1.4, 2.8], (200, 3)):
        at = np.array([np.cos(i), np.cos(e), np.arccos(np.cos(i) * np.cos(e) + np.sin(i) * np.sin(e) * np.cos(psi))])
        analytic = photometric_function(model.packed, *at)[1:]
        numeric = numerical_jacobian(lambda x, at=at: np.array([model(*(at + x))]), 3, 1e-6)[0]
        np.testing.assert_allclose(analytic, numeric, rtol=1e-5, atol=1e-7)


@each_model
def test_is_finite_at_zero_phase(model):
    mu = np.random.default_rng(0).uniform(0.01, 1, 100)
    for m in mu:
        assert np.all(np.isfinite(photometric_function(model.packed, m, m, 0.0)))


def test_akimov_at_limb_and_terminator():
    """In the scattering plane the quotient of cosines is pi / (pi - phase) at the limb and zero at the terminator."""
    phase, model = 0.8, published("akimov")
    limb = 1e-9  # normal at right angles to the camera, on the Sun's side
    expected = np.cos(phase / 2) * np.pi / (np.pi - phase)
    assert model(np.sin(phase), limb, phase) == pytest.approx(expected, rel=1e-6)
    assert model(1e-9, np.sin(phase), phase) == pytest.approx(0.0, abs=1e-7)


def test_lunar_lambert_by_hand():
    """Vesta at phase 20 degrees: g = 0.830 - 0.1444 = 0.6856; mu0 = mu = 0.9 gives d = 0.3144 * 0.9 + 0.6856."""
    model = published("lunar-lambert", "vesta")
    p = 20.0
    phase_function = 1 - 1.7160e-2 * p + 1.8306e-4 * p**2 - 1.0399e-6 * p**3 + 2.3223e-9 * p**4
    assert model(0.9, 0.9, p / DEG) == pytest.approx((0.3144 * 0.9 + 0.6856) * phase_function, rel=1e-12)
    assert model.phase_function(p / DEG) == pytest.approx(phase_function, rel=1e-12)


def test_angles_of_a_known_geometry():
    mu0, mu, phase = photometric_angles(
        np.array([1.0, 0, 0]), np.array([0, 0, 10.0]), np.zeros(3), np.array([np.sqrt(0.5), 0, np.sqrt(0.5)])
    )
    np.testing.assert_allclose([mu0, mu, phase], [np.sqrt(0.5), np.sqrt(0.5), np.pi / 2])


def test_unknown_models_and_bodies_say_what_is_known():
    with pytest.raises(InputError, match="lunar-lambert"):
        published("lambertian")
    with pytest.raises(InputError, match="ceres, vesta"):
        published("minnaert", "bennu")
    with pytest.raises(InputError, match="akimov"):
        Reflectance("lambert")
    with pytest.raises(InputError, match=r"hapke needs 6 parameters \(w, theta, b, c, B0, h\), got 2"):
        Reflectance("hapke", (0.5, 0.3))


@pytest.mark.parametrize("disk", ["lunar-lambert", "minnaert", "akimov+", "hapke"])
def test_derivatives_by_parameters(disk):
    """Of rho by w0, w1, c_1 ... against central differences."""
    model = published(disk, "vesta")
    angles = 0.7, 0.5, 0.8
    out = np.empty(len(model.parameters))
    photometric_parameters(model.packed, *angles, out)
    numeric = numerical_jacobian(lambda x: model.with_parameters(model.parameters + x)(*angles), len(out), 1e-5)[0]
    np.testing.assert_allclose(out, numeric, rtol=1e-6, atol=1e-9)


def test_parameters_make_the_model_again():
    model = published("minnaert", "ceres")
    assert model.with_parameters(model.parameters) == model
    assert len(published("mcewen").parameters) == 0


@pytest.mark.parametrize("parameter", range(6))
def test_hapke_beyond_what_is_physical_explains_nothing(parameter):
    """w, theta, b, B0 and h below zero; c may be anything."""
    model = published("hapke", "vesta")
    values = model.parameters
    values[parameter] *= -1.0
    found = model.with_parameters(values)(0.7, 0.5, 0.8)
    assert np.isfinite(found) if parameter == 3 else np.isnan(found)


def test_published_hapke_parameters():
    model = published("hapke", "ceres")
    assert model.parameter_names == ("w", "theta", "b", "c", "B0", "h")
    np.testing.assert_allclose(model.parameters, [0.14, np.radians(29), 0.316, 0.348, 1.6, 0.06])
    assert published("lunar-lambert", "ceres").parameter_names == ("w0", "w1", "c1", "c2", "c3")
    with pytest.raises(InputError, match="no published hapke coefficients for body 'bennu'"):
        published("hapke", "bennu")
