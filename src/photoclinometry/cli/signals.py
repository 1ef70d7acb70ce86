"""SIGTERM, SIGHUP and Ctrl-C end a command with one line and an exit code, also where compiled code is at work.

Python acts on a signal when the running call returns, which may take minutes in compiled code. So a thread watches: if
the command has not ended some seconds after the signal, it ends the process. Nothing is lost by that: files appear
whole or not at all, and the lock of a process that has ended is taken over.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

GRACE_S = 3.0
"""A command that has not ended so long after the signal is ended."""

_RESUMES = "the same command goes on from what is finished"
HANGUP = getattr(signal, "SIGHUP", None)
"""Comes when a terminal or an SSH session is closed; Windows has none."""
SAYS = {
    signal.SIGINT: (f"interrupted; {_RESUMES}", 130),
    signal.SIGTERM: (f"terminated; {_RESUMES}", 143),
    **({} if HANGUP is None else {HANGUP: (f"terminated, since the session was closed; {_RESUMES}", 129)}),
}
"""The last line, and the exit code, 128 + the signal's number."""

_SHOW_CURSOR = "\x1b[?25h"
"""Progress bars hide the cursor."""


class TerminatedError(BaseException):
    """SIGTERM or SIGHUP has come. As KeyboardInterrupt, no error that `except Exception` should catch."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = signal.Signals(number)


@contextmanager
def stoppable() -> Iterator[None]:
    """Within the block SIGTERM and SIGHUP raise TerminatedError; they and Ctrl-C end the process if the block does not.

    SIGHUP stays ignored where it is, as `nohup` has it. Does nothing in other threads than the main one, which get no
    signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    ended = threading.Event()
    watcher = threading.Thread(target=_watch, args=(reading, ended), name="signals", daemon=True)
    watcher.start()
    before = {number: signal.getsignal(number) for number in SAYS if number != signal.SIGINT}
    for number, handler in before.items():
        if not (number == HANGUP and handler == signal.SIG_IGN):
            signal.signal(number, _terminate)
    wakeup = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    try:
        yield
    finally:
        ended.set()
        signal.set_wakeup_fd(wakeup)
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        os.close(writing)  # the watcher reads the end of the pipe
        watcher.join()
        os.close(reading)


def _terminate(number: int, _frame: FrameType | None) -> None:
    raise TerminatedError(number)


def _watch(pipe: int, ended: threading.Event) -> None:
    """Waits for a signal's number, then for the command to end; ends the process where it does not."""
    while received := os.read(pipe, 1):
        if received[0] not in SAYS:
            continue
        if ended.wait(GRACE_S):
            return
        words, code = SAYS[signal.Signals(received[0])]
        with suppress(OSError, ValueError):
            if sys.stderr.isatty():
                sys.stderr.write(_SHOW_CURSOR)
            sys.stderr.write(f"phomo: {words}\n")
            sys.stderr.flush()
        os._exit(code)
