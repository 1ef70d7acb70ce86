"""Ground that scatters light by Hapke's model (`model/reflectance/hapke.py`), its albedo different from place to place.

The surface is described by its normal albedo: I/F at zero incidence, emission and phase, opposition surge included.
`single_scattering_albedo` finds the single-scattering albedo that has this normal albedo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance.hapke import PUBLISHED, radiance

_MAX_SINGLE_SCATTERING = 0.9999
"""Single-scattering albedos are looked up to here; at 1 nothing is absorbed."""


@njit(cache=True, nogil=True)
def _evaluate(w, mu0, mu, phase, b, c, b0, h, theta, out):
    """I/F into out (n,) from w, mu0, mu, phase [rad], (n,) each; zero where unlit or unseen."""
    for n in range(out.size):
        lit = mu0[n] > 0.0 and mu[n] > 0.0
        out[n] = radiance(mu0[n], mu[n], phase[n], w[n], theta, b, c, b0, h) if lit else 0.0


@dataclass(frozen=True, kw_only=True)
class Hapke:
    """Parameters that the whole surface shares; its albedo varies from place to place."""

    b: float
    """Width of the Henyey-Greenstein lobes, 0 <= b < 1."""
    c: float = 1.0
    """Backward against forward lobe, -1 to 1."""
    surge: float
    """Amplitude B0 of the opposition surge."""
    surge_width: float
    """Angular width parameter h of the surge [-]."""
    roughness_deg: float
    """Mean slope angle theta-bar."""

    def __post_init__(self):
        if not (
            0 <= self.b < 1
            and -1 <= self.c <= 1
            and self.surge >= 0
            and self.surge_width > 0
            and 0 <= self.roughness_deg <= 60
        ):
            raise InputError(f"Hapke parameters out of range: {self}")

    @property
    def _shared(self) -> tuple[float, float, float, float, float]:
        return self.b, self.c, self.surge, self.surge_width, math.radians(self.roughness_deg)

    def from_single_scattering(self, w: ArrayLike, mu0: ArrayLike, mu: ArrayLike, phase: ArrayLike) -> np.ndarray:
        """I/F for single-scattering albedo w, cosines mu0 and mu, phase [rad]; arrays of a common shape."""
        w, mu0, mu, phase = np.broadcast_arrays(*(np.asarray(x, float) for x in (w, mu0, mu, phase)))
        out = np.empty(w.size)
        _evaluate(w.ravel(), mu0.ravel(), mu.ravel(), phase.ravel(), *self._shared, out)
        return out.reshape(w.shape)

    def normal_albedo(self, w: np.ndarray) -> np.ndarray:
        """I/F at zero incidence, emission and phase of single-scattering albedo w."""
        return self.from_single_scattering(w, 1.0, 1.0, 0.0)

    def single_scattering_albedo(self, normal_albedo: np.ndarray) -> np.ndarray:
        """The inverse of `normal_albedo`, to 1e-6. Raises InputError for albedos that no w reaches."""
        w = 1.0 - np.linspace(1.0, math.sqrt(1.0 - _MAX_SINGLE_SCATTERING), 4001) ** 2
        table = self.normal_albedo(w)
        found = np.asarray(normal_albedo, float)
        if found.size and (np.nanmin(found) < 0 or np.nanmax(found) > table[-1]):
            raise InputError(
                f"normal albedo from {np.nanmin(found):.3g} to {np.nanmax(found):.3g}: this Hapke model "
                f"reaches 0 to {table[-1]:.3g}; lower the albedo"
            )
        return np.interp(found, table, w)

    def radiance_factor(self, albedo: np.ndarray, mu0: ArrayLike, mu: ArrayLike, phase: ArrayLike) -> np.ndarray:
        """I/F for normal albedo, cosines mu0 and mu, phase [rad]; arrays of a common shape."""
        return self.from_single_scattering(self.single_scattering_albedo(albedo), mu0, mu, phase)


BODIES = {
    body: Hapke(b=p.b, c=p.c, surge=p.surge, surge_width=p.surge_width, roughness_deg=p.roughness_deg)
    for body, p in PUBLISHED.items()
}


def published_hapke(body: str | None) -> Hapke:
    """Parameters of "vesta" or "ceres"; sources beside `PUBLISHED`. Raises InputError."""
    key = (body or "").lower()
    if key not in BODIES:
        raise InputError(f"no Hapke parameters for body {body!r}; known: {', '.join(BODIES)}")
    return BODIES[key]
