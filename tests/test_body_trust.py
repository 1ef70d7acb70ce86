"""Whether a body's map is to be trusted."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from photoclinometry.body import products
from photoclinometry.body.tile_map import TileLandmarks, TileMap, TileTiePoints
from photoclinometry.body.trust import why_untrusted
from photoclinometry.model.warning import Warned

SOUND = TileMap(landmarks=TileLandmarks.none(), ties=TileTiePoints.none(), gsd=1.0)
FAILED = replace(SOUND, failure="no landmark is seen by enough views")
WRONG = replace(SOUND, distrust=("the joint estimate has not converged: it ran out of steps",))
WELL = np.array([0.9, 0.8, np.nan, 0.95])


def test_a_sound_body_is_trusted():
    assert why_untrusted([SOUND, SOUND, FAILED, WRONG], WELL, [Warned("tile-failed", "tile 2 is not mapped")]) == ()


def test_suns_that_contradict_one_tile_leave_the_others_trusted():
    """The check of Suns is that of a tile: a body's list of warnings has those of its tiles, too."""
    warned = Warned("most-suns-contradict", "the Sun directions and the brightness of the views contradict each other")
    assert why_untrusted([SOUND, SOUND, WRONG], WELL, [warned]) == ()


def test_a_body_most_of_whose_tiles_are_wrong_is_not_trusted():
    """The words are those of the more frequent kind."""
    (reason,) = why_untrusted([FAILED, SOUND, WRONG, WRONG], WELL, [])
    of = "tiles have no map or one that is not to be trusted, such as tile"
    assert reason == f"3 of 4 {of} 2: the joint estimate has not converged: it ran out of steps"
    (reason,) = why_untrusted([SOUND, FAILED, FAILED, replace(WRONG, failure=FAILED.failure)], WELL, [])
    assert reason == f"3 of 4 {of} 1: no landmark is seen by enough views"


def test_a_body_that_predicts_images_worse_than_even_disks_is_not_trusted():
    (reason,) = why_untrusted([SOUND], np.array([0.9, -0.5, np.nan, -2.0]), [])
    assert reason.startswith("renderings of the surface are 1.5 times as far off the images as disks of one brightness")
    assert why_untrusted([SOUND], np.array([np.nan]), []) == ()


@pytest.mark.parametrize(("saying", "trusted"), [(2, True), (3, False)])
def test_images_are_encoded_where_most_tiles_say_so(saying, trusted):
    """The response is that of all images; single tiles tell it badly."""
    model = SimpleNamespace(
        plan=SimpleNamespace(value=SimpleNamespace(tiles=[None] * 4)), site=SimpleNamespace(views=())
    )
    placed = SimpleNamespace(placed=np.zeros(0, bool))
    said = [Warned("response-not-linear", f"raised to the power 2.{n}") for n in range(saying)]
    warnings = products._of_the_body(said, model, placed)
    assert len(warnings) == (0 if trusted else saying)
    reasons = why_untrusted([SOUND] * 4, WELL, warnings)
    assert reasons == (() if trusted else ("the numbers of the images are not linear in radiance",))


@pytest.mark.parametrize("code", ["relief-by-shading", "relief-inverted"])
def test_a_body_whose_relief_is_inverted_is_not_trusted(code):
    (reason,) = why_untrusted([SOUND], WELL, [Warned(code, "brightness contradicts the slopes of the sparse model")])
    assert "hills for hollows" in reason
