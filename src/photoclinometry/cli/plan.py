"""`phomo plan`: what a map from given views would have, before images are taken, and what one more image would add."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from photoclinometry.cli.site_path import site_file
from photoclinometry.plan.options import PlanOptions

if TYPE_CHECKING:
    from photoclinometry.plan.run import Plan

_SHOWN = 10
"""Candidates on the terminal; plan.json has all."""
_NAME_WIDTH = 24
"""Longer names of views are cut on the terminal, at their beginning."""


def plan(
    site: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    tried: Annotated[bool, tyro.conf.arg(name="candidates")] = True,
    options: Annotated[PlanOptions, tyro.conf.arg(name="")] = PlanOptions(),  # noqa: B008
) -> None:
    """Forecast the map from these views, before images are taken or processed, and the gain by one more image.

    The poses and Suns are those of a site with pose priors, or of a table. Images are not opened: the views look at
    ground of an assumed slope, and a small map of it is made as a run would make it, with the uncertainties that the
    run would state. Candidates for one more image are ranked by how far the mean sigmas fall.

    Args:
        site: A site.toml with pose priors, the folder with one, or a table of poses and Suns (.csv):
            view,x_m,y_m,z_m,sun_x,sun_y,sun_z,focal_px,width_px,height_px.
        out: Folder for plan.json and the pictures. Default: plan/ beside the site.
        tried: Try candidates for one more image; they take two thirds of the time.
        options: The place, what is assumed of the ground, and the candidates.
    """
    from rich.console import Console

    import photoclinometry as pcm
    from photoclinometry.cli.bars import progress_bars

    path = site_file(site)
    folder = out or path.parent / "plan"
    with progress_bars(Console(stderr=True)) as progress:
        found = pcm.plan(path, out=folder, options=options, with_candidates=tried, progress=progress)
    for line in lines(found):
        print(line)
    print(folder)


def lines(found: Plan) -> list[str]:
    """The plan for a terminal of 80 columns."""
    return [*_about(found), "", *_sigma_table(found), "", *_view_table(found), *_candidate_table(found)]


def _about(found: Plan) -> list[str]:
    light, planned = found.light, found.planned
    by = "brightness" if found.forecast.direct else "matches"
    side = found.options.patch_px
    return [
        f"{found.name}: {light['views']:.0f} views see the place, reference {planned.views.name[planned.reference]}",
        f"GSD {light['gsd_m']:.4g} m ({light['gsd_finest_m']:.4g} to {light['gsd_coarsest_m']:.4g}); "
        f"region {planned.region_px} px, {planned.region_px * planned.gsd_m:.4g} m",
        f"incidence {light['incidence_least_deg']:.0f} to {light['incidence_most_deg']:.0f}, emission "
        f"{light['emission_least_deg']:.0f} to {light['emission_most_deg']:.0f}, phase "
        f"{light['phase_least_deg']:.0f} to {light['phase_most_deg']:.0f} deg; Suns spread "
        f"{light['sun_spread_deg']:.0f} deg",
        f"map of {side} x {side} px: {light['landmarks_percent']:.0f} % become landmarks, in "
        f"{light['views_per_landmark_mean']:.1f} views each, lit in {light['lit_views_per_landmark_mean']:.1f}",
        f"heights by {by}; assumed ground: RMS slope {found.options.slope_deg:g} deg",
    ]


def _sigma_table(found: Plan) -> list[str]:
    sigmas = found.sigmas
    rows = [("height", "height_sigma", "gsd", "GSD"), ("normal", "normal_sigma", "deg", "deg")]
    rows.append(("albedo", "albedo_sigma", "percent", "%"))
    if found.forecast.pose_priors is not None:
        rows.append(("height in the priors' frame", "in_frame_height_sigma", "gsd", "GSD"))
        rows.append(("normal in the priors' frame", "in_frame_normal_sigma", "deg", "deg"))
    out = [f"{'sigma':28}{'unit':>5}{'mean':>9}{'median':>9}{'RMS':>9}{'90 %':>9}"]
    for words, name, unit, shown in rows:
        numbers = "".join(f"{sigmas[f'{name}_{part}_{unit}']:9.3g}" for part in ("mean", "median", "rms", "p90"))
        out.append(f"{words:28}{shown:>5}{numbers}")
    return out


def _view_table(found: Plan) -> list[str]:
    from photoclinometry.plan.candidates import view_angles

    views, shown = found.planned.views, set(found.forecast.scene.views.name)
    out = [f"{'view':{_NAME_WIDTH}}{'m/px':>9}{'emis.':>7}{'inc.':>7}{'phase':>7}{'Sun az.':>9}{'cam. az.':>9}"]
    for k, name in enumerate(views.name):
        a = view_angles(views, k)
        beside = "" if name in shown else "  not of the map"
        out.append(
            f"{name[-_NAME_WIDTH:]:{_NAME_WIDTH}}{a['gsd_m']:9.3g}{a['emission_deg']:7.1f}{a['incidence_deg']:7.1f}"
            f"{a['phase_deg']:7.1f}{a['sun_azimuth_deg']:9.0f}{a['camera_azimuth_deg']:9.0f}{beside}"
        )
    out += [f"not used: {name}: {reason}" for name, reason in found.planned.not_seen.items()]
    return out


def _candidate_table(found: Plan) -> list[str]:
    hidden = [f"not tried: {name}: {reason}" for name, reason in found.candidates_not_seen.items()]
    if not found.gains:
        return hidden
    head = f"{'one more image':20}{'m/px':>8}{'emis.':>7}{'inc.':>7}{'phase':>7}{'normal':>9}{'albedo':>9}{'height':>9}"
    out = ["", "mean sigmas fall by [%]; Sun azimuth/elevation, camera azimuth/emission", head]
    for gain in found.gains[:_SHOWN]:
        a, drop = gain.angles, gain.drop_percent
        out.append(
            f"{gain.candidate.name[-20:]:20}{a['gsd_m']:8.3g}{a['emission_deg']:7.1f}{a['incidence_deg']:7.1f}"
            f"{a['phase_deg']:7.1f}{drop['normal']:9.1f}{drop['albedo']:9.1f}{drop['height']:9.1f}"
        )
    left = len(found.gains) - _SHOWN
    return [*out, *([f"and {left} more in plan.json"] if left > 0 else []), *hidden]
