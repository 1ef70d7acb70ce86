"""Python threads, for calls of libraries that let go of the interpreter while they compute."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba

Item = TypeVar("Item")
Result = TypeVar("Result")


PARALLEL_LOOPS = threading.RLock()
"""Of Numba: their threads serve one caller at a time."""


def in_threads(
    function: Callable[[Item], Result], items: Iterable[Item], done: Callable[[int], None] | None = None
) -> list[Result]:
    """[function(item) for item in items], in as many threads as compiled loops take (`numba.get_num_threads`).

    function: must hold PARALLEL_LOOPS while it runs parallel loops of Numba. done: called in the caller's thread with
    the number of results so far, after each.
    """
    threads = numba.get_num_threads()
    if threads == 1:
        return counted(map(function, items), done)
    with ThreadPoolExecutor(threads) as pool:
        return counted(pool.map(function, items), done)


def counted(results: Iterable[Result], done: Callable[[int], None] | None) -> list[Result]:
    """The results as a list; done: called with the number of them so far, after each."""
    found = []
    for result in results:
        found.append(result)
        if done is not None:
            done(len(found))
    return found


RUNS = 32
"""Parts of a long loop: enough to keep many cores busy to the end, few enough that sums over each are cheap."""


def runs(count: int) -> list[slice]:
    """Consecutive runs of `count` items, RUNS of them at most. They are the same whatever the number of threads, and so
    are sums over each and then over all."""
    size = max(1, -(-count // RUNS))
    return [slice(first, first + size) for first in range(0, count, size)]
