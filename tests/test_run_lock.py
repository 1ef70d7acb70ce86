"""One process at a time writes into a run folder; a lock whose process has ended is taken over."""

import json
import os
import socket
import subprocess
import sys
import time

import psutil
import pytest

from photoclinometry.model.errors import RunFolderError
from photoclinometry.pipeline.folder.run_lock import NAME, check_lock, locked


def write_lock(folder, **changes):
    """A lock as of this process, with changes."""
    content = {
        "pid": os.getpid(),
        "host": socket.gethostname(),
        "since": "2026-01-02T03:04:05Z",
        "process_started": psutil.Process().create_time(),
    }
    (folder / NAME).write_text(json.dumps(content | changes))


def ended_process() -> int:
    """The number of a process that has ended."""
    done = subprocess.Popen([sys.executable, "-c", ""])
    done.wait()
    return done.pid


def test_a_lock_names_its_process_and_goes_with_the_block(tmp_path):
    with locked(tmp_path):
        content = json.loads((tmp_path / NAME).read_text())
        assert (content["pid"], content["host"]) == (os.getpid(), socket.gethostname())
    assert not list(tmp_path.iterdir())
    with pytest.raises(ZeroDivisionError), locked(tmp_path):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_a_second_run_in_the_same_process_is_refused(tmp_path):
    refusal = pytest.raises(RunFolderError, match=rf"process {os.getpid()} on .* has been writing to this folder since")
    with locked(tmp_path):
        with refusal, locked(tmp_path):
            pass
        assert (tmp_path / NAME).exists()


@pytest.mark.parametrize(
    "stale",
    [
        pytest.param({"pid": None}, id="the process has ended"),
        pytest.param({"process_started": 1.0}, id="another process has its number"),
        pytest.param({"pid": -1}, id="the number is negative"),
        pytest.param({"pid": 2**70}, id="no process has such a number"),
    ],
)
def test_a_stale_lock_is_taken_over(tmp_path, caplog, stale):
    write_lock(tmp_path, **({"pid": ended_process()} if stale == {"pid": None} else stale))
    check_lock(tmp_path)
    caplog.set_level("INFO")
    with locked(tmp_path):
        assert json.loads((tmp_path / NAME).read_text())["pid"] == os.getpid()
    assert "taken over" in caplog.text
    assert not list(tmp_path.iterdir())


def test_another_computers_lock_is_refused_with_what_to_do(tmp_path):
    write_lock(tmp_path, host="elsewhere", pid=1)
    for attempt in (lambda: check_lock(tmp_path), lambda: locked(tmp_path).__enter__()):
        with pytest.raises(
            RunFolderError, match=rf"on elsewhere .*2026-01-02.* if it no longer runs there, remove .*{NAME}"
        ):
            attempt()
    assert json.loads((tmp_path / NAME).read_text())["host"] == "elsewhere"


@pytest.mark.parametrize("text", ["", "{", "[]", '{"pid": "x"}', '{"pid": 1e999}', "[" * 100_000])
def test_a_damaged_lock_is_waited_for_while_it_is_young(tmp_path, text):
    (tmp_path / NAME).write_text(text)
    with pytest.raises(RunFolderError, match="is just being written by another run; try again"):
        check_lock(tmp_path)
    old = time.time() - 60
    os.utime(tmp_path / NAME, (old, old))
    with locked(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_a_lock_that_cannot_be_written_names_the_file(tmp_path):
    with pytest.raises(RunFolderError, match=rf"{NAME}: cannot be written"), locked(tmp_path / "none"):
        pass
