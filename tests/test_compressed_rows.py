"""Compressed rows: counts, starts and the row of each entry."""

import numpy as np

from photoclinometry.model.compressed_rows import row_of_entry, row_starts
from photoclinometry.model.row_medians import row_medians


def test_starts_are_the_running_sum_of_counts():
    np.testing.assert_array_equal(row_starts(np.array([2, 0, 3])), [0, 2, 2, 5])


def test_each_entry_belongs_to_the_row_between_whose_starts_it_lies():
    np.testing.assert_array_equal(row_of_entry(np.array([0, 2, 2, 5])), [0, 0, 2, 2, 2])


def test_no_rows_have_no_entries():
    start = row_starts(np.array([], int))
    assert start.tolist() == [0]
    assert row_of_entry(start).size == 0


def test_medians_are_of_rows_and_the_upper_one_of_two():
    value = np.array([3.0, 1.0, 2.0, 7.0, 5.0])
    np.testing.assert_array_equal(row_medians(value, np.array([0, 3, 3, 5])), [2.0, np.nan, 7.0])
