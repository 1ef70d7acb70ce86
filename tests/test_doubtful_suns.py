"""Suns that sparse points contradict: the map's landmarks tell the wrong ones, and clear the others."""

import math
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.evaluate.own_suns import own_suns
from photoclinometry.model.geometry import angle_between, so3_exp, tangent_basis
from photoclinometry.model.progress import no_progress
from photoclinometry.model.reflectance import published
from photoclinometry.model.warning import collected_warnings
from photoclinometry.pipeline.doubtful_suns import CheckDoubtfulSuns, largest_by_chance
from photoclinometry.pipeline.folder.stage import Keyed, Tools
from photoclinometry.pipeline.map_stages import IntermediateMap
from scenes import synthetic_scene

MODEL = published("lunar-lambert", "vesta")
WRONG = 3
"""The view whose Sun is wrong."""


def scene_with_one_sun_off(degrees, views=8):
    """A scene in which one Sun is stated to be elsewhere, and all to be certain to a twentieth of a degree."""
    scene = synthetic_scene(size=24, views=views, reflectance=MODEL, brightness_noise=0.003)
    off = so3_exp(math.radians(degrees) * tangent_basis(scene.views.sun_measured[WRONG])[:, 0])
    measured, sun = scene.views.sun_measured.copy(), scene.views.sun.copy()
    measured[WRONG] = off @ measured[WRONG]
    sun[WRONG] = scene.views.body_from_cam.rotation[WRONG] @ measured[WRONG]
    return replace(scene, views=replace(scene.views, sun_measured=measured, sun=sun)), scene.views.sun


def checked(scene, tmp_path):
    stage = CheckDoubtfulSuns(relit=Keyed(IntermediateMap(scene=scene), "a"), reflectance=MODEL, doubtful=("a", "b"))
    with collected_warnings() as warned:
        found = stage.make(Tools(progress=no_progress, scratch=tmp_path))
    return found, warned


def test_each_sun_is_found_by_itself():
    scene, true = scene_with_one_sun_off(8.0)
    found = own_suns(scene, MODEL, 300)
    wrong = np.arange(8) == WRONG
    assert found.off[WRONG] == pytest.approx(math.radians(8.0), abs=math.radians(2.0))
    assert (found.off[~wrong] < math.radians(2.0)).all()
    assert (angle_between(found.sun, true) < 4.0 * found.sigma + math.radians(0.1)).all()


def test_the_wrong_sun_is_named_and_sound_ones_are_cleared(tmp_path):
    scene, true = scene_with_one_sun_off(8.0)
    found, warned = checked(scene, tmp_path)
    assert np.flatnonzero(found.wrong).tolist() == [WRONG]
    assert [(each.code, each.view) for each in warned] == [("suns-moved", scene.views.name[WRONG])]
    np.testing.assert_array_equal(found.sun[0], scene.views.sun[0])
    assert angle_between(found.sun[WRONG], true[WRONG]) < math.radians(2.0)
    sound, warned = checked(scene_with_one_sun_off(0.0)[0], tmp_path)
    assert not sound.wrong.any()
    assert warned == []


def test_a_map_that_takes_the_wrong_sun_into_account_has_the_true_one(tmp_path):
    scene, true = scene_with_one_sun_off(8.0)
    found, _ = checked(scene, tmp_path)
    free = found.taken_into_account(scene)
    assert free.views.sun_sigma[WRONG] == pytest.approx(found.off[WRONG])
    assert free.views.sun_sigma[0] == scene.views.sun_sigma[0]
    options = AdjustOptions(uncertainty=False)
    held, freed = (adjust(each, options).scene.views.sun for each in (scene, free))
    assert angle_between(freed[WRONG], true[WRONG]) < 0.2 * angle_between(held[WRONG], true[WRONG])


@pytest.mark.parametrize("suns", [5, 12])
def test_in_one_site_of_a_hundred_a_sound_sun_is_called_wrong(suns):
    off = np.linalg.norm(np.random.default_rng(0).normal(size=(100_000, suns, 2)), axis=-1)
    assert np.mean((off > largest_by_chance(suns)).any(1)) == pytest.approx(0.01, abs=0.001)


def test_of_few_views_the_doubt_remains_and_is_said(tmp_path):
    scene, _ = scene_with_one_sun_off(8.0, views=4)
    found, warned = checked(scene, tmp_path)
    assert not found.wrong.any()
    assert np.isnan(found.off).all()
    assert [each.code for each in warned] == ["sun-undecided"]
    assert "(a, b), and 4 views do not tell" in warned[0].words
