"""The benchmark of tuned numbers: which literals it finds, and what it changes."""

import ast

import pytest

from sensitivity import ROOT, Number, changed_source, table, tuned_numbers

PACKAGE = ROOT / "src" / "photoclinometry"


@pytest.fixture(scope="module")
def numbers():
    return list(tuned_numbers(PACKAGE))


def test_named_constants_options_and_unnamed_numbers_are_found(numbers):
    found = {(n.file, n.name): n for n in numbers}
    assert found["adjust/groups.py", "DIRECT_SIGMA_PX"].text == "25.0"
    assert found["adjust/options.py", "smooth_neighbours"].text == "4"
    assert ("adjust/graph/kernels.py", "STORED") not in found
    assert len({n.key for n in numbers}) == len(numbers)


def test_one_literal_changes_and_nothing_else(numbers):
    number = next(n for n in numbers if n.name == "DIRECT_SIGMA_PX")
    text = (PACKAGE / number.file).read_text(encoding="utf-8")
    half = changed_source(text, number, 0.5)
    assert "DIRECT_SIGMA_PX = 12.5" in half
    assert half.replace("DIRECT_SIGMA_PX = 12.5", "DIRECT_SIGMA_PX = 25.0") == text
    for each in numbers:
        ast.parse(changed_source((PACKAGE / each.file).read_text(encoding="utf-8"), each, 2.0))


def test_integers_stay_integers_and_positive():
    number = Number("a.py", 1, 4, "1", "N", True)
    assert changed_source("N = 1", number, 0.5) == "N = 1"
    assert changed_source("N = 1", number, 2.0) == "N = 2"
    with pytest.raises(ValueError, match="expected '1'"):
        changed_source("N = 2", number, 2.0)


def test_the_table_has_the_largest_change_over_sites_and_directions():
    def result(key, factor, surface):
        figures = None if surface is None else dict(surface=surface, normals=1.0, rotations=1.0, completeness=99.0)
        number = {"file": "a.py", "line": 3, "name": key, "text": "2.0"}
        return {"key": key, "factor": factor, "site": "moderate", "figures": figures, "number": number}

    results = [result("base", 1.0, 0.1), result("A", 0.5, 0.12), result("A", 2.0, 0.07), result("B", 2.0, None)]
    rows = table(results).split("\n")[2:]
    assert rows[0].startswith("| a.py:3 B |")
    assert rows[0].endswith("| yes |")
    assert rows[1] == "| a.py:3 A | 2.0 | 30.0 | 0.0 | 0.0 | 0.0 |  |"
