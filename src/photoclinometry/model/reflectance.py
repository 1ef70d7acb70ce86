"""How brightness follows from incidence, emission and phase: each model stated once.

    radiance factor  I/F = albedo * Lambda(phase) * d(mu0, mu, phase)                     (paper Eq. 20)

mu0 = cos(incidence), mu = cos(emission), phase [rad]; d is the disk function and Lambda the phase
function, both 1 at mu0 = mu = 1, phase = 0. A disk function below is a scalar function that returns d, its
three partial derivatives and that by its weight g; the renderer, the simulator and the joint estimate all call
it, compiled. To add one: write the function, add it to `_disk` and to `DISK_FUNCTIONS`, add coefficients if it has any.
Hapke's model (`hapke.py`) is no such product: it has branches of its own, and is 1 there, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from photoclinometry.model import hapke
from photoclinometry.model.errors import InputError

DEG = 180.0 / math.pi
HAPKE = 5
"""The number of Hapke's model among DISK_FUNCTIONS."""
_PHASE_FLOOR = 1e-7
"""Sines of the phase angle are kept above this [rad]: 0.02 arc seconds."""


@njit(cache=True, inline="always")
def _mixed(mu0, mu, weight, weight_slope):
    """Lambert and Lommel-Seeliger mixed: d = (1 - g) mu0 + g 2 mu0 / (mu0 + mu)."""
    q = 1.0 / (mu0 + mu)
    seeliger = 2.0 * mu0 * q
    return (
        (1.0 - weight) * mu0 + weight * seeliger,
        (1.0 - weight) + weight * 2.0 * mu * q * q,
        -weight * 2.0 * mu0 * q * q,
        weight_slope * (seeliger - mu0),
        seeliger - mu0,
    )


@njit(cache=True)
def lunar_lambert(mu0, mu, phase, w0, w1):
    """d = (1 - g) mu0 + g 2 mu0 / (mu0 + mu),  g = w0 + w1 phase              (Eq. 25)

    McEwen (1991), Icarus 92, doi:10.1016/0019-1035(91)90053-V.
    """
    return _mixed(mu0, mu, w0 + w1 * phase, w1)


@njit(cache=True)
def mcewen(mu0, mu, phase, w0, w1):
    """As Lunar-Lambert with g = exp(-phase / 60 deg)                          (Eq. 23)

    The exponential form is that of Gaskell et al. (2008), doi:10.1111/j.1945-5100.2008.tb00692.x.
    """
    weight = math.exp(-phase * DEG / 60.0)
    return _mixed(mu0, mu, weight, -weight * DEG / 60.0)


@njit(cache=True)
def minnaert(mu0, mu, phase, w0, w1):
    """d = mu0^g mu^(g - 1),  g = w0 + w1 phase                                (Eq. 26)

    Minnaert (1941), ApJ 93, doi:10.1086/144279.
    """
    g = w0 + w1 * phase
    log0, log1 = math.log(mu0), math.log(mu)
    d = math.exp(g * log0 + (g - 1.0) * log1)
    return d, d * g / mu0, d * (g - 1.0) / mu, d * w1 * (log0 + log1), d * (log0 + log1)


@njit(cache=True)
def akimov(mu0, mu, phase, w0, w1):
    """Akimov's disk function with a phase weight (Akimov+; plain Akimov is g = 1)      (Eqs. 22, 24)

        d = cos(phase/2) cos[k (gamma - phase/2)] / cos(gamma)  cos(beta)^(g phase / (pi - phase)),
        k = pi / (pi - phase),  g = w0 + w1 phase

    gamma and beta: photometric longitude and latitude, tan(gamma) = (mu0/mu - cos phase) / sin phase,
    cos(beta) = mu / cos(gamma)  (Eqs. 27, 28; Eq. 22 prints eta for beta). Here they come from the normal's
    components in the scattering plane, mu towards the camera and t across it, and with
    delta = pi/2 - gamma = atan2(mu, t) the quotient of cosines is sin(k delta) / sin(delta): finite at the
    limb (delta = 0, where it is k), and zero at the terminator (k delta = pi).
    Shkuratov et al. (2011), PSS 59, doi:10.1016/j.pss.2011.06.011.
    """
    sine = max(math.sin(phase), _PHASE_FLOOR)
    cosine = math.cos(phase)
    g = w0 + w1 * phase
    k = math.pi / (math.pi - phase)
    t = (mu0 - mu * cosine) / sine
    across = mu * mu + t * t  # cos(beta)^2
    delta = math.atan2(mu, t)
    sin_delta = mu / math.sqrt(across)
    sin_k, cos_k = math.sin(k * delta), math.cos(k * delta)
    quotient = sin_k / sin_delta
    half = math.cos(0.5 * phase)
    exponent = g * (k - 1.0)  # phase / (pi - phase) = k - 1
    log_beta = 0.5 * math.log(across)
    power = math.exp(exponent * log_beta)
    d = half * quotient * power
    # partial derivatives through delta, t and the explicit phase
    d_delta = half * power * (k * cos_k - quotient * t / math.sqrt(across)) / sin_delta
    d_log_beta = d * exponent
    along_t = -d_delta * mu / across + d_log_beta * t / across
    along_mu = d_delta * t / across + d_log_beta * mu / across
    t_phase = mu - t * cosine / sine
    k_phase = k * k / math.pi
    d_phase = (
        -0.5 * math.sin(0.5 * phase) * quotient * power
        + half * power * cos_k * delta / sin_delta * k_phase
        + d * log_beta * (w1 * (k - 1.0) + g * k_phase)
        + along_t * t_phase
    )
    return d, along_t / sine, along_mu - along_t * cosine / sine, d_phase, d * log_beta * (k - 1.0)


