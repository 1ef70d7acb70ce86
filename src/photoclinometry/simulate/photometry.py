"""How the simulated surface scatters light: any reflectance model of the package, or Hapke's."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from photoclinometry.model.reflectance import MODELS, Reflectance, starting_model
from photoclinometry.simulate.hapke import Hapke, published_hapke

Photometry = Reflectance | Hapke
"""Of Hapke's model the single-scattering albedo differs from place to place, where `Reflectance` scales brightness."""


def named_photometry(name: str, body: str) -> Photometry:
    """The model of a body: its published parameters, or the model's neutral ones. Raises InputError."""
    return published_hapke(body) if name.lower() == "hapke" else starting_model(name, body)


def radiance_factor(
    photometry: Photometry, albedo: np.ndarray, mu0: np.ndarray, mu: np.ndarray, phase: np.ndarray
) -> np.ndarray:
    """I/F for normal albedo, cosines of incidence and emission, phase [rad]; zero where unlit or unseen.

    Arrays of one shape.
    """
    if isinstance(photometry, Hapke):
        return photometry.radiance_factor(albedo, mu0, mu, phase)
    return albedo * photometry(mu0, mu, phase)


def as_dict(photometry: Photometry) -> dict[str, Any]:
    """Plain values from which `from_dict` makes the same model again."""
    return {"model": "hapke" if isinstance(photometry, Hapke) else "reflectance", **asdict(photometry)}


def from_dict(values: dict[str, Any]) -> Photometry:
    """The model that `as_dict` described."""
    values = dict(values)
    if values.pop("model") == "hapke":
        return Hapke(**values)
    if "disk" in values:  # written before parameters had names
        name = values["disk"]
        given = (*values["weight"], *values["phase_coefficients"])
        return Reflectance(name, given if MODELS[name].parameters else ())
    return Reflectance(values["name"], tuple(values["values"]))
