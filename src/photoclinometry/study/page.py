"""The results of a study as files: study.md, study.json and figures/."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from photoclinometry import __version__
from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.io.json_file import write_json
from photoclinometry.io.options import options_for_json
from photoclinometry.simulate.presets import named_preset
from photoclinometry.study.figures import CELL_FIGURES, COUNTERPART, draw_heights, draw_scales
from photoclinometry.study.plan import GEOMETRY, StudyOptions
from photoclinometry.study.record import Record
from photoclinometry.study.summary import groups, label, select, tables


def write_page(out: Path, options: StudyOptions, records: Sequence[Record]) -> Path:
    """study.md, study.json and figures/ in `out`; returns the path of study.md. Raises RunFolderError."""
    found = tables(options, records)
    with atomic_path(out / "figures") as folder:
        folder.mkdir()
        pictures = [line for group in groups(records) for line in _pictures(folder, out, options, records, group)]
    lines = [f"# Study of {', '.join(options.presets)}", "", _about(options, records), ""]
    lines += [table.markdown() for table in found]
    lines += ["## Pictures", "", *pictures] if pictures else []
    write_text(out / "study.md", "\n".join(lines).rstrip() + "\n")
    content = {
        "version": __version__,
        "options": options_for_json(asdict(options)),
        "tables": [table.as_dict() for table in found],
        "cells": [_as_dict(record) for record in records],
    }
    write_json(out / "study.json", content)
    return out / "study.md"


def _about(options: StudyOptions, records: Sequence[Record]) -> str:
    """The study's sites and comparison, in a paragraph."""
    failed = [record.cell.name for record in records if record.failure]
    unfinished = [record.cell.name for record in records if record.metrics.get("converged") == 0]
    held = f"one view in {options.hold_out_every}" if options.hold_out_every else "no view"
    parts = [
        f"Simulated ground: {', '.join(options.surfaces)}; lighting: {', '.join(options.lightings)}; "
        f"{len(options.seeds)} seed{'s' if len(options.seeds) > 1 else ''}; {held} held out. Normals and albedos are "
        "compared with the truth averaged over the optics' footprint; albedos after one common factor.",
        f"Runs without a map: {', '.join(failed)}." if failed else "",
        f"Not converged: {', '.join(unfinished)}." if unfinished else "",
    ]
    return " ".join(part for part in parts if part)


def _pictures(
    folder: Path, out: Path, options: StudyOptions, records: Sequence[Record], group: tuple[str, str, str]
) -> list[str]:
    """Draws or copies the figures of a group's first seed into `folder`; returns their lines of Markdown."""
    stem, text = "-".join(group), label(options, group)
    lines = []

    def add(name: str, caption: str) -> None:
        lines.extend([f"{text}. {caption}", "", f"![{text}: {caption}](figures/{name})", ""])

    shown, without = select(records, group, options.shown)[:1], select(records, group, GEOMETRY)[:1]
    for record in shown:
        for file, caption in CELL_FIGURES:
            source = out / "results" / record.cell.name / file
            if source.is_file():
                shutil.copyfile(source, folder / f"{stem}-{file}")
                add(f"{stem}-{file}", caption)
    if shown and without:
        draw_heights(folder / f"{stem}-heights.png", without[0], shown[0])
        add(f"{stem}-heights.png", "Fig. 11: height errors without and with photometry, and a scan along one row.")
    free = [r for model in options.models if model in COUNTERPART for r in select(records, group, model)[:1]]
    if free:
        draw_scales(folder / f"{stem}-scales.png", free, named_preset(group[0]).body)
        add(f"{stem}-scales.png", "Fig. 14: scale of each image against the phase function.")
    return lines


def _as_dict(record: Record) -> dict[str, Any]:
    cell = record.cell
    s = cell.simulation
    about = {"preset": s.preset, "lighting": s.lighting, "surface": cell.surface, "seed": s.seed, "model": cell.model}
    results = {"metrics": record.metrics, "rivals": record.rivals}
    return {**about, "failure": record.failure or None, **results}
