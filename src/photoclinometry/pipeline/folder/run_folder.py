"""A run's folder: its options, its log, and the results of its stages, so that a run that was stopped goes on.

A stage whose key (`stage.Stage.key`) is the one on disk is read back; any other is made, and kept. A folder belongs to
one site (`run_owner`), and one process at a time writes there (`run_lock`).
"""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from photoclinometry.io.atomic import atomic_path, unwritable
from photoclinometry.io.options import options_text, write_options
from photoclinometry.io.run_files import CONFIG_FILE, METRICS_FILE, REPORT_FOLDER, STAGES_FOLDER
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.owner import Owner
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.warning import Warned, collected_warnings, distinct
from photoclinometry.pipeline.folder import run_lock
from photoclinometry.pipeline.folder.memory import give_back_memory, peak_memory_gb
from photoclinometry.pipeline.folder.records import has_record, read_record, write_record
from photoclinometry.pipeline.folder.run_mark import (
    FORMAT,
    MARK,
    check_format,
    check_new,
    clear,
    remove,
    to_be_cleared,
    write_mark,
)
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools

__all__ = [
    "FORMAT",
    "MARK",
    "RunFolder",
    "StageCost",
    "adopt_stages",
    "check_run",
    "claimed_run",
    "joined_run",
    "open_run",
    "peak_memory_gb",
]

log = logging.getLogger(__name__)

T = TypeVar("T")

PLAN_FIRST = "run the command with --plan-only in place of --tile first"
"""Advice where a part of the work is asked for and the stages before it are missing."""


@dataclass
class StageCost:
    """What one stage took."""

    stage: str
    resumed: bool
    """Whether it was read back from an earlier run."""
    wall_s: float
    cpu_s: float
    peak_memory_gb: float | None
    """Largest resident size of the process up to the end of the stage; None where the system does not report it."""


@dataclass
class RunFolder:
    """An open run folder. Make one with `open_run`."""

    path: Path
    progress: Progress = no_progress
    costs: list[StageCost] = field(default_factory=list)
    """Of the stages so far, in their order."""
    warned: list[Warned] = field(default_factory=list)
    """All warnings so far, including those of stages that were read back."""
    finished_by_others: tuple[str, ...] = ()
    """Stages, by name, that another process makes: here they are only read back."""

    @property
    def warnings(self) -> tuple[Warned, ...]:
        """All warnings so far, each once."""
        return distinct(self.warned)

    def withdraw(self, first: int, last: int, kept: Collection[str]) -> tuple[Warned, ...]:
        """Takes back warnings of a result that is discarded, and returns them.

        first, last: the range of `warned` in which they are, without `last`. kept: codes of those that stay.
        """
        of_range = self.warned[first:last]
        back = distinct(warned for warned in of_range if warned.code not in kept)
        self.warned[first:last] = [warned for warned in of_range if warned.code in kept]
        for warned in back:
            log.info("no longer warned of, as its map is discarded: %s", warned.line)
        return back

    def result_of(self, stage: Stage[T]) -> Keyed[T]:
        """The stage's result: from disk if its key is there, else made and, where the stage says so, kept.

        What is made is read back, too: a run in one go and one in pieces are then the same to the last bit.
        """
        file, key = self._file(stage.file_name), stage.key
        with self.timed(stage.file_name) as cost:
            found = read_record(file, key, stage.result) if stage.kept else None
            cost.resumed = found is not None
            if found is not None:
                self.warned += found.warnings
                return Keyed(found.value, key)
            if stage.name in self.finished_by_others:
                raise RunFolderError(f"{file}: not made yet, or of other options; {PLAN_FIRST}")
            tools = Tools(progress=self.progress, scratch=self.path / STAGES_FOLDER / stage.file_name)
            with collected_warnings() as warned:
                made = stage.make(tools)
            if not stage.kept:
                return Keyed(made, key)
            write_record(file, key, made, distinct(warned))
            del made  # both at a time would take twice the memory
            give_back_memory()
            found = read_record(file, key, stage.result)
            if found is None:
                raise RunFolderError(f"{file}: cannot be read back; check the disk")
            return Keyed(found.value, key)

    def holds(self, stage: Stage[Any]) -> bool:
        """Whether the stage's result is on disk. Its content is not read."""
        return has_record(self._file(stage.file_name), stage.key)

    @contextmanager
    def timed(self, name: str) -> Iterator[StageCost]:
        """Times a part of the run and logs it; yields its `StageCost`.

        The record of its end has `ended`, the name, and `wall_s`, None where the part was read back.
        """
        cost = StageCost(name, False, 0.0, 0.0, 0.0)
        wall, cpu = time.perf_counter(), time.process_time()
        log.info("%s ...", name)
        yield cost
        cost.wall_s, cost.cpu_s = time.perf_counter() - wall, time.process_time() - cpu
        cost.peak_memory_gb = peak_memory_gb()
        self.costs.append(cost)
        how = "read back from the earlier run" if cost.resumed else f"{cost.wall_s:.1f} s, {cost.cpu_s:.1f} CPU s"
        log.info("%s: %s", name, how, extra={"ended": name, "wall_s": None if cost.resumed else cost.wall_s})

    def log_config(self, config: Mapping[str, Any]) -> None:
        """What is to be mapped, and every option, in the log: the products may still be of a run with others."""
        log.debug("options:\n%s", options_text(config))

    def reopen(self) -> None:
        """Removes the files that say that the map in the folder is finished, and how it was made.

        To be called before the first product of a run is written: a run that is stopped meanwhile then leaves no
        figures and options of another map beside its own. metrics.json is written last. Raises RunFolderError.
        """
        for name in (METRICS_FILE, CONFIG_FILE, REPORT_FOLDER):
            remove(self.path / name)

    def write_config(self, config: Mapping[str, Any]) -> None:
        """config.toml: what was mapped, and every option, defaults included."""
        write_options(self.path / CONFIG_FILE, config)

    def _file(self, name: str) -> Path:
        return self.path / STAGES_FOLDER / f"{name}.npz"


