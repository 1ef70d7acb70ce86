"""Arcs of attitude and orbit by the times of images."""

from datetime import datetime, timedelta

from photoclinometry.ingest.arcs import ARC_GAP, arcs_of


def test_a_gap_of_more_than_a_day_and_another_camera_begin_an_arc():
    """Images in any order; those without a time have none."""
    first = datetime(2015, 6, 17, 22)
    taken = [
        ("fc2, SPICE", first),
        ("fc2, SPICE", first + 2.5 * ARC_GAP),
        ("fc2, SPICE", first + ARC_GAP),
        ("fc1, SPICE", first),
        ("fc2, SPICE", None),
        ("fc2, SPICE", first + 2.5 * ARC_GAP + timedelta(hours=23)),
    ]
    late = "fc2, SPICE, 2015-06-20"
    expected = ["fc2, SPICE, 2015-06-17", late, "fc2, SPICE, 2015-06-17", "fc1, SPICE, 2015-06-17", None, late]
    assert arcs_of(*zip(*taken, strict=True)) == expected
    assert arcs_of(["a", "a", "a"], [first, None, first + ARC_GAP]) == [None, None, None], "one arc needs no name"
    assert arcs_of([], []) == []
