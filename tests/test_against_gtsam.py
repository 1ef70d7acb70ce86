"""Minimum and sigmas against GTSAM, where it is installed. `benchmarks/against_gtsam.py` does it at full size."""

import pytest

pytest.importorskip("gtsam", reason="GTSAM is not installed: pip install gtsam")


def test_the_minimum_and_the_sigmas_are_those_of_gtsam():
    """Its own Pose3 and Unit3, our residuals: cost to 1e-6, variables to 1e-4 of their sigmas, sigmas to 1 %."""
    from against_gtsam import compare

    found = compare(6, 8, from_start=False)
    assert found["cost difference, relative"] < 1e-6
    assert found["variables apart at most [their sigma]"] < 1e-4
    assert found["sigmas apart at most, relative"] < 1e-2
