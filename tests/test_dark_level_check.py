"""An offset that may be left in uncalibrated images is warned of where it would halve the relief."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.image import Image
from photoclinometry.model.warning import collected_warnings
from photoclinometry.pipeline.checks.dark_level_check import warn_of_dark_level
from scenes import synthetic_scene


def codes(brightness="dn", darkest=60.0, dark_level=0.0):
    """Of a map from images of a median of 100 whose darkest pixels are given."""
    scene = synthetic_scene(size=8, views=3)
    views = replace(scene.views, dark_level=np.array([0.0, dark_level, 0.0]))
    scene = replace(scene, brightness=brightness, views=views)
    pixels = np.linspace(darkest, 200.0 - darkest, 10_001).reshape(1, -1).astype(np.float32)
    valid = np.ones(pixels.shape, bool)
    images = [Image(name, pixels, valid) for name in views.name] + [Image("another", 0.0 * pixels, valid)]
    with collected_warnings() as warned:
        warn_of_dark_level(scene, images)
    return [each.code for each in warned]


@pytest.mark.parametrize(("darkest", "said"), [(60.0, ["dark-level-unknown"]), (40.0, [])])
def test_an_unknown_dark_level_is_warned_of_where_it_may_be_most_of_the_brightness(darkest, said):
    assert codes(darkest=darkest) == said


def test_calibrated_images_and_known_levels_are_not_warned_of():
    assert codes(brightness="iof") == []
    assert codes(dark_level=30.0) == []


def test_a_camera_without_shadows_is_warned_of_beside_one_that_has_them():
    """Levels belong to cameras: three views of two cameras, the second of which shows neither shadow nor sky."""
    scene = synthetic_scene(size=8, views=3)
    first = scene.views.cameras[0]
    second = replace(first, params=tuple(1.1 * value for value in first.params))

    def warned(levels, darkest):
        views = replace(scene.views, cameras=(first, second, second), dark_level=np.array(levels))
        images = []
        for name, level in zip(views.name, darkest, strict=True):
            pixels = np.linspace(level, 200.0 - level, 10_001).reshape(1, -1).astype(np.float32)
            images.append(Image(name, pixels, np.ones(pixels.shape, bool)))
        with collected_warnings() as found:
            warn_of_dark_level(replace(scene, brightness="dn", views=views), images)
        return [each.words for each in found]

    (words,) = warned([30.0, 0.0, 0.0], [0.0, 60.0, 70.0])
    assert f"2 of 3 uncalibrated images, {', '.join(scene.views.name[1:])}, which may be up to 65 %" in words
    assert warned([30.0, 0.0, 20.0], [0.0, 60.0, 60.0]) == [], "one image shows the level of its camera"
    assert warned([30.0, 0.0, 0.0], [0.0, 40.0, 40.0]) == []
    (words,) = warned([0.0, 0.0, 0.0], [60.0, 60.0, 60.0])
    assert "of these uncalibrated images, which may be up to 60 %" in words
