"""A body that is mapped again with another plan: its tiles take the folders of the earlier plan, and no others stay."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from photoclinometry.body import tile as tiles
from photoclinometry.body.options import BodyOptions
from photoclinometry.body.plan import Tile, TilePlan
from photoclinometry.body.tile import BodyModel, map_tile, remove_tiles_from, tile_folder
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.region import Region
from photoclinometry.pipeline.folder.records import write_record
from photoclinometry.pipeline.folder.run_lock import locked
from photoclinometry.pipeline.folder.run_mark import MARK
from photoclinometry.pipeline.folder.stage import Keyed
from sites import write_small_site


def model_of(site, *views):
    """A body whose plan has one tile of some views."""
    region = Region(col=0, row=0, width=8, height=8, stride=1)
    tile = Tile(reference=views[0], region=region, views=np.array(views), gsd=1.0, area=1.0, new_area=1.0)
    plan = TilePlan(tiles=(tile,), area={}, views_of_face=np.zeros(0, int), tile_of_face=np.zeros(0, int))
    nothing = Keyed(None, "")
    return BodyModel(
        site=site, posed=nothing, known=nothing, shape=nothing, plan=Keyed(plan, str(views)), options=BodyOptions()
    )


@pytest.fixture
def site(tmp_path, monkeypatch):
    """Of four views, whose tiles are mapped by a stand-in."""

    def mapped(folder, posed, config):
        (folder.path / "scene.h5").write_text("a map")
        return SimpleNamespace(folder=folder.path, names=[view.name for view in posed.views])

    monkeypatch.setattr(tiles, "_posed_site", lambda folder, site, *_: site)
    monkeypatch.setattr(tiles, "map_posed", mapped)
    return read_site(write_small_site(tmp_path / "site"))


def test_a_tile_of_other_views_takes_the_place_of_the_one_before(site, tmp_path):
    """With smaller tiles number 0 is other ground."""
    names = [view.name for view in site.views]
    assert map_tile(tmp_path, model_of(site, 0, 1), 0).names == names[:2]
    (tmp_path / "tiles" / "0000" / "report").mkdir()
    found = map_tile(tmp_path, model_of(site, 2, 3), 0)
    assert found.names == names[2:]
    assert not (found.folder / "report").exists()
    assert len(json.loads((found.folder / MARK).read_text())["owner"]["images"]) == 2


def test_a_tile_of_the_same_views_goes_on(site, tmp_path):
    folder = map_tile(tmp_path, model_of(site, 0, 1), 0).folder
    (folder / "stages").mkdir()
    map_tile(tmp_path, model_of(site, 0, 1, 2), 0)
    assert (folder / "stages").is_dir()


def test_tiles_beyond_the_plan_are_removed_with_their_results(tmp_path):
    for number in (0, 1, 9, 10, 12345):
        (tile_folder(tmp_path, number) / "report").mkdir(parents=True)
        write_record(tmp_path / "stages" / f"tile_{number:04d}.npz", "key", None)
    write_record(tmp_path / "stages" / "plan.npz", "key", None)
    (tmp_path / "tiles" / "notes").mkdir()
    remove_tiles_from(tmp_path, 9)
    assert {path.name for path in (tmp_path / "tiles").iterdir()} == {"0000", "0001", "notes"}
    assert {path.name for path in (tmp_path / "stages").iterdir()} == {"plan.npz", "tile_0000.npz", "tile_0001.npz"}


def test_a_tile_that_is_being_mapped_is_not_removed(tmp_path):
    folder = tile_folder(tmp_path, 3)
    folder.mkdir(parents=True)
    with locked(folder), pytest.raises(RunFolderError, match="has been writing to this folder"):
        remove_tiles_from(tmp_path, 2)
    assert folder.is_dir()
