"""Threads do what a loop does."""

import numba
import pytest

from photoclinometry.model.threads import in_threads


@pytest.fixture(params=[1, 3], autouse=True)
def threads(request, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: request.param)


def test_results_are_in_the_order_of_the_items():
    assert in_threads(lambda x: x * x, range(100)) == [x * x for x in range(100)]


def test_what_a_call_raises_is_raised():
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda x: 1 / x, [3, 2, 1, 0])
