"""Tables of 80 columns: numbers without exponents, and long names without what all of them have in common."""

import re

import pytest

from commands import phomo
from photoclinometry.cli.columns import plain_number, rows_as_text, short_names
from photoclinometry.io.site import read_site
from sites import HEADER, view_text, write_small_site

OCAMS = [f"images/2019030{k}T101500S123_map_iofL2pan_V001.fits" for k in range(4)]


@pytest.mark.parametrize(
    ("value", "text"),
    [(7784.2, "7784"), (45.51, "45.5"), (0.475, "0.475"), (0.008064, "0.00806"), (0, "0"), (-9.996, "-10.00")],
)
def test_numbers_have_three_digits_and_no_exponent(value, text):
    assert plain_number(value) == text
    assert "e" not in plain_number(1e-9) + plain_number(1e12)


def test_long_names_lose_what_all_have_in_common():
    short, pattern = short_names(OCAMS, 20)
    assert short == [f"2019030{k}T101500S123" for k in range(4)]
    assert pattern == "images/*_map_iofL2pan_V001.fits"
    assert [pattern.replace("*", name) for name in short] == OCAMS
    for names in (["a.fits", "b.fits"], OCAMS[:1], ["x" * 30, "x" * 31], ["a_" * 20, "a_" * 20 + "b"]):
        shown, left_out = short_names(names, 20)
        assert [left_out.replace("*", name) if left_out else name for name in shown] == names


def test_columns_are_apart():
    lines = rows_as_text(("image", "m/px", "km"), [("* a", "44.9", "7784"), ("  b", "0.00806", "3")])
    assert lines == ["image     m/px    km", "* a       44.9  7784", "  b    0.00806     3"]
    wide = rows_as_text(("x" * 60, "y" * 9, "z" * 9), [("a", "b", "c")])
    assert {len(line) for line in wide} == {80}


def test_a_table_of_long_names_has_one_line_a_view_and_fits(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    path = write_small_site(tmp_path)
    text = HEADER.replace("images/1.fits", OCAMS[1])
    for k, name in enumerate(OCAMS):
        (tmp_path / f"images/{k}.fits").rename(tmp_path / name)
        text += view_text(k).replace(f"images/{k}.fits", name) + f"sun_sigma_deg = 0.{k + 1}\n"
    path.write_text(text)
    assert len(read_site(path).views) == 4
    (tmp_path / OCAMS[2]).unlink()
    assert phomo("info", path) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    rows = [line.split() for line in lines if re.match(r" *2019030", line)]
    assert [row[0] for row in rows] == [f"2019030{k}T101500S123" for k in range(4)]
    assert [row[-1] for row in rows] == ["found", "found", "missing", "found"]
    assert "size 64 x 64 px" in " ".join(lines).replace("\u00a0", " ")
