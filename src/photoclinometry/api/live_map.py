"""The viewer's page within another page: a map under any Sun in a notebook, and in documents."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path

from photoclinometry.api.given import given_folder, given_scene
from photoclinometry.model.scene import Scene
from photoclinometry.output.viewer.content import viewer_content
from photoclinometry.output.viewer.page import viewer_page
from photoclinometry.output.viewer.run_page import run_page
from photoclinometry.pipeline.products import RunResult

HEIGHT_PX = 640
"""Of the frame: the picture, and the panel down to its measuring tools."""


@dataclass(frozen=True, kw_only=True)
class LiveMap:
    """A map that a notebook shows as the viewer's page, in a frame within the notebook's."""

    page: str
    """The viewer's page, HTML."""
    height_px: int

    def _repr_html_(self) -> str:
        # One line: what takes it into a document may indent lines, and the program's text is not to change.
        source = escape(self.page).replace("\n", "&#10;")
        style = f"width: 100%; height: {self.height_px}px; border: 0"
        return f'<iframe title="map" srcdoc="{source}" style="{style}"></iframe>'


def view(scene: RunResult | Scene | str | Path, *, height_px: int = HEIGHT_PX) -> LiveMap:
    """Show a map in a notebook: move the Sun, compare with the images, measure.

    Args:
        scene: The result of `run`, the folder of a finished run or body, a scene.h5, or a scene. Of a folder it is the
            page of its report, with the images; of a scene by itself, or a scene.h5, the map alone.
        height_px: Height of the frame [px].

    Returns:
        What a notebook draws. Its `page` is the viewer's page as HTML.

    Raises:
        InputError: There is no map.
    """
    folder = given_folder(scene)
    if folder is None or (isinstance(scene, (str, Path)) and Path(scene).is_file()):
        page = viewer_page(viewer_content(given_scene(scene)))
    else:
        page = run_page(folder).read_text(encoding="utf-8")
    return LiveMap(page=page, height_px=height_px)
