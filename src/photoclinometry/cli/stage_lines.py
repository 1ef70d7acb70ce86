"""One line on the terminal for each stage: its name, what it found and how good that is, and its time.

    sparse              29 of 29 views, 41,203 points, 0.31 px          12.4 s
    relighting 1        matches moved 0.12 px, normals 0.8 degrees      31.0 s

What a stage found, and that it has ended, are records of the log that carry it (`pipeline.folder.stage.say_found`,
`RunFolder.timed`). Warnings are shown as they are, and everything else is only in the log file.
"""

from __future__ import annotations

import logging

from photoclinometry.model.warning import subject

NAMES = {
    "images": "images",
    "sparse": "sparse",
    "body_sparse": "sparse",
    "pose_covariances": "pose sigmas",
    "coarse_shape": "coarse shape",
    "plan": "plan",
    "tile": "tile",
    "cameras": "shared cameras",
    "merge": "merge",
    "placement": "placement",
    "renderings": "renderings",
    "distortion": "distortion",
    "inconsistent_views": "check of views",
    "region": "region",
    "dense": "dense",
    "initialise": "first scene",
    "first_estimate": "first estimate",
    "relighting": "relighting",
    "reflectance": "reflectance",
    "doubtful_suns": "doubtful Suns",
    "suns": "suns",
    "reflectance_again": "reflectance",
    "response": "response",
    "last_estimate": "last estimate",
    "held_out": "views held out",
    "refine": "estimate",
    "model": "model",
    "products": "files",
    "report": "report",
}
"""Of stages, as people read them; an iteration's number follows."""
_NAME, _FOUND = 16, 50
"""Widths of the columns, in characters: with the time, lines fit 80 columns."""
_UNTOLD_S = 0.05
"""Stages that have nothing to report and took less are left out [s]."""


class StageLines:
    """Makes lines of the log's records."""

    def __init__(self) -> None:
        self.found: list[str] = []
        """The finding of the running stage."""
        self.warned: set[tuple[str, str]] = set()
        """Subjects of warnings that were shown."""

    def line(self, record: logging.LogRecord) -> str | None:
        """The text of a record on the terminal; None for nothing. An error ends the command, which prints it last.

        Of several warnings of one code about one view, such as those of each estimate, the first; the end of the
        command shows the latest (`model.warning.distinct`).
        """
        if record.levelno == logging.WARNING:
            about = subject(getattr(record, "code", ""), getattr(record, "view", ""), record.getMessage())
            told = about in self.warned
            self.warned.add(about)
            return None if told else record.getMessage()
        if (found := getattr(record, "found", None)) is not None:
            self.found.append(str(found))
        elif has_ended(record):
            found, self.found = ", ".join(self.found), []
            return stage_line(getattr(record, "ended", ""), found, getattr(record, "wall_s", None))
        return None


def has_ended(record: logging.LogRecord) -> bool:
    """Whether a record says that a stage has ended."""
    return hasattr(record, "ended")


def stage_line(stage: str, found: str, wall_s: float | None) -> str | None:
    """The line of a stage that has ended; wall_s None: it was read back. None for one that has nothing to report."""
    if wall_s is None:
        found, time = found or "as in the earlier run", ""
    elif not found and wall_s < _UNTOLD_S:
        return None
    else:
        time = f"{wall_s:.1f} s" if wall_s < 600 else f"{wall_s / 60:.1f} min"
    return f"{shown_name(stage):{_NAME}}{found:{_FOUND}} {time:>10}".rstrip()


def shown_name(stage: str) -> str:
    """A stage's name as people read it: relighting_2 is "relighting 2", and relighting_2_held that of a second map."""
    stage = stage.removesuffix("_held")
    kind, _, number = stage.rpartition("_")
    return f"{NAMES[kind]} {number}" if kind in NAMES and number.isdigit() else NAMES.get(stage, stage)
