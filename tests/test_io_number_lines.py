"""Lines of numbers are read as Python reads them, or the first that is none is named."""

import numpy as np
import pytest

from photoclinometry.io.models import number_lines
from photoclinometry.io.models.number_lines import announced_count, first_not_whole, parse_numbers, read_rows
from photoclinometry.model.errors import InputError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "numbers.txt"


def rows_of(path):
    """(line, values) of every row of a file."""
    return [
        (int(line), rows.value[rows.start[i] : rows.start[i + 1]].tolist())
        for rows in read_rows(path, "with numbers")
        for i, line in enumerate(rows.line)
    ]


def test_doubles_come_back_bit_by_bit(path):
    bits = np.random.default_rng(0).integers(0, 2**64, 5000, dtype=np.uint64).view(float)
    values = bits[np.isfinite(bits)]
    text = " ".join(map(repr, values.tolist())).encode()
    assert parse_numbers(path, 1, text).tobytes() == values.tobytes()


@pytest.mark.parametrize("block", [1, 20, 1 << 24])
def test_rows_are_what_splitting_lines_gives(path, block, monkeypatch):
    monkeypatch.setattr(number_lines, "BLOCK_BYTES", block)
    path.write_bytes(b"# about\n1 2.5\t-3e-2\r\n\n  # more 7\n \n+4 .5 5.\n6\n\n")
    assert rows_of(path) == [(2, [1, 2.5, -0.03]), (6, [4, 0.5, 5]), (7, [6])]


@pytest.mark.parametrize(
    "word", ["nan", "inf", "1e999", "1-2", "1.0.5", "1_0", "0x10", "1,5", "x", "-", "1e", "\xff", "\0", "--1", "١"]
)
@pytest.mark.parametrize("block", [1, 1 << 24])
def test_what_is_no_finite_number_is_named_with_its_place(path, word, block, monkeypatch):
    monkeypatch.setattr(number_lines, "BLOCK_BYTES", block)
    path.write_bytes(b"# about\n1 2\n3 " + word.encode("latin-1" if word == "\xff" else "utf-8") + b" 5\n6\n")
    with pytest.raises(InputError, match=r"numbers\.txt, line 3: value 2 is .*, expected a finite number"):
        rows_of(path)


def test_a_file_that_ends_within_a_line_is_refused(path):
    path.write_bytes(b"1 2\n3 4")
    with pytest.raises(InputError, match=r"line 2: the file ends in the middle of this line"):
        rows_of(path)


def test_missing_empty_and_unreadable_files_are_named(path, tmp_path):
    with pytest.raises(InputError, match=r"numbers\.txt: there is no such file.*with numbers"):
        rows_of(path)
    path.touch()
    with pytest.raises(InputError, match=r"numbers\.txt: is empty"):
        rows_of(path)
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        rows_of(tmp_path)


def test_the_first_number_that_is_not_whole_is_found():
    assert first_not_whole(np.array([0.0, 7.0, 2.0**53])) is None
    assert first_not_whole(np.array([3.0, 0.5, 0.25])) == 1
    assert first_not_whole(np.array([3.0, -1.0])) == 1
    assert first_not_whole(np.array([3.0, -1.0]), lowest=-1) is None
    assert first_not_whole(np.array([2.0**53 + 2])) == 0


def test_only_comments_before_the_first_line_announce_a_count(path):
    path.write_text("# about\n# Number of points: 12, mean track length: 3\n")
    assert announced_count(path, "points") == 12
    assert announced_count(path, "images") is None
    path.write_text("1 2\n# Number of points: 12\n")
    assert announced_count(path, "points") is None
