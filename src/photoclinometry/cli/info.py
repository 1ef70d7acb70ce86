"""`phomo info`: the content of a site, of a run folder, or of the folder of a whole body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from photoclinometry.cli.columns import plain_number, short_names
from photoclinometry.io.run_files import BODY_FILE, METRICS_FILE, SCENE_FILE, is_body, is_map, read_metrics, read_run
from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import BODY_FIXED, SHARED
from photoclinometry.model.warning import Warned, few_of_each

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from photoclinometry.io.site import Site

TIGHT = (0, 1, 0, 0)
"""Padding of tables: two blanks between columns."""
_LONGEST_NAME = 20
"""Longer names of views leave no room for the columns [characters]: what all have in common is left out."""


def info(path: Path, /) -> None:
    """Show the content of a site.toml, of a run folder, or of the folder of a whole body.

    Args:
        path: A site.toml, a folder with one, a run folder, or the folder of a whole body.
    """
    if path.is_file():
        show_site(path)
    elif is_map(path):
        show_run(path)
    elif is_body(path):
        show_body(path)
    elif (path / "site.toml").is_file():
        show_site(path / "site.toml")
    else:
        none = f"the folder holds none of site.toml, {SCENE_FILE} and {BODY_FILE}"
        found = none if path.is_dir() else "no such file or folder"
        raise InputError(f"{path}: {found}; give a site.toml or the folder of a finished run or body")


def show_site(path: Path) -> None:
    """Name, brightness, region, and a table of the views with their cameras, Suns and pose priors."""
    from rich.console import Console

    from photoclinometry.io.site import read_site

    site = read_site(path)
    console = Console(highlight=False)
    _say_name(console, site.name, f"{len(site.views)} views, brightness {site.brightness}, body {site.body}")
    region = site.region
    if region is None:
        console.print("region: chosen automatically")
    else:
        parts = {"reference": region.reference, "centre [px]": region.center_px, "size [px]": region.size_px}
        if region.stride is not None:
            parts |= {"stride [px]": region.stride}
        listed = ", ".join(f"{k} {v if v is not None else 'automatic'}" for k, v in parts.items())
        _say(console, f"region: {listed}")
    _show_views(console, site)
    own, common = np.degrees(site.sun_sigmas)
    if common.any():
        console.print(f"Suns: each {np.median(own):.2g}° by itself, all {np.median(common):.2g}° together")


def _show_views(console: Console, site: Site) -> None:
    """The views with their cameras, Suns and pose priors; values that all share are shown once, above the table."""
    from rich.text import Text

    columns: dict[tuple[str, str], list[str]] = {
        ("camera", ""): [view.camera.model for view in site.views],
        ("size", "px"): [f"{view.camera.width}\u00a0x\u00a0{view.camera.height}" for view in site.views],
        ("focal", "px"): [f"{view.camera.focal_px[0]:.1f}" for view in site.views],
        # In C the body lies along +z, so the Sun is at -z at zero phase angle.
        ("phase", "°"): [f"{np.degrees(np.arctan2(np.hypot(*v.sun[:2]), -v.sun[2])):.1f}" for v in site.views],
        ("Sun sigma", "°"): [plain_number(float(np.degrees(view.sun_sigma_rad))) for view in site.views],
        ("pose prior", ""): ["yes" if view.pose_prior is not None else "none" for view in site.views],
        ("file", ""): ["found" if view.image.is_file() else "missing" for view in site.views],
    }
    same = {head: values[0] for head, values in columns.items() if len(set(values)) == 1}
    told = (f"{name} {value}\u00a0{unit}".rstrip() for (name, unit), value in same.items())
    _say(console, f"all views: {', '.join(told)}")
    names, table = _names_and_table(console, [view.name for view in site.views])
    shown = {head: values for head, values in columns.items() if head not in same}
    for name, unit in shown:
        table.add_column(f"{name}\n\\[{unit}]" if unit else name, justify="right")
    for name, *values in zip(names, *shown.values(), strict=True):
        table.add_row(Text(name), *(f"[red]{value}[/red]" if value == "missing" else value for value in values))
    console.print(table)


def _say(console: Console, text: str) -> None:
    """A line in which "[" is no markup: names may have it."""
    console.print(text, markup=False)


def _say_name(console: Console, name: str, text: str) -> None:
    """The name of the object, in bold, and more about it."""
    from rich.text import Text

    console.print(Text.assemble((name, "bold"), f": {text}"))


def _names_and_table(console: Console, names: Sequence[str]) -> tuple[list[str], Table]:
    """Names of views, and a table that begins with them.

    The common part of long names is shown above the table. Where the terminal is narrow, names are folded, not
    cut.
    """
    from rich import box
    from rich.table import Table

    short, pattern = short_names(names, _LONGEST_NAME)
    if pattern:
        _say(console, f"view: * of {pattern}")
    table = Table(box=box.SIMPLE_HEAD, padding=TIGHT, pad_edge=False)
    table.add_column("view", overflow="fold", min_width=15)
    return short, table


def figure_rows(content: Mapping[str, Any]) -> tuple[list[tuple[str, ...]], list[tuple[str, str]]]:
    """The rows of `evaluate.tables.metric_rows` for what metrics.json holds."""
    from photoclinometry.evaluate.tables import metric_rows

    metrics = content.get("metrics", {})
    return metric_rows({k: v for k, v in metrics.items() if isinstance(v, (int, float)) and not isinstance(v, bool)})


def frame_in_words(frame: str, content: Mapping[str, Any]) -> str:
    """The frame of a scene, and the data that placed it there. content: of metrics.json, whose tables show them."""
    if frame == SHARED:
        return "that of a larger model"
    if frame != BODY_FIXED:
        return "of the images alone"
    tables = {"pose priors": "pose_priors", "ground control points": "control_points"}
    by = [name for name, key in tables.items() if any(row.get("used") for row in content.get(key, ()))]
    return f"body-fixed, by {' and '.join(by)}" if by else "body-fixed"


def show_run(run: Path) -> None:
    """The content of the scene, its views, and the figures that the run recorded."""
    from rich.console import Console
    from rich.text import Text

    from photoclinometry.evaluate.sigmas import view_sigmas
    from photoclinometry.evaluate.tables import split_unit, words
    from photoclinometry.io.dark_level import in_words

    scene = read_run(run)
    console = Console(highlight=False)
    model = "geometry alone" if scene.reflectance is None else scene.reflectance.name
    _say_name(
        console,
        scene.name,
        f"{len(scene.landmarks)} landmarks, {len(scene.views)} views, {len(scene.tracks)} observations, {model}, "
        f"brightness {scene.brightness}, body {scene.body}",
    )
    region, unit = scene.region, scene.unit or "scene unit"
    every = "" if region.stride == 1 else f", a landmark at every {region.stride} of them"
    _say(
        console,
        f"region: {region.width} x {region.height} pixels from column {region.col}, row {region.row} of "
        f"{scene.views.name[scene.reference]}{every}; ground sample distance {scene.gsd:.4g} ({unit})",
    )
    content = read_metrics(run)
    console.print(f"frame: {frame_in_words(scene.frame, content)}")
    if scene.brightness != "iof":
        console.print("dark level: {}, {}".format(*in_words(scene.views.dark_level)))
    names, table = _names_and_table(console, scene.views.name)
    sigmas = view_sigmas(scene)
    heads = [f"{words(name)} \\[{unit}]".replace(" ", "\n") for name, unit in map(split_unit, sigmas)]
    for head in ("keypoints", "scale", "bias", *heads):
        table.add_column(head, justify="right", overflow="fold")
    keypoints = np.bincount(scene.tracks.view, minlength=len(scene.views))
    for k, name in enumerate(names):
        shown = (f"{scene.views.scale[k]:.4g}", f"{scene.views.bias[k]:.1e}", *(f"{s[k]:.3g}" for s in sigmas.values()))
        table.add_row(Text(name), str(keypoints[k]), *shown)
    console.print(table)
    _show_figures(console, content, [warned.line for warned in _warnings(content)])


def show_body(body: Path) -> None:
    """The figures that a body recorded."""
    from rich.console import Console

    console, content = Console(highlight=False), read_metrics(body)
    metrics = content.get("metrics", {})
    told = f"{metrics['facets']:,.0f} facets" if "facets" in metrics else f"without {METRICS_FILE}"
    _say_name(console, body.resolve().name, f"a whole body, {told}")
    _show_figures(console, content, few_of_each(_warnings(content)))


def _warnings(content: Mapping[str, Any]) -> list[Warned]:
    return [Warned(str(row["code"]), str(row["words"])) for row in content.get("warnings", ())]


def _show_figures(console: Console, content: Mapping[str, Any], warnings: Sequence[str]) -> None:
    """The figures of metrics.json, the verdict, the lines of the warnings, and the reasons for the verdict."""
    from rich import box
    from rich.table import Column, Table
    from rich.text import Text

    if not content:
        return
    spreads, singles = figure_rows(content)
    heads = (Column(head, justify="right") for head in ("mean", "median", "RMS", "90 %"))
    figures = Table("figure", *heads, box=box.SIMPLE_HEAD, padding=TIGHT, pad_edge=False)
    for name, unit, *values in spreads:
        figures.add_row(Text(f"{name} [{unit}]"), *values)
    for name, value in singles:
        figures.add_row(Text(name), value.replace(" ", "\u00a0"))
    console.print(figures)
    if "verdict" in content:
        console.print(f"verdict: {content['verdict']}", markup=False)
    for line in content.get("care", ()):
        console.print(f"take care: {line}", markup=False)
    for line in warnings:
        console.print(f"warning: {line}", markup=False)
    for reason in content.get("not_trusted_because", []):
        console.print(f"not to be trusted: {reason}", markup=False, style="red")
