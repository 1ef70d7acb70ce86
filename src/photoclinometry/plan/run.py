"""A plan: the views that see the place, the map that they would make, and the gain by one more image."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.site import Site, read_site
from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.plan.candidates import Gain, candidates, gains, ranked, view_angles
from photoclinometry.plan.forecast import KINDS, Forecast, forecast
from photoclinometry.plan.options import PlanOptions
from photoclinometry.plan.place import PlannedViews, planned_views
from photoclinometry.plan.table import read_table


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The expected properties of a map before its images are taken."""

    name: str
    options: PlanOptions
    planned: PlannedViews
    forecast: Forecast
    gains: tuple[Gain, ...]
    """Of all candidates, best first; those that do not show the map are left out."""
    candidates_not_seen: dict[str, str]
    """Reasons why candidates of a table do not see the place, by name."""

    @cached_property
    def sigmas(self) -> dict[str, float]:
        """Mean, median, RMS and 90th percentile over the landmarks that are measured; names end in the unit."""
        found = {}
        for kind, values in self.forecast.sigmas().items():
            found |= _figures(KINDS[kind], values)
        for kind, values in self.forecast.in_frame.items():
            found |= _figures(f"in_frame_{KINDS[kind]}", values)
        return found

    @property
    def light(self) -> dict[str, float]:
        """Views, resolution, and the spread of the directions of Suns and cameras."""
        views = self.forecast.scene.views
        angles = [view_angles(views, k) for k in range(len(views))]
        count = np.diff(self.forecast.scene.tracks.start)
        lit = np.bincount(self.forecast.scene.tracks.landmark, self.forecast.adjustment.lit, len(count))
        gsd = [a["gsd_m"] for a in angles]
        return {
            "views": len(views),
            "landmarks_percent": 100.0 * len(count) / self.options.patch_px**2,
            "views_per_landmark_mean": float(count.mean()),
            "lit_views_per_landmark_mean": float(lit.mean()),
            "gsd_m": self.planned.gsd_m,
            "gsd_finest_m": min(gsd),
            "gsd_coarsest_m": max(gsd),
            **_range("incidence_deg", angles),
            **_range("emission_deg", angles),
            **_range("phase_deg", angles),
            "sun_spread_deg": _spread(views.sun),
            "camera_spread_deg": _spread(unit(views.body_from_cam.translation)),
        }

    def as_dict(self) -> dict[str, Any]:
        """Plain values for plan.json."""
        planned, views = self.planned, self.planned.views
        shown = set(self.forecast.scene.views.name)
        return {
            "name": self.name,
            "place": {
                "lon_deg": planned.place.lon_deg,
                "lat_deg": planned.place.lat_deg,
                "position_m": planned.place.position.tolist(),
                "normal": planned.place.normal.tolist(),
            },
            "reference": views.name[planned.reference],
            "region_px": planned.region_px,
            "map_px": self.options.patch_px,
            "last_estimate": "images" if self.forecast.direct else "matches",
            "sigmas": self.sigmas,
            "light": self.light,
            "views": [
                {"name": name, **view_angles(views, k), "shows_map": name in shown} for k, name in enumerate(views.name)
            ],
            "not_seen": planned.not_seen,
            "candidates": [
                {"name": g.candidate.name, "tries": g.candidate.tries, **g.angles, "drop_percent": g.drop_percent}
                for g in self.gains
            ],
            "candidates_not_seen": self.candidates_not_seen,
            "assumed": {
                "slope_deg": self.options.slope_deg,
                "albedo": self.options.albedo,
                "ground": self.forecast.ground.model_name,
                "reflectance": self.forecast.reflectance.name,
                "tie_points": self.options.tie_points,
                "tie_point_sigma_px": self.options.tie_point_sigma_px,
                "seed": self.options.seed,
            },
        }


def plan_site(
    site: Site, options: PlanOptions | None = None, *, with_candidates: bool = True, progress: Progress = no_progress
) -> Plan:
    """The plan of a site with poses. Images are not opened. Raises InputError where the views make no map."""
    options = options or PlanOptions()
    planned = planned_views(site, options)
    tried, not_seen = candidates(planned, options.candidates) if with_candidates else ([], {})
    found = forecast(planned, site.body, site.brightness, options, progress)
    gained = ranked(gains(found, tried, progress), options.kind) if tried else []
    return Plan(
        name=site.name,
        options=options,
        planned=planned,
        forecast=found,
        gains=tuple(gained),
        candidates_not_seen=not_seen,
    )


def read_views(path: Path | str) -> Site:
    """A site.toml, or a table of poses and Suns (.csv). Raises InputError."""
    path = Path(path)
    return read_table(path) if path.suffix.lower() == ".csv" else read_site(path)


def _figures(name: str, values: np.ndarray) -> dict[str, float]:
    stem, _, unit_name = name.rpartition("_")
    known = values[np.isfinite(values)]
    return {
        f"{stem}_mean_{unit_name}": float(np.mean(known)),
        f"{stem}_median_{unit_name}": float(np.median(known)),
        f"{stem}_rms_{unit_name}": float(np.sqrt(np.mean(known**2))),
        f"{stem}_p90_{unit_name}": float(np.percentile(known, 90.0)),
    }


def _range(name: str, angles: list[dict[str, float]]) -> dict[str, float]:
    stem, _, unit_name = name.rpartition("_")
    values = [each[name] for each in angles]
    return {f"{stem}_least_{unit_name}": min(values), f"{stem}_most_{unit_name}": max(values)}


def _spread(direction: np.ndarray) -> float:
    """RMS angle of unit vectors (K, 3) from their mean [deg]."""
    off = angle_between(direction, unit(direction.mean(0)))
    return float(np.degrees(np.sqrt(np.mean(off**2))))
