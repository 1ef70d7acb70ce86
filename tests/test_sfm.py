"""Poses from images alone: recovered from rendered views, compared with published ones, and refused with reasons."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.geometry import Rigid, Similarity, align_similarity
from photoclinometry.model.image import Image
from photoclinometry.model.sparse import connected_groups, normalised, transformed
from photoclinometry.sfm import SfmOptions, reconstruct_sparse
from photoclinometry.sfm.keypoints import sift_keypoints
from photoclinometry.sfm.pictures import brightness_picture
from sparse_views import CAMERA, FOCAL_PX, OPTIONS, painted, painted_site, rotation_errors_deg, views_around


@pytest.fixture(scope="module")
def one_site():
    return painted_site()


@pytest.fixture(scope="module")
def sparse(one_site, tmp_path_factory):
    return reconstruct_sparse(one_site[0], [CAMERA] * 5, tmp_path_factory.mktemp("sfm"), OPTIONS)


CROPS = [
    Camera("PINHOLE", 300, 300, (FOCAL_PX, FOCAL_PX, -400.0, 150.0)),
    Camera("PINHOLE", 300, 300, (FOCAL_PX, FOCAL_PX, 1200.5, 150.0)),
    Camera("PINHOLE", 300, 300, (FOCAL_PX, FOCAL_PX, 150.0, -900.25)),
    Camera("SIMPLE_PINHOLE", 300, 300, (FOCAL_PX, 700.0, 900.0)),
    CAMERA,
]
"""Crops of larger images: the principal point is left, right, above, and right below the crop, and in it."""


def crops_of_one_site():
    """As `painted_site`, by the cameras CROPS: each turned so that the middle of its crop shows the origin."""
    images, poses = [], views_around(len(CROPS))
    for k, camera in enumerate(CROPS):
        middle = camera.ray_in_cam(np.array([150.0, 150.0]))
        turn = Rotation.align_vectors([0.0, 0.0, 1.0], middle)[0].as_matrix()
        poses.rotation[k] = poses.rotation[k] @ turn
        images.append(Image(f"c{k}.fits", painted(poses[k], 0, camera), np.ones((300, 300), bool)))
    return images, poses


def test_poses_are_recovered_from_images_alone(sparse, one_site):
    true = one_site[1]
    assert sparse.registered.all()
    assert sparse.mean_reprojection_px < 0.3
    similarity = align_similarity(sparse.body_from_cam.translation, true.translation)
    off = np.linalg.norm(similarity(sparse.body_from_cam.translation) - true.translation, axis=-1)
    assert off.max() < 0.01 * FOCAL_PX
    assert rotation_errors_deg(sparse.body_from_cam, true).max() < 0.3


@pytest.mark.parametrize("mapper", ["incremental", "global"])
def test_crops_whose_principal_point_lies_outside_register(mapper, tmp_path):
    """COLMAP registers no view with such a camera as it is."""
    images, true = crops_of_one_site()
    found = reconstruct_sparse(images, CROPS, tmp_path, replace(OPTIONS, mapper=mapper))
    assert found.registered.all()
    assert found.mean_reprojection_px < 0.3
    assert rotation_errors_deg(found.body_from_cam, true).max() < 0.3
    similarity = align_similarity(found.body_from_cam.translation, true.translation)
    off = np.linalg.norm(similarity(found.body_from_cam.translation) - true.translation, axis=-1)
    assert off.max() < 0.01 * FOCAL_PX
    for k, camera in enumerate(CROPS):
        index, xy = found.seen_by(k)
        assert xy.min() > 0.0
        assert xy.max() < 300.0
        projected = camera.pixel_from_cam(found.body_from_cam[k].inverse()(found.points[index]))
        assert np.median(np.linalg.norm(projected - xy, axis=-1)) < 0.3


def test_the_unit_of_length_is_a_ground_sample_distance(sparse):
    assert np.abs(np.median(sparse.points, axis=0)).max() < 5.0
    depth = sparse.body_from_cam[0].inverse()(sparse.points)[:, 2]
    assert np.median(depth) / FOCAL_PX == pytest.approx(1.0, abs=0.05)
    towards = sparse.body_from_cam.translation.mean(0)
    np.testing.assert_allclose(towards / np.linalg.norm(towards), [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(sparse.body_from_cam.rotation), 1.0)


def test_the_gauge_does_not_depend_on_the_frame_it_came_from(sparse):
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    other = Similarity(0.02, turn * np.sign(np.linalg.det(turn)), np.array([5.0, -3.0, 100.0]))
    again = normalised(transformed(sparse, other), [CAMERA] * 5)
    # The median point moves with the axes, by a little.
    np.testing.assert_allclose(again.body_from_cam.rotation, sparse.body_from_cam.rotation, atol=5e-3)
    assert np.ptp(again.points - sparse.points, axis=0).max() < 5.0


def test_points_project_to_their_observations(sparse):
    cam_from_body = sparse.body_from_cam.inverse()[sparse.point_view]
    local = cam_from_body(sparse.points[sparse.point_of_observation])
    error = np.linalg.norm(CAMERA.pixel_from_cam(local) - sparse.point_xy, axis=-1)
    assert error.mean() == pytest.approx(sparse.mean_reprojection_px, rel=0.3)
    index, xy = sparse.seen_by(2)
    assert len(index) == len(xy) == np.count_nonzero(sparse.point_view == 2)


def test_one_thread_and_the_same_seed_give_the_same_model_bit_by_bit(one_site, tmp_path):
    """Several threads add up in varying order, so that weakly determined values vary within their uncertainty."""
    options = replace(OPTIONS, threads=1)
    one, other = (reconstruct_sparse(one_site[0], [CAMERA] * 5, tmp_path / name, options) for name in "ab")
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.body_from_cam.rotation, other.body_from_cam.rotation)


def test_the_global_mapper_agrees(one_site, tmp_path):
    options = replace(OPTIONS, mapper="global")
    found = reconstruct_sparse(one_site[0], [CAMERA] * 5, tmp_path, options)
    assert found.registered.all()
    assert rotation_errors_deg(found.body_from_cam, one_site[1]).max() < 0.5


def test_views_of_another_place_are_left_out_by_name(one_site, tmp_path, caplog, capfd):
    """Cameras of two kinds at once: the intrinsics are per view."""
    strangers = painted_site(count=3, seed=7, prefix="b")[0]
    twin = Camera("SIMPLE_PINHOLE", 300, 300, (FOCAL_PX, 150.0, 150.0))
    with caplog.at_level(logging.WARNING):
        found = reconstruct_sparse(one_site[0] + strangers, [CAMERA] * 4 + [twin] * 4, tmp_path, OPTIONS)
    assert found.registered.tolist() == [True] * 5 + [False] * 3
    assert "b1.fits is left out: not registered, it matched 0 of the 5 registered views" in caplog.text
    assert "it shows another place, with b0.fits, b2.fits" in found.why_unregistered()[6]
    assert not "".join(found.reason[:5])
    assert capfd.readouterr().err == ""


def test_images_without_overlap_are_refused_with_advice(tmp_path):
    strangers = [painted_site(count=1, seed=seed, prefix=f"s{seed}")[0][0] for seed in range(4)]
    with pytest.raises(
        ReconstructionError,
        match=r"0 of 4 views .*--sfm\.max-features \d+; now \d+\), or the global mapper \(--sfm\.map",
    ):
        reconstruct_sparse(strangers, [CAMERA] * 4, tmp_path, OPTIONS)


def test_two_separate_pairs_of_views_are_refused_and_listed(tmp_path):
    images = painted_site(count=2, seed=0, prefix="a")[0] + painted_site(count=2, seed=7, prefix="b")[0]
    with pytest.raises(ReconstructionError, match=r"\[a0.fits, a1.fits\]; \[b0.fits, b1.fits\]"):
        reconstruct_sparse(images, [CAMERA] * 4, tmp_path, OPTIONS)


def test_two_images_are_refused(one_site, tmp_path):
    with pytest.raises(InputError, match="at least 3 views"):
        reconstruct_sparse(one_site[0][:2], [CAMERA] * 2, tmp_path)


def test_an_image_that_shows_nothing_is_refused(one_site, tmp_path):
    blank = Image("blank.fits", np.full((300, 300), 0.1, np.float32), np.ones((300, 300), bool))
    with pytest.raises(InputError, match=r"blank\.fits"):
        reconstruct_sparse([*one_site[0][:2], blank], [CAMERA] * 3, tmp_path)


def test_keypoints_keep_away_from_invalid_pixels(one_site):
    image = one_site[0][0]
    valid = np.ones((300, 300), bool)
    valid[:, 150:] = False
    keypoints, descriptors = sift_keypoints(brightness_picture(image), valid, 500)
    assert len(keypoints) == len(descriptors) > 50
    assert keypoints[:, 0].max() < 150


def test_keypoints_are_unbiased_in_half_turns(one_site):
    """Pixel convention: turning the picture by 180 degrees maps (x, y) to (width - x, height - y)."""
    picture, valid = brightness_picture(one_site[0][0]), np.ones((300, 300), bool)
    a = sift_keypoints(picture, valid, 400)[0][:, :2]
    b = 300.0 - sift_keypoints(picture[::-1, ::-1].copy(), valid, 400)[0][:, :2]
    difference = b[:, None] - a[None]
    nearest = difference[np.arange(len(b)), np.linalg.norm(difference, axis=-1).argmin(1)]
    assert np.abs(np.median(nearest, axis=0)).max() < 0.02


def test_groups_are_chains_of_matching_views():
    inliers = np.zeros((6, 6), int)
    for a, b, n in ((0, 2, 50), (2, 4, 30), (1, 3, 100), (4, 5, 5)):
        inliers[a, b] = inliers[b, a] = n
    assert connected_groups(inliers, 20) == [[0, 2, 4], [1, 3], [5]]


@pytest.mark.data
@pytest.mark.parametrize("mapper", ["incremental", "global"])
def test_real_images_of_vesta_agree_with_their_published_poses(mapper, tmp_path):
    """Camera centres within 0.3 km at 3,860 km, relative rotations within 0.015 degrees on average."""
    import pycolmap

    from photoclinometry.io.site import read_site
    from photoclinometry.io.site_images import load_images

    folder = Path(__file__).parents[2] / "shared" / "data" / "vesta-opnav022"
    if not folder.exists():
        pytest.skip(f"no real images at {folder}")
    real = read_site(folder / "site.toml")
    cameras = [view.camera for view in real.views]
    found = reconstruct_sparse(load_images(real), cameras, tmp_path, SfmOptions(mapper=mapper))
    published = pycolmap.Reconstruction(str(folder / "published"))
    by_name = {Path(i.name).stem: i.cam_from_world().inverse() for i in published.images.values()}
    poses = [by_name[view.image.stem] for view in real.views]
    true = Rigid(np.stack([p.rotation.matrix() for p in poses]), np.stack([p.translation for p in poses]))
    assert found.registered.all()
    assert found.mean_reprojection_px < 0.12
    similarity = align_similarity(found.body_from_cam.translation, true.translation)
    off_km = similarity(found.body_from_cam.translation) - true.translation
    assert np.sqrt((off_km**2).sum(-1).mean()) < 0.3
    assert rotation_errors_deg(found.body_from_cam, true).mean() < 0.015
