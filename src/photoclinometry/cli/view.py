"""`phomo view`: the map of a run or a body in the browser, under any Sun."""

from __future__ import annotations

from pathlib import Path


def view(run: Path, /, browser: bool = True) -> Path:
    """Open a map in the browser: move the Sun, compare with the images, measure.

    The page is report/viewer.html of the run or body, one file that needs no network and can be given to others. Where
    the report lacks it, it is made now, with the images where they still are.

    Args:
        run: Folder of a finished run, or of a body.
        browser: Also open the page in the default browser.
    """
    from photoclinometry.output.viewer.run_page import run_page

    page = run_page(run)
    print(page)
    if browser:
        show(page)
    return page


def show(page: Path) -> None:
    """Opens the page in the default browser; says what to do where there is none."""
    import webbrowser

    from rich.console import Console

    if not webbrowser.open(page.resolve().as_uri()):
        Console(stderr=True).print("no browser was found; open the page by hand", highlight=False)
