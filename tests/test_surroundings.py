"""The ground around a map: fitted to sparse points, with shadows on the map of the length that trigonometry gives."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Surroundings
from photoclinometry.model.sparse import SparseModel
from photoclinometry.photometry.render import render_reference
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.surface.map_rays import in_sunlight
from photoclinometry.surface.relief import local_frame, sun_from_angles
from photoclinometry.surface.surroundings import (
    FINEST,
    MIN_POINTS,
    NODES,
    NOISE_GSD,
    REACH_PX,
    carried_along,
    surroundings_of,
)
from scenes import GSD, bumpy_surface, level, look_at_origin, synthetic_scene

DISTANCE = 600e3
CAMERA = Camera("PINHOLE", 200, 160, (1e4, 1e4, 100.0, 80.0))
REGION = Region(row=60, col=70, height=40, width=40)


def around(points, seen_from):
    """A sparse model of points (P, 3), all seen by one view in each of the poses; the first is the reference."""
    poses = Rigid(np.stack([p.rotation for p in seen_from]), np.stack([p.translation for p in seen_from]))
    count = len(seen_from)
    return SparseModel(
        registered=np.ones(count, bool),
        body_from_cam=poses,
        points=points,
        point_start=np.arange(0, count * len(points) + 1, count),
        point_view=np.tile(np.arange(count, dtype=np.int32), len(points)),
        point_xy=np.zeros((count * len(points), 2)),
        mean_reprojection_px=0.3,
    )


def ground(pose, camera=CAMERA):
    """Where the rays of all pixels meet the bumps: (h, w, 3), and their depths (h, w)."""
    frame = Region.of_image(camera.height, camera.width)
    rays = camera.ray_in_cam(frame.pixel_centers()) @ pose.rotation.T
    point = bumpy_surface().hit(np.broadcast_to(pose.translation, rays.shape), rays)
    return point, pose.inverse()(point)[..., 2]


@pytest.fixture(scope="module")
def poses():
    return [look_at_origin(np.array([x, 0.0, DISTANCE]), 0.1) for x in (0.0, 2e5)]


def landmarks_of(point):
    row, col = np.divmod(np.arange(REGION.height * REGION.width), REGION.width)
    pixel = np.stack([row + REGION.row, col + REGION.col], -1)
    return point[pixel[:, 0], pixel[:, 1]], pixel


def test_the_surface_passes_through_sparse_points_and_ends_where_there_are_none(poses):
    """600 points on half of the image: bumps of 8 to 25 px but for a sixth of their variance; nothing farther off."""
    point, depth = ground(poses[0])
    rng = np.random.default_rng(0)
    row, col = rng.integers(0, 160, 1200), rng.integers(0, 110, 1200)
    found = surroundings_of(around(point[row, col], poses), 0, REGION, *landmarks_of(point), CAMERA)
    assert found.stride == FINEST
    assert found.depth.shape == (40, 50)
    known = np.isfinite(found.depth)
    cols = FINEST * np.arange(50)
    rows = FINEST * np.arange(40)
    on_map = (np.abs(rows + 0.5 - 80) < 24)[:, None] & (np.abs(cols + 0.5 - 90) < 24)
    np.testing.assert_array_equal(known[:, cols <= 110], ~on_map[:, cols <= 110])
    assert not known[:, cols > 111 + REACH_PX].any()
    off = (found.depth - depth[::FINEST, ::FINEST])[:, cols <= 108] / GSD
    assert np.nanmedian(off) == pytest.approx(NOISE_GSD, abs=0.05)
    assert np.nanstd(off) < 0.4 * np.std(depth / GSD)


def test_points_hidden_from_the_reference_are_left_out(poses):
    """Points of the far side of a small body, seen only from behind, change nothing."""
    point, _ = ground(poses[0])
    rng = np.random.default_rng(1)
    here = point[rng.integers(0, 160, 500), rng.integers(0, 200, 500)]
    behind = look_at_origin(np.array([0.0, 0.0, -DISTANCE]), 0.0)
    both = around(np.concatenate([here, here - [0.0, 0.0, 1e4]]), [*poses, behind])
    # The first half is seen by the two views in front, the second by the one behind.
    seen = np.where(np.repeat(np.arange(1000) < 500, 3), both.point_view < 2, both.point_view == 2)
    count = np.add.reduceat(seen, both.point_start[:-1])
    both = replace(
        both,
        point_start=np.concatenate([[0], np.cumsum(count)]),
        point_view=both.point_view[seen],
        point_xy=both.point_xy[seen],
    )
    alone = surroundings_of(around(here, poses), 0, REGION, *landmarks_of(point), CAMERA)
    found = surroundings_of(both, 0, REGION, *landmarks_of(point), CAMERA)
    np.testing.assert_allclose(found.depth, alone.depth, equal_nan=True)


def test_a_map_of_all_that_the_points_show_has_no_surroundings(poses):
    point, _ = ground(poses[0])
    row, col = np.divmod(np.arange(1600), 40)
    few = point[: MIN_POINTS - 1, 0]
    sparse = around(np.concatenate([point[row + REGION.row, col + REGION.col], few]), poses)
    assert surroundings_of(sparse, 0, REGION, *landmarks_of(point), CAMERA) is None


def test_nodes_are_coarser_in_larger_images(poses):
    large = replace(CAMERA, width=1000, height=800, params=(1e4, 1e4, 500.0, 400.0))
    xy = np.random.default_rng(2).uniform(0.0, 800.0, (400, 2))
    points = poses[0](DISTANCE * large.ray_in_cam(xy))
    pixel = np.array([REGION.row, REGION.col]) + np.stack(np.divmod(np.arange(1600), 40), -1)
    on_map = poses[0](DISTANCE * large.ray_in_cam(pixel[:, ::-1] + 0.5))
    found = surroundings_of(around(points, poses), 0, REGION, on_map, pixel, large)
    assert found.stride == 7
    assert max(found.depth.shape) <= NODES


def test_a_wall_beside_the_map_shades_it_as_far_as_trigonometry_gives():
    """A wall 10 GSD high, its top 8 px right of the map, Sun 22 degrees high behind it: 25 px of shadow, 17 of them on
    the map, to a node's width."""
    scene = level(synthetic_scene(size=40, views=2), DISTANCE)
    camera, region = scene.views.cameras[0], scene.region
    frame = Region.of_image(camera.height, camera.width, stride=4)
    depth = np.full(frame.grid_shape, DISTANCE)
    edge = region.col + region.width
    wall = (4 * np.arange(depth.shape[1]) >= edge + 8) & (4 * np.arange(depth.shape[1]) < edge + 16)
    depth[:, wall] -= 10 * GSD
    slope = 0.4
    sun = scene.views.body_from_cam[0].rotation @ np.array([1.0, 0.0, -slope])
    assert in_sunlight(scene, sun).all()
    shaded = replace(scene, surroundings=Surroundings(depth=depth, stride=4))
    dark = ~(scene.grid(in_sunlight(shaded, sun, shaded.surroundings).astype(float)) > 0)
    length = dark[5:-5].sum(1)
    np.testing.assert_array_equal(render_reference(shaded, sun=sun, cast_shadows=True)[0][10, -10:], 0.0)
    assert (np.abs(length - 17) <= 4).all()
    np.testing.assert_array_equal(dark[10], np.arange(40) >= 40 - length[5])
    assert in_sunlight(shaded, -sun * [1.0, 1.0, -1.0], shaded.surroundings).all()
    gap = np.where(wall, np.nan, depth)
    assert in_sunlight(scene, sun, Surroundings(depth=gap, stride=4)).all()


