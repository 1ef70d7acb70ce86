"""Pixels of an image that are not to be used, beyond those that its own file marks: masks and borders in
`site.toml`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.images import read_mask
from photoclinometry.io.relative_path import relative_path
from photoclinometry.io.table import Table
from photoclinometry.model.errors import ImageError

MASK, BORDER = "mask", "border_px"
"""Keys in `site.toml`, of a camera and of a view."""


@dataclass(frozen=True, kw_only=True)
class Masking:
    """Masks and borders of one image: where any of them says so, its pixels are not used."""

    files: tuple[Path, ...] = ()
    """PNG or TIFF of the image's size, 0 where it is not to be used."""
    border_px: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Width of the margins that are not used: left, top, right, bottom [px]."""

    def joined(self, other: Masking) -> Masking:
        """Both together."""
        left, top, right, bottom = map(max, self.border_px, other.border_px)
        return Masking(files=(*self.files, *other.files), border_px=(left, top, right, bottom))

    def usable(self, shape: tuple[int, ...]) -> np.ndarray:
        """(height, width) bool, where an image of a shape is used. Raises ImageError for masks of another size."""
        height, width = shape
        left, top, right, bottom = self.border_px
        there = np.zeros((height, width), bool)
        # A border wider than the image leaves nothing: a negative end would count from the far side.
        there[top : max(height - bottom, 0), left : max(width - right, 0)] = True
        for file in self.files:
            mask = read_mask(file)
            if mask.shape != (height, width):
                raise ImageError(
                    f"{file}: the mask is {mask.shape[1]} x {mask.shape[0]} pixels, its image {width} x {height}; "
                    "make it as large as the image"
                )
            there &= mask
        return there

    def document(self, folder: Path) -> dict[str, Any]:
        """The keys of `site.toml` in a folder; none where all is used."""
        found: dict[str, Any] = {}
        if self.files:
            found[MASK] = [relative_path(file, folder) for file in self.files]
        if any(self.border_px):
            found[BORDER] = list(self.border_px)
        return found


ALL_USED = Masking()
"""Nothing is masked."""


def read_masking(table: Table, folder: Path) -> Masking:
    """The masks and borders in the table of a camera or a view; mask files are relative to the folder.

    Raises SiteError.
    """
    names = table.texts(MASK) if MASK in table else ()
    border = table.integers_from_zero(BORDER, 4) if BORDER in table else (0, 0, 0, 0)
    left, top, right, bottom = (int(each) for each in border)
    return Masking(files=tuple(folder / name for name in names), border_px=(left, top, right, bottom))
