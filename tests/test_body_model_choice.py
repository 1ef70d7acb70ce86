"""Which tile chooses a body's reflectance model, and what happens where tiles are not mapped."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from photoclinometry.body import model_choice
from photoclinometry.body import tile as tiles
from photoclinometry.body.model_choice import TRIED, ChooseBodyModel, chooses_reflectance, most_telling
from photoclinometry.body.options import BodyOptions
from photoclinometry.body.plan import Tile, TilePlan
from photoclinometry.body.tile import BodyModel, MapTile
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.progress import no_progress
from photoclinometry.model.reflectance import starting_model
from photoclinometry.model.region import Region
from photoclinometry.pipeline.folder.stage import Keyed, Tools
from sites import write_small_site


def tile(views, area):
    region = Region(col=0, row=0, width=64, height=64, stride=1)
    return Tile(reference=0, region=region, views=np.arange(views), gsd=1.0, area=area, new_area=area)


TILES = (tile(5, 9.0), tile(8, 3.0), tile(8, 4.0), tile(6, 9.0), tile(4, 9.0))


@pytest.fixture
def stage(tmp_path):
    """Of a body of which only the site and the plan are asked."""
    site = read_site(write_small_site(tmp_path))
    plan = TilePlan(tiles=TILES, area={}, views_of_face=np.zeros(0, int), tile_of_face=np.zeros(0, int))
    nothing = Keyed(None, "")
    model = BodyModel(
        site=site, posed=nothing, known=nothing, shape=nothing, plan=Keyed(plan, "plan"), options=BodyOptions()
    )
    return ChooseBodyModel(model=model, body=Keyed(tmp_path, "body"))


def made(stage, tmp_path):
    return stage.make(Tools(progress=no_progress, scratch=tmp_path)).reflectance


def test_the_tile_of_most_views_chooses_and_of_these_the_largest():
    assert most_telling(TILES) == [2, 1, 3, 0, 4]


def test_the_model_is_as_it_is_known_beforehand(stage, tmp_path, monkeypatch):
    """Not with the parameters of the one tile."""
    body = stage.model.site.body
    estimated = starting_model("hapke", body)
    estimated = estimated.with_parameters(1.01 * np.array(estimated.parameters))
    asked = []

    def mapped(folder, model, number, progress):
        asked.append(number)
        return SimpleNamespace(scene=SimpleNamespace(reflectance=estimated))

    monkeypatch.setattr(model_choice, "map_tile", mapped)
    assert made(stage, tmp_path) == starting_model("hapke", body)
    assert asked == [2]


def test_the_next_tile_chooses_where_one_is_not_mapped(stage, tmp_path, monkeypatch):
    asked = []

    def fails(folder, model, number, progress):
        asked.append(number)
        raise ReconstructionError("no map")

    monkeypatch.setattr(model_choice, "map_tile", fails)
    assert made(stage, tmp_path).name == "lunar-lambert"
    assert asked == [2, 1, 3]
    assert len(asked) == TRIED


@pytest.mark.parametrize(("name", "chooses"), [("auto", True), ("hapke", False), ("none", False)])
def test_a_model_that_is_given_is_not_chosen(stage, name, chooses):
    run = replace(stage.model.options.run, reflectance=name)
    assert chooses_reflectance(replace(stage.model, options=replace(stage.model.options, run=run))) is chooses


def test_an_unexpected_error_names_the_tile_and_its_folder(stage, tmp_path, monkeypatch):
    """One of a hundred tiles ended a body with a traceback that did not tell which."""

    def broken(folder, model, number, progress):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(tiles, "map_tile", broken)
    with pytest.raises(ZeroDivisionError) as caught:
        MapTile(number=3, model=stage.model, body=stage.body).make(Tools(progress=no_progress, scratch=tmp_path))
    assert caught.value.__notes__ == [f"while tile 3 was mapped, in {tmp_path / 'tiles' / '0003'}"]
    assert pickle.loads(pickle.dumps(caught.value)).__notes__ == caught.value.__notes__, "lost on the way from a worker"
