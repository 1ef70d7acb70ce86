"""Whether the map of a body is to be trusted: a few general statements, each of which a sound one fulfils by far."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photoclinometry.body.tile_map import TileMap
from photoclinometry.model.warning import Warned
from photoclinometry.pipeline.trust import encoded_images, inverted_relief

MOST_TILES = 0.5
"""If more than this share of the tiles has no map to be trusted, sound tiles are the exception."""

LEAST_EXPLAINED = 0.0
"""Renderings of the typical image must explain more than this share of the variation of brightness over the disk
(`disk_explained`): a disk of one brightness explains 0."""


def why_untrusted(tiles: Sequence[TileMap], explained: np.ndarray, warnings: Sequence[Warned]) -> tuple[str, ...]:
    """The reasons why the map of a body is not to be trusted; none of a sound one.

    explained: (K,) of each image by the finished surface (`disk_explained`), NaN of those without a pose. warnings: all
    of the body, those of single tiles among them. Only warnings about the sparse model, or about all images from most
    tiles, concern the whole.
    """
    reasons = [*encoded_images(warnings), *inverted_relief(warnings)]
    failed = [(n, tile.failure) for n, tile in enumerate(tiles) if tile.failure]
    doubted = [(n, "; ".join(tile.distrust)) for n, tile in enumerate(tiles) if tile.distrust and not tile.failure]
    wrong = len(failed) + len(doubted)
    if wrong > MOST_TILES * len(tiles):
        number, why = (doubted if len(doubted) >= len(failed) else failed)[0]
        reasons.append(
            f"{wrong} of {len(tiles)} tiles have no map or one that is not to be trusted, such as tile {number}: {why}"
        )
    known = explained[np.isfinite(explained)]
    if len(known) and np.median(known) < LEAST_EXPLAINED:
        reasons.append(
            f"renderings of the surface are {1.0 - np.median(known):.1f} times as far off the images as disks of one "
            "brightness are: check the Sun directions and what the brightness is"
        )
    return tuple(reasons)
