"""Values of every reflectance model at fixed angles, stored to the last bit, and the recipe that stores them.

`python tests/stored_reflectance.py` writes `stored_reflectance.json`. Do so only for a change of numbers that is meant,
with an empty cache of compiled functions (`NUMBA_CACHE_DIR`): a function loaded from the cache is not inlined into its
callers, and rounds otherwise.
"""

import json
import platform
from pathlib import Path

import numpy as np

from photoclinometry.model.reflectance import photometric_function, photometric_parameters, photometric_value, published

FILE = Path(__file__).with_suffix(".json")
MODELS = ("akimov", "mcewen", "akimov+", "lunar-lambert", "minnaert", "hapke")
BODIES = ("vesta", "ceres")
ANGLES = (
    (1.0, 1.0, 0.0),
    (0.6, 0.6, 0.0),
    (0.95, 0.93, 0.01),
    (0.7, 0.5, 0.8),
    (0.3, 0.9, 1.1),
    (0.05, 0.8, 1.4),
    (0.6, 0.02, 1.2),
    (0.2, 0.3, 2.3),
)
"""mu0, mu and phase [rad]: overhead, without phase, near it, usual, grazing either way, large phase."""


def evaluated(name: str, body: str) -> list[list[str]]:
    """For each of ANGLES: rho, its derivatives by mu0, mu and phase, rho alone, its derivatives by the parameters."""
    model, rows = published(name, body), []
    vector = model.parameter_vector
    for angles in ANGLES:
        by_parameter = np.zeros(len(model.parameters))
        if len(by_parameter):
            photometric_parameters(vector, *angles, by_parameter)
        function, value = photometric_function(vector, *angles), photometric_value(vector, *angles)
        rows.append([float(x).hex() for x in (*function, value, *by_parameter)])
    return rows


def all_values() -> str:
    """As JSON, with the machine whose processor computed them."""
    values = {f"{name}-{body}": evaluated(name, body) for name in MODELS for body in BODIES}
    return json.dumps({"machine": platform.machine(), "values": values}, indent=0) + "\n"


if __name__ == "__main__":
    FILE.write_text(all_values())
