"""Lengths, slopes and volumes of maps, with standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photoclinometry.api.given import given_scene
from photoclinometry.model.scene import Scene
from photoclinometry.pipeline.products import RunResult
from photoclinometry.surface import measure
from photoclinometry.surface.measure import Measured, Pixel


def distance(scene: RunResult | Scene | str | Path, start: Pixel, end: Pixel) -> Measured:
    """Measure the straight distance between two places of a map.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        start: One place (x, y) in pixels of the reference image, as the axes of `plot` count them.
        end: The other place.

    Returns:
        Value and standard deviation, in metres, or in GSD where the map has no unit of length.

    Raises:
        InputError: There is no landmark at a place, both are one, or the map states no uncertainties.
    """
    return measure.distance(given_scene(scene), start, end)


def height_difference(scene: RunResult | Scene | str | Path, start: Pixel, end: Pixel) -> Measured:
    """Measure by how much the second place of a map is higher than the first, over the map's mean plane.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        start: One place (x, y) in pixels of the reference image, as the axes of `plot` count them.
        end: The other place.

    Returns:
        Value and standard deviation, in metres, or in GSD where the map has no unit of length.

    Raises:
        InputError: There is no landmark at a place, both are one, or the map states no uncertainties.
    """
    return measure.height_difference(given_scene(scene), start, end)


def slope(scene: RunResult | Scene | str | Path, start: Pixel, end: Pixel) -> Measured:
    """Measure the slope from one place of a map up to another, against the map's mean plane.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        start: One place (x, y) in pixels of the reference image, as the axes of `plot` count them.
        end: The other place.

    Returns:
        Value and standard deviation in degrees.

    Raises:
        InputError: There is no landmark at a place, both are one, or the map states no uncertainties.
    """
    return measure.slope(given_scene(scene), start, end)


def volume(scene: RunResult | Scene | str | Path, corners: Sequence[Pixel]) -> Measured:
    """Measure the volume of a hill, or of a hollow (negative), over the plane through the ground around it.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        corners: Of a polygon around it, (x, y) in pixels of the reference image, as the axes of `plot` count them.

    Returns:
        Value and standard deviation, in cubic metres, or in GSD cubed where the map has no unit of length.

    Raises:
        InputError: The polygon contains too few landmarks, or holes, or the map states no uncertainties.
    """
    return measure.volume(given_scene(scene), np.asarray(corners, float))
