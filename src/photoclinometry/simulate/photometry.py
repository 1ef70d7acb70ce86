"""How the simulated surface scatters light: any reflectance model of the package, or Hapke's."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from photoclinometry.model.reflectance import Reflectance, published
from photoclinometry.simulate.hapke import Hapke, published_hapke

Photometry = Reflectance | Hapke


def named_photometry(name: str, body: str) -> Photometry:
    """The published model of a body: "hapke", or a disk function by name. Raises InputError."""
    return published_hapke(body) if name.lower() == "hapke" else published(name, body)


def radiance_factor(
    photometry: Photometry, albedo: np.ndarray, mu0: np.ndarray, mu: np.ndarray, phase: np.ndarray
) -> np.ndarray:
    """I/F for normal albedo, cosines of incidence and emission, phase [rad]; zero where unlit or unseen."""
    if isinstance(photometry, Hapke):
        return photometry.radiance_factor(albedo, mu0, mu, phase)
    return albedo * photometry(mu0, mu, phase)


def as_dict(photometry: Photometry) -> dict[str, Any]:
    """Plain values from which `from_dict` makes the same model again."""
    return {"model": "hapke" if isinstance(photometry, Hapke) else "reflectance", **asdict(photometry)}


def from_dict(values: dict[str, Any]) -> Photometry:
    """The model that `as_dict` described."""
    kind: Any = Hapke if values["model"] == "hapke" else Reflectance
    known: dict[str, Any] = {f.name: values[f.name] for f in fields(kind)}
    return kind(**{key: tuple(v) if isinstance(v, list) else v for key, v in known.items()})
