"""`phomo evaluate`: how good a run is, against its images, a simulation's truth, or another map."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from photoclinometry.cli.folders import read_run, run_images, site_path
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import METRES, Similarity
from photoclinometry.model.scene import Scene

if TYPE_CHECKING:
    from photoclinometry.evaluate.compare import Comparison


def evaluate(
    run: Path,
    /,
    truth: Path | None = None,
    reference: Path | None = None,
    cameras: Path | None = None,
    unit: str = "m",
    site: Path | None = None,
    images: bool = True,
    maps: bool = False,
    out: Path | None = None,
) -> dict[str, float]:
    """Measure a run: photometric error, PSNR and completeness, and how far it is from truth or another map.

    Writes evaluation.json and evaluation.md, and prints the same as tables. Each figure's name ends in its
    unit; GSD is the ground sample distance, one reference pixel on the ground. The alignment with a truth or map in
    metres or kilometres is kept in reference_from_scene.toml: `phomo export --transform` takes it.

    Args:
        run: Folder of a finished run.
        truth: truth.h5 of a simulated site: compares surface, normals, albedos, poses, Suns and keypoints.
        reference: Another map of the place, to compare surface, normals and albedos with: a PLY file (mesh or
            points), a GeoTIFF of heights (needs the extra `geo`), another run's folder, or its scene.h5.
        cameras: COLMAP model folder with poses in the frame of the reference map. Its views, matched by name,
            give the first alignment; another run brings its own. Without any the run must be in the map's frame.
        unit: Length unit of the reference map, for the names of the figures.
        site: The site.toml, if it has moved since the run.
        images: Read the images too, for PSNR and completeness.
        maps: Also draw what differs from the truth or the other map, one picture for each kind of error.
        out: Folder for the files. Default: evaluation/ in the run folder.
    """
    from photoclinometry.evaluate.tables import json_numbers, markdown
    from photoclinometry.io.atomic import write_text
    from photoclinometry.io.similarity import write_similarity

    if truth is not None and reference is not None:
        raise InputError("give --truth or --reference, not both: run the command twice, with two --out folders")
    if cameras is not None and reference is None:
        raise InputError("--cameras aligns a run with a map: give --reference too")
    scene = read_run(run)
    metrics = image_metrics(scene, run, site_path(run, site) if images else None)
    folder = out or run / "evaluation"
    found = None
    if truth is not None:
        found = against_truth(scene, truth)
    if reference is not None:
        found = against_map(scene, reference, cameras, unit)
    if found is not None:
        metrics |= found.metrics
        if unit in METRES:
            to_metres = Similarity(METRES[unit], np.eye(3), np.zeros(3))
            write_similarity(folder / "reference_from_scene.toml", to_metres @ found.similarity)
        if maps:
            draw_differences(folder / "maps", found)
    write_text(folder / "evaluation.json", json.dumps(json_numbers(metrics), indent=2) + "\n")
    write_text(folder / "evaluation.md", markdown(metrics, f"Evaluation of {scene.name}"))
    show(metrics, scene.name, folder)
    return metrics


def image_metrics(scene: Scene, run: Path, site: Path | None) -> dict[str, float]:
    """Figures of a run against its images, those held out from it included; without `site` against none."""
    from photoclinometry.evaluate.evaluate import evaluate_scene, held_out_table
    from photoclinometry.io.held_out import NAME, read_held_out

    if site is None:
        return evaluate_scene(scene)
    held_out = read_held_out(run / NAME)
    images = run_images(site, scene.views.name + (held_out.name if held_out else ()))
    used = images[: len(scene.views)]
    return evaluate_scene(scene, used, held_out=held_out_table(scene, held_out, images) if held_out else ())


def against_truth(scene: Scene, truth: Path) -> Comparison:
    """The comparison with truth.h5."""
    from photoclinometry.evaluate.compare import evaluate_against_truth
    from photoclinometry.simulate.truth_file import read_truth

    return evaluate_against_truth(scene, read_truth(truth))


def against_map(scene: Scene, reference: Path, cameras: Path | None, unit: str) -> Comparison:
    """The comparison with another map, aligned by a COLMAP model's poses, or its own, where there are any."""
    from photoclinometry.evaluate.compare import evaluate_against_map
    from photoclinometry.io.models.colmap import read_colmap
    from photoclinometry.io.reference import read_reference

    other = read_reference(reference)
    names, poses = other.names, other.body_from_cam
    if cameras is not None:
        names, _, poses, _ = read_colmap(cameras)
    return evaluate_against_map(scene, other.surface, names=names, body_from_cam=poses, unit=unit)


def draw_differences(folder: Path, found: Comparison) -> None:
    """A map of every kind of error, as PNG; the folder appears whole. Raises RunFolderError."""
    from photoclinometry.io.atomic import atomic_path
    from photoclinometry.output.report.maps import draw_values

    with atomic_path(folder) as work:
        work.mkdir()
        draw_values(work, found.aligned, found.errors, "difference")


def show(metrics: Mapping[str, float], name: str, folder: Path) -> None:
    """The metrics as two tables on the terminal, and where they were written."""
    from rich.console import Console
    from rich.table import Table

    from photoclinometry.evaluate.tables import metric_rows

    console = Console()
    spreads, singles = metric_rows(metrics)
    table = Table(title=name, title_justify="left")
    for head in ("quantity", "unit", "mean", "median", "RMS", "90 %"):
        table.add_column(head, justify="left" if head in ("quantity", "unit") else "right")
    for row in spreads:
        table.add_row(*row)
    console.print(table)
    table = Table(show_header=False)
    table.add_column()
    table.add_column(justify="right")
    for row in singles:
        table.add_row(*row)
    console.print(table)
    Console(stderr=True).print(f"written: {folder}/evaluation.json, .md", soft_wrap=True, highlight=False)