@njit(cache=True)
def _disk(kind, mu0, mu, phase, w0, w1):
    if kind == 0:
        return akimov(mu0, mu, phase, 1.0, 0.0)
    if kind == 1:
        return mcewen(mu0, mu, phase, w0, w1)
    if kind == 2:
        return akimov(mu0, mu, phase, w0, w1)
    if kind == 3:
        return lunar_lambert(mu0, mu, phase, w0, w1)
    return minnaert(mu0, mu, phase, w0, w1)


@njit(cache=True, inline="always")
def _hapke_parameters(packed):
    """w, theta, b, c, b0, h."""
    return packed[1], packed[2], packed[3], packed[4], packed[5], packed[6]


@njit(cache=True)
def _hapke(packed, mu0, mu, phase):
    """Hapke's model over its value at mu0 = mu = 1, phase = 0, and partial derivatives (`photoclinometry.hapke`)."""
    overhead = packed[7]
    value, by_mu0, by_mu, by_phase = hapke.by_angles(mu0, mu, phase, *_hapke_parameters(packed))
    return value / overhead, by_mu0 / overhead, by_mu / overhead, by_phase / overhead


@njit(cache=True)
def photometric_function(packed, mu0, mu, phase):
    """rho = Lambda(phase) d(mu0, mu, phase) and its partial derivatives by mu0, mu, phase (Eq. 19).

    packed: `Reflectance.packed`. All zero where unlit or unseen (mu0 <= 0 or mu <= 0).
    """
    if mu0 <= 0.0 or mu <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    if packed[0] == HAPKE:
        return _hapke(packed, mu0, mu, phase)
    d, d_mu0, d_mu, d_phase, _ = _disk(int(packed[0]), mu0, mu, phase, packed[1], packed[2])
    value, slope = 0.0, 0.0
    for i in range(packed.size - 1, 2, -1):  # Horner, c_0 = 1
        slope = slope * phase + value
        value = value * phase + packed[i]
    slope = slope * phase + value
    value = value * phase + 1.0
    return value * d, value * d_mu0, value * d_mu, value * d_phase + slope * d


@njit(cache=True)
def photometric_value(packed, mu0, mu, phase):
    """rho alone, which of Hapke's model takes a quarter of the time."""
    if packed[0] != HAPKE:
        return photometric_function(packed, mu0, mu, phase)[0]
    if mu0 <= 0.0 or mu <= 0.0:
        return 0.0
    return hapke.radiance(mu0, mu, phase, *_hapke_parameters(packed)) / packed[7]


@njit(cache=True)
def photometric_parameters(packed, mu0, mu, phase, out):
    """Partial derivatives of rho by `Reflectance.parameters` into out (T,). Zero where unlit or unseen."""
    out[:] = 0.0
    if mu0 <= 0.0 or mu <= 0.0:
        return
    if packed[0] == HAPKE:
        overhead = packed[7]
        value, by_parameter = hapke.by_parameters(mu0, mu, phase, *_hapke_parameters(packed))
        for i in range(6):
            out[i] = (by_parameter[i] - value / overhead * packed[8 + i]) / overhead
        return
    d, _, _, _, by_weight = _disk(int(packed[0]), mu0, mu, phase, packed[1], packed[2])
    value, power = 1.0, 1.0
    for i in range(3, packed.size):
        power *= phase
        value += packed[i] * power
        out[i - 1] = power * d
    out[0] = value * by_weight
    out[1] = value * by_weight * phase


