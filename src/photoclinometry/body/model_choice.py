"""One reflectance model for a whole body, chosen by how well models predict views kept out of one tile's map."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

from photoclinometry.body.plan import Tile
from photoclinometry.body.tile import BodyModel, map_tile
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.reflectance import starting_model
from photoclinometry.pipeline.choices import choose_reflectance
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, digest, program_digest, say_found
from photoclinometry.pipeline.model_choice import ChosenModel

log = logging.getLogger(__name__)

TRIED = 3
"""Most tiles that are tried: where none of these finds a map, the others will hardly find one."""


@dataclass(frozen=True, kw_only=True)
class ChooseBodyModel(Stage[ChosenModel]):
    """The model that the tile with the most views finishes its own map with (`--reflectance auto`).

    All tiles then finish with it: albedos of tiles with different models would differ by more than a factor. The tile's
    own map goes on from there when its turn comes.
    """

    name = "reflectance"
    result = ChosenModel
    model: BodyModel
    """The body, whose tiles have no model yet."""
    body: Keyed[Path]
    """The body's folder."""

    @property
    def key(self) -> str:
        return digest(program_digest(), self.name, self.model.plan, *self.model.of_tiles)

    def make(self, tools: Tools) -> ChosenModel:
        model = self.model
        for number in most_telling(model.plan.value.tiles)[:TRIED]:
            try:
                found = map_tile(self.body.value, model, number, tools.progress).scene.reflectance
            except ReconstructionError as error:
                log.info("tile %d chooses no reflectance model, it is not mapped: %s", number, error)
                continue
            assert found is not None
            say_found(f"{found.name}, by tile {number}")
            return ChosenModel(reflectance=starting_model(found.name, model.site.body))
        first = choose_reflectance(model.options.run.reflectance, model.site.body)
        assert first is not None
        say_found(f"{first.name}, not chosen by a map")
        return ChosenModel(reflectance=first)


def chooses_reflectance(model: BodyModel) -> bool:
    """Whether the images of the body are to choose its reflectance model."""
    return model.options.run.reflectance == "auto"


def most_telling(tiles: tuple[Tile, ...]) -> list[int]:
    """Numbers of tiles, those of most views first, and of these the larger ones."""
    return sorted(range(len(tiles)), key=lambda n: (-len(tiles[n].views), -tiles[n].area))
