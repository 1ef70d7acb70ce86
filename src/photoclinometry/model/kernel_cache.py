"""Compiled functions on disk that notice changes in other files, and are made anew where they cannot be read.

Numba keeps a compiled function until its own file changes, although functions and constants of other files are
compiled into it. Once this module is imported, every cached function of the package is stamped with all files of the
package that its own file imports, directly or not. A change in any of these compiles it anew. A file whose functions
others call imports this module, or one that does.
"""

from __future__ import annotations

import hashlib
import pickle
import re
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import caching

PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(
    r"^\s*(?:from|import)\s+photoclinometry([\w.]*)(?:\s+import\s+(?:\(([^)]*)\)|(.*)))?", re.MULTILINE
)
_FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+.*\n|[ \t]*\n)*", re.MULTILINE)
"""Imports for type checkers alone, such as all of the package in its `__init__.py`."""


@cache
def imported(file: Path) -> frozenset[Path]:
    """Files of the package that a file of it imports names from when it runs.

    `__init__.py` of packages around these run, too, but compiled functions contain nothing of them.
    """
    found = set()
    for dotted, several, one in _IMPORT.findall(_FOR_TYPES.sub("", file.read_text(encoding="utf-8"))):
        base = PACKAGE.joinpath(*dotted.split(".")[1:])
        stems = [base, base / "__init__", *(base / name for name in re.findall(r"\w+", several + one))]
        found |= {path for stem in stems if (path := stem.with_suffix(".py")).is_file()}
    return frozenset(found)


def reached(file: Path) -> list[Path]:
    """A file of the package and all that it imports from the package, directly or not, sorted."""
    todo, known = [file], {file}
    while todo:
        new = imported(todo.pop()) - known
        known |= new
        todo += new
    return sorted(known)


@cache
def stamp(file: Path) -> str:
    """Digest of the contents of the files that `reached` finds."""
    digest = hashlib.sha256()
    for path in reached(file):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def stamped(locator: Any) -> Any:
    """A cache locator of Numba's for files of this package alone, which stamps them with `stamp`."""

    class Stamped(locator):
        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> Any:
            own = PACKAGE in Path(py_file).resolve().parents and Path(py_file).is_file()
            return super().from_function(py_func, py_file) if own else None

        def get_source_stamp(self) -> Any:
            return Stamp((super().get_source_stamp(), stamp(Path(self._py_file).resolve())))

    return Stamped


class Stamp(tuple[Any, str]):
    """Numba's stamp of a file of this package, and `stamp`."""


def loaded_index(self: Any) -> dict[Any, str]:
    """As Numba's `IndexDataCacheFile._load_index`; of this package empty, too, where it cannot be read.

    An index is read before its stamp is compared. That of an earlier version may name objects that no longer exist.
    """
    try:
        return _read(self)
    except (AttributeError, EOFError, ImportError, pickle.UnpicklingError):
        if isinstance(self._source_stamp, Stamp):
            return {}
        raise


# Numba tries its locators in turn; those of the package go first, and know no other files.
_LOCATORS, _READ = "_locator_classes", "_load_index"
"""Numba has no public way to add a locator, or to handle an index that cannot be read."""
_known = getattr(caching.CacheImpl, _LOCATORS)
setattr(caching.CacheImpl, _LOCATORS, [*map(stamped, _known), *_known])
_read = getattr(caching.IndexDataCacheFile, _READ)
setattr(caching.IndexDataCacheFile, _READ, loaded_index)
