"""Tasks that other processes do, raise in or die of. They leave a file each, and are imported there by name."""

import os
import time
from pathlib import Path

from photoclinometry.body.workers import ONE_THREAD
from photoclinometry.model.errors import InputError


def write_threads(folder: Path, number: int) -> None:
    """What the variables of threads say in the process that does the task."""
    (folder / str(number)).write_text(" ".join(os.environ.get(name, "-") for name in ONE_THREAD))


def refuse(folder: Path, number: int) -> None:
    """The second task raises."""
    if number == 1:
        raise InputError("task 1 is refused")
    time.sleep(0.05)
    write_threads(folder, number)


def die_once(folder: Path, number: int) -> None:
    """The second task takes its process with it at its first trial."""
    mark = folder / f"tried-{number}"
    if number == 1 and not mark.exists():
        mark.write_text("")
        os._exit(9)
    write_threads(folder, number)


def die(folder: Path, number: int) -> None:
    """The second task takes its process with it."""
    if number == 1:
        os._exit(9)
    write_threads(folder, number)


def done(folder: Path) -> set[str]:
    """Numbers of the tasks that left their file."""
    return {path.name for path in folder.iterdir() if path.name.isdigit()}


def calls(folder: Path) -> list[tuple[Path, int]]:
    """Three tasks."""
    return [(folder, number) for number in range(3)]
