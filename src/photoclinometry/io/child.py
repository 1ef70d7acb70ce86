"""Processes of this package's own that answer requests, one line of JSON each, on standard output."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from threading import Event, Timer
from typing import Any


class NoAnswerError(Exception):
    """A process ended, or was ended, before it answered."""

    def __init__(self, timed_out: bool):
        super().__init__("the process did not answer in time" if timed_out else "the process ended")
        self.timed_out = timed_out
        """Whether it was ended, since it took too long."""


class Child:
    """A running script of this folder; what it writes on standard error is dropped."""

    def __init__(self, script: str):
        # -P: modules beside the script must not hide others of the same name, such as the standard `site`.
        self.process = subprocess.Popen(
            [sys.executable, "-P", str(Path(__file__).with_name(script))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
        )

    def ask(self, request: Any, timeout_s: float) -> Any:
        """The answer to a request. Raises NoAnswerError where the process ends; after `timeout_s` it is ended."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        timed_out = Event()

        def end() -> None:
            timed_out.set()
            self.process.kill()

        timer = Timer(timeout_s, end)
        timer.start()
        try:
            self.process.stdin.write(json.dumps(request) + "\n")
            self.process.stdin.flush()
            answer = self.process.stdout.readline()
        except OSError:
            answer = ""
        finally:
            timer.cancel()
        if not answer:
            raise NoAnswerError(timed_out.is_set())
        return json.loads(answer)

    def close(self) -> None:
        """Ends the process."""
        self.process.kill()
        self.process.communicate()
