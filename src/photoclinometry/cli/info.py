"""`phomo info`: what a site or a run folder holds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from photoclinometry.io.run_files import read_run
from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import BODY_FIXED


def info(path: Path, /) -> None:
    """Say what a site.toml describes, or what a run folder holds.

    Args:
        path: A site.toml, a folder with one, or a run folder.
    """
    if path.is_file():
        show_site(path)
    elif (path / "scene.h5").is_file():
        show_run(path)
    elif (path / "site.toml").is_file():
        show_site(path / "site.toml")
    else:
        found = "the folder holds neither site.toml nor scene.h5" if path.is_dir() else "no such file or folder"
        raise InputError(f"{path}: {found}; give a site.toml or the folder of a finished run")


def show_site(path: Path) -> None:
    """Name, brightness, region, and a table of the views with what is known of them beforehand."""
    from rich.console import Console
    from rich.table import Table

    from photoclinometry.io.site import read_site

    site = read_site(path)
    console = Console(highlight=False)
    console.print(f"[bold]{site.name}[/bold]: {len(site.views)} views, brightness {site.brightness}, body {site.body}")
    region = site.region
    if region is None:
        console.print("region: chosen automatically")
    else:
        parts = {"reference": region.reference, "centre [px]": region.center_px, "size [px]": region.size_px}
        if region.stride is not None:
            parts |= {"stride [px]": region.stride}
        told = ", ".join(f"{k} {v if v is not None else 'automatic'}" for k, v in parts.items())
        console.print("region: " + told.replace("[", r"\["))
    table = Table()
    table.add_column("view", no_wrap=True)
    for head in ("camera", "size [px]", "focal [px]", "Sun off axis [°]", "Sun sigma [°]", "pose", "file"):
        table.add_column(head.replace("[", r"\["))
    for view in site.views:
        camera = view.camera
        # The Sun is given from the body towards it, in C; the body lies along +z, so zero phase is at -z.
        off_axis = np.degrees(np.arctan2(np.hypot(*view.sun[:2]), -view.sun[2]))
        table.add_row(
            view.name,
            camera.model,
            f"{camera.width} x {camera.height}",
            f"{camera.focal_px[0]:.1f}",
            f"{off_axis:.1f}",
            f"{np.degrees(view.sun_sigma_rad):.3g}",
            "prior" if view.pose_prior is not None else "-",
            "found" if view.image.is_file() else "[red]missing[/red]",
        )
    console.print(table)


def show_run(run: Path) -> None:
    """What the scene consists of, its views, and the figures that the run recorded."""
    from rich.console import Console
    from rich.table import Table

    from photoclinometry.evaluate.sigmas import view_sigmas
    from photoclinometry.evaluate.tables import metric_rows, number, split_unit, words

    scene = read_run(run)
    console = Console(highlight=False)
    model = "geometry alone" if scene.reflectance is None else scene.reflectance.name
    console.print(
        f"[bold]{scene.name}[/bold]: {len(scene.landmarks)} landmarks, {len(scene.views)} views, "
        f"{len(scene.tracks)} observations, {model}, brightness {scene.brightness}, body {scene.body}"
    )
    region, unit = scene.region, scene.unit or "scene unit"
    every = "" if region.stride == 1 else f", a landmark at every {region.stride} of them"
    console.print(
        f"region: {region.width} x {region.height} pixels from column {region.col}, row {region.row} of "
        f"{scene.views.name[scene.reference]}{every}; one pixel is {scene.gsd:.4g} long on the ground ({unit})"
    )
    console.print(f"frame: {'body-fixed, by pose priors' if scene.frame == BODY_FIXED else 'its own'}")
    table = Table()
    table.add_column("view", no_wrap=True)
    sigmas = view_sigmas(scene)
    units = [split_unit(name) for name in sigmas]
    for head in ("keypoints", "scale", "bias", *(f"{words(name)} \\[{unit}]" for name, unit in units)):
        table.add_column(head, justify="right")
    keypoints = np.bincount(scene.tracks.view, minlength=len(scene.views))
    for k, name in enumerate(scene.views.name):
        values = (scene.views.scale[k], scene.views.bias[k], *(sigma[k] for sigma in sigmas.values()))
        table.add_row(name, str(keypoints[k]), *(number(float(value)) for value in values))
    console.print(table)
    if (run / "metrics.json").is_file():
        metrics = json.loads((run / "metrics.json").read_text(encoding="utf-8"))["metrics"]
        flat = {k: v for k, v in metrics.items() if isinstance(v, (int, float)) and not isinstance(v, bool)}
        spreads, singles = metric_rows(flat)
        figures = Table("figure", "mean", "median", "RMS", "90 %")
        for name, unit, *values in spreads:
            figures.add_row(f"{name} [{unit}]".replace("[", r"\["), *values)
        for name, value in singles:
            figures.add_row(name, value)
        console.print(figures)
