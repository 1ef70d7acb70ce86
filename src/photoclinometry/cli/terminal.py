"""The terminal output of long commands: progress bars, log and result."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from photoclinometry.cli.stage_lines import StageLines
from photoclinometry.model.progress import Progress
from photoclinometry.model.warning import Warned
from photoclinometry.pipeline.products import RunResult

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def progress_bars(console: Any) -> Iterator[Progress]:
    """A progress bar on the console for the work that is reported, with the time that it still takes.

    A bar is there while its work is, and goes when other work begins: what came of it is in the stage's line. Work
    without a known total shows its count and no time left.
    """
    from rich import progress as bar

    columns = (
        bar.TextColumn("{task.description:18}"),
        bar.BarColumn(),
        bar.TextColumn("{task.fields[count]}"),
        bar.TimeElapsedColumn(),
        bar.TextColumn("{task.fields[left]}"),
    )
    with bar.Progress(*columns, console=console, transient=True) as bars:
        now: dict[str, bar.TaskID] = {}

        def progress(what: str, done: int, total: int) -> None:
            if what not in now:
                for old in now.values():
                    bars.remove_task(old)
                now.clear()
                now[what] = bars.add_task(what, total=None, count="", left="")
            elapsed = bars.tasks[0].elapsed if bars.tasks else None
            count = f"{done}/{total}" if total else f"{done}"
            bars.update(
                now[what], completed=done, total=total or None, count=count, left=time_left(elapsed, done, total)
            )

        yield progress


def time_left(elapsed_s: float | None, done: int, total: int) -> str:
    """The time that the rest takes at the mean speed so far, as "left 0:12"; empty where that is not known."""
    if not elapsed_s or not 0 < done < total:
        return ""
    seconds = round(elapsed_s * (total - done) / done)
    return f"left {seconds // 60}:{seconds % 60:02d}"


def say_result(console: Any, result: RunResult) -> None:
    """The size of the map and its shortcomings on the console; the report's path on standard output.

    Raises UntrustedMapError, for the last line and the exit code, where the map is not to be trusted.
    """
    from photoclinometry.model.errors import UntrustedMapError

    warned_of = {warned.view for warned in result.warnings}
    for name, reason in result.left_out.items():
        if name not in warned_of:
            console.print(f"left out: {name}: {reason}", highlight=False, markup=False)
    psnr = result.metrics.get("psnr_mean_db")
    quality = f", mean PSNR {psnr:.1f} dB" if psnr is not None else ""
    console.print(f"{len(result.scene.landmarks)} landmarks in {len(result.scene.views)} views{quality}")
    if not result.adjustment.converged:
        console.print(f"the joint estimate has not converged: {result.adjustment.message}")
    say_warnings(console, result.warnings)
    print(result.report, flush=True)
    if not result.trusted:
        raise UntrustedMapError(f"the map is written, but not to be trusted: {'; '.join(result.distrust)}")


def say_warnings(console: Any, warnings: Sequence[Warned]) -> None:
    """All that was warned of, once more at the end, where people look."""
    if warnings:
        console.print(f"warnings: {len(warnings)}")
    for warned in warnings:
        console.print(f"- {warned.words} [{warned.code}]", highlight=False, markup=False)


class log_to:
    """Context in which the package's log goes to OUT/log (everything) and to the terminal (stages, warnings).

    overwrite: begin the file anew.
    """

    def __init__(self, out: Path, console: Console, *, overwrite: bool = False):
        self.out, self.console = Path(out), console
        self.mode = "w" if overwrite else "a"

    def __enter__(self) -> Self:
        from photoclinometry.io.atomic import unwritable
        from photoclinometry.pipeline.run_folder import MARK, open_run

        self.logger = logging.getLogger("photoclinometry")
        self.level = self.logger.level
        if not (self.out / MARK).is_file():
            open_run(self.out)
        try:
            file = _LogFile(self.out / "log", self.mode, encoding="utf-8")
        except OSError as error:
            raise unwritable(self.out / "log", error) from error
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


class _LogFile(logging.FileHandler):
    """The log on disk. A line that does not fit on the disk any more is lost; the run ends by what it cannot write."""

    def handleError(self, record: logging.LogRecord) -> None:
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)

    def close(self) -> None:
        with suppress(OSError):
            super().close()


class _Terminal(logging.Handler):
    def __init__(self, console: Console):
        super().__init__()
        self.console, self.stages = console, StageLines()

    def emit(self, record: logging.LogRecord) -> None:
        line = self.stages.line(record)
        if line is not None:
            self.console.print(line, highlight=False, markup=False, soft_wrap=True)
