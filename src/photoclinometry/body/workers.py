"""Tasks in processes of this machine: each takes paths and numbers, and leaves its result on disk."""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.progress import Progress

log = logging.getLogger(__name__)

ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that set the number of threads of a process: one, where there are as many processes as cores."""
WATCH_S = 2.0
"""Interval at which a process checks whether its parent still runs [s]: without it, a process whose parent was killed
would go on unseen."""
TRIES = 2
"""Number of times that a task's process may die before the task is given up: the first time, another may be the
cause."""


def in_processes(workers: int, task: Callable[..., None], calls: Sequence[tuple[Any, ...]], progress: Progress) -> None:
    """task(*call) of every call, `workers` at a time, in fresh processes of one thread each.

    Exceptions of the task are raised here, after those that had begun have ended; the others are given up. Raises
    ReconstructionError where a process dies again and again, as for lack of memory.
    """
    left, died, done = list(range(len(calls))), dict.fromkeys(range(len(calls)), 0), 0
    while left:
        try:
            with _one_thread_each(), _pool(workers) as pool:
                running = {pool.submit(task, *calls[n]): n for n in left}
                try:
                    for future in as_completed(running):
                        future.result()
                        left.remove(running[future])
                        done += 1
                        progress("tiles", done, len(calls))
                finally:
                    pool.shutdown(cancel_futures=True)
        except BrokenProcessPool as error:
            first = left[: max(1, workers)]
            for n in first:
                died[n] += 1
            if max(died[n] for n in first) >= TRIES:
                raise ReconstructionError(
                    f"a process that mapped a tile was ended from outside {TRIES} times, as for lack of memory; give "
                    "fewer --workers or smaller tiles (--plan.tile-px). Finished tiles are kept"
                ) from error
            log.info("a process that mapped a tile was ended from outside; unfinished tiles are begun again")


def _pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_begin)


def _begin() -> None:
    """Nothing is printed, since a task's warnings are kept with its result; and the process ends with its parent."""
    logging.getLogger().addHandler(logging.NullHandler())
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Within the block, processes that are started use one thread each."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value