@njit(cache=True)
def phase_angle(cosine, sine):
    """Phase [rad] from s.e and |s x e|: no infinite slope at zero phase."""
    return math.atan2(sine, cosine)


@njit(cache=True, inline="always")
def angles_at(sun, center, position, normal):
    """`photometric_angles` of one point: mu0, mu, phase [rad]; (3,) each."""
    n0, n1, n2 = normal[0], normal[1], normal[2]
    e0, e1, e2 = center[0] - position[0], center[1] - position[1], center[2] - position[2]
    inverse = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    e0, e1, e2 = e0 * inverse, e1 * inverse, e2 * inverse
    s0, s1, s2 = sun[0], sun[1], sun[2]
    x0, x1, x2 = s1 * e2 - s2 * e1, s2 * e0 - s0 * e2, s0 * e1 - s1 * e0
    phase = phase_angle(s0 * e0 + s1 * e1 + s2 * e2, math.sqrt(x0 * x0 + x1 * x1 + x2 * x2))
    return s0 * n0 + s1 * n1 + s2 * n2, e0 * n0 + e1 * n1 + e2 * n2, phase


@njit(cache=True)
def _evaluate(packed, mu0, mu, phase, out):
    for i in range(out.size):
        out[i] = photometric_value(packed, mu0[i], mu[i], phase[i])


DISK_FUNCTIONS = {"akimov": 0, "mcewen": 1, "akimov+": 2, "lunar-lambert": 3, "minnaert": 4, "hapke": HAPKE}

HAS_PHASE_FUNCTION = {"akimov+", "lunar-lambert", "minnaert", "hapke"}
"""The others describe brightness up to a factor per image (paper Eq. 30)."""

# Table 2 (Schroeder et al. 2013, 2017): w0, w1 per degree, c_i per degree^i.
_COEFFICIENTS = {
    ("vesta", "akimov+"): (1.57, -9.88e-3, -1.9219e-2, 2.2193e-4, -1.6245e-6, 4.6468e-9),
    ("vesta", "lunar-lambert"): (0.830, -7.22e-3, -1.7160e-2, 1.8306e-4, -1.0399e-6, 2.3223e-9),
    ("vesta", "minnaert"): (0.554, 4.35e-3, -1.6910e-2, 1.7807e-4, -9.7674e-7, 2.1063e-9),
    ("ceres", "akimov+"): (1.109, -2.85e-3, -2.2435e-2, 2.1477e-4, -7.5103e-7),
    ("ceres", "lunar-lambert"): (0.896, -8.87e-3, -2.2118e-2, 2.0912e-4, -6.4209e-7),
    ("ceres", "minnaert"): (0.514, 5.09e-3, -2.2568e-2, 2.2297e-4, -7.3108e-7),
}


