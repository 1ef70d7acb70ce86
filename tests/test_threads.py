"""Threads do what a loop does."""

import numba
import pytest

from photoclinometry.model.threads import in_threads


@pytest.fixture(params=[1, 2])
def threads(request):
    if request.param > numba.config.NUMBA_NUM_THREADS:
        pytest.skip("Numba has fewer threads here")
    before = numba.get_num_threads()
    numba.set_num_threads(request.param)
    yield request.param
    numba.set_num_threads(before)


def test_results_are_in_the_order_of_the_items(threads):
    assert in_threads(lambda x: x * x, range(100)) == [x * x for x in range(100)]


def test_what_a_call_raises_is_raised(threads):
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda x: 1 / x, [3, 2, 1, 0])
