"""A small site on disk, good in every respect, for tests to read or to spoil."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.images import write_fits

SIZE = 64

HEADER = """name = "small"
body = "vesta"
brightness = "iof"

[camera]
model = "PINHOLE"
width = 64
height = 64
params = [640.0, 640.0, 32.0, 32.0]

[region]
reference = "images/1.fits"
center_px = [30.0, 32.0]
size_px = [40, 20]
"""


def view_text(number: int) -> str:
    return f"""
[[views]]
image = "images/{number}.fits"
sun = [0.6, 0.0, -0.8]
"""


def picture(number: int) -> np.ndarray:
    """(SIZE, SIZE) float32 brightness of image `number`: waves that move from image to image."""
    y, x = np.mgrid[:SIZE, :SIZE]
    return (0.1 + 0.05 * np.sin(x / 5 + number) * np.cos(y / 7)).astype(np.float32)


def write_small_site(folder: Path, views: int = 4) -> Path:
    """`site.toml` and its images; the path of the former."""
    for number in range(views):
        write_fits(folder / "images" / f"{number}.fits", picture(number))
    path = folder / "site.toml"
    path.write_text(HEADER + "".join(view_text(number) for number in range(views)))
    return path
