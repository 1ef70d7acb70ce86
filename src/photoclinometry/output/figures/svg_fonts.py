"""Fonts inside an SVG file, so that its text stays text and looks the same everywhere."""

from __future__ import annotations

import base64
import io
import logging
import re
from html import unescape
from pathlib import Path

FONTS = {"normal": "DejaVuSans.ttf", "bold": "DejaVuSans-Bold.ttf"}
"""The files of matplotlib's own font, by weight."""
FAMILY = "DejaVu Sans"


def with_fonts(file: bytes) -> bytes:
    """An SVG file of matplotlib with the letters of its text, as fonts in its style sheet."""
    svg = file.decode()
    letters = "".join(unescape(re.sub("<[^>]*>", "", text)) for text in re.findall(r"<text.*?</text>", svg, re.DOTALL))
    faces = "".join(_face(weight, file, letters) for weight, file in FONTS.items())
    style = f"<style>{faces}</style>"
    return re.sub(r"(<svg[^>]*>)", lambda found: found[1] + style, svg, count=1).encode()


def _face(weight: str, file: str, letters: str) -> str:
    """A style sheet's rule of a font that has these letters alone."""
    import matplotlib
    from fontTools import subset
    from fontTools.ttLib import TTFont

    logging.getLogger("fontTools").setLevel(logging.WARNING)  # it logs every table that it drops
    font = TTFont(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / file)
    options = subset.Options()
    options.drop_tables += ["FFTM"]
    cutter = subset.Subsetter(options)
    cutter.populate(text=letters)
    cutter.subset(font)
    data = io.BytesIO()
    font.save(data)
    source = f"data:font/ttf;base64,{base64.b64encode(data.getvalue()).decode()}"
    return f"@font-face{{font-family:'{FAMILY}';font-weight:{weight};src:url({source}) format('truetype')}}"
