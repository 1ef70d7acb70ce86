"""The inputs from which `site.py` makes a site: a place or a whole body, its views, and the writer of its truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from photoclinometry.io.site import RegionRequest
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.scene import Views
from photoclinometry.simulate.observe import RayTracer
from photoclinometry.simulate.photometry import Photometry


@dataclass(frozen=True, kw_only=True)
class SimulatedPlace:
    """A surface and the views of it, without noise."""

    name: str
    body: str
    """The body whose reflectance it has."""
    tracer: RayTracer
    photometry: Photometry
    views: Views
    write_truth: Callable[[Path, Views], None]
    """Writes truth files into a folder, for the views with their scales and biases."""
    region: RegionRequest | None = None
    altimetry: AltimeterTracks | None = None
    body_radius_m: float | None = None
    shows_sky: bool = False
    """Whether images may reach beyond the surface."""
    settings: dict[str, Any] = field(default_factory=dict)
    """Quantities that follow from the options and are worth keeping beside them."""
