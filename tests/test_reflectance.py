"""Laws and hand-computed values of the reflectance models."""

import json
import os
import platform
import subprocess
import sys

import numpy as np
import pytest

from jacobians import numerical_jacobian
from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import (
    DEG,
    Reflectance,
    continued_function,
    mean_model,
    photometric_angles,
    photometric_function,
    photometric_parameters,
    published,
    starting_model,
)
from photoclinometry.model.reflectance import (
    MODELS as REGISTERED,
)
from printed_hapke import printed_radiance_factor
from stored_reflectance import FILE

stored = json.loads(FILE.read_text(encoding="utf-8"))

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
    values = [printed_radiance_factor(w, *angles, *others, theta) for angles in zip(i, e, psi, strict=True)]
    return np.array(values) / printed_radiance_factor(w, 1e-9, 1e-9, 0.0, *others, theta)


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
        at, analytic = np.array([mu0, mu, phase]), photometric_function(model.parameter_vector, mu0, mu, phase)[1:]
        for axis, expected in zip(np.eye(3), analytic, strict=True):
            h = 1e-4 * abs(at @ axis)
            values = [photometric_function(model.parameter_vector, *(at + k * h * axis))[0] for k in (-2, -1, 1, 2)]
            numeric = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
            assert expected == pytest.approx(numeric, rel=2e-5, abs=2e-6)


@pytest.mark.parametrize("body", ["vesta", "ceres"])
def test_partial_derivatives_of_hapke_match_differences(body):
    """It has a kink where Sun and camera are on one side of the ground or on opposite ones: away from these."""
    model, rng = published("hapke", body), np.random.default_rng(0)
    for i, e, psi in rng.uniform([0.05, 0.05, 0.3], [1.4, 1.4, 2.8], (200, 3)):
        at = np.array([np.cos(i), np.cos(e), np.arccos(np.cos(i) * np.cos(e) + np.sin(i) * np.sin(e) * np.cos(psi))])
        analytic = photometric_function(model.parameter_vector, *at)[1:]
        numeric = numerical_jacobian(lambda x, at=at: np.array([model(*(at + x))]), 3, 1e-6)[0]
        np.testing.assert_allclose(analytic, numeric, rtol=1e-5, atol=1e-7)


@each_model
def test_is_finite_at_zero_phase(model):
    mu = np.random.default_rng(0).uniform(0.01, 1, 100)
    for m in mu:
        assert np.all(np.isfinite(photometric_function(model.parameter_vector, m, m, 0.0)))


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


@pytest.mark.parametrize("disk", [name for name, model in REGISTERED.items() if model.parameters])
def test_derivatives_by_parameters(disk):
    """Of rho by w0, w1, c_1 ... against central differences."""
    model = starting_model(disk, "vesta")
    angles = 0.7, 0.5, 0.8
    out = np.empty(len(model.parameters))
    photometric_parameters(model.parameter_vector, *angles, out)
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


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    """The stored values computed again, by a process that compiles all functions together."""
    program = "import stored_reflectance; print(stored_reflectance.all_values())"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("compiled"))}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=FILE.parent, env=environment, capture_output=True, check=True
    )
    return json.loads(done.stdout)["values"]


@pytest.mark.parametrize("key", stored["values"])
def test_numbers_are_those_stored_to_the_last_bit(key, computed):
    """`stored_reflectance.py` is the recipe. Another processor's exponential may differ in the last bit."""
    found = computed[key]
    if platform.machine() == stored["machine"]:
        assert found == stored["values"][key]
    for row, expected in zip(found, stored["values"][key], strict=True):
        np.testing.assert_allclose([*map(float.fromhex, row)], [*map(float.fromhex, expected)], rtol=1e-12, atol=1e-15)


def test_minnaert_in_magnitudes_by_hand():
    """k = 0.6 + 0.2 x 0.5 = 0.7 and 0.5 x 2 + 0.25 x 0.4 - 0.125 x 0.8 = 1 magnitude, a factor of 10^-0.4 = 0.398107:
    0.64^0.7 x 0.36^-0.3 = 0.994112."""
    model = Reflectance("minnaert-magnitudes", (0.6, 0.2, 2.0, 0.4, -0.8))
    assert model(0.64, 0.36, 0.5) == pytest.approx(0.994112 * 0.398107, rel=1e-5)
    assert model.phase_function(0.5) == pytest.approx(0.398107, rel=1e-5)


def test_a_phase_function_in_magnitudes_is_positive_where_a_polynomial_is_not():
    phase = np.radians(np.linspace(0.0, 170.0, 50))
    dark = Reflectance("minnaert-magnitudes", (0.5, 0.0, 2.3, 0.2, -0.2))
    assert np.all(dark.phase_function(phase) > 0)
    assert np.any(published("akimov+", "ceres").phase_function(phase) < 0)


