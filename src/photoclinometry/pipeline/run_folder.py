"""A run's folder: its options, its log, and the stages it has finished, so that a killed run goes on where it was.

Every stage has a key: a digest of what it depends on, the key of the stage before it included. A stage whose key
is the one on disk is read back; any change of inputs or options changes the keys of exactly what follows from it.
"""

from __future__ import annotations

import hashlib
import json
import logging
import resource
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry import __version__
from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.geometry import Rigid

log = logging.getLogger(__name__)

FORMAT = 1
"""Raised when what is in a run folder changes its meaning."""

MARK = "run.json"


@dataclass
class Stage:
    """What became of one stage."""

    stage: str
    resumed: bool
    wall_s: float
    cpu_s: float
    peak_memory_gb: float
    """Largest resident size of the process up to the end of the stage."""


@dataclass
class RunFolder:
    """An open run folder. Make one with `open_run`."""

    path: Path
    stages: list[Stage] = field(default_factory=list)

    def stage(self, name: str, key: str, make: Callable[[], Any], kind: type) -> Any:
        """The result of a stage, a dataclass `kind` of arrays: from disk if its key is there, else made and kept."""
        file = self.path / "stages" / f"{name}.npz"
        with self.timed(name) as stage:
            found = _read(file, key, kind)
            stage.resumed = found is not None
            if found is None:
                found = make()
                _write(file, key, found)
        return found

    def holds(self, name: str, key: str, kind: type) -> bool:
        """Whether the result of a stage, of this key, is on disk and can be read."""
        return _read(self.path / "stages" / f"{name}.npz", key, kind) is not None

    def forget(self, name: str) -> None:
        """Takes back that a stage is finished; the next run does it again."""
        (self.path / "stages" / f"{name}.npz").unlink(missing_ok=True)

    @contextmanager
    def timed(self, name: str):
        """Times a stage and logs it; yields its `Stage`."""
        stage = Stage(name, False, 0.0, 0.0, 0.0)
        wall, cpu = time.perf_counter(), time.process_time()
        log.info("%s ...", name)
        yield stage
        stage.wall_s, stage.cpu_s = time.perf_counter() - wall, time.process_time() - cpu
        stage.peak_memory_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        self.stages.append(stage)
        how = "read back from the earlier run" if stage.resumed else f"{stage.wall_s:.1f} s, {stage.cpu_s:.1f} CPU s"
        log.info("%s: %s", name, how)


def open_run(path: Path) -> RunFolder:
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
    return RunFolder(path)


def adopt_stages(source: Path, target: Path, names: Sequence[str]) -> None:
    """Copies finished stages of another run folder that `target` lacks, such as those of the same images.

    Nothing is taken on trust: a run uses a stage only if its key is the one that it needs. Raises RunFolderError.
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


def digest(*parts: Any) -> str:
    """A short digest of options (dataclasses), strings and numbers."""
    text = json.dumps([asdict(p) if is_dataclass(p) and not isinstance(p, type) else p for p in parts], default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _write(file: Path, key: str, value: Any) -> None:
    """A dataclass of arrays, numbers and Rigid as an .npz that names its key."""
    arrays: dict[str, np.ndarray] = {"key": np.array(key)}
    for f in fields(value):
        item = getattr(value, f.name)
        if isinstance(item, Rigid):
            arrays[f"{f.name}.rotation"], arrays[f"{f.name}.translation"] = item.rotation, item.translation
        else:
            arrays[f.name] = np.asarray(item)
    with atomic_path(file) as temporary, open(temporary, "wb") as stream:
        np.savez(stream, **arrays)  # pyright: ignore[reportArgumentType]


def _read(file: Path, key: str, kind: type) -> Any | None:
    """What `_write` wrote, or None where there is nothing of this key."""
    if not file.is_file():
        return None
    try:
        with open(file, "rb") as stream, np.load(stream) as stored:
            if str(stored["key"]) != key:
                return None
            return kind(**{f.name: _field(stored, f.name) for f in fields(kind)})
    # zipfile meets damage with nearly every built-in exception.
    except Exception as error:
        log.warning("%s: damaged (%s); the stage is done again", file, error)
        return None


def _field(stored: Mapping[str, np.ndarray], name: str) -> Any:
    if f"{name}.rotation" in stored:
        return Rigid(stored[f"{name}.rotation"], stored[f"{name}.translation"])
    item = stored[name]
    return item.item() if item.ndim == 0 else item
