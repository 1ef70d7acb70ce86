"""Normals and albedos from brightness: recovered exactly, independent of neighbours, kept where nothing is seen."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.model.image import Image
from photoclinometry.model.reflectance import published
from photoclinometry.photometry.predict import observation_brightness
from photoclinometry.photometry.render import render_view
from photoclinometry.photometry.shading import brightness_on_surface, normals_from_shading, unresolved_detail
from photoclinometry.surface.map_rays import in_sunlight
from scenes import LUNAR_LAMBERT, from_zenith, synthetic_images, synthetic_scene


def blurred(scene, seed=0):
    """The scene with normals off by about 3 degrees and albedos off by 5 per cent."""
    rng = np.random.default_rng(seed)
    marks = scene.landmarks
    normal = unit(marks.normal + 0.05 * rng.normal(size=marks.normal.shape))
    albedo = marks.albedo * np.exp(0.05 * rng.normal(size=len(marks)))
    return replace(scene, landmarks=replace(marks, normal=normal, albedo=albedo))


@pytest.mark.parametrize(
    "model", [LUNAR_LAMBERT, *(published(disk, "vesta") for disk in ("mcewen", "akimov+", "hapke"))]
)
def test_true_normals_and_albedos_are_found_from_exact_brightness(model):
    scene = synthetic_scene(size=12, views=8, reflectance=model)
    found = normals_from_shading(blurred(scene), iterations=20).landmarks
    assert np.median(angle_between(found.normal, scene.landmarks.normal)) < np.radians(0.1)
    np.testing.assert_allclose(found.albedo, scene.landmarks.albedo, rtol=0.01)
    np.testing.assert_array_equal(found.position, scene.landmarks.position)


def test_noise_leaves_normals_near_what_the_measurements_allow():
    """One percent of noise in eight views: about a degree, and residuals no larger than before."""
    scene = synthetic_scene(size=16, views=8, brightness_noise=0.01)
    start = blurred(scene)
    found = normals_from_shading(start)
    off = np.degrees(angle_between(found.landmarks.normal, scene.landmarks.normal))
    assert np.median(off) < 1.5
    before, after = (np.std(s.tracks.brightness - observation_brightness(s)) for s in (start, found))
    assert after < 0.5 * before


def test_landmarks_without_light_stay_and_do_not_touch_others():
    scene = blurred(synthetic_scene(size=10, views=6))
    dark = scene.tracks.landmark < 30
    half = replace(scene, tracks=replace(scene.tracks, lit=~dark))
    found, whole = normals_from_shading(half).landmarks, normals_from_shading(scene).landmarks
    np.testing.assert_allclose(found.normal[:30], scene.landmarks.normal[:30], atol=1e-12)
    np.testing.assert_allclose(found.albedo[:30], scene.landmarks.albedo[:30], rtol=1e-12)
    np.testing.assert_allclose(found.normal[30:], whole.normal[30:], atol=2e-3)


@pytest.mark.parametrize("views", [1, 2])
def test_with_too_few_views_normals_stay_near_their_start(views):
    """Residuals vanish after the first fit; what is not determined stays near its start."""
    scene = synthetic_scene(size=12, views=6, brightness_noise=0.03)
    lit = scene.tracks.view < views
    found = normals_from_shading(normals_from_shading(replace(scene, tracks=replace(scene.tracks, lit=lit))))
    assert np.degrees(angle_between(found.landmarks.normal, scene.landmarks.normal)).max() < 15.0
    np.testing.assert_allclose(np.linalg.norm(found.landmarks.normal, axis=-1), 1.0)


def test_one_shadowed_view_moves_normals_by_less_than_two_degrees():
    scene = synthetic_scene(size=12, views=10)
    brightness = scene.tracks.brightness.copy()
    brightness[3::10] *= 0.3
    found = normals_from_shading(replace(scene, tracks=replace(scene.tracks, brightness=brightness))).landmarks
    assert np.degrees(np.median(angle_between(found.normal, scene.landmarks.normal))) < 2.0


def test_brightness_is_taken_where_the_surface_projects_not_at_the_keypoints():
    scene = synthetic_scene(size=24, views=4, keypoint_noise_px=1.0)
    found = brightness_on_surface(scene, synthetic_images(scene)).tracks
    assert found.lit.all()
    np.testing.assert_allclose(found.brightness, observation_brightness(scene), rtol=0.01)
    np.testing.assert_array_equal(found.keypoint, scene.tracks.keypoint)


def test_brightness_in_a_cast_shadow_of_the_map_is_not_lit():
    scene = synthetic_scene(size=40, views=3)
    sun = scene.views.sun.copy()
    sun[1] = from_zenith(np.radians(82.0), np.array(0.3))
    low = replace(scene, views=replace(scene.views, sun=sun))
    found = brightness_on_surface(low, synthetic_images(scene)).tracks
    clear = in_sunlight(low, sun[1])
    assert 0.1 < clear.mean() < 0.9
    np.testing.assert_array_equal(found.lit[found.view == 1], clear)
    assert found.lit[found.view != 1].all()


def test_a_view_coarser_than_the_map_agrees_with_it_about_detail():
    """Its image is the map's own rendering, averaged over pixels of twice the size: as the map knows what they average
    over, no brightness is off by more than interpolation; without that, by the detail of 30 % of albedo."""
    scene = synthetic_scene(size=40, views=4)
    rough = replace(
        scene.landmarks,
        albedo=scene.landmarks.albedo * np.random.default_rng(0).uniform(0.7, 1.3, len(scene.landmarks)),
    )
    camera = scene.views.cameras[0]
    coarse = Camera("PINHOLE", camera.width // 2, camera.height // 2, tuple(np.divide(camera.params, 2)))
    views = replace(scene.views, cameras=(*scene.views.cameras[:3], coarse))
    scene = replace(scene, landmarks=rough, views=views)
    images = []
    for k in range(4):
        brightness, valid = render_view(scene, k)
        images.append(Image(scene.views.name[k], brightness.astype(np.float32), valid))
    tracks = brightness_on_surface(scene, images).tracks
    mine = tracks.lit & (tracks.view == 3)
    predicted = observation_brightness(scene)
    assert mine.sum() > 1000
    assert np.std((tracks.brightness / predicted - 1.0)[mine]) < 0.04
    unaided = tracks.brightness - unresolved_detail(scene, 3)[tracks.landmark]
    assert np.std((unaided / predicted - 1.0)[mine]) > 0.15


def test_geometry_alone_has_no_detail_to_add():
    scene = synthetic_scene(size=12, views=3, reflectance=None)
    np.testing.assert_array_equal(unresolved_detail(scene, 1), np.zeros(144))
