"""Pages of the viewer for the tests in a browser: a small map that is known exactly, and what tests ask of a page."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from photoclinometry.model.reflectance import Reflectance, starting_model
from photoclinometry.model.scene import Scene
from photoclinometry.output.viewer import write_viewer
from scenes import synthetic_images, synthetic_scene

MIDDLE = (430.0, 330.0)
"""A place on the map in the window [px]."""

SUNS_DEG = ((315.0, 50.0), (80.0, 25.0), (190.0, 10.0))
"""Azimuths and elevations: high, middle, and low, where shadows are long."""

RENDERED = "return Array.from(viewer.renderingOf(...arguments), x => Number.isNaN(x) ? null : x)"
"""Asks a page for the brightness of a view's pixels under a Sun; null where nothing is shown."""


def model_of(name: str) -> Reflectance:
    """A model with its values for Vesta; Minnaert's in magnitudes with values that all count."""
    if name == "minnaert-magnitudes":
        return Reflectance(name, (0.6, 0.2, 1.8, -0.3, 0.1))
    return starting_model(name, "vesta")


def scene_of(model: str = "lunar-lambert") -> Scene:
    """40 x 40 landmarks in four views, with sigmas of positions, normals and albedos; steep enough to cast shadows."""
    scene = synthetic_scene(size=40, views=4, reflectance=model_of(model))
    count = len(scene.landmarks)
    rng = np.random.default_rng(0)
    stated = {
        "position": rng.uniform(3.0, 9.0, (count, 3))[:, None] ** 2 * np.eye(3),
        "normal": np.radians(rng.uniform(0.2, 0.8, (count, 2))),
        "albedo": rng.uniform(0.005, 0.02, count) * scene.landmarks.albedo,
    }
    return replace(scene, uncertainty=stated)


def page_of(folder: Path, scene: Scene, name: str = "viewer.html") -> Path:
    """The scene's page, with the images of its four views."""
    return write_viewer(folder / name, scene, synthetic_images(scene))


def differ(before, after):
    """Share of pixels that differ between two pictures."""
    return (before != after).any(-1).mean()


def rows_of(page, table):
    """The rows of a table by their first cell."""
    script = "return [...document.getElementById(arguments[0]).rows].map(r => [...r.cells].map(c => c.textContent))"
    return dict(page.run(script, table))


def box_of(page, part):
    """Left, top, right and bottom of a part of the page in the window [px]."""
    script = "const b = document.getElementById(arguments[0]).getBoundingClientRect();"
    return page.run(script + "return [b.left, b.top, b.right, b.bottom]", part)


def downloaded(folder, pattern):
    """The file that the page has written, as soon as it is whole."""
    for _ in range(200):
        found = [path for path in folder.glob(pattern) if path.stat().st_size]
        if found:
            return found[0]
        time.sleep(0.05)
    raise AssertionError(f"nothing was written: {pattern}")