@dataclass(frozen=True)
class Reflectance:
    """A disk function with its phase weighting and phase function."""

    disk: str
    """One of DISK_FUNCTIONS."""
    weight: tuple[float, float] = (0.0, 0.0)
    """g(phase) = weight[0] + weight[1] phase  [-, 1/rad]; unused by "akimov" and "mcewen". Of "hapke", what shapes its
    disk function: single-scattering albedo w [-] and mean slope theta-bar [rad]."""
    phase_coefficients: tuple[float, ...] = ()
    """c_1, c_2, ... of Lambda(phase) = 1 + sum c_i phase^i  [1/rad^i]. Of "hapke" b, c, B0, h [-], what shapes its
    phase function (`hapke.radiance`)."""

    def __post_init__(self):
        if self.disk not in DISK_FUNCTIONS:
            raise InputError(f"no disk function {self.disk!r}; known: {', '.join(DISK_FUNCTIONS)}")
        if self.disk == "hapke" and len(self.phase_coefficients) != 4:
            raise InputError(f"hapke needs the four phase coefficients b, c, B0, h; got {self.phase_coefficients}")

    @property
    def packed(self) -> np.ndarray:
        """(3 + n,) float64 for compiled code: disk function's number, w0, w1, c_1 ... c_n; of "hapke" then its value
        at mu0 = mu = 1, phase = 0 and the derivatives of that by the parameters, and NaN behind the number where these
        are not physical: no brightness is explained so, and no estimate goes there."""
        packed = [DISK_FUNCTIONS[self.disk], *self.weight, *self.phase_coefficients]
        if self.disk == "hapke":
            if not hapke.is_physical(*packed[1:]):
                return np.array([HAPKE, *(np.nan,) * 13])
            value, by_parameter = hapke.by_parameters(1.0, 1.0, 0.0, *packed[1:])
            packed += [value, *by_parameter]
        return np.array(packed, float)

    @property
    def parameters(self) -> np.ndarray:
        """(T,) w0, w1, c_1 ... c_n; of "hapke" w, theta-bar [rad], b, c, B0, h; none of models without a phase
        function."""
        known = self.disk in HAS_PHASE_FUNCTION
        return np.array([*self.weight, *self.phase_coefficients] if known else [], float)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Of `parameters`."""
        if self.disk == "hapke":
            return "w", "theta", "b", "c", "B0", "h"
        return tuple(f"w{i}" if i < 2 else f"c{i - 1}" for i in range(len(self.parameters)))

    def relative_change(self, other: Reflectance) -> np.ndarray:
        """(T,) by how much the parameters of another estimate of the same model differ, relative to these; 0 of a 0."""
        own = self.parameters
        return np.divide(other.parameters - own, own, out=np.zeros(len(own)), where=own != 0)

    def with_parameters(self, values: np.ndarray) -> Reflectance:
        """The same model with other `parameters` (T,)."""
        if len(values) == 0:
            return self
        w0, w1, *coefficients = map(float, values)
        return Reflectance(self.disk, (w0, w1), tuple(coefficients))

    def __call__(self, mu0: np.ndarray, mu: np.ndarray, phase: np.ndarray) -> np.ndarray:
        """The photometric function rho, so that I/F = albedo * rho; arrays of any common shape.

        mu0, mu: cosines of incidence and emission; phase [rad]. Zero where mu0 <= 0 or mu <= 0.
        """
        mu0, mu, phase = np.broadcast_arrays(*(np.asarray(x, float) for x in (mu0, mu, phase)))
        out = np.empty(mu0.size)
        _evaluate(self.packed, mu0.ravel(), mu.ravel(), phase.ravel(), out)
        return out.reshape(mu0.shape)

    def phase_function(self, phase: np.ndarray) -> np.ndarray:
        """Lambda(phase), phase [rad]; of "hapke", which has no such factor, rho at mu0 = mu = cos(phase / 2)."""
        if self.disk == "hapke":
            return self(np.cos(0.5 * np.asarray(phase)), np.cos(0.5 * np.asarray(phase)), phase)
        return np.polynomial.polynomial.polyval(phase, [1.0, *self.phase_coefficients])


def has_published(disk: str, body: str | None) -> bool:
    """Whether coefficients of this model are published for this body."""
    body = (body or "").lower()
    return body in hapke.PUBLISHED if disk == "hapke" else (body, disk) in _COEFFICIENTS


def published(disk: str, body: str | None = None) -> Reflectance:
    """The model with Table 2's coefficients of a body ("vesta", "ceres"), or those beside `hapke.PUBLISHED`.

    Bodies without published coefficients: pass a `Reflectance` of your own, or use "mcewen" or "akimov",
    which need none. Raises InputError.
    """
    name = disk.lower()
    if name not in DISK_FUNCTIONS:
        raise InputError(f"no reflectance model {disk!r}; known: {', '.join(DISK_FUNCTIONS)}")
    if name not in HAS_PHASE_FUNCTION:
        return Reflectance(name)
    key = ((body or "").lower(), name)
    if not has_published(name, body):
        known = ", ".join(sorted({b for b, _ in _COEFFICIENTS}))
        raise InputError(
            f"no published {name} coefficients for body {body!r} (known: {known}); "
            "use reflectance mcewen or akimov, which need none"
        )
    if name == "hapke":
        p = hapke.PUBLISHED[key[0]]
        return Reflectance(name, (p.w, math.radians(p.roughness_deg)), (p.b, p.c, p.surge, p.surge_width))
    w0, w1, *coefficients = _COEFFICIENTS[key]
    powers = tuple(c * DEG**i for i, c in enumerate(coefficients, start=1))
    return Reflectance(name, (w0, w1 * DEG), powers)


def photometric_angles(
    sun: np.ndarray, camera_center: np.ndarray, position: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """mu0, mu and phase [rad] at surface points.

    sun: (..., 3) unit vector towards the Sun; camera_center, position, normal: (..., 3); all in B.
    """
    to_camera = camera_center - position
    to_camera = to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
    mu0 = np.sum(sun * normal, -1)
    mu = np.sum(to_camera * normal, -1)
    sine = np.linalg.norm(np.cross(sun, to_camera), axis=-1)
    return mu0, mu, np.arctan2(sine, np.sum(sun * to_camera, -1))
