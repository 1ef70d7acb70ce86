"""PVL labels: values as written by hand, real labels as another parser reads them, and damage named."""

import re
import time

import numpy as np
import pytest

from archives import FORMATS, SPICE, needs_formats
from photoclinometry.io.archives.pvl import Quantity, number, parse_pvl, whole
from photoclinometry.model.errors import InputError

LABEL = b"""/* a comment = nothing */
PDS_VERSION_ID = PDS3
EXPOSURE = 89.00 <ms>   # said twice
TEXT = "two
        lines"
EMPTY = ()
PATH = $base/kernels/hayabusa_itokawarendezvo-
        us_v02n.bc
POSITIONS = (1, -2.5e3, (3, "x"), 4 <km>)
MISSION:DATE = 2015-170T16:15:46.345
OBJECT = IMAGE
  Group = Deep
    LINES = 244
  End_Group
END_OBJECT = IMAGE
END
LINES = 7 \xff\xfe
"""


def test_values_are_what_is_written():
    label = parse_pvl(LABEL, "a.lbl")
    assert label.get("PDS_VERSION_ID") == "PDS3"
    assert label.get("EXPOSURE") == Quantity(89.0, "ms")
    assert label.get("TEXT") == "two lines"
    assert label.get("EMPTY") == ()
    assert label.get("PATH") == "$base/kernels/hayabusa_itokawarendezvous_v02n.bc"
    assert label.get("POSITIONS") == (1, -2500.0, (3, "x"), Quantity(4.0, "km"))
    assert label.get("MISSION:DATE") == "2015-170T16:15:46.345"
    assert label.block("IMAGE", "DEEP").get("LINES") == 244
    assert label.find("LINES") == 244


def test_a_clock_keeps_its_digits():
    """Ticks are counted after the point: 1.830 is 830 of them, and 1.83 would be 83."""
    assert parse_pvl(b"CLOCK = 126865998.830\nEND\n", "a").get("CLOCK").text == "126865998.830"


def test_what_follows_the_end_is_not_looked_at():
    assert parse_pvl(b"A = 1\nEND\n\x00\xff(((", "a").get("A") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"A = 1\nB 2\nEND\n", "2: after 'B' there is no '='"),
        (b"A = = 1\nEND", "expected a value"),
        (b"OBJECT = IMAGE\nA = 1\nEND\n", "IMAGE is not ended"),
        (b"END_OBJECT = IMAGE\nEND\n", "END_OBJECT without a beginning"),
        (b'A = "open\nEND\n', "is not understood"),
        (b"A = (1, 2\nEND\n", "a list is not closed"),
        (b"A = " + b"(" * 1000, "nested more than"),
        (b"OBJECT = A\n" * 100, "nested more than"),
        (b"A = b\xe9b\nEND\n", "not ASCII"),
        (b"A = 1\n" * 200_000, "no END in its first"),
    ],
)
def test_damage_is_named_with_its_line(text, message):
    with pytest.raises(InputError, match=rf"bad\.lbl: the label is damaged, line \d*.*({message})"):
        parse_pvl(text, "bad.lbl")


@pytest.mark.parametrize("junk", [b"A = B\n", b"A = a-\n", b"/*", b"'", b"A=(", b"OBJECT=X\n", b"<<", b"9" * 100])
def test_the_longest_label_takes_seconds_whatever_is_in_it(junk):
    """Time grows with length, not with its square."""
    data = junk * (1_100_000 // len(junk))
    begin = time.process_time()
    with pytest.raises(InputError):
        parse_pvl(data, "long.lbl")
    assert time.process_time() - begin < 10.0


def test_numbers_are_asked_for_by_name():
    block = parse_pvl(b"A = 2.5\nB = x\nC = 3 <px>\nD = -1\nEND\n", "a")
    assert number("a", block, "A") == 2.5
    assert whole("a", block, "C") == 3
    assert whole("a", block, "E", 4) == 4
    for key, found in (("A", "2.5"), ("B", "'x'"), ("D", "-1"), ("E", "None")):
        with pytest.raises(InputError, match=rf"a: the label's {key} is .*{found}"):
            whole("a", block, key)


def real_labels():
    patterns = ("*/*.cub", "*/*.lbl", "near/*/*.lbl", "pds3/nac*.img", "pds3/h*.img")
    formats = [p for pattern in patterns for p in sorted(FORMATS.glob(pattern))]
    return formats + sorted(SPICE.glob("*/*.lbl"))


@pytest.mark.data
@needs_formats
@pytest.mark.parametrize("path", real_labels(), ids=lambda p: p.name)
def test_real_labels_are_read_as_another_parser_reads_them(path):
    pvl = pytest.importorskip("pvl", reason="the second opinion, pvl, is not installed")
    data = path.read_bytes()
    end = re.search(rb"(?im)^\s*END\s*[\r\n\0]", data + b"\n").end()
    same_as(parse_pvl(data, str(path)), pvl.loads(data[:end]))


def same_as(block, other):
    statements, blocks = list(block.statements), list(block.blocks)
    for key, value in other.items():
        if hasattr(value, "items"):
            inner = blocks.pop(0)
            assert inner.name == str(key).upper()
            same_as(inner, value)
            continue
        name, ours = statements.pop(0)
        assert name == key.upper()
        theirs, ours = getattr(value, "value", value), getattr(ours, "value", ours)
        if isinstance(theirs, int | float) and not isinstance(theirs, bool):
            np.testing.assert_allclose(ours, theirs, rtol=1e-15)
        elif isinstance(theirs, list):
            assert len(ours) == len(theirs)
        elif isinstance(theirs, str):
            assert re.sub(r"\s", "", str(ours)) == re.sub(r"\s", "", theirs)
    assert not statements
    assert not blocks
