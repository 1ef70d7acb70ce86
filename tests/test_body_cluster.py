"""Tasks on a Dask cluster: all are done, errors come through, and those of lost workers are done by others."""

import numba
import pytest

from photoclinometry.body import cluster
from photoclinometry.body.cluster import on_cluster
from photoclinometry.model.errors import InputError, ReconstructionError
from worker_tasks import calls, die, die_once, done, refuse

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # of connections that end with their workers


@pytest.fixture(scope="module")
def local():
    """A scheduler with two workers of one thread each, which are replaced if they die."""
    import dask

    settings = {"distributed.scheduler.allowed-failures": 1, "distributed.worker.memory.terminate": False}
    with dask.config.set(settings), distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=":0") as made:
        yield made.scheduler_address


def write_numba_threads(folder, number):
    (folder / str(number)).write_text(str(numba.get_num_threads()))


def test_every_task_is_done_in_one_thread_and_counted(local, tmp_path):
    counted = []
    on_cluster(local, write_numba_threads, calls(tmp_path), lambda *now: counted.append(now))
    assert [path.read_text() for path in sorted(tmp_path.iterdir())] == ["1"] * 3
    assert counted == [("tiles", n, 3) for n in (1, 2, 3)]


def test_a_client_that_was_given_stays_open(local, tmp_path):
    with distributed.Client(local) as client:
        on_cluster(client, write_numba_threads, calls(tmp_path), lambda *_: None)
        assert client.submit(sum, [1, 2]).result() == 3
    assert done(tmp_path) == {"0", "1", "2"}


def test_what_a_task_raises_comes_through(local, tmp_path):
    with pytest.raises(InputError, match="task 1 is refused"):
        on_cluster(local, refuse, calls(tmp_path), lambda *_: None)


def test_a_task_whose_worker_was_lost_is_begun_again(local, tmp_path):
    on_cluster(local, die_once, calls(tmp_path), lambda *_: None)
    assert done(tmp_path) == {"0", "1", "2"}


def test_a_task_that_always_loses_its_worker_ends_with_what_to_do(local, tmp_path):
    with pytest.raises(ReconstructionError, match="give workers more memory, or smaller tiles"):
        on_cluster(local, die, calls(tmp_path)[1:2], lambda *_: None)


def test_workers_of_several_threads_are_refused(tmp_path):
    made = distributed.LocalCluster(1, threads_per_worker=2, processes=False, dashboard_address=":0")
    with made, pytest.raises(InputError, match=r"has 2 threads: start workers with --nthreads 1"):
        on_cluster(made.scheduler_address, write_numba_threads, calls(tmp_path), lambda *_: None)


def test_a_scheduler_that_does_not_answer_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER_S", 0.5)
    with pytest.raises(InputError, match=r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:9'"):
        on_cluster("tcp://127.0.0.1:9", write_numba_threads, calls(tmp_path), lambda *_: None)


def test_nothing_to_do_asks_no_scheduler():
    on_cluster("tcp://127.0.0.1:9", die, [], lambda *_: None)
