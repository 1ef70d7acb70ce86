"""Views that are less sharp than the map: how much, and that they are named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.model.sampling import gaussian, masked_filter
from photoclinometry.model.warning import collected_warnings
from photoclinometry.photometry.predict import observation_brightness
from photoclinometry.photometry.sharpness import blur_px
from photoclinometry.pipeline import checked_map
from photoclinometry.pipeline.checks.blurred_views import BLURRED_PX, views_to_leave_out, warn_of_blurred_views
from photoclinometry.pipeline.options import RunOptions
from scenes import synthetic_scene


@pytest.fixture(scope="module")
def true():
    """A scene whose albedo has detail of the size of a landmark, with brightness as predicted, and a little noise."""
    scene = synthetic_scene(size=60, views=5)
    rng = np.random.default_rng(0)
    albedo = scene.landmarks.albedo * (1.0 + 0.1 * rng.standard_normal(len(scene.landmarks)))
    scene = replace(scene, landmarks=replace(scene.landmarks, albedo=albedo))
    predicted = observation_brightness(scene)
    noisy = predicted * (1.0 + 0.005 * rng.standard_normal(len(predicted)))
    return replace(scene, tracks=replace(scene.tracks, brightness=noisy))


def with_blurred_view(scene, view, width):
    """Brightness of one view averaged over `width` landmarks."""
    brightness, seen = scene.tracks.brightness.copy(), np.flatnonzero(scene.tracks.view == view)
    average = masked_filter(scene.grid_of_observations(brightness, seen), gaussian(width))[0]
    brightness[seen] = average[scene.cells][scene.tracks.landmark[seen]]
    return replace(scene, tracks=replace(scene.tracks, brightness=brightness))


@pytest.mark.parametrize("width", [0.85, 1.2, 1.7, 2.4])
def test_the_width_of_a_blur_is_found(true, width):
    """In pixels of the view, whose ground sample is not that of the reference view."""
    found = blur_px(with_blurred_view(true, 3, width))
    expected = width * true.spacing / true.views.gsd(3, true.landmarks.position)
    assert found[3] == pytest.approx(expected, rel=0.1)
    assert np.delete(found, 3).max() < 0.3


def test_sharp_views_have_no_blur_whatever_their_scale_and_smooth_errors(true):
    tracks = true.tracks
    column = true.landmarks.pixel[tracks.landmark, 0]
    wrong = tracks.brightness * (0.5 + 0.1 * tracks.view) * (1.0 + 0.1 * np.sin(column / 30.0))
    assert blur_px(replace(true, tracks=replace(tracks, brightness=wrong))).max() < 0.3


def test_wrong_detail_of_the_map_is_no_blur_of_the_views(true):
    """A smoother prediction would be likest to them; their own contrast is all there."""
    rng = np.random.default_rng(1)
    albedo = true.landmarks.albedo * (1.0 + 0.1 * rng.standard_normal(len(true.landmarks)))
    assert blur_px(replace(true, landmarks=replace(true.landmarks, albedo=albedo))).max() < 0.3


def test_nothing_is_said_of_a_view_that_shows_too_little(true):
    few = true.tracks.lit & ((true.tracks.view != 1) | (true.tracks.landmark < 150))
    found = blur_px(replace(true, tracks=replace(true.tracks, lit=few)))
    assert np.isnan(found[1])
    assert np.isfinite(np.delete(found, 1)).all()


def test_a_blurred_view_is_named_and_sharp_ones_are_not(true):
    with collected_warnings() as warned:
        warn_of_blurred_views(true)
        assert warned == []
        warn_of_blurred_views(with_blurred_view(true, 2, 2.0 * BLURRED_PX))
    assert [(each.code, each.view) for each in warned] == [("view-blurred", true.views.name[2])]


def test_a_scene_of_geometry_alone_is_left_in_peace(true):
    with collected_warnings() as warned:
        warn_of_blurred_views(replace(with_blurred_view(true, 2, 2.0), reflectance=None))
    assert warned == []


def test_of_several_blurred_views_those_go_that_one_more_blurred_does_not_explain(true):
    """Blurred by 2, 2.4 and, less than half of that, 1.1 landmarks, which is less of a view's pixels."""
    three = with_blurred_view(with_blurred_view(with_blurred_view(true, 1, 2.0), 3, 2.4), 4, 1.1)
    blur = blur_px(three)
    assert blur[4] > BLURRED_PX
    found = views_to_leave_out(three, fewest=2)
    assert list(found) == [3, 1]
    assert [found[3], found[1]] == pytest.approx([blur[3], blur[1]])


def test_no_view_goes_whose_loss_leaves_too_few_nor_the_reference(true):
    two = with_blurred_view(with_blurred_view(true, 1, 2.0), 3, 2.4)
    assert list(views_to_leave_out(two, fewest=4)) == [3]
    assert views_to_leave_out(two, fewest=5) == {}
    assert views_to_leave_out(replace(two, reference=3), fewest=2).keys() == {1}
    assert views_to_leave_out(true, fewest=2) == {}
    assert views_to_leave_out(replace(two, reflectance=None), fewest=2) == {}


@pytest.mark.parametrize(
    ("with_prior", "left_out"), [((), [3, 1]), ((0, 2, 4), [3, 1]), ((0, 1, 2), [3]), ((0, 1, 2, 3), [3])]
)
def test_no_view_goes_without_whose_prior_the_frame_would_not_be_held(true, with_prior, left_out):
    """The first map is in the priors' frame, and three of them hold it at least."""
    two = with_blurred_view(with_blurred_view(true, 1, 2.0), 3, 2.4)
    first = SimpleNamespace(scene=two, is_start_of_last=False)
    options = RunOptions(densify=DensifyOptions(min_views=2))
    priors = {true.views.name[k]: None for k in with_prior}
    found = checked_map._blurred(first, SimpleNamespace(options=options), priors)
    assert list(found) == [true.views.name[k] for k in left_out]
