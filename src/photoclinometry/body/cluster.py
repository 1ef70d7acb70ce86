"""Tasks on the workers of a Dask cluster, by the same calls as in processes of this machine. Needs the extra `cluster`.

Workers must see the folders that tasks name, and have this version of the package.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.progress import Progress

if TYPE_CHECKING:
    from distributed import Client

log = logging.getLogger(__name__)

ANSWER_S = 15.0
"""Longest time for a scheduler's answer [s]: one that works answers within a second, even over slow networks."""


def on_cluster(
    scheduler: str | Client, task: Callable[..., None], calls: Sequence[tuple[Any, ...]], progress: Progress
) -> None:
    """task(*call) of every call, on the workers of a Dask scheduler, given by its address or by a client of it.

    Exceptions of the task are raised here; calls that have not begun are then given up. A call whose worker is lost
    goes to another one. Raises InputError where no scheduler answers, or where a worker runs several threads, and
    ReconstructionError where workers are lost by the same call again and again.
    """
    if not calls:
        return
    with _client(scheduler) as client:
        from distributed import KilledWorker, as_completed

        if not client.scheduler_info()["workers"]:
            log.info("the Dask scheduler has no workers yet: waiting for the first")
        running = [client.submit(_in_one_thread, task, call, pure=False) for call in calls]
        try:
            for done, future in enumerate(as_completed(running), start=1):
                future.result()
                progress("tiles", done, len(calls))
        except KilledWorker as error:
            raise ReconstructionError(
                "the workers that mapped one tile were lost again and again, as for lack of memory; give workers more "
                "memory, or smaller tiles (--plan.tile-px). Finished tiles are kept"
            ) from error
        finally:
            client.cancel(running)


@contextmanager
def _client(scheduler: str | Client) -> Iterator[Client]:
    """A client that was given, or one of its own of the scheduler at an address."""
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise InputError("--scheduler needs Dask: pip install 'photoclinometry[cluster]'") from error
    if not isinstance(scheduler, str):
        yield scheduler
        return
    try:
        client = Client(scheduler, timeout=ANSWER_S)
    except (OSError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {scheduler!r} ({error}); `dask scheduler` prints its address"
        ) from error
    with client:
        yield client


def _in_one_thread(task: Callable[..., None], call: tuple[Any, ...]) -> None:
    """The task of a worker. Raises InputError where it has several threads: compiled loops share one pool of threads in
    a process, and the process ends where two threads enter it."""
    import numba
    from distributed import get_worker

    worker = get_worker()
    if worker.state.nthreads != 1:
        raise InputError(
            f"the Dask worker {worker.name} has {worker.state.nthreads} threads: start workers with --nthreads 1, and "
            "as many of them as there are cores"
        )
    numba.set_num_threads(1)
    task(*call)
