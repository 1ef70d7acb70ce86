"""Figures of the merged surface: its size, its mapped share, and its uncertainties."""

from __future__ import annotations

import numpy as np

from photoclinometry.body.merge import MergedSurface
from photoclinometry.evaluate.metrics import spread
from photoclinometry.surface.closed_mesh import area_vectors, signed_volume
from photoclinometry.surface.mass_properties import DEFAULT_CORRELATION, mass_properties, mean_radius

EXTENTS = ("longest", "middle", "shortest")


def surface_figures(surface: MergedSurface) -> dict[str, float]:
    """For metrics.json; docs/reference/metrics.md says what each means. Lengths are in the unit of B.

    Extents are along the principal axes of inertia. The standard deviation of the volume assumes that errors of heights
    are correlated over DEFAULT_CORRELATION of the mean radius; NaN where no heights have one.
    """
    area = np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=-1)
    mapped = (surface.views[surface.faces] > 0).all(1)
    found = {
        "facets": len(surface.faces),
        "mapped_percent": 100.0 * float(area[mapped].sum() / area.sum()),
        **_size(surface),
        "area": float(area.sum()),
        "gsd": surface.gsd,
        "height_sigma_median_gsd": _median(surface.height_sigma) / surface.gsd,
        "normal_sigma_median_deg": float(np.degrees(_median(surface.normal_sigma))),
        "albedo_sigma_median_percent": 100.0 * _median(surface.albedo_sigma),
    }
    names = ("height", "normal", "albedo")
    found |= {f"{name}_sigma_factor": float(f) for name, f in zip(names, surface.sigma_factor, strict=True)}
    overlap = surface.step[np.isfinite(surface.step)] / surface.gsd
    return found | (spread(overlap, "step_between_tiles", "gsd") if len(overlap) else {})


def _size(surface: MergedSurface) -> dict[str, float]:
    """Volume, its standard deviation, the radius of the sphere of that volume, and the extents."""
    vertices, faces = surface.vertices, surface.faces
    found = mass_properties(
        vertices,
        faces,
        normals=surface.normals,
        sigma_height=surface.height_sigma,
        correlation_length=DEFAULT_CORRELATION * mean_radius(signed_volume(vertices, faces)),
    )
    extent = np.sort(np.ptp(vertices @ np.linalg.eigh(found.inertia)[1], axis=0))[::-1]
    return {
        "mean_radius": found.mean_radius,
        "volume": found.volume,
        "volume_sigma": found.sigma_volume,
        **{f"{name}_extent": float(value) for name, value in zip(EXTENTS, extent, strict=True)},
    }


def _median(sigma: np.ndarray) -> float:
    """Of those that are known; NaN without any."""
    known = sigma[np.isfinite(sigma)]
    return float(np.median(known)) if len(known) else float("nan")
