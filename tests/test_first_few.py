"""Of many names an error tells the first few, and how many more there are."""

from photoclinometry.model.first_few import first_names, first_reasons


def test_names_beyond_the_first_few_are_counted():
    assert first_names(["a", "b", "c"], 3) == "a, b, c"
    assert first_names(["a", "b", "c", "d"], 3) == "a, b, c and 1 more"
    assert first_names([str(k) for k in range(1000)], 2) == "0, 1 and 998 more"


def test_reasons_beyond_the_first_few_are_counted():
    assert first_reasons({"a": "it is dark", "b": "it is empty"}, 2) == "a: it is dark; b: it is empty"
    assert first_reasons({"a": "it is dark", "b": "it is empty", "c": "it is far"}, 1) == "a: it is dark; and 2 more"
