"""Threads do what a loop does."""

import numba
import pytest

from photoclinometry.model.threads import RUNS, in_threads, runs


@pytest.fixture(params=[1, 3], autouse=True)
def threads(request, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: request.param)


def test_results_are_in_the_order_of_the_items():
    assert in_threads(lambda x: x * x, range(100)) == [x * x for x in range(100)]


def test_what_a_call_raises_is_raised():
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda x: 1 / x, [3, 2, 1, 0])


def test_results_are_counted_as_they_come():
    counts = []
    in_threads(lambda x: x, "abc", counts.append)
    assert counts == [1, 2, 3]


@pytest.mark.parametrize("count", [0, 1, RUNS - 1, RUNS, RUNS + 1, 1000])
def test_runs_have_each_item_once_in_order(count):
    found = runs(count)
    assert len(found) <= RUNS
    assert [i for run in found for i in range(count)[run]] == list(range(count))
