"""Training of a cloud on pictures: Adam over single views in random order, with density control on the way.

Kingma and Ba (2015), arXiv:1412.6980; rates of Kerbl et al. (2023). Their schedule is of 30,000 iterations; here
degrees and the begin and end of density control come at shares of the iterations, at larger ones than theirs since
there are fewer iterations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.rivals.adam import Adam
from photoclinometry.rivals.gaussians.cloud import Cloud
from photoclinometry.rivals.gaussians.colour import Colour, HarmonicColour
from photoclinometry.rivals.gaussians.density import densified
from photoclinometry.rivals.gaussians.loss import Gradients, Target, gradients

RATES = {"log_scale": 5e-3, "quaternion": 1e-3, "logit": 0.05, "harmonics": 2.5e-3, "log_albedo": 5e-3}
"""Adam's step of each parameter (Kerbl et al. 2023); that of albedos is as of scales."""
HIGHER_HARMONICS = 1.0 / 20.0
"""Rate of harmonics above degree 0, over that of degree 0."""
POSITION_RATES = (1.6e-4, 1.6e-6)
"""Of positions at the begin and at the end, over the map's radius; between these geometrically."""
EXPOSURE_RATE = 1e-3
"""Of the gain and offset of each view."""
MOMENTS = (0.9, 0.999)
"""Adam's decays (Kerbl et al. 2023)."""
DEGREE_EVERY = 0.1
"""Harmonics get a further degree after each such share of the iterations (1 / 30 in Kerbl et al. 2023)."""
DENSIFY_FROM, DENSIFY_TO, DENSIFY_EVERY = 0.05, 0.5, 100
"""Start and end of density control, as shares of the iterations, and its interval (Kerbl et al. 2023: from 1 / 60 to 1
/ 2, every 100, so that there are 145 rounds of it; of 1,000 iterations there are five)."""
HISTORY_EVERY = 50
"""Iterations over which the recorded losses are means."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """Options of the training of a cloud."""

    iterations: int
    growth: float
    """Gaussians at most, over those at the start."""
    radius: float
    """Of the map, in the unit of B."""
    exposures: bool
    """Whether each view has a gain and an offset of its own."""
    seed: int = 0


@dataclass(frozen=True)
class Trained:
    """The outcome of a training."""

    cloud: Cloud
    exposure: np.ndarray
    """(K, 2) gain and offset of each view."""
    history: list[float]
    """Mean loss of every HISTORY_EVERY iterations."""


def train(
    cloud: Cloud,
    colour: Colour,
    targets: Sequence[Target],
    training: Training,
    progress: Callable[[int, int], None] | None = None,
) -> Trained:
    """The cloud that explains the targets best."""
    rng = np.random.default_rng(training.seed)
    most = int(training.growth * len(cloud))
    exposure, exposed = np.tile([1.0, 0.0], (len(targets), 1)), Adam({"exposure": np.zeros((len(targets), 2))}, MOMENTS)
    adam, order, history, losses = Adam(cloud.parameters, MOMENTS), [], [], []
    pulled, times = np.zeros(len(cloud)), np.zeros(len(cloud))
    for n in range(training.iterations):
        if not order:
            order = list(rng.permutation(len(targets)))
        k = order.pop()
        found = gradients(cloud, _at_degree(colour, n / training.iterations), targets[k], *exposure[k])
        losses.append(found.loss)
        change = adam.step(found.by, _rates(cloud, training, n))
        cloud = Cloud.of({name: values - change[name] for name, values in cloud.parameters.items()})
        if training.exposures:
            by = np.zeros_like(exposure)
            by[k] = found.by_gain, found.by_offset
            exposure = exposure - exposed.step({"exposure": by}, {"exposure": EXPOSURE_RATE})["exposure"]
        pulled += _pull(found, targets[k].mask.shape)
        times += found.seen
        share = (n + 1) / training.iterations
        if (n + 1) % DENSIFY_EVERY == 0 and DENSIFY_FROM <= share <= DENSIFY_TO:
            cloud, origin = densified(cloud, pulled / np.maximum(times, 1), training.radius, most, rng)
            adam.follow(origin)
            pulled, times = np.zeros(len(cloud)), np.zeros(len(cloud))
        if len(losses) == HISTORY_EVERY or n + 1 == training.iterations:
            history.append(float(np.mean(losses)))
            losses = []
            if progress is not None:
                progress(n + 1, training.iterations)
    return Trained(cloud, exposure, history)


def _at_degree(colour: Colour, share: float) -> Colour:
    """Harmonics of as many degrees as are in use after a share of the iterations; other colours as they are."""
    if isinstance(colour, HarmonicColour):
        return replace(colour, degree=min(colour.degree, int(share / DEGREE_EVERY)))
    return colour


def _rates(cloud: Cloud, training: Training, n: int) -> dict[str, float | np.ndarray]:
    """Adam's step of every parameter in iteration n."""
    first, last = POSITION_RATES
    rates: dict[str, float | np.ndarray] = dict(RATES)
    rates["position"] = training.radius * first * (last / first) ** (n / training.iterations)
    if "harmonics" in cloud.colour:
        count = cloud.colour["harmonics"].shape[1]
        rates["harmonics"] = RATES["harmonics"] * np.r_[1.0, np.full(count - 1, HIGHER_HARMONICS)]
    return rates


def _pull(found: Gradients, shape: tuple[int, int]) -> np.ndarray:
    """(N,) lengths of the derivatives by places, in units of half the picture."""
    return np.hypot(found.by_center[:, 0] * 0.5 * shape[1], found.by_center[:, 1] * 0.5 * shape[0])
