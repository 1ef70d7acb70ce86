"""Files that cannot be used: each image once, and one sentence for all files with the same cause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from photoclinometry.io.archives.archive import label_beside
from photoclinometry.io.spice import TimeNotCoveredError
from photoclinometry.model.errors import InputError
from photoclinometry.model.first_few import first_names

_CAUSES = 20
"""Causes that an error names; the others are counted."""
_FILES = 4
"""Files that a cause names; the others are counted."""


@dataclass(frozen=True)
class Refusal:
    """Why one file cannot be used."""

    path: Path
    cause: str
    """Without the file; a time that kernels do not cover is left out."""
    time: str = ""
    """That time, in words that sort like times; empty for other causes."""
    named: bool = True
    """Whether the cause is one of the file; False for options and other files, which name themselves."""

    @classmethod
    def of(cls, path: Path, error: InputError) -> Refusal:
        """Grouped by the exceptions of reading."""
        cause, time = str(error), ""
        own = next((p for p in (path, label_beside(path)) if cause.startswith(f"{p}: ")), None)
        cause = cause.removeprefix(f"{own}: ")
        for each in _chain(error):
            if isinstance(each, TimeNotCoveredError):
                time = each.time
        return cls(path, cause.replace(each_time(time), _TIMES) if time else cause, time, own is not None)

    @property
    def image(self) -> Path:
        """The file that represents the image: the label of its name beside it, or the file itself."""
        return label_beside(self.path) or self.path


_TIMES = "\0"
"""In the place of a time, in causes."""


def each_time(first: str, last: str | None = None) -> str:
    """The beginning of the sentence about a time, or about several, that kernels do not cover."""
    return f"the times {first} to {last} are" if last and last != first else f"the time {first} is"


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__


def counted(paths: Sequence[Path]) -> int:
    """Number of images among files: a label and its image count once."""
    return len({(label_beside(path) or path).resolve() for path in paths})


def distinct(refused: Sequence[Refusal]) -> list[Refusal]:
    """Each image and cause once."""
    return list({(each.image.resolve(), each.cause): each for each in reversed(refused)}.values())[::-1]


def sentences(refused: Sequence[Refusal]) -> list[str]:
    """One sentence for each cause, with its files."""
    by_cause: dict[str, list[Refusal]] = {}
    for each in distinct(refused):
        by_cause.setdefault(each.cause, []).append(each)
    return [_sentence(cause, group) for cause, group in by_cause.items()]


def _sentence(cause: str, group: Sequence[Refusal]) -> str:
    if not group[0].named:
        return cause
    files = first_names([str(each.path) for each in group], _FILES)
    times = sorted(each.time for each in group)
    return f"{files}: {cause.replace(_TIMES, each_time(times[0], times[-1]))}"


def message(refused: Sequence[Refusal], count: int) -> str:
    """The error for files of `count` images, of which these are refused."""
    found = sentences(refused)
    if count == 1 and len(found) == 1:
        return found[0]
    shown = "\n  ".join(found[:_CAUSES])
    more = f"\n  and {len(found) - _CAUSES} more reasons" if len(found) > _CAUSES else ""
    images = len({each.image.resolve() for each in refused})
    return f"{images} of {count} files cannot be used (--keep-going leaves them out):\n  {shown}{more}"
