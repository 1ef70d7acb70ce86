"""Processes that answer requests: their answers, and what is raised where there is none."""

import os
import signal
import sys

import pytest

from photoclinometry.io.child import Child, NoAnswerError


@pytest.fixture
def child():
    found = Child("hdf5_check.py")
    yield found
    found.close()


def test_requests_are_answered_one_after_another(child, tmp_path):
    for name in ("a.h5", "ä.h5"):
        (tmp_path / name).write_bytes(b"text")
        assert child.ask(str(tmp_path / name), 60.0) == "it is no HDF5 file"


def test_a_process_that_has_ended_gives_no_answer(child):
    child.process.kill()
    child.process.wait()
    with pytest.raises(NoAnswerError) as caught:
        child.ask("a.h5", 60.0)
    assert not caught.value.timed_out


@pytest.mark.skipif(sys.platform == "win32", reason="Windows stops no process")
def test_a_process_that_does_not_answer_is_ended(child):
    os.kill(child.process.pid, signal.SIGSTOP)
    with pytest.raises(NoAnswerError) as caught:
        child.ask("a.h5", 0.1)
    assert caught.value.timed_out
    assert child.process.wait(timeout=60.0)


def test_a_closed_process_has_ended(child):
    child.close()
    assert child.process.poll() is not None
