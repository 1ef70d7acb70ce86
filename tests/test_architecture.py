"""The order of packages in DESIGN.md, imports that keep it, and tests that stand by themselves."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "photoclinometry"
TESTS = ROOT / "tests"


def stated_order() -> list[str]:
    """The packages in the order of DESIGN.md's table."""
    layout = (ROOT / "DESIGN.md").read_text(encoding="utf-8").split("## Layout\n")[1].split("\n## ")[0]
    return re.findall(r"^\| `(\w+)` \|", layout, flags=re.MULTILINE)


def imported_modules(file: Path) -> set[str]:
    """Modules that a file imports, anywhere in it, by their full names."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def imported_packages(file: Path) -> set[str]:
    """Packages of photoclinometry that a file imports, anywhere in it."""
    return {name.split(".")[1] for name in imported_modules(file) if name.startswith("photoclinometry.")}


def test_the_table_lists_every_package():
    packages = {folder.name for folder in SOURCE.iterdir() if (folder / "__init__.py").is_file()}
    assert packages == set(stated_order())


@pytest.mark.parametrize("package", stated_order())
def test_imports_point_up_the_table(package):
    order = stated_order()
    allowed = set(order[: order.index(package) + 1])
    for file in (SOURCE / package).rglob("*.py"):
        assert imported_packages(file) <= allowed, file


def test_what_stages_call_imports_no_stage():
    """The run folder, the frames and the checks of maps are below the stages that use them."""
    for room in ("folder", "frame", "checks"):
        for file in (SOURCE / "pipeline" / room).glob("*.py"):
            own = {name for name in imported_modules(file) if name.startswith("photoclinometry.pipeline.")}
            assert {name.split(".")[2] for name in own} <= {"folder", room}, file


def test_only_comparisons_import_the_rivals():
    """What makes maps does not depend on methods that it is compared with."""
    users = {file.relative_to(SOURCE) for file in SOURCE.rglob("*.py") if "rivals" in imported_packages(file)}
    assert {path for path in users if path.parts[0] != "rivals"} == {
        Path("cli/rivals.py"),
        Path("study/figures.py"),
        Path("study/plan.py"),
        Path("study/summary.py"),
        Path("study/work.py"),
        Path("__init__.py"),
    }


def test_tests_are_not_imported():
    """What several tests need is in a module of its own, whose name says what it is."""
    for file in TESTS.glob("*.py"):
        assert not [name for name in imported_modules(file) if name.startswith("test_")], file
