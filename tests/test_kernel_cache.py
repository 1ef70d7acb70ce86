"""Compiled functions on disk are made anew when a file that they were compiled with changes."""

import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from photoclinometry.model import kernel_cache
from photoclinometry.model.kernel_cache import PACKAGE, imported, reached

COMPILED = sorted(path for path in PACKAGE.rglob("*.py") if "@njit" in path.read_text(encoding="utf-8"))


def test_imports_of_every_form_are_found(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_cache, "PACKAGE", tmp_path)
    for package in ("b", "g"):
        (tmp_path / package).mkdir()
    files = dict.fromkeys(
        ("a.py", "c.py", "types.py", "b/__init__.py", "b/d.py", "b/e.py", "g/__init__.py", "g/h.py"), ""
    )
    user = (
        "from photoclinometry.a import x\nfrom photoclinometry.b import (\n    d,\n    y,\n)\n"
        "if TYPE_CHECKING:\n    from photoclinometry.types import z\n\n    from photoclinometry.b.e import w\n\n"
        "def f():\n    import photoclinometry.c\n    from photoclinometry.g.h import v\n"
    )
    for name, text in {**files, "user.py": user}.items():
        (tmp_path / name).write_text(text)
    found = {str(path.relative_to(tmp_path)) for path in imported(tmp_path / "user.py")}
    assert found == {"a.py", "c.py", "b/__init__.py", "b/d.py", "g/h.py"}


@pytest.mark.parametrize("file", COMPILED, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_file_that_compiles_functions_of_others_is_stamped_with_them(file):
    """By an import of its own, or of a package around it or around what it imports, which runs before."""
    others = set(reached(file))
    if others & set(COMPILED) != {file}:
        around = {folder / "__init__.py" for each in others for folder in each.parents if PACKAGE in folder.parents}
        run = others.union(*map(reached, around))
        assert PACKAGE / "model" / "kernel_cache.py" in run, "import photoclinometry.model.kernel_cache there"


@pytest.mark.parametrize("file", COMPILED, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_change_of_the_public_interface_compiles_nothing_anew(file):
    assert not {PACKAGE / "api" / "maps.py", PACKAGE / "pipeline" / "run.py"} & set(reached(file))


def test_a_change_of_the_solver_or_of_an_option_does_not_compile_the_kernels_anew():
    kernels = set(reached(PACKAGE / "adjust" / "graph" / "kernels.py"))
    assert PACKAGE / "adjust" / "graph" / "rows.py" in kernels
    assert not {PACKAGE / "adjust" / name for name in ("estimate.py", "options.py", "noise.py")} & kernels


PROGRAM = """
import importlib, sys
sys.path.insert(0, sys.argv[1])
import photoclinometry.outer as outer
print(outer.doubled(1.0), sum(outer.doubled.stats.cache_hits.values()))
"""


def said(folder, factor: float) -> str:
    """Writes the other file with a factor and runs both: the outcome for 1, and how often it came from the cache."""
    inner = (
        "import photoclinometry.model.kernel_cache\nfrom numba import njit\n\n"
        f"@njit(cache=True)\ndef f(x):\n    return {factor} * x\n"
    )
    (folder / "photoclinometry" / "inner.py").write_text(inner)
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(folder)], capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The folder of a package whose `doubled` calls a kernel of another file; both are in the cache."""
    folder = tmp_path_factory.mktemp("compiled")
    package = folder / "photoclinometry"
    (package / "model").mkdir(parents=True)
    own = Path(kernel_cache.__file__).read_text(encoding="utf-8")
    (package / "__init__.py").write_text("")
    (package / "model" / "__init__.py").write_text("")
    (package / "model" / "kernel_cache.py").write_text(own)
    outer = (
        "from numba import njit\nfrom photoclinometry.inner import f\n\n"
        "@njit(cache=True)\ndef doubled(x):\n    return 2.0 * f(x)\n"
    )
    (package / "outer.py").write_text(outer)
    assert said(folder, 1.0) == "2.0 0"
    return folder


@pytest.fixture
def package(compiled, tmp_path):
    """A copy of that folder, with its cache."""
    return shutil.copytree(compiled, tmp_path / "package")


@pytest.mark.slow
def test_a_change_in_another_file_compiles_its_callers_anew(package):
    """2 x 1 from the cache, then 2 x 10."""
    assert [said(package, 1.0), said(package, 10.0)] == ["2.0 1", "20.0 0"]


@pytest.mark.slow
@pytest.mark.parametrize("content", [b"cphotoclinometry.outer\nGone\n.", b"cphotoclinometry.gone\nx\n.", b""])
def test_a_cache_that_names_what_the_package_has_no_more_is_made_anew(package, content):
    """Numba reads it before it looks whether it is stale."""
    (index,) = (package / "photoclinometry" / "__pycache__").glob("outer.doubled*.nbi")
    index.write_bytes(pickle.dumps(numba.__version__) + content)
    assert [said(package, 1.0), said(package, 1.0)] == ["2.0 0", "2.0 1"]
