"""Volume, area, centre of mass and inertia as a file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.json_file import write_json
from photoclinometry.output.export.shape.placed import PlacedShape
from photoclinometry.surface.mass_properties import MassProperties

ASSUMPTION = (
    "errors of heights have the model's standard deviations, the mean zero, and the correlation exp(-d^2 / (2 L^2)) at "
    "a distance d; density is the same everywhere"
)


def write_properties(folder: Path, placed: PlacedShape, products: tuple[str, ...], options: Any) -> dict[str, str]:
    """Writes properties.json; returns its description. Raises RunFolderError."""
    length = placed.correlation
    found, independent, common = placed.properties((length, 0.0, math.inf))
    unit = placed.shape.unit or "unit"
    moments, axes = np.linalg.eigh(found.inertia)
    content: dict[str, Any] = {
        "unit": placed.shape.unit or "that of the model",
        "facets": len(placed.shape.faces),
        "star_shaped": placed.star_shaped,
        f"mean_radius_{unit}": found.mean_radius,
        f"volume_{unit}3": found.volume,
        f"area_{unit}2": found.area,
        f"center_of_mass_{unit}": found.center.tolist(),
        f"inertia_over_mass_{unit}2": found.inertia.tolist(),
        f"principal_moments_over_mass_{unit}2": moments.tolist(),
        "principal_axes": axes.T.tolist(),
        "sigma": _sigmas(found, length, unit),
        "sigma_if_errors_are_independent": _sigmas(independent, 0.0, unit),
        "sigma_if_all_share_one_error": _sigmas(common, math.inf, unit),
        "assumption": ASSUMPTION,
    }
    density = placed.options.density_kg_m3
    if density is not None:
        content["density_kg_m3"] = density
        content["mass_kg"] = density * found.volume
        content["spin_rate_rad_s"] = placed.spin
        assert placed.gravity is not None
        content["reference_potential_J_kg"] = placed.gravity.reference
    write_json(folder / "properties.json", content)
    return {"properties.json": "volume, area, centre of mass and inertia, with standard deviations"}


def _sigmas(found: MassProperties, length: float, unit: str) -> dict[str, Any] | None:
    """None where the model states no standard deviations of heights."""
    if math.isnan(found.sigma_volume):
        return None
    return {
        f"correlation_length_{unit}": length if math.isfinite(length) else "infinite",
        f"volume_{unit}3": found.sigma_volume,
        f"area_{unit}2": found.sigma_area,
        f"center_of_mass_{unit}": found.sigma_center.tolist(),
        f"inertia_over_mass_{unit}2": found.sigma_inertia.tolist(),
    }
