"""The benchmark of tuned numbers: which literals it finds, and what it changes."""

import ast

import pytest

from sensitivity_results import Results, described, table
from tuned_numbers import SOURCE, Number, changed_source, groups_of, is_compiled, tuned_numbers


@pytest.fixture(scope="module")
def numbers():
    return list(tuned_numbers(SOURCE))


def test_named_constants_options_and_unnamed_numbers_are_found(numbers):
    found = {(n.file, n.name): n for n in numbers}
    assert found["adjust/groups.py", "DIRECT_SIGMA_PX"].text == "25.0"
    assert found["adjust/options.py", "smooth_neighbours"].text == "4"
    assert ("adjust/graph/kernels.py", "STORED") not in found
    assert len({n.key for n in numbers}) == len(numbers)


def test_one_literal_changes_and_nothing_else(numbers):
    number = next(n for n in numbers if n.name == "DIRECT_SIGMA_PX")
    text = (SOURCE / number.file).read_text(encoding="utf-8")
    half = changed_source(text, [number], 0.5)
    assert "DIRECT_SIGMA_PX = 12.5" in half
    assert half.replace("DIRECT_SIGMA_PX = 12.5", "DIRECT_SIGMA_PX = 25.0") == text
    for each in numbers:
        ast.parse(changed_source((SOURCE / each.file).read_text(encoding="utf-8"), [each], 2.0))


def test_integers_stay_integers_and_positive():
    number = Number("a.py", 1, 4, "1", "N", True)
    assert changed_source("N = 1", [number], 0.5) == "N = 1"
    assert changed_source("N = 1", [number], 2.0) == "N = 2"
    with pytest.raises(ValueError, match="expected '1'"):
        changed_source("N = 2", [number], 2.0)


def test_of_shares_near_one_the_rest_is_changed():
    share = Number("a.py", 1, 4, "0.98", "N", True)
    for factor, rest in ((2.0, 0.01), (0.5, 0.04)):
        changed = changed_source("N = 0.98", [share], factor)
        assert 1.0 - ast.literal_eval(changed.removeprefix("N = ")) == pytest.approx(rest)


def test_numbers_of_one_line_change_together():
    numbers = [Number("a.py", 1, 7, "1.5", "A, B", True), Number("a.py", 1, 12, "70.0", "A, B", True)]
    assert changed_source("A, B = 1.5, 70.0", numbers, 2.0) == "A, B = 3.0, 140.0"


def test_groups_are_of_one_file():
    numbers = [Number(file, line, 0, "1.0", "N", True) for file in ("a.py", "b.py") for line in (1, 2, 3)]
    assert [[n.key for n in group] for group in groups_of(numbers, 2)] == [
        ["a.py:1:0", "a.py:2:0"],
        ["a.py:3:0"],
        ["b.py:1:0", "b.py:2:0"],
        ["b.py:3:0"],
    ]


def test_the_table_has_the_largest_change_over_sites_and_directions(tmp_path):
    def figures(surface):
        return dict(surface=surface, normals=1.0, rotations=1.0, completeness=99.0)

    first, second, third, fourth = (Number("a.py", k, 4, f"{k}.5", f"N{k}", True) for k in (1, 2, 3, 4))
    results = Results(tmp_path / "results.jsonl", {})
    results.add("base", 1.0, "moderate", figures(0.1))
    results.add("chance", 0.0, "moderate", figures(0.104))
    results.add("chance", 1.0, "moderate", figures(0.096))
    results.add("a.py:1:4 a.py:2:4", 0.5, "moderate", figures(0.1))
    results.add("a.py:1:4 a.py:2:4", 2.0, "moderate", figures(0.13))
    results.add("a.py:2:4", 0.5, "moderate", figures(0.12))
    results.add("a.py:2:4", 2.0, "moderate", figures(0.09))
    results.add("a.py:3:4", 2.0, "moderate", None)
    assert results.counts("moderate") == pytest.approx(dict(surface=12.0, normals=1.0, rotations=1.0, completeness=1.0))
    rows = table(Results.read(results.file), [[first, second], [third], [fourth]]).split("\n")[2:-1]
    assert rows == [
        "| a.py | N3 3.5 | no map | no map | no map | no map | - |",
        "| a.py | N1 1.5 | 30.0 | 0.0 | 0.0 | 0.0 | 2.5 |",
        "| a.py | N2 2.5 | 20.0 | 0.0 | 0.0 | 0.0 | 1.7 |",
    ]


def test_numbers_that_were_only_changed_together_share_a_row():
    pair = [Number("a.py", 1, 7, "1.5", "A, B", True), Number("a.py", 1, 12, "70.0", "A, B", True)]
    assert described([*pair, Number("a.py", 2, 4, "3", "C", True)]) == "A, B 1.5 and 70.0, C 3"


def test_what_compiled_functions_hold_is_compiled_anew(tmp_path):
    for name, text in (
        ("a.py", "LIMIT = 0.5\nOTHER = 0.7\n"),
        ("b.py", "@njit\ndef f(x):\n    return LIMIT * x + 0.3\n"),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
    limit, other = (
        Number("a.py", k, 8, text, name, True) for k, text, name in ((1, "0.5", "LIMIT"), (2, "0.7", "OTHER"))
    )
    inside = Number("b.py", 3, 23, "0.3", "f()", False)
    assert is_compiled(tmp_path, [limit])
    assert is_compiled(tmp_path, [other, inside])
    assert not is_compiled(tmp_path, [other])
