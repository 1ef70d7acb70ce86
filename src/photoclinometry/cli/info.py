"""`phomo info`: the content of a site or of a run folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.run_files import read_run
from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import BODY_FIXED


def info(path: Path, /) -> None:
    """Show the content of a site.toml, or of a run folder.

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
    """Name, brightness, region, and a table of the views with their cameras, Suns and pose priors."""
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
        listed = ", ".join(f"{k} {v if v is not None else 'automatic'}" for k, v in parts.items())
        console.print("region: " + listed.replace("[", r"\["))
    table = Table()
    table.add_column("view", no_wrap=True)
    for head in ("camera", "size [px]", "focal [px]", "phase [°]", "Sun sigma [°]", "pose", "file"):
        table.add_column(head.replace("[", r"\["))
    for view in site.views:
        camera = view.camera
        # In C the body lies along +z, so the Sun is at -z at zero phase angle.
        phase = np.degrees(np.arctan2(np.hypot(*view.sun[:2]), -view.sun[2]))
        table.add_row(
            view.name,
            camera.model,
            f"{camera.width} x {camera.height}",
            f"{camera.focal_px[0]:.1f}",
            f"{phase:.1f}",
            f"{np.degrees(view.sun_sigma_rad):.3g}",
            "prior" if view.pose_prior is not None else "-",
            "found" if view.image.is_file() else "[red]missing[/red]",
        )
    console.print(table)


def show_run(run: Path) -> None:
    """The content of the scene, its views, and the figures that the run recorded."""
    from rich.console import Console
    from rich.table import Table

    from photoclinometry.evaluate.sigmas import view_sigmas
    from photoclinometry.evaluate.tables import metric_rows, number, split_unit, words
    from photoclinometry.io.json_file import read_json

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
        f"{scene.views.name[scene.reference]}{every}; ground sample distance {scene.gsd:.4g} ({unit})"
    )
    console.print(f"frame: {'body-fixed, by pose priors' if scene.frame == BODY_FIXED else 'of the images alone'}")
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
        metrics = read_json(run / "metrics.json")["metrics"]
        flat = {k: v for k, v in metrics.items() if isinstance(v, (int, float)) and not isinstance(v, bool)}
        spreads, singles = metric_rows(flat)
        figures = Table("figure", "mean", "median", "RMS", "90 %")
        for name, unit, *values in spreads:
            figures.add_row(f"{name} [{unit}]".replace("[", r"\["), *values)
        for name, value in singles:
            figures.add_row(name, value)
        console.print(figures)