def test_shadows_are_the_same_in_another_frame():
    scene = synthetic_scene(size=30, views=2)
    camera = scene.views.cameras[0]
    frame = Region.of_image(camera.height, camera.width, stride=4)
    depth = DISTANCE + 8 * GSD * np.sin(np.arange(frame.grid_shape[1]) / 2.0) + np.zeros(frame.grid_shape)
    scene = replace(scene, surroundings=Surroundings(depth=depth, stride=4))
    other = Similarity(0.01, so3_exp(np.array([0.3, -0.2, 0.9])), np.array([5.0, 6.0, 7.0]))
    sun = sun_from_angles(local_frame(scene), 0.7, np.deg2rad(12.0))
    lit = in_sunlight(scene, sun, scene.surroundings)
    assert 0.1 < lit.mean() < 0.9
    moved = transform_scene(other, scene)
    np.testing.assert_array_equal(in_sunlight(moved, other.rotation @ sun, moved.surroundings), lit)


@pytest.mark.parametrize("tilt", [0.0, 0.01])
def test_the_ground_around_stays_where_it_is_to_the_map_when_an_estimate_moves_the_reference(tilt):
    """Its view moves away along the line of sight; the map is tilted, and the ground around it with it."""
    scene = replace(
        synthetic_scene(size=12, views=4), surroundings=Surroundings(depth=np.full((8, 9), 100.0), stride=4)
    )
    poses, k = scene.views.body_from_cam, scene.reference
    center = poses.translation.copy()
    center[k] -= 50.0 * poses.rotation[k][:, 2]
    x = scene.landmarks.pixel[:, 1] - scene.landmarks.pixel[:, 1].mean()
    raised = scene.landmarks.position + tilt * x[:, None] * poses.rotation[k][:, 2]
    after = scene.with_estimate(
        replace(scene.views, body_from_cam=Rigid(poses.rotation, center)), replace(scene.landmarks, position=raised)
    )
    found = carried_along(scene, after)
    columns = 4 * np.arange(9) - scene.landmarks.pixel[:, 1].mean()
    np.testing.assert_allclose(found.depth, np.tile(150.0 + tilt * columns, (8, 1)), atol=1e-6)
    assert carried_along(replace(scene, surroundings=None), after) is None


def test_an_estimate_carries_the_ground_around_along():
    scene = replace(
        synthetic_scene(size=12, views=5), surroundings=Surroundings(depth=np.full((8, 9), 100.0), stride=4)
    )
    found = adjust(scene, AdjustOptions(uncertainty=False, max_reweightings=1)).scene
    np.testing.assert_array_equal(found.surroundings.depth, carried_along(scene, found).depth)
