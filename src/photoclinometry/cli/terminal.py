"""The terminal output of long commands: log and result."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from photoclinometry.cli.bars import Bars
from photoclinometry.cli.stage_lines import StageLines, has_ended
from photoclinometry.io.run_files import LOG_FILE
from photoclinometry.pipeline.products import RunResult

if TYPE_CHECKING:
    from rich.console import Console

    from photoclinometry.body.products import BodyResult


def say_result(console: Any, result: RunResult) -> None:
    """The size of the map and its shortcomings on the console, and as `say_ending`."""
    warned_of = {warned.view for warned in result.warnings}
    for name, reason in result.left_out.items():
        if name not in warned_of:
            console.print(f"left out: {name}: {reason}", highlight=False, markup=False)
    psnr = result.metrics.get("psnr_mean_db")
    quality = f", mean PSNR {psnr:.1f} dB" if psnr is not None else ""
    console.print(f"{len(result.scene.landmarks)} landmarks in {len(result.scene.views)} views{quality}")
    if not result.adjustment.converged:
        console.print(f"the joint estimate has not converged: {result.adjustment.message}")
    say_ending(console, result, [warned.line for warned in result.warnings])


def say_ending(console: Any, result: RunResult | BodyResult, warnings: Sequence[str]) -> None:
    """The verdict, what to take care of, and lines of warnings on the console, once more at the end, and the report's
    path on standard output.

    Raises UntrustedMapError, for the last line and the exit code, where the map is not to be trusted.
    """
    from photoclinometry.model.errors import UntrustedMapError

    console.print(f"verdict: {result.verdict}")
    for line in result.care:
        console.print(f"- {line}", highlight=False, markup=False)
    if warnings:
        console.print(f"warnings: {len(result.warnings)}")
    for line in warnings:
        console.print(f"- {line}", highlight=False, markup=False)
    print(result.report, flush=True)
    if not result.trusted:
        raise UntrustedMapError(f"the map is written, but not to be trusted: {'; '.join(result.distrust)}")


class log_to:
    """Context in which the package's log goes to OUT/log (everything) and to the terminal (stages, warnings).

    bars: those of the work, which go when their stage has ended. overwrite: begin the file anew.
    """

    def __init__(self, out: Path, console: Console, bars: Bars, *, overwrite: bool = False):
        self.out, self.console, self.bars = Path(out), console, bars
        self.mode = "w" if overwrite else "a"

    def __enter__(self) -> Self:
        from photoclinometry.io.atomic import unwritable
        from photoclinometry.pipeline.folder.run_folder import MARK, open_run

        self.logger = logging.getLogger("photoclinometry")
        self.level = self.logger.level
        if not (self.out / MARK).is_file():
            open_run(self.out)
        try:
            file = _LogFile(self.out / LOG_FILE, self.mode, encoding="utf-8")
        except OSError as error:
            raise unwritable(self.out / LOG_FILE, error) from error
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        terminal = _Terminal(self.console, self.bars)
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
    def __init__(self, console: Console, bars: Bars):
        super().__init__()
        self.console, self.bars, self.stages = console, bars, StageLines()

    def emit(self, record: logging.LogRecord) -> None:
        if has_ended(record):
            self.bars.end()
        line = self.stages.line(record)
        if line is not None:
            self.console.print(line, highlight=False, markup=False, soft_wrap=True)
