"""The runs of a study, one at a time. Finished parts are kept, so that an interrupted study can be resumed."""

from __future__ import annotations

import logging
import shutil
from dataclasses import asdict, replace
from pathlib import Path

from photoclinometry.evaluate.compare import Comparison
from photoclinometry.io.atomic import write_text
from photoclinometry.io.options import write_options
from photoclinometry.io.reading import read_text
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.folder.run_folder import adopt_stages
from photoclinometry.pipeline.folder.stage import digest, program_digest
from photoclinometry.rivals.compare import RIVALS_FIGURE, RivalComparison, compare_rivals
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.truth_file import read_truth
from photoclinometry.study.plan import Cell, StudyOptions, cells
from photoclinometry.study.record import Record, measure, read_record, write_record

log = logging.getLogger(__name__)

STUDY_FILE = "study.toml"
"""The options of the last call; `run_study` writes only into folders that hold this file, or are empty."""


def run_study(options: StudyOptions, out: Path, progress: Progress = no_progress) -> Path:
    """Simulates, maps and measures every cell, then writes study.md, study.json and figures/; returns study.md.

    The folder may hold an earlier study, also with other options: finished cells are kept. A run whose images do not
    determine a map is a dash in the tables. Raises InputError.
    """
    from photoclinometry.study.page import write_page

    out = Path(out)
    _open(out, options)
    todo = cells(options)
    records = []
    for done, cell in enumerate(todo):
        progress(cell.name, done, len(todo))
        records.append(_cell_or_read(out, cell, options))
    progress("tables and figures", len(todo), len(todo))
    return write_page(out, options, records)


def _open(out: Path, options: StudyOptions) -> None:
    if out.exists() and not (out / STUDY_FILE).is_file() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: exists and is not a study; choose another folder")
    write_options(out / STUDY_FILE, asdict(options))


def _cell_or_read(out: Path, cell: Cell, options: StudyOptions) -> Record:
    folder, shown = out / "results" / cell.name, cell.model == options.shown
    rivals = (options.rivals, options.rival) if shown and options.rivals else None
    key = digest("study cell", program_digest(), cell.simulation, cell.run_options(options), shown, rivals)
    found = read_record(folder, cell, key)
    if found is not None:
        log.info("%s: read back", cell.name)
        return found
    site = _site(out, cell)
    run = out / "runs" / cell.site / cell.model
    for sibling in sorted(run.parent.glob("*")) if run.parent.is_dir() else ():
        adopt_stages(sibling, run, ("sparse", "region", "dense"))
    try:
        # Sites change with options.
        result = pipeline.run(site, run, cell.run_options(options), overwrite=True)
    except ReconstructionError as error:
        warn(log, "run-failed", "%s: %s", cell.name, error)
        record = Record(cell, {}, failure=str(error))
        write_record(folder, record, key)
        return record
    truth = site.with_name("truth.h5")
    record, comparison = measure(cell, result, read_truth(truth))
    if not shown:
        write_record(folder, record, key)
        return record
    beside = None
    if options.rivals:
        beside = compare_rivals(run, methods=options.rivals, truth=truth, options=options.rival)
        record = replace(record, rivals=beside.figures)
    write_record(folder, record, key, lambda work: _draw(work, result.scene, comparison, beside))
    return record


def _draw(folder: Path, scene: Scene, comparison: Comparison, rivals: RivalComparison | None) -> None:
    """The figures of a run, and that of its rivals."""
    from photoclinometry.study.figures import draw_cell

    draw_cell(folder, scene, comparison)
    if rivals is not None:
        shutil.copyfile(rivals.folder / RIVALS_FIGURE, folder / RIVALS_FIGURE)


def _site(out: Path, cell: Cell) -> Path:
    """site.toml of the cell's site, which is simulated unless a site with the same options exists."""
    folder = out / "sites" / cell.site
    key = folder.with_name(f"{cell.site}.key")
    wanted = digest(program_digest(), cell.simulation)
    if (folder / "site.toml").is_file() and key.is_file() and read_text(key).strip() == wanted:
        return folder / "site.toml"
    key.unlink(missing_ok=True)
    site = simulate_site(cell.simulation, folder, overwrite=True)
    write_text(key, wanted + "\n")
    return site