@contextmanager
def claimed_run(
    path: Path, owner: Owner, progress: Progress = no_progress, *, overwrite: bool = False
) -> Iterator[RunFolder]:
    """The folder at `path` for a run of `owner`, made if it is new, and locked for other runs during the block.

    The folder's `warned` collects what is warned of in the block. overwrite: what the folder holds of another site is
    removed. Raises RunFolderError for folders of another site without that, for those that are not a run's, are in use,
    hold files that no run wrote where they are to be cleared, or cannot be written.
    """
    path = Path(path)
    check_run(path, owner, overwrite=overwrite)
    with _locked(path), collected_warnings() as warned:
        # Another run may have come first.
        if (path / MARK).is_file() and to_be_cleared(path, owner, overwrite):
            clear(path)
        write_mark(path, owner)
        yield RunFolder(path, progress, warned=warned)


def check_run(path: Path, owner: Owner, *, overwrite: bool = False) -> None:
    """Raises RunFolderError where `claimed_run` would, but for what shows only in writing. Changes nothing."""
    path = Path(path)
    marked = (path / MARK).is_file()
    if not marked:
        check_new(path)
    if path.is_dir():
        run_lock.check_lock(path)
    if marked:
        to_be_cleared(path, owner, overwrite)


def joined_run(path: Path, owner: Owner) -> RunFolder:
    """The run folder of `owner` at `path`, in which another process may be at work: its lock is not asked for.

    Raises RunFolderError where there is no run of `owner`.
    """
    path = Path(path)
    if not (path / MARK).is_file():
        raise RunFolderError(f"{path}: no plan was made there; {PLAN_FIRST}")
    to_be_cleared(path, owner, overwrite=False)
    return RunFolder(path)


def open_run(path: Path, progress: Progress = no_progress) -> RunFolder:
    """The folder at `path`, made if it is new, neither locked nor of a certain site.

    Raises RunFolderError for a folder that is not a run's, was made by another version, is just being marked by another
    run, or cannot be written.
    """
    path = Path(path)
    if (path / MARK).is_file():
        check_format(path)
        return RunFolder(path, progress)
    check_new(path)
    with _locked(path):
        if not (path / MARK).is_file():  # another run may have come first
            write_mark(path)
    return RunFolder(path, progress)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Holds the lock of the folder at `path` during the block. It is made if it is new, and goes again if it stays
    empty. Raises RunFolderError as `run_lock.locked`."""
    new: list[Path] = []
    try:
        new = [folder for folder in (path, *path.parents) if not folder.exists()]
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path / MARK, error) from error
    try:
        with run_lock.locked(path):
            yield
    finally:
        for folder in new:
            with suppress(OSError):
                folder.rmdir()


def adopt_stages(source: Path, target: Path, names: Sequence[str]) -> None:
    """Copies results of stages of another run folder that `target` lacks, such as those of the same images.

    Nothing is taken on trust: a run uses a result only if its key is the one that it needs. Raises RunFolderError.
    """
    if source == target:
        return
    for name in names:
        file, own = (folder / STAGES_FOLDER / f"{name}.npz" for folder in (source, target))
        if file.is_file() and not own.is_file():
            open_run(target)
            with atomic_path(own) as temporary:
                shutil.copyfile(file, temporary)
