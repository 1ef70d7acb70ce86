"""The process that reads whole HDF5 files before this package does: each line is a path in JSON, answered by the fault.

The HDF5 library does not check what it reads: a damaged file can crash it, make it loop for ever, or ask for any amount
of memory. `io/hdf5.py` therefore runs this file as a script in a separate process, which limits its time and memory. It
imports h5py and nothing of this package.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
from collections.abc import Iterator
from typing import Any

# Set before HDF5 is loaded: a filter that a file asks for is never looked for among shared libraries.
os.environ["HDF5_PLUGIN_PRELOAD"] = "::"

import h5py

_FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32"}
"""HDF5's numbers of the filters that this package writes."""
_BEST_RATIO = 1032
"""gzip makes data smaller by this factor at most."""
_SMALL_BYTES = 1 << 24
"""Arrays that need not be in the file, since HDF5 fills them (16 MiB)."""
_MAX_DEPTH = 4
"""Nested groups; the files of this package have two, and recursion must end."""
_CPU_S, _BYTES_PER_S = 3, 20_000_000
"""CPU time for any file [s], and rate at which a large one is read at least."""
_MEMORY_BYTES = 1 << 30
"""Memory for any file (1 GiB), in addition to that of its arrays."""


def limit_resources(size: int) -> None:
    """Limits of CPU time and memory for the next file, of `size` bytes, where the system has them."""
    with contextlib.suppress(ImportError):
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        seconds = int(used.ru_utime + used.ru_stime) + _CPU_S + size // _BYTES_PER_S
        memory = _MEMORY_BYTES + _SMALL_BYTES + 4 * _BEST_RATIO * size
        for kind, limit in ((resource.RLIMIT_CPU, seconds), (resource.RLIMIT_AS, memory), (resource.RLIMIT_CORE, 0)):
            highest = resource.getrlimit(kind)[1]
            if highest in (resource.RLIM_INFINITY, -1) or limit < highest:
                resource.setrlimit(kind, (limit, highest))


def fault_of(path: str) -> str:
    """The fault of a file; empty for one whose groups, attributes and arrays can all be read."""
    try:
        limit_resources(os.path.getsize(path))
        with h5py.File(path, "r") as file:
            return _fault(file, os.path.getsize(path))
    # A damaged file makes h5py raise nearly every built-in exception.
    except Exception as error:
        return _in_plain_words(f"{type(error).__name__}: {error}".splitlines()[0])


def _in_plain_words(error: str) -> str:
    """HDF5's words for a file that is another one, or not complete, in words of the file; others as they are."""
    if "file signature not found" in error:
        return "it is no HDF5 file"
    cut = re.search(r"truncated file: eof = (\d+), .*stored_eof = (\d+)", error)
    return f"it ends after {cut[1]} of {cut[2]} bytes" if cut else error


def _fault(file: Any, size: int) -> str:
    found, held = list(_walk(file, "")), 0
    for name, item in found:
        for attribute in item.attrs:
            item.attrs[attribute]
        if not isinstance(item, h5py.Dataset):
            continue
        wrong = _fault_of_dataset(item)
        if wrong:
            return f"{name} {wrong}"
        held += item.size * item.dtype.itemsize if item.size else 0
        if held > _SMALL_BYTES + _BEST_RATIO * size:
            return f"{name} is of {item.shape} values, which its {size} bytes cannot hold"
    for _, item in found:
        if isinstance(item, h5py.Dataset):
            item[()]
    return ""


def _walk(group: Any, where: str) -> Iterator[tuple[str, Any]]:
    """The group and all below it. Raises ValueError for links to elsewhere, and for groups within themselves."""
    yield where or "/", group
    if where.count("/") > _MAX_DEPTH:
        raise ValueError(f"groups are nested too deeply ({where})")
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise ValueError(f"{where}/{name} is a link to elsewhere")
        item = group[name]
        if isinstance(item, h5py.Group):
            yield from _walk(item, f"{where}/{name}")
        else:
            yield f"{where}/{name}", item


def _fault_of_dataset(dataset: h5py.Dataset) -> str:
    plist = dataset.id.get_create_plist()
    filters = [plist.get_filter(n)[0] for n in range(plist.get_nfilters())]
    if dataset.external or dataset.is_virtual:
        return "has its values in another file"
    if any(number not in _FILTERS for number in filters):
        return f"needs the filters {filters}, known are {_FILTERS}"
    if dataset.dtype.kind == "O" and not h5py.check_string_dtype(dataset.dtype):
        return "holds objects"
    return "" if dataset.dtype.kind in "biufSO" else f"holds values of type {dataset.dtype}"


if __name__ == "__main__":
    for line in sys.stdin:
        sys.stdout.write(json.dumps(fault_of(json.loads(line))) + "\n")
        sys.stdout.flush()
