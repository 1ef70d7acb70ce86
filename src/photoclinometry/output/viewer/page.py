"""The page: its program, its style and a map in one file, which asks for nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

from photoclinometry import __version__
from photoclinometry.io.atomic import write_text
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance.shader import shader_functions
from photoclinometry.model.scene import Scene
from photoclinometry.output.viewer.body_content import ViewedBody, body_content
from photoclinometry.output.viewer.colours import colour_tables
from photoclinometry.output.viewer.content import viewer_content

NAME = "viewer.html"
"""The page's file in a report and in an export."""

ASSETS = Path(__file__).with_name("assets")

SCRIPTS = (
    "arrays",
    "linear",
    "map",
    "sampling",
    "light",
    "camera",
    "graphics",
    "grid_passes",
    "shadow_map",
    "renderer",
    "layers",
    "state",
    "link",
    "marks",
    "moves",
    "legend",
    "contours",
    "overlay",
    "sky",
    "sun_map",
    "measure",
    "section",
    "region",
    "body",
    "chart",
    "values",
    "save",
    "panel",
    "picture",
    "actions",
    "pointer",
    "keys",
    "main",
)
"""Files of assets/js in the order in which the page joins them: each uses those before it."""

SHADERS = (
    "grid.vert",
    "shadow.frag",
    "sun_heights.vert",
    "sun_heights.frag",
    "sunlit.frag",
    "brightness.frag",
    "average.frag",
    "filled.frag",
    "spline.frag",
    "surface.vert",
    "surface.frag",
    "display.frag",
)
"""Files of assets/glsl."""


def write_viewer(
    path: Path | str,
    scene: Scene,
    images: Sequence[Image] = (),
    pose_priors: Mapping[str, PosePrior] | None = None,
) -> Path:
    """Writes the scene's page, whole or not at all; returns its path. Raises RunFolderError.

    images: of the scene's views, in any order, to compare renderings with. pose_priors: by name of view, to show how
    the estimate moved the cameras.
    """
    path = Path(path)
    write_text(path, viewer_page(viewer_content(scene, images, pose_priors)))
    return path


def write_body_viewer(path: Path | str, body: ViewedBody, images: Sequence[Image] = ()) -> Path:
    """Writes the page of a whole body, as `write_viewer` does that of a map."""
    path = Path(path)
    write_text(path, viewer_page(body_content(body, images)))
    return path


def viewer_page(content: dict[str, Any]) -> str:
    """The HTML of the data from `viewer_content` or `body_content`.

    No part of it names another file, and its policy forbids every request.
    """
    about = {"version": __version__, "shaders": shaders(), "colours": colour_tables(), "scene": content}
    data = json.dumps(about, separators=(",", ":"), allow_nan=False)
    parts = {
        "TITLE": escape(f"{content['name']}: map"),
        "STYLE": asset("viewer.css"),
        # In HTML, "</script" and "<!--" would end or change the element that holds the text.
        "DATA": data.replace("<", "\\u003c"),
        "PROGRAM": program(),
    }
    html = asset("viewer.html")
    for name, text in parts.items():
        html = html.replace(f"<!--{name}-->", text, 1)
    return html


@cache
def program() -> str:
    """The page's program: all SCRIPTS as one."""
    body = "\n".join(asset(f"js/{name}.js") for name in SCRIPTS)
    return f'"use strict";\n(() => {{\n{body}\n}})();\n'


@cache
def shaders() -> dict[str, str]:
    """The programs of the graphics processor by name, and the functions of the reflectance models."""
    return {name: asset(f"glsl/{name}") for name in SHADERS} | {"reflectance": shader_functions()}


def asset(name: str) -> str:
    """A file of assets/ as text."""
    return (ASSETS / name).read_text(encoding="utf-8")
