"""The worst places of a body: tiles where heights and normals are uncertain, tiles disagree or images are few, and the
largest piece without a map."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.report.facts import WorstPlace
from photoclinometry.output.report.weak_places import compared, stands_out
from photoclinometry.registration.place import lon_lat_deg
from photoclinometry.surface.closed_mesh import area_vectors, parts_of

_LEAST_SHARE = 0.1
"""Tiles are judged that have this share of the vertices of the mean tile, or more."""
_LEAST_GAP_PERCENT = 0.1
"""Share of the surface from which a piece without a map is named: a square of 3 GSD on a body of 10,000."""


@dataclass(frozen=True, kw_only=True)
class BodyPlace(WorstPlace):
    """A tile, or ground without a map."""

    vertex: int
    """In its middle."""


def body_places(shape: ShapeModel, step: np.ndarray, gsd: float) -> tuple[BodyPlace, ...]:
    """The worst places: the largest gap, and the worst tile in every respect in which it stands out, each once.

    step: (V,) scatter of heights between tiles, NaN where there is but one; gsd: both in the unit of the shape.
    """
    found: dict[int, BodyPlace] = {}
    for words, values, unit, large_is_bad in _judged(shape, step, gsd):
        worst = _worst_tile(shape, values, large_is_bad=large_is_bad)
        if worst is None or worst[0] in found:
            continue
        tile, value, whole = worst
        if stands_out(value, whole, large_is_bad=large_is_bad):
            how = "in the median" if large_is_bad else "in the mean"
            rows = np.flatnonzero(shape.tile == tile)
            told = compared(words, value, whole, unit, how, "surface")
            found[tile] = _place(shape, rows, told, f"tile {tile}, ")
    return (*_largest_gap(shape), *found.values())


def _judged(shape: ShapeModel, step: np.ndarray, gsd: float) -> Iterator[tuple[str, np.ndarray, str, bool]]:
    """The property of a bad tile in words, (V,) values, their unit, and whether large ones are bad."""
    if shape.views is not None:
        yield "fewest images", np.where(shape.views > 0, shape.views, np.nan), "", False
    if "height" in shape.sigma:
        yield "largest uncertainty of heights", shape.sigma["height"] / gsd, " GSD", True
    if "normal" in shape.sigma:
        yield "largest uncertainty of normals", np.degrees(shape.sigma["normal"]), "°", True
    yield "largest scatter of heights between tiles", step / gsd, " GSD", True


def _worst_tile(shape: ShapeModel, values: np.ndarray, *, large_is_bad: bool) -> tuple[int, float, float] | None:
    """The tile of the worst value, this value, and that of the whole surface; None where no tile can be judged."""
    average = np.median if large_is_bad else np.mean
    known = np.isfinite(values) & (shape.tile >= 0) if shape.tile is not None else np.zeros(len(values), bool)
    if shape.tile is None or not known.any():
        return None
    order = np.argsort(shape.tile[known], kind="stable")
    tiles, first = np.unique(shape.tile[known][order], return_index=True)
    of_tiles = np.split(values[known][order], first[1:])
    least = _LEAST_SHARE * known.sum() / len(tiles)
    judged = [(int(n), float(average(each))) for n, each in zip(tiles, of_tiles, strict=True) if len(each) >= least]
    tile, value = (max if large_is_bad else min)(judged, key=lambda pair: pair[1])
    return tile, value, float(average(values[known]))


def _largest_gap(shape: ShapeModel) -> list[BodyPlace]:
    """The largest piece of the surface that was not mapped."""
    if shape.views is None:
        return []
    area = np.linalg.norm(area_vectors(shape.vertices, shape.faces), axis=-1)
    guessed = np.flatnonzero((shape.views[shape.faces] == 0).any(1))
    if not len(guessed):
        return []
    part = parts_of(shape.faces[guessed], len(shape.vertices))
    of_part = np.bincount(part, area[guessed])
    percent = 100.0 * float(of_part.max() / area.sum())
    if percent < _LEAST_GAP_PERCENT:
        return []
    rows = np.unique(shape.faces[guessed[part == of_part.argmax()]])
    words = f"no map: {percent:.2g} % of the surface in one piece, closed by a smooth guess"
    return [_place(shape, rows, words, "")]


def _place(shape: ShapeModel, rows: np.ndarray, words: str, name: str) -> BodyPlace:
    """A place of vertices (n,), named by the one that is nearest to their middle."""
    points = shape.vertices[rows]
    vertex = int(rows[np.argmin(np.linalg.norm(points - points.mean(0), axis=1))])
    lon, lat = lon_lat_deg(shape.vertices[vertex])
    if shape.from_images_alone:
        where = f"{name}around {lon % 360.0:.0f}° from x to y, {lat:.0f}° towards z"
    else:
        where = f"{name}around {lon % 360.0:.0f}° E, {abs(lat):.0f}° {'N' if lat >= 0 else 'S'}"
    return BodyPlace(words=words, where=where, vertex=vertex)
