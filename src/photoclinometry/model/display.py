"""Display of a scene: one line at the prompt, a table and a picture in a notebook.

The picture is a PNG made with the standard library, inside the page, so that a notebook keeps it. It is drawn when the
notebook asks. If that fails, the table is shown all the same, with the reason in place of the picture.
"""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Callable, Mapping
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from photoclinometry.model.tiny import TINY

if TYPE_CHECKING:
    from photoclinometry.model.scene import Scene

PICTURE_PX = 256
"""Greatest width and height of a thumbnail; larger maps are averaged over blocks."""
STRETCH_PERCENT = (1.0, 99.0)
"""Percentiles of the values that are drawn black and white, so that single outliers do not flatten a picture."""
LIGHT_IN_CAM = np.array([-1.0, -1.0, -1.0]) / np.sqrt(3.0)
"""Towards the light of the relief picture, in the reference camera's frame: from the upper left, 35 degrees above the
image plane. Light from the upper left makes people see relief the right way round."""
BRIGHTNESS_UNITS = {"iof": "I/F", "dn": "DN"}


def scene_line(scene: Scene) -> str:
    """The scene in one line."""
    about = scene_table(scene)
    counts = f"{about['views']} views, {about['landmarks']} landmarks, GSD {about['GSD']}"
    parts = [
        about["reflectance"],
        about["brightness"],
        about["frame"],
        "with sigmas" if scene.uncertainty else "no sigmas",
    ]
    return f"<Scene {named(scene.name, scene.body)}: {'; '.join([counts, *parts])}>"


def scene_card(scene: Scene) -> str:
    """The scene as HTML."""
    title = f"Scene {named(scene.name, scene.body)}"
    return card(title, scene_table(scene), lambda: scene_picture(scene), scene_caption(scene))


def named(name: str, body: str | None) -> str:
    """A scene's or a site's name, and its body where that is known."""
    return f"{name!r}" + (f" ({body})" if body else "")


def scene_table(scene: Scene) -> dict[str, str]:
    """Properties of the scene, in words and numbers."""
    reference = scene.views.name[scene.reference]
    rows, cols = scene.region.grid_shape
    return {
        "views": f"{len(scene.views)}",
        "landmarks": f"{len(scene.landmarks)}",
        "observations": f"{len(scene.tracks)}",
        "map": f"{cols} x {rows} pixels of {reference}",
        "GSD": f"{scene.gsd:.3g} {scene.unit or '(own unit)'}" if len(scene.landmarks) else "unknown",
        "reflectance": "geometry alone" if scene.reflectance is None else scene.reflectance.name,
        "brightness": BRIGHTNESS_UNITS.get(scene.brightness, scene.brightness),
        "frame": f"{scene.frame} frame",
        "sigmas": ", ".join(scene.uncertainty) or "none",
    }


def scene_picture(scene: Scene) -> np.ndarray:
    """Grey values (h, w) in [0, 1], NaN where there is no landmark: the albedo beside the relief; of geometry alone the
    relief.
    """
    light = scene.views.body_from_cam[scene.reference].rotation @ LIGHT_IN_CAM
    relief = thumbnail(scene.grid(np.clip(scene.landmarks.normal @ light, 0.0, 1.0)))
    if scene.reflectance is None:
        return relief
    gap = np.full((len(relief), max(1, relief.shape[1] // 40)), np.nan)
    return np.concatenate([thumbnail(scene.grid(scene.landmarks.albedo)), gap, relief], axis=1)


def scene_caption(scene: Scene) -> str:
    """The caption of `scene_picture`."""
    return ("" if scene.reflectance is None else "albedo, and ") + "relief lit from the upper left"


def thumbnail(values: np.ndarray) -> np.ndarray:
    """Values (h, w), NaN where there are none, as grey (h', w') in [0, 1], at most PICTURE_PX wide and high."""
    step = -(-max(values.shape) // PICTURE_PX)
    rows, cols = (step * (-(-size // step)) for size in values.shape)
    padded = np.full((rows, cols), np.nan)
    padded[: values.shape[0], : values.shape[1]] = values
    blocks = padded.reshape(rows // step, step, cols // step, step)
    there = np.isfinite(blocks)
    count = there.sum((1, 3))
    total = np.where(there, blocks, 0.0).sum((1, 3))
    mean = np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)
    if not count.any():
        return mean
    low, high = np.nanpercentile(mean, STRETCH_PERCENT)
    return np.clip((mean - low) / max(high - low, TINY), 0.0, 1.0)


def png_of_grey(grey: np.ndarray) -> bytes:
    """Grey values (h, w) in [0, 1] as a PNG file of 8 bits; NaN is transparent."""
    there = np.isfinite(grey)
    level = np.round(255.0 * np.where(there, grey, 0.0)).astype(np.uint8)
    pixels = np.stack([level, np.where(there, 255, 0).astype(np.uint8)], -1)
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)  # each row begins with its filter: none
    grey_with_alpha = struct.pack(">IIBBBBB", grey.shape[1], grey.shape[0], 8, 4, 0, 0, 0)
    chunks = ((b"IHDR", grey_with_alpha), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_png_chunk(kind, data) for kind, data in chunks)


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def card(title: str, about: Mapping[str, str], picture: Callable[[], np.ndarray], caption: str) -> str:
    """A title above a table and a picture, as HTML. picture: gives grey values (h, w) as `png_of_grey` takes them."""
    rows = "".join(
        f'<tr><th style="text-align: left">{escape(key)}</th><td style="text-align: left">{escape(value)}</td></tr>'
        for key, value in about.items()
    )
    return (
        f"<div><strong>{escape(title)}</strong>"
        '<div style="display: flex; flex-wrap: wrap; gap: 1em; align-items: flex-start">'
        f"<table>{rows}</table>{_picture(picture, caption)}</div></div>"
    )


def _picture(draw: Callable[[], np.ndarray], caption: str) -> str:
    """The picture as an HTML element, or the reason why there is none: the table is shown even if the picture fails."""
    try:
        grey = draw()
        data = base64.b64encode(png_of_grey(grey)).decode()
    except Exception as error:
        return f"<div>no picture: {escape(f'{type(error).__name__}: {error}')}</div>"
    width = grey.shape[1] * max(1, PICTURE_PX // len(grey))
    image = f'<img src="data:image/png;base64,{data}" style="width: {width}px; image-rendering: pixelated">'
    return f'<figure style="margin: 0">{image}<figcaption>{escape(caption)}</figcaption></figure>'
