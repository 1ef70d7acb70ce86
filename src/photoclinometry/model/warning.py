"""Warnings of the library: logged, and collected as values, so that the result of a run can name them all.

Every warning goes through `warn`, which asks for a code. Collecting does not depend on how logging is set up.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass

CODES: Mapping[str, str] = {
    "altimetry-contradicts": "shots of a laser altimeter do not lie on the map, within what is known of their track",
    "altimetry-tracks": "most tracks of a laser altimeter have a single shot",
    "altimetry-unused": "no shot of the laser altimeter lies over the map",
    "body-unknown": "a body of which nothing is known here is left out of a site that was made of archive files",
    "brightness-impossible": "the brightness of a view cannot be that of sunlit ground, and the view is left out",
    "camera-distorted": "the images of a camera have distortion that the site does not state",
    "control-contradicts": "a ground control point is far from the estimate",
    "control-too-few": "the ground control points do not determine the frame",
    "dark-level-unknown": "nothing shows the dark level of uncalibrated images, which may be half of their brightness",
    "distortion-unused": "keywords state a distortion that is not one for the image, and the table of cameras is used",
    "few-views": "a site that was made of archive files has too few views to be mapped",
    "file-damaged": "a file of an earlier run was damaged, and what it held is made again",
    "ground-overlaps": "part of a surface given to the simulator lies under other parts",
    "held-out-unseen": "a held-out view shows too little of the map to be measured",
    "image-compressed": "images went through JPEG, which takes fine shading",
    "most-suns-contradict": "the Sun directions as a whole contradict the brightness of the images",
    "no-uncertainty": "no uncertainties could be computed",
    "noise-unknown": "too few views light the landmarks to determine the noise of brightness",
    "product-left-out": "a product of an export needs a package that is not installed",
    "photometry-held": "Suns, biases and reflectance are not estimated, since relief would contradict parallax",
    "prior-contradicts": "a pose prior is left out, or far off",
    "priors-too-few": "the pose priors do not determine the frame",
    "relief-by-shading": "brightness shows the relief of the keypoints with hills for hollows: Suns or poses are wrong",
    "relief-contradicts": "the relief of the map is not that which the parallax of the images shows",
    "relief-inverted": "brightness shows the sparse model's relief with hills for hollows: Suns or poses are wrong",
    "renderings-differ": "renderings of the map differ from the images by more than noise and models explain",
    "response-not-linear": "the numbers of the images are a power of the radiance, and heights and albedos are wrong",
    "reversal-undecided": "rays are so nearly parallel that the relief may be reversed",
    "rival-failed": "a method that a run is compared with finds no map, or one that lies elsewhere",
    "run-failed": "a run of a study gave no map",
    "sumfile-missing": "images that were made into a site have no SUMFILE, though SUMFILEs given describe no image",
    "suns-moved": "brightness has all Suns alike, or one by itself, far beyond what is stated of them",
    "sun-undecided": "Sun directions contradict each other, and it is not clear which are wrong",
    "tile-failed": "a tile of a body is not mapped, and its ground is guessed or mapped by other tiles",
    "tile-unplaced": "a tile of a body has too few tie points to be placed among the others, and is left out",
    "tile-untrusted": "the map of a tile is not to be trusted, and counts only where there is no other",
    "view-blurred": "a view is less sharp than the map of all views",
    "view-brightness": "the brightness of a view is far off what the map predicts",
    "view-empty": "a view has no valid pixel, or shows nothing, and is left out",
    "view-left-out": "a view contradicts the others and is left out",
    "view-past-edge": "a simulated view sees past the edge of its ground",
    "view-unregistered": "a view could not be registered and is left out",
}
"""Every code, and its meaning."""


@dataclass(frozen=True)
class Warned:
    """A warning."""

    code: str
    """One of CODES."""
    words: str
    view: str = ""
    """Name of the view that it is about; empty where it is about several or none."""

    @property
    def line(self) -> str:
        """For people: the words, and the code to look up."""
        return f"{self.words} [{self.code}]"

    def as_row(self) -> dict[str, str]:
        """For JSON and tables."""
        return asdict(self)


MANY_ALIKE = 3
"""Number of warnings of one kind that are shown for a body; there may be one for each of hundreds of images and
tiles."""

_collectors: list[list[Warned]] = []
"""The lists of all blocks of `collected_warnings` that are open."""


def warn(log: logging.Logger, code: str, words: str, *values: object, view: str = "") -> None:
    """Logs a warning (`words % values`), and hands it to every open `collected_warnings`.

    log: of the calling module. code: one of CODES. view: name of the view that it is about.
    """
    if code not in CODES:
        raise ValueError(f"{code!r} is no code of a warning; add it to CODES")
    log.warning(words, *values, extra={"code": code, "view": view}, stacklevel=2)
    warned = Warned(code, words % values if values else words, view)
    for collector in _collectors:
        collector.append(warned)


@contextmanager
def collected_warnings() -> Iterator[list[Warned]]:
    """Collects the warnings issued in the block, by any thread of this process, in the list that it yields."""
    found: list[Warned] = []
    _collectors.append(found)
    try:
        yield found
    finally:
        # By identity: lists with the same content are equal.
        del _collectors[next(n for n, other in enumerate(_collectors) if other is found)]


def subject(code: str, view: str, words: str) -> tuple[str, str]:
    """The subject of a warning, the same for repetitions with other figures: its code, and its view or its words."""
    return code, view or words


def distinct(warnings: Iterable[Warned]) -> tuple[Warned, ...]:
    """The warnings in their order, each once; of those of one code about one view, the latest.

    A run judges a view at every relighting iteration, by a better map each time.
    """
    latest = {subject(w.code, w.view, w.words): w for w in warnings}
    return tuple(latest.values())


def few_of_each(warnings: Sequence[Warned]) -> list[str]:
    """Lines of warnings with their codes; the first MANY_ALIKE of each code, and the number of further ones."""
    lines = []
    for code in dict.fromkeys(warned.code for warned in warnings):
        alike = [warned.line for warned in warnings if warned.code == code]
        lines += alike[:MANY_ALIKE]
        if len(alike) > MANY_ALIKE:
            lines.append(f"and {len(alike) - MANY_ALIKE} more like it, listed in metrics.json [{code}]")
    return lines
