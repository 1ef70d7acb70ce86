"""Tasks in processes of their own: all are done, errors come through, and processes that die are replaced."""

import os

import pytest

from photoclinometry.body.workers import in_processes
from photoclinometry.model.errors import InputError, ReconstructionError
from worker_tasks import calls, die, die_once, done, refuse, write_threads


def test_every_task_is_done_in_one_thread_and_counted(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    counted = []
    in_processes(2, write_threads, calls(tmp_path), lambda *now: counted.append(now))
    assert [path.read_text() for path in sorted(tmp_path.iterdir())] == ["1 1 1 1"] * 3
    assert counted == [("tiles", n, 3) for n in (1, 2, 3)]
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_what_a_task_raises_comes_through(tmp_path):
    with pytest.raises(InputError, match="task 1 is refused"):
        in_processes(1, refuse, [(tmp_path, number) for number in range(40)], lambda *_: None)
    assert len(done(tmp_path)) < 20  # those that had not begun are given up


def test_a_task_whose_process_died_is_begun_again(tmp_path):
    in_processes(1, die_once, calls(tmp_path), lambda *_: None)
    assert done(tmp_path) == {"0", "1", "2"}


def test_a_task_whose_processes_always_die_ends_with_what_to_do(tmp_path):
    with pytest.raises(ReconstructionError, match="fewer --workers or smaller tiles"):
        in_processes(1, die, calls(tmp_path), lambda *_: None)
    assert "0" in done(tmp_path)


def test_nothing_to_do_starts_nothing(tmp_path):
    in_processes(1, die, [], lambda *_: None)
