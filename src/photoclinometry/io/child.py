"""Processes of this package's own that answer lines on standard input by lines on standard output."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def started(script: str) -> subprocess.Popen[str]:
    """A running script of this folder, with pipes of UTF-8 text; what it writes on standard error is dropped."""
    # -P: modules beside the script must not hide others of the same name, such as the standard `site`.
    return subprocess.Popen(
        [sys.executable, "-P", str(Path(__file__).with_name(script))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        encoding="utf-8",
    )
