"""Type hints are complete, and users' checkers find them. That they are right is checked by `make types`."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "photoclinometry"


def is_compiled(function: ast.FunctionDef) -> bool:
    """Numba types the arguments of these when it compiles them."""
    return any("njit" in ast.unparse(decorator) for decorator in function.decorator_list)


def unannotated(function: ast.FunctionDef) -> list[str]:
    """Arguments of a function without a type hint, and "return" where that is wanting."""
    given = function.args
    stars = [star for star in (given.vararg, given.kwarg) if star is not None]
    arguments = [*given.posonlyargs, *given.args, *given.kwonlyargs, *stars]
    missing = [a.arg for a in arguments if a.annotation is None and a.arg not in ("self", "cls")]
    returns_nothing = function.name in ("__init__", "__post_init__")
    return missing + (["return"] if function.returns is None and not returns_nothing else [])


def test_every_function_that_is_not_compiled_is_annotated():
    found = {}
    for file in sorted(SOURCE.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and not is_compiled(node) and unannotated(node):
                found[f"{file.relative_to(ROOT)}, line {node.lineno}: {node.name}"] = unannotated(node)
    assert found == {}


def test_the_package_says_that_it_is_typed():
    """PEP 561: checkers read the hints of an installed package only where py.typed lies in it."""
    assert (SOURCE / "py.typed").is_file()
    assert 'photoclinometry = ["py.typed", ' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_no_complaint_is_silenced_without_its_name():
    """`# pyright: ignore[rule]` names one rule; without, it would hide any."""
    for file in SOURCE.rglob("*.py"):
        assert not re.search(r"#\s*(type|pyright):\s*ignore(?!\[)", file.read_text(encoding="utf-8")), file
