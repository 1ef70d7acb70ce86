"""An error that all Suns have in common: told by brightness, warned of where it is clear, and allowed for in maps."""

import math
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.evaluate.common_sun import common_sun_turn
from photoclinometry.model.geometry import angle_between, so3_exp
from photoclinometry.model.progress import no_progress
from photoclinometry.model.reflectance import published
from photoclinometry.model.warning import collected_warnings
from photoclinometry.pipeline.common_sun_error import CheckSuns, CommonSunError
from photoclinometry.pipeline.folder.stage import Keyed, Tools
from photoclinometry.pipeline.map_stages import IntermediateMap
from scenes import synthetic_scene

MODEL = published("lunar-lambert", "vesta")
TURN = np.radians([1.5, -1.0, 0.0])
"""From the Suns as they are stated to be to the true ones."""


def scene_with_suns_off(turn=TURN, views=8):
    """A scene whose measured Suns all are off by one rotation, and stated to be certain to a twentieth of a degree."""
    scene = replace(synthetic_scene(size=24, views=views, reflectance=MODEL, brightness_noise=0.003), body="vesta")
    measured = scene.views.sun_measured @ so3_exp(turn)  # rows: the inverse rotation of each
    return replace(scene, views=replace(scene.views, sun_measured=measured, sun_common_sigma=np.zeros(views)))


def checked(scene, tmp_path):
    stage = CheckSuns(relit=Keyed(IntermediateMap(scene=scene), "a"), reflectance=MODEL)
    with collected_warnings() as warnings:
        found = stage.make(Tools(progress=no_progress, scratch=tmp_path))
    return found, [warning.code for warning in warnings]


def test_the_turn_is_found_within_its_sigma():
    turn, sigma = common_sun_turn(scene_with_suns_off(), MODEL, 300)
    assert (np.abs(turn - TURN) < 4 * sigma + math.radians(0.05)).all()
    assert (np.abs(turn - TURN)[:2] < math.radians(0.3)).all()


def test_suns_that_are_off_are_warned_of_and_sound_ones_are_not(tmp_path):
    off, said = checked(scene_with_suns_off(), tmp_path)
    assert off.is_clear
    assert said == ["suns-moved"]
    sound, said = checked(scene_with_suns_off(turn=np.zeros(3)), tmp_path)
    assert not sound.is_clear
    assert said == []


def test_an_error_that_is_stated_is_not_warned_of(tmp_path):
    scene = scene_with_suns_off()
    stated = replace(scene.views, sun_common_sigma=np.full(8, math.radians(2.0)))
    found, said = checked(replace(scene, views=stated), tmp_path)
    assert not found.is_clear
    assert said == []


def test_too_few_views_tell_nothing(tmp_path):
    found, said = checked(scene_with_suns_off(views=4), tmp_path)
    assert np.isnan(found.turn).all()
    assert not found.is_clear
    assert said == []


@pytest.mark.parametrize(
    ("turn_deg", "sigma_deg", "clear"),
    [
        ((0.0, 2.0, 0.0), (0.1, 0.1, 0.1), True),
        ((0.0, 2.0, 0.0), (0.1, 0.5, 0.1), False),  # four sigmas
        ((0.0, 0.4, 0.0), (0.01, 0.01, 0.01), False),  # what models miss
        ((0.1, 0.1, 4.0), (0.1, 0.1, 2.0), False),  # the axis that images tell least
    ],
)
def test_a_turn_is_clear_where_it_is_large_and_certain(turn_deg, sigma_deg, clear):
    assert CommonSunError(turn=np.radians(turn_deg), sigma=np.radians(sigma_deg)).is_clear == clear


def test_the_map_that_allows_for_it_has_the_normals_of_one_with_right_suns():
    """Held to the wrong Suns, normals are more than half of the error of the Suns off; else as with the right ones."""
    options = AdjustOptions(uncertainty=False)
    truth = scene_with_suns_off(turn=np.zeros(3))
    scene = scene_with_suns_off()
    scene = replace(scene, views=scene.views.at_poses(scene.views.body_from_cam))
    found = CommonSunError(turn=TURN, sigma=np.radians([0.1, 0.1, 0.5]))

    def error(start):
        normal = adjust(start, options).scene.landmarks.normal
        return math.degrees(np.mean(angle_between(normal, truth.landmarks.normal)))

    held, allowed, right = error(scene), error(found.taken_into_account(scene)), error(truth)
    assert held > 0.9
    assert allowed < right + 0.15


def test_what_is_stated_of_the_common_error_is_not_made_smaller():
    scene = scene_with_suns_off()
    stated = replace(scene.views, sun_common_sigma=np.full(8, math.radians(5.0)))
    views = CommonSunError(turn=TURN, sigma=np.full(3, 1e-3)).taken_into_account(replace(scene, views=stated)).views
    np.testing.assert_array_equal(views.sun_common_sigma, np.full(8, math.radians(5.0)))
    in_cam = np.einsum("kji,kj->ki", views.body_from_cam.rotation, views.sun)
    np.testing.assert_allclose(in_cam, scene.views.sun_measured @ so3_exp(TURN).T, atol=1e-12)
