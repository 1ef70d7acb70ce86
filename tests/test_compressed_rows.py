"""Compressed rows: counts, starts and the row of each entry."""

import numpy as np

from photoclinometry.model.compressed_rows import row_of_entry, row_starts


def test_starts_are_the_running_sum_of_counts():
    np.testing.assert_array_equal(row_starts(np.array([2, 0, 3])), [0, 2, 2, 5])


def test_each_entry_belongs_to_the_row_between_whose_starts_it_lies():
    np.testing.assert_array_equal(row_of_entry(np.array([0, 2, 2, 5])), [0, 0, 2, 2, 2])


def test_no_rows_have_no_entries():
    start = row_starts(np.array([], int))
    assert start.tolist() == [0]
    assert row_of_entry(start).size == 0
