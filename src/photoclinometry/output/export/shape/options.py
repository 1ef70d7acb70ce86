"""Properties of a body besides its shape, and the resolution of its products."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from photoclinometry.model.ranges import Range, Ranged


@dataclass(frozen=True, kw_only=True)
class ShapeOptions(Ranged):
    """Of whole bodies alone."""

    density_kg_m3: Annotated[float | None, Range(above=0)] = None
    """Bulk density, the same everywhere [kg/m^3]. Without it nothing is said of gravity, slope and elevation."""
    spin_period_h: Annotated[float | None, Range(above=0)] = None
    """Sidereal period of rotation about z [h]. Left out: gravity without the centrifugal acceleration."""
    gravity_facets: Annotated[int, Range(least=100, most=400_000)] = 20_000
    """Facets of the mesh over which gravity is summed. It has the model's mass, and its gravity is carried to the
    model."""
    correlation_m: Annotated[float | None, Range(least=0, infinite=True)] = None
    """Distance over which errors of heights are correlated, for the standard deviations of volume, centre and inertia
    [m]; 0 for independent errors, inf for one that all share. Left out: a tenth of the mean radius."""
    icq_q: Literal[64, 128, 256, 512] | None = None
    """Q of the ICQ model: 6 (Q + 1)^2 vertices. Left out: the one nearest to the model's facets."""
    naif_id: Annotated[int | None, Range(least=-2_147_483_648, most=2_147_483_647)] = None
    """NAIF code of the body for the DSK. Left out: SPICE's code for --body."""
    frame: str | None = None
    """SPICE's name of the body-fixed frame for the DSK. Left out: the one that SPICE has for the body."""
    surface_id: Annotated[int, Range(least=1, most=2_147_483_647)] = 1
    """NAIF code of the surface in the DSK, which distinguishes models of a body."""
    kernels: tuple[Path, ...] = ()
    """Text kernels that define the body or its frame, for the DSK."""
