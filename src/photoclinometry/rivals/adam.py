"""Adam: steps by the mean and the mean square of past derivatives (Kingma and Ba 2015, arXiv:1412.6980)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

FLOOR = 1e-15
"""Constant that prevents a division by 0 (Kerbl et al. 2023; Mueller et al. 2022)."""


class Adam:
    """Adam's moments for a set of arrays by name."""

    def __init__(self, parameters: Mapping[str, np.ndarray], decays: tuple[float, float]):
        self.decays = decays
        self.first = {name: np.zeros_like(values) for name, values in parameters.items()}
        self.second = {name: np.zeros_like(values) for name, values in parameters.items()}
        self.steps = 0

    def step(self, by: Mapping[str, np.ndarray], rates: Mapping[str, float | np.ndarray]) -> dict[str, np.ndarray]:
        """The step to subtract from the parameters."""
        self.steps += 1
        a, b = self.decays
        change = {}
        for name, gradient in by.items():
            first, second = self.first[name], self.second[name]
            first += (1.0 - a) * (gradient - first)
            second += (1.0 - b) * (gradient**2 - second)
            size = np.sqrt(second / (1.0 - b**self.steps)) + FLOOR
            change[name] = rates[name] / (1.0 - a**self.steps) * first / size
        return change

    def follow(self, origin: np.ndarray) -> None:
        """The moments of arrays whose rows have come from rows `origin` (n,); those of new ones (-1) are 0."""
        for moments in (self.first, self.second):
            for name, values in moments.items():
                taken = values[np.maximum(origin, 0)]
                taken[origin < 0] = 0.0
                moments[name] = taken
