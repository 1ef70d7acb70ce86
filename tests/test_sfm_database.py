"""COLMAP's pictures are padded until the principal point is in them; pixels of ours are those of the images."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.image import Image
from photoclinometry.model.progress import no_progress
from photoclinometry.sfm import SfmOptions, completion, matching
from photoclinometry.sfm.database import (
    DATABASE,
    add_relief_keypoints,
    padded_size,
    padding_px,
    read_keypoints,
    read_matches,
    to_colmap,
    write_matches,
    write_views,
)
from photoclinometry.sfm.keypoints import sift_keypoints
from photoclinometry.sfm.pictures import brightness_picture

INSIDE = Camera("PINHOLE", 96, 80, (900.0, 910.0, 40.25, 30.5))
OUTSIDE = Camera("PINHOLE", 96, 80, (900.0, 910.0, -400.25, 130.5))
FLOAT32_PX = 1e-4
"""Keypoints are single numbers; padded, they are hundreds of pixels."""


def cameras_with(principal):
    return replace(INSIDE, params=(900.0, 910.0, *principal)), Camera("SIMPLE_PINHOLE", 96, 80, (900.0, *principal))


@pytest.mark.parametrize(
    ("principal", "padding", "size"),
    [
        ((40.25, 30.5), (0, 0), (96, 80)),
        ((0.0, 80.0), (0, 0), (96, 80)),
        ((-400.25, 30.5), (401, 0), (497, 80)),
        ((40.25, -3.0), (0, 3), (96, 83)),
        ((700.5, 30.5), (0, 0), (701, 80)),
        ((-12.0, 133.0), (12, 0), (108, 133)),
    ],
)
def test_colmaps_picture_is_the_image_and_the_principal_point(principal, padding, size):
    for camera in cameras_with(principal):
        assert tuple(padding_px(camera)) == padding
        assert padded_size(camera) == size
        made = to_colmap(camera)
        assert (made.width, made.height) == size
        assert not made.has_bogus_params(0.1, 100.0, 1.0)
        points = np.array([[0.1, -0.02, 1.0], [-0.3, 0.2, 2.0]])
        np.testing.assert_allclose(made.img_from_cam(points) - padding, camera.pixel_from_cam(points), atol=1e-9)


def test_an_ordinary_camera_is_colmaps_bit_by_bit():
    made = to_colmap(INSIDE)
    assert (made.width, made.height, tuple(made.params)) == (96, 80, INSIDE.params)


@pytest.fixture
def views():
    """Two images with texture."""
    rng = np.random.default_rng(1)
    size = (INSIDE.height, INSIDE.width)
    return [Image(f"{k}.fits", rng.uniform(0.5, 1.0, size).astype(np.float32), np.ones(size, bool)) for k in range(2)]


def test_keypoints_return_from_the_database_in_pixels_of_the_image(views, tmp_path):
    import pycolmap

    cameras, options = [INSIDE, OUTSIDE], SfmOptions(max_features=200)
    write_views(views, cameras, tmp_path, options, no_progress)
    expected = [sift_keypoints(brightness_picture(image), image.valid, options.max_features) for image in views]
    found = read_keypoints(cameras, tmp_path)
    np.testing.assert_array_equal(found[0][0], expected[0][0])
    np.testing.assert_allclose(found[1][0], expected[1][0], atol=FLOAT32_PX)
    np.testing.assert_array_equal(found[1][1], expected[1][1])
    with pycolmap.Database.open(tmp_path / DATABASE) as database:
        stored = np.asarray(database.read_keypoints(2))
    np.testing.assert_allclose(stored[:, :2], expected[1][0][:, :2] + [401.0, 0.0], atol=FLOAT32_PX)
    write_matches(tmp_path, {(0, 1): np.array([[3, 4]])})
    matches = read_matches(cameras, tmp_path)
    np.testing.assert_array_equal(matches.pairs[0, 1], [[3, 4]])
    np.testing.assert_allclose(matches.keypoints[1], expected[1][0][:, :2], atol=FLOAT32_PX)


def test_keypoints_of_the_relief_are_in_pixels_of_the_image_too(views, tmp_path):
    options = SfmOptions(max_features=200)
    sun = np.array([[0.6, 0.0, -0.8]] * 2)
    found = []
    for camera in (INSIDE, OUTSIDE):
        write_views(views, [camera] * 2, tmp_path, options, no_progress)
        before = len(read_keypoints([camera] * 2, tmp_path)[0][0])
        add_relief_keypoints(views, [camera] * 2, sun, tmp_path, options)
        found.append(read_keypoints([camera] * 2, tmp_path)[0])
        assert len(found[-1][0]) > before
    np.testing.assert_allclose(found[0][0], found[1][0], atol=FLOAT32_PX)
    np.testing.assert_array_equal(found[0][1], found[1][1])


def test_a_crop_is_located_by_points_as_the_whole_image_is():
    rng = np.random.default_rng(2)
    body_from_cam = Rigid(np.eye(3), np.array([3.0, -5.0, -900.0]))
    points = rng.uniform(-30.0, 30.0, (40, 3))
    for camera in (INSIDE, OUTSIDE):
        pixels = camera.pixel_from_cam(body_from_cam.inverse()(points))
        found = completion._pose(camera, pixels, points, SfmOptions())
        np.testing.assert_allclose(found.rotation.matrix(), np.eye(3), atol=1e-6)
        np.testing.assert_allclose(found.translation, body_from_cam.translation, atol=1e-3)


def test_guided_matches_of_a_crop_are_verified_with_its_rays(views, tmp_path, monkeypatch):
    """Wrong rays would show in no number of matches: COLMAP then takes those of the fundamental matrix."""
    import pycolmap

    estimate, rays = pycolmap.estimate_calibrated_two_view_geometry, []

    def spied(first, first_xy, second, second_xy, *others):
        rays.extend([first.cam_from_img(first_xy), second.cam_from_img(second_xy)])
        return estimate(first, first_xy, second, second_xy, *others)

    points = np.random.default_rng(3).uniform([-1.0, -1.0, 20.0], [1.0, 1.0, 25.0], (60, 3))
    moved = points + [0.8, 0.1, 0.2]
    cameras = [INSIDE, OUTSIDE]
    seen = [c.pixel_from_cam(each) for c, each in zip(cameras, (points, moved), strict=True)]
    keypoints = [(np.column_stack([xy, np.ones((60, 2))]), np.ones((60, 128))) for xy in seen]
    write_views(views, cameras, tmp_path, SfmOptions(), no_progress)
    monkeypatch.setattr(pycolmap, "estimate_calibrated_two_view_geometry", spied)
    monkeypatch.setattr(matching, "read_keypoints", lambda *_: keypoints)
    monkeypatch.setattr(matching, "guided_matches", lambda *_: np.tile(np.arange(60)[:, None], 2))
    found = matching.match_guided(cameras, [(0, 1)], tmp_path, SfmOptions(), "guided matches", no_progress)
    assert found[0, 1] == 60
    np.testing.assert_allclose(rays[0], points[:, :2] / points[:, 2:], atol=1e-9)
    np.testing.assert_allclose(rays[1], moved[:, :2] / moved[:, 2:], atol=1e-9)
