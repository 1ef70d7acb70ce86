"""Progress bars: at their total when their work is done, and gone when their stage has ended or failed."""

import io
import logging
import re
import time

import pytest
from rich.console import Console

from commands import phomo
from photoclinometry.cli import bars
from photoclinometry.cli.bars import progress_bars, time_left
from photoclinometry.cli.terminal import log_to


@pytest.fixture
def console():
    return Console(file=io.StringIO(), force_terminal=True, width=80)


def frames(text):
    """What stood on the terminal, one text after another: redrawn lines without colours."""
    plain = re.sub(r"\x1b\[(\?25[hl]|[0-9;]*m)", "", text)
    return [" ".join(part.split()) for part in re.split(r"\x1b\[2K|\n", plain)]


def drawn(console):
    return frames(console.file.getvalue())


@pytest.mark.parametrize(
    ("elapsed", "done", "total", "left"),
    [(10.0, 1, 3, "left 0:20"), (61.0, 50, 100, "left 1:01"), (10.0, 3, 3, ""), (10.0, 5, 0, ""), (None, 0, 3, "")],
)
def test_the_time_left_is_that_of_the_mean_speed_and_nothing_where_the_total_is_unknown(elapsed, done, total, left):
    assert time_left(elapsed, done, total) == left


def test_a_bar_goes_when_other_work_begins(console):
    with progress_bars(console) as progress:
        progress("images", 3, 3)
        assert any("images" in frame and "3/3" in frame for frame in drawn(console))
        progress("adjust", 1, 0)
        progress("adjust", 2, 0)
        assert [task.description for task in progress.drawn.tasks] == ["adjust"]


def test_a_bar_at_its_total_is_drawn_at_once(console):
    """The thread that draws may have no time until the stage ends."""
    with progress_bars(console) as progress:
        progress("relight 2", 0, 5)
        progress("relight 2", 5, 5)
        assert "5/5" in drawn(console)[-1]


def test_a_bar_goes_when_its_stage_ends(console, tmp_path):
    folder = logging.getLogger("photoclinometry.pipeline.folder.run_folder")
    with progress_bars(console) as progress, log_to(tmp_path / "run", console, progress):
        progress("adjust", 7, 0)
        assert "adjust" in drawn(console)[-1]
        folder.info("it has ended", extra={"ended": "last_estimate", "wall_s": 2.1})
        folder.info("%s ...", "report")
        assert not progress.drawn.tasks
        assert drawn(console)[-1] == ""
    assert "last estimate 2.1 s" in drawn(console)


def test_the_log_is_told_of_long_work_from_time_to_time(console, tmp_path, monkeypatch):
    """What is done, of how much, and the time left; nothing of short work."""
    monkeypatch.setattr(bars, "LOG_EVERY_S", 0.05)
    with progress_bars(console) as progress, log_to(tmp_path / "run", console, progress):
        progress("relight 1", 0, 4)
        progress("relight 1", 1, 4)
        time.sleep(0.1)
        progress("relight 1", 2, 4)
        progress("relight 1", 3, 4)
        progress("adjust", 0, 0)
        time.sleep(0.1)
        progress("adjust", 7, 0)
    lines = [
        line.split("photoclinometry.cli.bars: ")[1] for line in (tmp_path / "run" / "log").read_text().splitlines()
    ]
    assert lines == ["relight 1 2/4 left 0:00", "adjust 7"]


def test_a_bar_goes_when_its_stage_fails(console):
    with pytest.raises(ValueError, match="no matches"), progress_bars(console) as progress:  # noqa: PT012
        progress("mapping", 4, 6)
        raise ValueError("no matches")
    assert not progress.drawn.tasks
    assert "mapping" not in drawn(console)[-1]


def test_a_command_that_fails_leaves_no_bar(tmp_path, monkeypatch, capsys):
    """FORCE_COLOR makes rich take standard error for a terminal."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    (tmp_path / "a.png").write_bytes(b"")
    assert phomo("ingest", tmp_path / "a.png", "--out", tmp_path / "out") == 2
    said = frames(capsys.readouterr().err)
    assert "phomo: " in said[-2]
    assert "0/?" not in "".join(said)
