"""The terminal output of long commands: progress bars, log and result."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from photoclinometry.model.progress import Progress
from photoclinometry.pipeline.products import RunResult

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def progress_bars(console: Any) -> Iterator[Progress]:
    """A progress bar on the console for every kind of work that is reported."""
    from rich import progress as bar

    columns = (
        bar.TextColumn("{task.description:18}"),
        bar.BarColumn(),
        bar.MofNCompleteColumn(),
        bar.TimeElapsedColumn(),
    )
    with bar.Progress(*columns, console=console) as bars:
        tasks: dict[str, bar.TaskID] = {}

        def progress(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=None)
            bars.update(tasks[what], completed=done, total=total or None)

        yield progress


def say_result(console: Any, result: RunResult) -> None:
    """The size of the map and its shortcomings on the console; the report's path on standard output."""
    for name, reason in result.left_out.items():
        console.print(f"left out: {name}: {reason}", highlight=False, markup=False)
    psnr = result.metrics.get("psnr_mean_db")
    quality = f", mean PSNR {psnr:.1f} dB" if psnr is not None else ""
    console.print(f"{len(result.scene.landmarks)} landmarks in {len(result.scene.views)} views{quality}")
    if not result.adjustment.converged:
        console.print(f"the joint estimate has not converged: {result.adjustment.message}")
    print(result.report)


class log_to:
    """Context in which the package's log goes to OUT/log (everything) and to the terminal (stages, warnings)."""

    def __init__(self, out: Path, console: Console):
        self.out, self.console = Path(out), console

    def __enter__(self) -> Self:
        from photoclinometry.model.errors import RunFolderError
        from photoclinometry.pipeline.run_folder import open_run

        self.logger = logging.getLogger("photoclinometry")
        self.level = self.logger.level
        open_run(self.out)
        try:
            file = logging.FileHandler(self.out / "log", encoding="utf-8")
        except OSError as error:
            reason = error.strerror or error
            raise RunFolderError(f"{self.out / 'log'}: cannot be written: {reason}; choose another --out") from error
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        terminal = _Terminal(self.console)
        terminal.setLevel(logging.INFO)
        self.handlers = [file, terminal]
        self.logger.setLevel(logging.DEBUG)
        for handler in self.handlers:
            self.logger.addHandler(handler)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if kind is not None:
            self.logger.error("stopped: %s: %s", kind.__name__, error)
        for handler in self.handlers:
            self.logger.removeHandler(handler)
            handler.close()
        self.logger.setLevel(self.level)


class _Terminal(logging.Handler):
    def __init__(self, console: Console):
        super().__init__()
        self.console = console

    def emit(self, record: logging.LogRecord) -> None:
        self.console.print(record.getMessage(), highlight=False, markup=False)
