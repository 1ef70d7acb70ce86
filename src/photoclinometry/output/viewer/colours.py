"""The colour tables of the viewer's layers. All are readable by colour-blind people."""

from __future__ import annotations

TABLES = ("gray", "cividis", "viridis", "magma", "RdBu_r")
"""Names of matplotlib's colour maps. Lightness rises all along; in the last it falls from the middle to the ends."""
ENTRIES = 64
"""Colours of a table; the page interpolates between them."""


def colour_tables() -> dict[str, str]:
    """Each table as hexadecimal digits, six for each of ENTRIES colours."""
    import matplotlib
    import numpy as np

    places = np.linspace(0.0, 1.0, ENTRIES)
    return {
        name: (255.0 * matplotlib.colormaps[name](places)[:, :3]).round().astype(np.uint8).tobytes().hex()
        for name in TABLES
    }
