"""Progress bars on the terminal: there while their work is, and at their total when it is done.

Of long work the log has the same.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress as Drawn
    from rich.progress import TaskID


log = logging.getLogger(__name__)

LOG_EVERY_S = 60.0
"""Time from one line of the log about the same work to the next [s]: an hour's run has dozens, a short one none."""


class Bars:
    """A `Progress` that shows the work that is reported as a bar, with the time that it still takes.

    A bar goes when other work begins, and at `end`: what came of it is in the stage's line. Work without a known total
    shows its count and no time left.
    """

    def __init__(self, drawn: Drawn):
        self.drawn = drawn
        self.what: str | None = None
        """The work whose bar is there, None without one."""
        self.task: TaskID
        self.logged_s = 0.0
        """Time of the last log line about the work, after its beginning [s]."""

    def __call__(self, what: str, done: int, total: int) -> None:
        begins = what != self.what
        if begins:
            self._remove()
        elapsed = None if begins else self.drawn.tasks[0].elapsed
        shown: dict[str, Any] = {
            "completed": done,
            "total": total or None,
            "count": f"{done}/{total}" if total else f"{done}",
            "left": time_left(elapsed, done, total),
        }
        if begins:
            self.what, self.task, self.logged_s = what, self.drawn.add_task(what, **shown), 0.0
        else:
            self.drawn.update(self.task, **shown)
        if elapsed is not None and elapsed - self.logged_s >= LOG_EVERY_S:
            self.logged_s = elapsed
            log.info("%s", " ".join(part for part in (what, shown["count"], shown["left"]) if part))
        # The thread that draws waits while compiled code holds the interpreter, which may be for seconds.
        if done == total:
            self.drawn.refresh()

    def end(self) -> None:
        """Removes the bar: the stage that it was of has ended."""
        if self.what is not None:
            self._remove()
            self.drawn.refresh()

    def _remove(self) -> None:
        if self.what is not None:
            self.drawn.remove_task(self.task)
        self.what = None


@contextmanager
def progress_bars(console: Any) -> Iterator[Bars]:
    """Bars on the console; none is left when the block ends, by an error, too."""
    from rich import progress as bar

    columns = (
        bar.TextColumn("{task.description:18}", markup=False),
        bar.BarColumn(),
        bar.TextColumn("{task.fields[count]}"),
        bar.TimeElapsedColumn(),
        bar.TextColumn("{task.fields[left]}"),
    )
    with bar.Progress(*columns, console=console, transient=True) as drawn:
        bars = Bars(drawn)
        try:
            yield bars
        finally:
            bars.end()


def time_left(elapsed_s: float | None, done: int, total: int) -> str:
    """The time that the rest takes at the mean speed so far, as "left 0:12"; empty where that is not known."""
    if not elapsed_s or not 0 < done < total:
        return ""
    seconds = round(elapsed_s * (total - done) / done)
    return f"left {seconds // 60}:{seconds % 60:02d}"