def test_bodies_without_published_values_start_from_neutral_ones_where_a_model_has_them():
    model = starting_model("minnaert-magnitudes", "bennu")
    assert model.parameter_names == ("k0", "b", "beta", "gamma", "delta")
    assert model(0.5, 0.5, 0.0) == pytest.approx(1.0)  # no limb darkening at opposition
    assert -2.5 * np.log10(model.phase_function(np.radians(10.0))) == pytest.approx(0.4)  # 0.04 mag/deg
    assert starting_model("minnaert", "vesta") == published("minnaert", "vesta")
    with pytest.raises(InputError, match=r"no published minnaert-magnitudes .* \(known: none\)"):
        published("minnaert-magnitudes", "bennu")


@pytest.mark.parametrize("name", REGISTERED)
def test_every_parameter_has_a_name_a_unit_and_a_meaning(name):
    model = REGISTERED[name]
    assert model.source
    assert model.predicts_absolute_brightness == bool(model.parameters)
    for p in model.parameters:
        assert p.name
        assert p.unit
        assert p.about
        assert p.lower < p.upper
        assert p.default is None or p.lower <= p.default <= p.upper
        assert p.default != 0 or p.prior_sigma, "without a prior of its own a parameter that is 0 stays 0"
    for values in model.published.values():
        assert not np.isnan(Reflectance(name, values).parameter_vector).any()


def test_changes_are_relative_unless_a_parameter_states_its_own_prior():
    lunar, dark = published("lunar-lambert", "vesta"), starting_model("minnaert-magnitudes")
    change = np.array([0.1, -0.2, 0.0, 0.3, 0.05, 0.0])
    assert lunar.moved(change).values == tuple(lunar.parameters * (1.0 + change))
    np.testing.assert_allclose(lunar.relative_change(lunar.moved(change)), change, atol=1e-12)
    one_sigma = dark.moved(np.full(5, 0.05))
    np.testing.assert_allclose(
        one_sigma.parameters - dark.parameters, [0.05, 0.2, np.radians(1) ** -1 * 0.01, 0.2, 0.2]
    )
    np.testing.assert_allclose(dark.relative_change(one_sigma), 0.05)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_no_step_leaves_the_bounds(model, sign):
    """However large and however often."""
    change = np.zeros(len(model.values))
    for _ in range(5):
        change = change + model.limit_step(change, np.full(len(change), 1e6 * sign))
        assert np.isfinite(model.moved(change).parameter_vector).all()


def test_a_step_within_the_bounds_is_left_as_it_is():
    model = published("hapke", "vesta")
    step = np.array([0.1, -0.1, 0.3, 50.0, -0.2, 0.7])
    assert model.limit_step(np.zeros(6), step).tolist() == step.tolist()
    cut = model.limit_step(np.zeros(6), np.array([2.0, 0, 0, 0, 0, 0]))  # w = 0.5 would become 1.5
    np.testing.assert_allclose(model.moved(cut).values[0], 0.5 + 0.9 * 0.5, atol=1e-5)


def test_beyond_grazing_emission_estimates_see_what_they_see_there():
    """rho is zero beyond 90 degrees and not before: an estimate that crosses that would see its cost jump."""
    parameter_vector = published("lunar-lambert", "vesta").parameter_vector
    seen = [continued_function(parameter_vector, 0.5, mu, 1.0)[0] for mu in np.linspace(-0.2, 0.2, 401)]
    assert np.abs(np.diff(seen)).max() < 0.01 * max(seen)
    assert continued_function(parameter_vector, 0.5, -0.1, 1.0)[2] == 0.0
    assert continued_function(parameter_vector, 0.5, 0.3, 1.0) == photometric_function(parameter_vector, 0.5, 0.3, 1.0)
    assert photometric_function(parameter_vector, 0.5, 1e-3, 1.0)[0] > 0.1 * max(seen)
    assert photometric_function(parameter_vector, 0.5, -1e-3, 1.0)[0] == 0.0


def test_a_mean_is_of_models_of_one_name():
    one, other = published("minnaert", "vesta"), published("lunar-lambert", "vesta")
    moved = one.with_parameters(1.1 * one.parameters)
    found = mean_model([(one, 1.0, True), (other, 3.0, True), (moved, 3.0, True)])
    np.testing.assert_allclose(found.parameters, 1.075 * one.parameters)
    assert found.name == "minnaert"
    assert mean_model([(one, 1.0, False), (other, 0.1, True)]) == other
