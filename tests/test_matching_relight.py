"""Relighting: moved light causes no displacement, geometry is found, shadows and hidden ground do not match."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from photoclinometry.matching.dense import match_views
from photoclinometry.matching.flow import FlowMatcher
from photoclinometry.matching.interface import MatchSetup
from photoclinometry.matching.relight import RelightMatcher, RelitReference, map_depth
from photoclinometry.model.errors import InputError
from photoclinometry.surface.map_rays import in_sunlight
from scenes import from_zenith, synthetic_images, synthetic_scene

SIZE = 72


@pytest.fixture(scope="module")
def bumps():
    """A scene that explains its images exactly, and these; Suns all around."""
    scene = synthetic_scene(size=SIZE, views=4)
    return scene, synthetic_images(scene)


def request_of(scene, images, view, shift=(0.0, 0.0)):
    """Match `view`, expected where it truly is, but for a shift [px]."""
    views = scene.views
    poses, region = views.body_from_cam, scene.region
    setup = MatchSetup(
        images=images, cameras=views.cameras, body_from_cam=poses, reference=0, region=region, margin_px=12
    )
    request = setup.request(view, map_depth(scene, setup.padded))
    return replace(request, prediction=request.prediction + np.array(shift))


def error_px(matches, scene, view):
    true = scene.views.project(view, scene.landmarks.position).reshape(SIZE, SIZE, 2)
    return np.linalg.norm(matches.position - true, axis=-1)[matches.valid]


@pytest.mark.parametrize("view", [1, 2, 3])
def test_moved_light_displaces_flow_but_not_the_relit_reference(bumps, view):
    scene, images = bumps
    request = request_of(scene, images, view)
    relit, plain = RelightMatcher(scene).match(request), FlowMatcher().match(request)
    assert relit.valid.mean() > 0.95
    assert np.median(error_px(relit, scene, view)) < 0.03
    assert np.median(error_px(plain, scene, view)) > 5 * np.median(error_px(relit, scene, view))


def test_threads_match_as_one_does(bumps, monkeypatch):
    scene, images = bumps
    poses, region = scene.views.body_from_cam, scene.region
    setup = MatchSetup(images=images, cameras=scene.views.cameras, body_from_cam=poses, reference=0, region=region)
    depth, reports, found = map_depth(scene, setup.padded), [], {}
    for threads in (1, 3):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        matcher = RelightMatcher(scene)
        found[threads] = match_views(
            setup, [1, 2, 3], matcher, depth, lambda what, done, total: reports.append((what, done, total)), "relit"
        )
    assert reports == 2 * [("relit", done, 3) for done in range(4)]
    for view in (1, 2, 3):
        for name in ("position", "sigma_px", "valid"):
            np.testing.assert_array_equal(getattr(found[3][view], name), getattr(found[1][view], name))


def test_a_displacement_is_found_under_moved_light(bumps):
    scene, images = bumps
    matches = RelightMatcher(scene).match(request_of(scene, images, 1, shift=(0.9, -0.6)))
    assert matches.valid.mean() > 0.9
    edge = np.pad(np.zeros((SIZE - 16, SIZE - 16), bool), 8, constant_values=True)  # beyond it there is no map
    inner = replace(matches, valid=matches.valid & ~edge)
    assert np.median(error_px(inner, scene, 1)) < 0.1  # of 1.08, on ground without texture finer than 8 px


def test_the_relit_reference_is_the_view_up_to_gain(bumps):
    scene, images = bumps
    picture, mask = RelitReference(scene)(2, images[0])
    seen = scene.tracks.brightness[scene.tracks.view == 2].reshape(SIZE, SIZE)
    assert mask.all()
    np.testing.assert_allclose(picture, seen, rtol=2e-3)


def test_gain_and_bias_of_both_images_do_not_matter(bumps):
    scene, images = bumps
    views = replace(scene.views, scale=np.array([3.0, 0.5, 1.0, 1.0]), bias=np.array([0.1, -0.02, 0.0, 0.0]))
    exposed = replace(scene, views=views)
    pair = zip(images, views.scale, views.bias, strict=True)
    changed = [replace(i, brightness=(gain * i.brightness + bias).astype(np.float32)) for i, gain, bias in pair]
    first = RelightMatcher(scene).match(request_of(scene, images, 1))
    second = RelightMatcher(exposed).match(request_of(exposed, changed, 1))
    np.testing.assert_allclose(second.position, first.position, atol=0.02)


def test_ground_that_the_map_shades_or_hides_is_not_matched(bumps):
    """The Sun of view 1 is put 8 degrees above the horizon: half of the ground lies in cast shadow."""
    scene, images = bumps
    sun = scene.views.sun.copy()
    sun[1] = from_zenith(np.radians(82.0), np.array(0.3))
    low = replace(scene, views=replace(scene.views, sun=sun))
    dark = ~in_sunlight(low, sun[1]).reshape(SIZE, SIZE)
    assert 0.1 < dark.mean() < 0.9
    _, mask = RelitReference(low)(1, images[0])
    assert not mask[dark].any()
    assert mask.any()
    assert not RelightMatcher(low).match(request_of(low, images, 1)).valid[dark].any()


def test_ground_hidden_from_the_camera_is_masked(bumps):
    scene, images = bumps
    center = scene.views.body_from_cam.translation.copy()
    center[1] = np.linalg.norm(center[1]) * from_zenith(np.radians(82.0), np.array(0.3))
    pose = replace(scene.views.body_from_cam, translation=center)
    sun = scene.views.sun.copy()
    sun[1] = sun[0]
    oblique = replace(scene, views=replace(scene.views, body_from_cam=pose, sun=sun))
    hidden = ~in_sunlight(oblique, center[1]).reshape(SIZE, SIZE)  # so far away, the camera's rays are parallel
    assert 0.1 < hidden.mean() < 0.9
    _, mask = RelitReference(oblique)(1, images[0])
    assert mask[hidden].mean() < 0.02


def test_where_the_reference_is_in_shadow_the_model_is_drawn(bumps):
    scene, images = bumps
    dark = images[0].brightness.copy()
    row, col = scene.region.row, scene.region.col
    dark[row + 30 : row + 40, col + 30 : col + 40] = 0.0
    spoiled = [replace(images[0], brightness=dark), *images[1:]]
    matches = RelightMatcher(scene).match(request_of(scene, spoiled, 1))
    assert matches.valid[30:40, 30:40].all()
    assert np.median(error_px(matches, scene, 1)) < 0.02


def test_a_view_that_the_scene_does_not_hold_is_refused(bumps):
    scene, images = bumps
    request = request_of(scene, images, 1)
    with pytest.raises(InputError, match="stranger: not a view of the scene"):
        RelightMatcher(scene).match(replace(request, target=replace(images[1], name="stranger")))


def test_depth_is_exact_at_landmarks_and_filled_between_them(bumps):
    scene, _ = bumps
    kept = np.arange(len(scene.landmarks)) % 7 != 0
    depth = map_depth(replace(scene, landmarks=scene.landmarks[kept]), scene.region).ravel()
    true = scene.views.depth(0, scene.landmarks.position)
    np.testing.assert_array_equal(depth[kept], true[kept])
    assert np.median(np.abs(depth - true)[~kept]) < 0.3 * scene.gsd
