"""The memory of the process: what it has taken at most, and freed memory given back."""

from __future__ import annotations

import ctypes
import sys


def peak_memory_gb() -> float | None:
    """Largest resident size of this process so far; None where the system does not report it (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    bytes_each = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * bytes_each / 2**30


def give_back_memory() -> None:
    """Gives what was freed back to the system, where the C library keeps it and can (glibc).

    Each thread frees into an arena of its own, which no other thread takes from: a tenth of a full-size run's memory.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
