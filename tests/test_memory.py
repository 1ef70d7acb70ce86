"""Memory that was freed goes back to the system."""

import platform
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from photoclinometry.pipeline.folder.memory import give_back_memory, peak_memory_gb

CHUNK, COUNT = 100_000, 2_000
"""Bytes of each array, small enough to lie in the thread's arena, and their number: 0.2 GB."""


def resident_gb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**30


@pytest.mark.skipif(sys.platform != "linux" or platform.libc_ver()[0] != "glibc", reason="of glibc alone")
def test_what_a_thread_freed_below_what_it_holds_is_given_back():
    held = []

    def fill() -> None:
        freed = [np.ones(CHUNK, np.uint8) for _ in range(COUNT)]
        held.append(np.ones(CHUNK, np.uint8))
        del freed

    thread = threading.Thread(target=fill)
    thread.start()
    thread.join()
    before = resident_gb()
    give_back_memory()
    assert resident_gb() < before - 0.1
    assert peak_memory_gb() > before - 0.1
