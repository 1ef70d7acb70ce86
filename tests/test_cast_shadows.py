"""The ground around a map goes to where it casts the shadows that images show: rules by hand, and a ridge recovered."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.image import Image
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Surroundings
from photoclinometry.photometry.cast_shadows import PAST_GSD, SIGMA_GSD, _shift, surroundings_by_shadows
from photoclinometry.photometry.render import render_view
from photoclinometry.surface.map_rays import MapRays, in_sunlight
from scenes import GSD, level, look_at_origin, synthetic_scene

DISTANCE = 600e3
FREE = (0.25, 0.3, 0.35, 0.4, 0.45)
"""Tangents of the Suns' elevations."""
UNSEEN = 0.325


def flat_scene():
    """Level ground, 40 by 40 landmarks, seen from above; the Sun right of it at five elevations, one a view."""
    scene = synthetic_scene(size=40, views=len(FREE))
    pose = look_at_origin(np.array([0.0, 0.0, DISTANCE]), 0.0)
    poses = Rigid(np.tile(pose.rotation, (len(FREE), 1, 1)), np.tile(pose.translation, (len(FREE), 1)))
    suns = np.stack([sun_from_the_right(pose, slope) for slope in FREE])
    seen = level(replace(scene, views=replace(scene.views, body_from_cam=poses, sun=suns)), DISTANCE)
    return replace(seen, landmarks=replace(seen.landmarks, albedo=np.full(len(seen.landmarks), 0.3)))


def sun_from_the_right(pose, slope):
    sun = pose.rotation @ np.array([1.0, 0.0, -slope])
    return sun / np.linalg.norm(sun)


def ridge(scene, height_gsd):
    """Level ground around the map with a ridge 8 to 16 px right of it, as high as told from top to bottom (rows,)."""
    camera, region = scene.views.cameras[0], scene.region
    frame = Region.of_image(camera.height, camera.width, stride=4)
    depth = np.full(frame.grid_shape, DISTANCE)
    column = 4 * np.arange(depth.shape[1])
    edge = region.col + region.width
    depth[:, (column >= edge + 8) & (column <= edge + 16)] -= GSD * np.broadcast_to(height_gsd, len(depth))[:, None]
    return Surroundings(depth=depth, stride=4)


def images_of(scene):
    """What the cameras see, shadows included."""
    rendered = [(name, *render_view(scene, k, cast_shadows=True)) for k, name in enumerate(scene.views.name)]
    return [Image(name=name, brightness=seen.astype(np.float32), valid=mask) for name, seen, mask in rendered]


@pytest.fixture(scope="module")
def flat():
    return flat_scene()


@pytest.mark.parametrize("begin", [0.0, 4.0, 11.0])
def test_a_ridge_gets_the_height_whose_shadows_the_images_show(flat, begin):
    """From no ridge, a lower and a higher one, for a Sun that no image has, too."""
    rows = np.arange(len(ridge(flat, 0.0).depth))
    height = 7.5 + np.sin(rows / 3.0)
    true = replace(flat, surroundings=ridge(flat, height))
    given_ground = ridge(flat, begin * np.ones(len(rows)))
    found = surroundings_by_shadows(replace(flat, surroundings=given_ground), images_of(true))
    sun = sun_from_the_right(flat.views.body_from_cam[0], UNSEEN)
    lit, before, after = (in_sunlight(flat, sun, around) for around in (true.surroundings, given_ground, found))
    assert 0.2 < lit.mean() < 0.8
    assert np.mean(before != lit) > 0.1
    assert np.mean(after != lit) < 0.04


def test_ground_that_explains_all_shadows_stays(flat):
    true = replace(flat, surroundings=ridge(flat, 7.5))
    assert surroundings_by_shadows(true, images_of(true)) is true.surroundings


def test_shadows_of_the_map_itself_move_nothing_around_it(flat):
    """A tower of the map is no reason to raise the ground behind it."""
    position, wide = flat.landmarks.position.copy(), (flat.grid(np.arange(1600.0)) % 40 >= 30).ravel()
    position[wide] += 8 * GSD * flat.landmarks.normal[wide]
    tower = replace(flat, landmarks=replace(flat.landmarks, position=position), surroundings=ridge(flat, 0.0))
    assert np.mean(in_sunlight(tower, tower.views.sun[0])) < 0.8
    assert surroundings_by_shadows(tower, images_of(tower)) is tower.surroundings


def test_without_ground_around_there_is_nothing_to_fit(flat):
    assert surroundings_by_shadows(replace(flat, surroundings=None), []) is None


def test_geometry_alone_predicts_no_light(flat):
    scene = replace(flat, surroundings=ridge(flat, 7.5), reflectance=None)
    with pytest.raises(InputError, match="holds geometry alone"):
        surroundings_by_shadows(scene, images_of(replace(flat, surroundings=scene.surroundings)))


@given(st.integers(0, 2**32 - 1))
def test_a_ray_meets_the_ground_around_where_its_node_says_so(flat, seed):
    """And touches it once that node alone is as much deeper as told."""
    rng, depth = np.random.default_rng(seed), ridge(flat, 0.0).depth
    depth = depth + 4 * GSD * rng.standard_normal(depth.shape)
    around = Surroundings(depth=depth, stride=4)
    sun = sun_from_the_right(flat.views.body_from_cam[0], rng.uniform(0.1, 0.5))
    high = 40 * GSD
    decided = MapRays(flat, around).decided(sun, high)
    assert MapRays(flat).unoccluded_towards(sun).all()
    np.testing.assert_array_equal(decided.below > 0.0, ~in_sunlight(flat, sun, around))
    j = rng.choice(np.flatnonzero(decided.node >= 0))
    for factor, meets in ((0.999, True), (1.001, False)):
        moved = depth.copy()
        moved.flat[decided.node[j]] += decided.below[j] * factor
        if decided.below[j] < 0.0:
            meets = not meets
        again = MapRays(flat, Surroundings(depth=moved, stride=4)).of(np.array([j])).decided(sun, high)
        if again.node[0] == decided.node[j]:  # no other place on the ray decides it now
            assert (again.below[0] > 0.0) == meets


def test_a_node_goes_as_far_as_its_rays_gain_and_no_farther():
    """In standard deviations, by hand: shaded rays 0.1 and 0.2 above the ground, a lit one 0.5 above it."""
    past = PAST_GSD / SIGMA_GSD
    below, shaded = np.array([-0.5, -0.2, -0.1]), np.array([False, True, True])
    assert _shift(below, shaded, 0.0) == pytest.approx(-0.2 - past)
    assert _shift(below, ~shaded, 0.0) == 0.0
    assert _shift(-below, ~shaded, 0.0) == pytest.approx(0.2 + past)
    # Two wrong rays are worth no move of more than two standard deviations, 0.5 x 2^2, from where the node began.
    assert _shift(below - 2.0, shaded, 0.0) == 0.0
    assert _shift(below - 2.0, shaded, 1.0) == pytest.approx(-2.2 - past)
    # Between two rays closer to each other than it would go past one, a node goes halfway.
    assert _shift(np.array([-0.200, -0.199]), np.array([False, True]), 0.0) == pytest.approx(-0.1995)
