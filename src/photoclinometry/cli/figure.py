"""`phomo figure`: a figure for publication."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.output.figures.options import FigureOptions


def figure(
    run: tyro.conf.Positional[Path],
    /,
    out: Path,
    overwrite: bool = False,
    options: Annotated[FigureOptions, tyro.conf.arg(name="")] = FigureOptions(),  # noqa: B008
) -> None:
    """Draw a figure for publication: lettered maps and a profile, at the width of a journal's columns.

    Maps have colour bars with units, a scale bar, and an arrow to the north where the map is in the body-fixed frame.
    Text of PDF and SVG files is text, in fonts that lie in the file.

    Args:
        run: Folder of a finished run.
        out: File to write; .pdf, .svg or .png.
        overwrite: Replace a file that is there; without it, such a file is refused.
        options: What the figure shows, and how large it is.
    """
    from rich.console import Console

    import photoclinometry as pcm
    from photoclinometry.cli.render import check_new_file
    from photoclinometry.output.figures.layers import LAYERS

    check_new_file(out, overwrite)
    pcm.figure(run, out, options=options)
    shown = [LAYERS[name].title for name in options.layers]
    shown += [f"profile of the {options.profile_layer}"] if options.profile else []
    Console(stderr=True, soft_wrap=True).print(f"{out}: {', '.join(shown)}", highlight=False, markup=False)
