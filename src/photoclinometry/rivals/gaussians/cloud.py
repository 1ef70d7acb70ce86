"""A cloud of Gaussians as arrays of its parameters, which are unbounded: what has bounds is a function of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

GEOMETRY = ("position", "log_scale", "quaternion", "logit")
"""Parameters that every cloud has; further ones are those of its colour."""


@dataclass(frozen=True, kw_only=True)
class Cloud:
    """N Gaussians (Kerbl et al. 2023, section 4)."""

    position: np.ndarray
    """(N, 3) in B."""
    log_scale: np.ndarray
    """(N, 3) logarithms of the standard deviations along the Gaussian's axes, in the unit of B."""
    quaternion: np.ndarray
    """(N, 4) w, x, y, z of body_from_axes, of any length but 0."""
    logit: np.ndarray
    """(N,) of the opacity."""
    colour: Mapping[str, np.ndarray]
    """(N, ...) by name: what the brightness is made of."""

    def __len__(self) -> int:
        return len(self.logit)

    @property
    def opacity(self) -> np.ndarray:
        """(N,) between 0 and 1."""
        return 1.0 / (1.0 + np.exp(-self.logit))

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """All arrays by name."""
        return {name: getattr(self, name) for name in GEOMETRY} | dict(self.colour)

    @classmethod
    def of(cls, parameters: Mapping[str, np.ndarray]) -> Cloud:
        """The inverse of `parameters`."""
        colour = {name: values for name, values in parameters.items() if name not in GEOMETRY}
        return cls(**{name: parameters[name] for name in GEOMETRY}, colour=colour)


def rotations(quaternion: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) of quaternions (N, 4), of any length; the columns are a Gaussian's axes in B."""
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def flat_quaternions(normal: np.ndarray) -> np.ndarray:
    """Quaternions (N, 4) of rotations that turn the z axis to unit vectors (N, 3), the shortest way."""
    x, y, z = normal.T
    w = np.sqrt(np.maximum(0.5 * (1.0 + z), 1e-12))
    return np.stack([w, -0.5 * y / w, 0.5 * x / w, np.zeros_like(w)], -1)
