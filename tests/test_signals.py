"""SIGTERM and Ctrl-C: one line, the exit code, no traceback, also where compiled code is at work."""

import signal
import subprocess
import sys

import pytest

# A stand-in for the pipeline, in a process of its own: says that it is there, and then does not return to Python.
STUCK = """
import sys
from photoclinometry.cli import signals
from photoclinometry.cli import main
import photoclinometry.cli as cli
signals.GRACE_S = 0.3
def run(arguments):
    {before}
    print("there", flush=True)
    {work}
def forever():
    n = 0
    while n >= 0:
        n = (n + 1) % 7
cli._run = run
main([])
"""
# Signals act as in a terminal, also where the tests run behind one that is closed (nohup, &).
IN_A_TERMINAL = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
"""
PYTHON = "\n    import time\n    time.sleep(60)"
COMPILED = "\n    import numba\n    numba.njit('void()', nogil=True)(forever)()"
SWALLOWS = (
    "\n    import time\n    for _ in range(100):\n        try:\n            time.sleep(1)\n"
    "        except BaseException:\n            pass"
)
COLMAP = "from photoclinometry.sfm.mapping import quiet_pycolmap\n    quiet_pycolmap(0).__enter__()"


ENDS = [
    (signal.SIGTERM, 143, "terminated"),
    (signal.SIGINT, 130, "interrupted"),
    (getattr(signal, "SIGHUP", 1), 129, "terminated, since the session was closed"),
]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM to send")
@pytest.mark.parametrize(("number", "code", "word"), ENDS, ids=["term", "int", "hangup"])
@pytest.mark.parametrize(
    ("before", "work"),
    [("pass", PYTHON), ("pass", COMPILED), ("pass", SWALLOWS), (COLMAP, PYTHON)],
    ids=["python", "compiled code", "code that catches all", "after pycolmap was imported"],
)
def test_a_signal_ends_a_command_with_one_line(number, code, word, before, work):
    program = IN_A_TERMINAL + STUCK.format(before=before, work=work)
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "there\n"
        process.send_signal(number)
        try:
            _, said = process.communicate(timeout=30)
        finally:
            process.kill()
    assert process.returncode == code
    assert said == f"phomo: {word}; the same command goes on from what is finished\n"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGHUP")
def test_nohup_keeps_a_command():
    program = STUCK.format(before="pass", work="\n    import time\n    time.sleep(1)")
    ignored = "import signal\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
    process = subprocess.Popen([sys.executable, "-c", ignored + program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "there\n"
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=30)
    assert process.returncode == 0


def test_handlers_are_as_they_were_after_a_command():
    from commands import phomo

    before = signal.getsignal(signal.SIGTERM)
    phomo("--help")
    assert signal.getsignal(signal.SIGTERM) is before
    assert signal.set_wakeup_fd(-1) == -1
