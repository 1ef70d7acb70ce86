"""Everything that shapes the map of a whole body."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from photoclinometry.model.errors import InputError
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.sfm import SfmOptions


@dataclass(frozen=True, kw_only=True)
class TilePlanOptions(Ranged):
    """The choice of regions, images and views of the tiles."""

    tile_px: Annotated[int, Range(least=32, most=4096)] = 128
    """Width and height of a tile in its reference image [px]; less where the image is smaller."""
    overlap: Annotated[float, Range(least=0, below=0.5)] = 0.12
    """Share of a tile's width, at each side, by which neighbouring tiles overlap."""
    max_views: Annotated[int, Range(least=3, most=1000)] = 16
    """Views of a tile at most, those that differ most in light and line of sight."""
    min_views: Annotated[int, Range(least=3, most=1000)] = 4
    """Fewest views that must see ground lit for it to be mapped."""
    max_emission_deg: Annotated[float, Range(above=0, most=85)] = 60.0
    """Views that see ground at a greater emission angle [degrees] do not count for it."""
    max_incidence_deg: Annotated[float, Range(above=0, most=90)] = 80.0
    """Views in which the ground has a greater incidence angle [degrees] do not count for it either."""


def _tile_options() -> RunOptions:
    return RunOptions(check_views=False)


@dataclass(frozen=True, kw_only=True)
class BodyOptions(Ranged):
    """Everything that shapes the map of a body."""

    sfm: SfmOptions = field(default_factory=lambda: SfmOptions(min_pair_matches=10))
    plan: TilePlanOptions = field(default_factory=TilePlanOptions)
    run: RunOptions = field(default_factory=_tile_options)
    """How each tile is mapped."""

    def __post_init__(self):
        super().__post_init__()
        if self.run.hold_out or self.run.control is not None or self.run.altimetry is not None:
            raise InputError(
                "--run.hold-out, --run.control and --run.altimetry are of a place: tiles share the poses of all views, "
                "which none may change. Leave views out of site.toml; the other two go with `phomo run`"
            )
