"""A run's folder: its options, its log, and the results of its stages, so that a run that was stopped goes on.

A stage whose key (`stage.Stage.key`) is the one on disk is read back; any other is made, and kept.
"""

from __future__ import annotations

import json
import logging
import resource
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from photoclinometry import __version__
from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.io.options import write_options
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.pipeline.records import read_record, write_record
from photoclinometry.pipeline.stage import Keyed, Stage, Tools

log = logging.getLogger(__name__)

T = TypeVar("T")

FORMAT = 1
"""Raised when what is in a run folder changes its meaning."""

MARK = "run.json"


@dataclass
class StageCost:
    """What one stage took."""

    stage: str
    resumed: bool
    """Whether it was read back from an earlier run."""
    wall_s: float
    cpu_s: float
    peak_memory_gb: float
    """Largest resident size of the process up to the end of the stage."""


@dataclass
class RunFolder:
    """An open run folder. Make one with `open_run`."""

    path: Path
    progress: Progress = no_progress
    costs: list[StageCost] = field(default_factory=list)
    """Of the stages so far, in their order."""

    def done(self, stage: Stage[T]) -> Keyed[T]:
        """The stage's result: from disk if its key is there, else made and, where the stage says so, kept.

        What is made is read back, too: a run in one go and one in pieces are then the same to the last bit.
        """
        file, key = self._file(stage.file_name), stage.key
        with self.timed(stage.file_name) as cost:
            found = read_record(file, key, stage.result) if stage.kept else None
            cost.resumed = found is not None
            if found is None:
                found = stage.make(Tools(progress=self.progress, scratch=self.path / "stages" / stage.file_name))
                if stage.kept:
                    write_record(file, key, found)
                    found = None  # both at a time would take twice the memory
                    found = read_record(file, key, stage.result)
                    if found is None:
                        raise RunFolderError(f"{file}: cannot be read back; check the disk")
        return Keyed(found, key)

    @contextmanager
    def timed(self, name: str) -> Iterator[StageCost]:
        """Times a part of the run and logs it; yields its `StageCost`."""
        cost = StageCost(name, False, 0.0, 0.0, 0.0)
        wall, cpu = time.perf_counter(), time.process_time()
        log.info("%s ...", name)
        yield cost
        cost.wall_s, cost.cpu_s = time.perf_counter() - wall, time.process_time() - cpu
        cost.peak_memory_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        self.costs.append(cost)
        how = "read back from the earlier run" if cost.resumed else f"{cost.wall_s:.1f} s, {cost.cpu_s:.1f} CPU s"
        log.info("%s: %s", name, how)

    def write_config(self, config: Mapping[str, Any]) -> None:
        """config.toml: what was mapped, and every option, defaults included."""
        write_options(self.path / "config.toml", config)

    def _file(self, name: str) -> Path:
        return self.path / "stages" / f"{name}.npz"


def open_run(path: Path, progress: Progress = no_progress) -> RunFolder:
    """The folder at `path`, made if it is new.

    Raises RunFolderError for a folder that is not a run's, was made by another version, or cannot be written.
    """
    path = Path(path)
    mark = path / MARK
    if mark.is_file():
        _check_version(mark)
    elif path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise RunFolderError(f"{path}: exists and is not a run folder; choose another --out, or empty it")
    write_text(mark, json.dumps({"format": FORMAT, "version": __version__}) + "\n")
    return RunFolder(path, progress)


def adopt_stages(source: Path, target: Path, names: Sequence[str]) -> None:
    """Copies results of stages of another run folder that `target` lacks, such as those of the same images.

    Nothing is taken on trust: a run uses a result only if its key is the one that it needs. Raises RunFolderError.
    """
    if source == target:
        return
    for name in names:
        file, own = (folder / "stages" / f"{name}.npz" for folder in (source, target))
        if file.is_file() and not own.is_file():
            open_run(target)
            with atomic_path(own) as temporary:
                shutil.copyfile(file, temporary)


def _check_version(mark: Path) -> None:
    try:
        made_by = json.loads(mark.read_text(encoding="utf-8"))
        found = made_by["format"]
    except (ValueError, KeyError, TypeError) as error:
        raise RunFolderError(f"{mark}: damaged ({error}); choose another --out, or remove the folder") from error
    if found != FORMAT:
        raise RunFolderError(
            f"{mark.parent}: run folder format {found}, made by version {made_by.get('version')}; this version "
            f"({__version__}) writes format {FORMAT}: choose another --out, or remove the folder"
        )
