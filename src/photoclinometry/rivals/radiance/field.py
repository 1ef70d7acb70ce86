"""A radiance field: density by the place, brightness by place and direction, and its picture along rays.

Mueller et al. (2022), section 5.4, with one brightness in place of three colours; the picture by the quadrature of
Mildenhall et al. (2020, NeRF), arXiv:2003.08934, Eq. 3:

    C = sum_i T_i (1 - exp(-sigma_i delta_i)) c_i,    T_i = exp(-sum_{j < i} sigma_j delta_j)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.rivals.gaussians.harmonics import MOST_DEGREE, basis
from photoclinometry.rivals.radiance.hash_grid import FEATURES, encode, encode_back
from photoclinometry.rivals.radiance.network import backward, first_weights, forward

WIDTH = 64
"""Neurons of hidden layers (Mueller et al. 2022, section 5.4)."""
GEOMETRY = 16
"""Outputs of the network of density, of which the first is the density's logarithm (Mueller et al. 2022)."""
_TABLE = 1e-4
"""Bound of the table's first, uniform numbers (Mueller et al. 2022, section 4)."""
_MOST_LOG_DENSITY = 15.0
"""Above, densities are opaque at any step."""

Parameters = dict[str, np.ndarray]


@dataclass(frozen=True)
class Rays:
    """Samples along n rays in the unit cube."""

    places: np.ndarray
    """(n, S, 3)."""
    steps: np.ndarray
    """(n, S) lengths that the samples stand for, in sides of the cube."""
    directions: np.ndarray
    """(n, 3) unit vectors."""


@dataclass(frozen=True)
class Drawn:
    """Brightness and depth along rays."""

    brightness: np.ndarray
    """(n,)."""
    weight: np.ndarray
    """(n, S) share of each sample in the picture."""
    depth: np.ndarray
    """(n, S) optical depth of each sample."""
    value: np.ndarray
    """(n, S) its brightness."""
    passed: np.ndarray
    """(n, S) share of the light from behind it that reaches the camera."""
    density: list[np.ndarray]
    """Outputs of the layers of the density network for the n S samples (`network.forward`)."""
    brightness_layers: list[np.ndarray]
    """The same of the network of brightness."""


def first_parameters(rng: np.random.Generator, levels: int, size: int) -> Parameters:
    """Table and weights of a field that knows nothing."""
    directions = (MOST_DEGREE + 1) ** 2
    density = first_weights(rng, (levels * FEATURES, WIDTH, GEOMETRY))
    brightness = first_weights(rng, (GEOMETRY + directions, WIDTH, WIDTH, 1))
    table = rng.uniform(-_TABLE, _TABLE, (levels, size, FEATURES)).astype(np.float32)
    return (
        {"table": table}
        | {f"density_{k}": weight for k, weight in enumerate(density)}
        | {f"brightness_{k}": weight for k, weight in enumerate(brightness)}
    )


def draw(parameters: Parameters, cells: np.ndarray, rays: Rays) -> Drawn:
    """The brightness that rays see, 0 behind everything. cells: (L,) of the hash grid's levels."""
    count, samples, _ = rays.places.shape
    features = encode(rays.places.reshape(-1, 3), cells, parameters["table"])
    density = forward(_weights(parameters, "density"), features)
    geometry = density[-1]
    log_density = np.minimum(geometry[:, 0], _MOST_LOG_DENSITY)
    harmonics = basis(rays.directions, MOST_DEGREE)[0].astype(np.float32)
    seen_from = np.repeat(harmonics, samples, axis=0)
    brightness = forward(_weights(parameters, "brightness"), np.concatenate([geometry, seen_from], 1))
    value = 1.0 / (1.0 + np.exp(-brightness[-1][:, 0]))
    depth = (np.exp(log_density) * rays.steps.reshape(-1)).reshape(count, samples)
    value = value.reshape(count, samples)
    passed = np.exp(-np.cumsum(depth, axis=1))
    before = np.concatenate([np.ones((count, 1), passed.dtype), passed[:, :-1]], 1)
    weight = before - passed
    return Drawn(
        brightness=np.sum(weight * value, 1),
        weight=weight,
        depth=depth,
        value=value,
        passed=passed,
        density=density,
        brightness_layers=brightness,
    )


def draw_back(
    parameters: Parameters, cells: np.ndarray, rays: Rays, drawn: Drawn, by_brightness: np.ndarray
) -> Parameters:
    """Derivatives of a loss by the parameters, from those by the brightness (n,) of rays."""
    depth, value = drawn.depth, drawn.value
    by_value = by_brightness[:, None] * drawn.weight
    # A denser sample shows more and hides what is behind it: dC / d(depth_i) = T_(i+1) c_i - sum_(j > i) w_j c_j.
    shown = drawn.weight * value
    behind = np.cumsum(shown[:, ::-1], axis=1)[:, ::-1] - shown
    by_depth = by_brightness[:, None] * (drawn.passed * value - behind)
    by_logit = (by_value * value * (1.0 - value)).reshape(-1, 1).astype(np.float32)
    by_brightness_weights, by_input = backward(_weights(parameters, "brightness"), drawn.brightness_layers, by_logit)
    by_geometry = by_input[:, :GEOMETRY]
    bounded = drawn.density[-1][:, 0] < _MOST_LOG_DENSITY
    by_geometry[:, 0] += np.where(bounded, (by_depth * depth).reshape(-1), 0.0).astype(np.float32)
    by_density_weights, by_features = backward(_weights(parameters, "density"), drawn.density, by_geometry)
    places, size = rays.places.reshape(-1, 3), parameters["table"].shape[1]
    return (
        {"table": encode_back(places, cells, size, np.ascontiguousarray(by_features))}
        | {f"density_{k}": by for k, by in enumerate(by_density_weights)}
        | {f"brightness_{k}": by for k, by in enumerate(by_brightness_weights)}
    )


def _weights(parameters: Parameters, name: str) -> list[np.ndarray]:
    """The matrices of one network in order."""
    return [parameters[f"{name}_{k}"] for k in range(sum(key.startswith(f"{name}_") for key in parameters))]
