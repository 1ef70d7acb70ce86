"""Bundle adjustment with pose priors, and tiles brought into the frame of the cameras that they share."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import Estimate, KnownPoses, PosePriors
from photoclinometry.adjust.bundle import bundle_adjusted, landmarks_of, pose_covariances, reprojection_px
from photoclinometry.body.cameras import ShareCameras, in_shared_frame
from photoclinometry.body.tile_map import TileLandmarks, TileMap, TileTiePoints
from photoclinometry.io.site import Site, SiteView
from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, Similarity, align_similarity, angle_between, so3_exp, unit
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.sparse import SparseModel, of_views
from photoclinometry.pipeline.folder.stage import Keyed, Tools
from photoclinometry.pipeline.sparse_stages import Inputs, PosedImages, views_from
from photoclinometry.sfm.known_poses import likely_pairs
from photoclinometry.simulate.trajectory import looking_at

RADIUS, DISTANCE, FOCAL, SIZE = 10.0, 200.0, 2000.0, 256
CAMERA = Camera("PINHOLE", SIZE, SIZE, (FOCAL, FOCAL, SIZE / 2, SIZE / 2))
COUNT = 8


def true_poses():
    """Of COUNT views on an arc of 70 degrees."""
    turn = np.radians(np.linspace(-35.0, 35.0, COUNT))
    towards = np.stack([np.cos(turn), np.sin(turn), 0.25 * np.cos(3.0 * turn)], -1)
    poses = [looking_at(DISTANCE * unit(d), np.zeros(3), 0.0, (0.0, 0.0, 1.0)) for d in towards]
    return Rigid(np.array([p.rotation for p in poses]), np.array([p.translation for p in poses]))


def shaken(poses, rng, px):
    """The same views, each turned and moved by so many pixels along each axis."""
    turn = so3_exp(px / FOCAL * rng.normal(size=(len(poses), 3)))
    move = px / FOCAL * DISTANCE * rng.normal(size=(len(poses), 3))
    return Rigid(turn @ poses.rotation, poses.translation + move)


def site_of(poses, priors_px=None):
    sun = np.einsum("kji,j->ki", poses.rotation, unit(np.array([1.0, 0.5, 0.3])))
    prior = None
    views = []
    for k in range(len(poses)):
        if priors_px is not None:
            sigma = priors_px / FOCAL
            prior = PosePrior(
                cam_from_body=poses[k].inverse(), rotation_sigma_rad=sigma, translation_sigma=sigma * DISTANCE
            )
        views.append(SiteView(name=f"{k}", image=f"{k}", camera=CAMERA, sun=sun[k], pose_prior=prior))
    return Site(name="ball", body=None, brightness="iof", views=tuple(views), region=None, path="site.toml")


def seen(points, poses):
    """Compressed rows of all points in all views: starts, views and pixels."""
    pixel = np.stack([CAMERA.pixel_from_cam(poses[k].inverse()(points)) for k in range(len(poses))], 1)
    start = np.arange(len(points) + 1) * len(poses)
    return start, np.tile(np.arange(len(poses), dtype=np.int32), len(points)), pixel.reshape(-1, 2)


def front(rng, count, middle=(1.0, 0.0, 0.0), angle_deg=30.0):
    """Directions within an angle of the middle."""
    found = unit(rng.normal(size=(100 * count, 3)))
    return found[found @ unit(np.array(middle)) > np.cos(np.radians(angle_deg))][:count]


def sparse_of(points, poses, at):
    start, view, pixel = seen(points, poses)
    return SparseModel(
        registered=np.ones(len(poses), bool),
        body_from_cam=at,
        points=points,
        point_start=start,
        point_view=view,
        point_xy=pixel,
        mean_reprojection_px=0.0,
    )


def pose_error_px(poses, true):
    """(K,) how far points of the ball move in the image."""
    points = RADIUS * front(np.random.default_rng(5), 50)
    a, b = (seen(points, each)[2].reshape(50, -1, 2) for each in (poses, true))
    return np.sqrt(np.mean(np.sum((a - b) ** 2, -1), 0))


def test_a_bundle_adjustment_finds_the_poses_that_the_keypoints_are_of():
    rng, true = np.random.default_rng(0), true_poses()
    start = shaken(true, rng, 5.0)
    points = RADIUS * front(rng, 60)
    model = replace(sparse_of(points, true, start), points=points + 0.05 * rng.normal(size=points.shape))
    free = np.full(COUNT, np.inf)
    rotation, center = free.copy(), free.copy()
    rotation[[0, -1]], center[[0, -1]] = 1e-7, 1e-7 * DISTANCE
    priors = PosePriors(body_from_cam=true, rotation_sigma=rotation, center_sigma=center)
    found = bundle_adjusted(model, views_from(site_of(true), model), priors, 0.3)
    assert pose_error_px(start, true).max() > 5.0
    assert pose_error_px(found.body_from_cam, true).max() < 5e-3
    assert found.mean_reprojection_px < 5e-3
    assert np.abs(found.points - points).max() < 5e-3


def test_priors_and_keypoints_are_weighed_by_their_sigmas():
    """Priors tighter than keypoints by far are kept, looser ones are not."""
    rng, true = np.random.default_rng(1), true_poses()
    start = shaken(true, rng, 3.0)
    model = sparse_of(RADIUS * front(rng, 60), true, start)
    views = views_from(site_of(true), model)
    for px, kept in ((1e-4, True), (30.0, False)):
        priors = PosePriors(
            body_from_cam=start,
            rotation_sigma=np.full(COUNT, px / FOCAL),
            center_sigma=np.full(COUNT, px / FOCAL * DISTANCE),
        )
        found = bundle_adjusted(model, views, priors, 0.3)
        assert (pose_error_px(found.body_from_cam, start).max() < 0.01) == kept
        assert (found.mean_reprojection_px < 0.05) == (not kept)


def test_stated_covariances_of_poses_are_those_of_many_adjustments_of_noisy_keypoints():
    """Squared errors over the stated covariance are 6 in the mean, for rotation and centre together and on any axes."""
    rng, true, sigma = np.random.default_rng(3), true_poses(), 0.3
    points = RADIUS * front(rng, 60)
    model = sparse_of(points, true, true)
    views = views_from(site_of(true), model)
    priors = PosePriors(
        body_from_cam=true, rotation_sigma=np.full(COUNT, 1e-3), center_sigma=np.full(COUNT, 1e-3 * DISTANCE)
    )
    square = []
    for _ in range(24):
        xy = model.point_xy + sigma * rng.normal(size=model.point_xy.shape)
        turned = so3_exp(1e-3 * rng.normal(size=(COUNT, 3)))
        moved = true.translation + 1e-3 * DISTANCE * rng.normal(size=(COUNT, 3))
        known = replace(priors, body_from_cam=Rigid(turned @ true.rotation, moved))
        noisy = replace(model, point_xy=xy, body_from_cam=known.body_from_cam)
        found = bundle_adjusted(noisy, views_from(site_of(true), noisy), known, sigma)
        covariance = pose_covariances(found, views_from(site_of(true), found), known, sigma)
        off = KnownPoses(body_from_cam=found.body_from_cam, covariance=covariance).rows(
            Estimate(views, landmarks_of(found), np.zeros(3))
        )[0]
        square.append(np.sum(off.residual**2, -1))
    assert np.mean(square) == pytest.approx(6.0, abs=0.8)


def test_reprojection_is_the_distance_in_the_image():
    true = true_poses()
    model = sparse_of(RADIUS * front(np.random.default_rng(2), 10), true, true)
    model = replace(model, point_xy=model.point_xy + [3.0, 4.0])
    assert reprojection_px(model, views_from(site_of(true), model)) == pytest.approx(5.0)


def test_pairs_are_views_from_similar_directions_at_similar_resolutions():
    towards = unit(np.array([[1.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [1.0, 0.1, 0.0]]))
    assert likely_pairs(towards, np.array([1.0, 1.5, 1.0, 2.5])) == [(1, 0), (3, 1)]


def test_the_model_of_some_views_has_their_observations_alone():
    true = true_poses()
    model = sparse_of(RADIUS * front(np.random.default_rng(3), 10), true, true)
    chosen = np.array([5, 1, 2])
    part = of_views(model, chosen)
    assert np.array_equal(part.body_from_cam.translation, true.translation[chosen])
    assert np.bincount(part.point_view).tolist() == [10, 10, 10]
    for new, old in enumerate(chosen):
        assert np.array_equal(np.sort(part.seen_by(new)[1], 0), np.sort(model.seen_by(int(old))[1], 0))


def tile_of(true, middle, own_from_body, bend=0.0, count=800, number=0):
    """A tile of the ball in a frame of its own, its surface bent by a quadratic function of the reference's pixels."""
    rng = np.random.default_rng(7 + number)
    normal = front(rng, count, middle, 14.0)
    count = len(normal)
    position = RADIUS * normal
    pixel = CAMERA.pixel_from_cam(true[3].inverse()(position))[:, ::-1]
    at = (pixel - pixel.mean(0)) / np.ptp(pixel, axis=0).max()
    bent = position + bend * (at[:, :1] ** 2 - at[:, 1:]) * unit(np.array(middle))
    ties = np.arange(0, count, 8)
    start, view, keypoint = seen(position[ties], true)
    return TileMap(
        landmarks=TileLandmarks(
            position=own_from_body(bent),
            normal=normal @ own_from_body.rotation.T,
            albedo=np.full(count, 0.1),
            height_sigma=np.full(count, 0.02),
            normal_sigma=np.full(count, 0.01),
            albedo_sigma=np.full(count, 0.02),
            views=np.full(count, COUNT),
            weight=np.ones(count),
            pixel=pixel,
        ),
        ties=TileTiePoints(landmark=ties, start=start, view=view, keypoint=keypoint),
        gsd=1.0,
    ), position


def test_a_tile_moves_as_its_tie_points_do():
    true, own_from_body = true_poses(), Similarity(3.0, so3_exp(np.array([0.3, -0.2, 0.5])), np.array([5.0, 1.0, 2.0]))
    tile, position = tile_of(true, (1.0, 0.1, 0.0), own_from_body, bend=0.05)
    views = views_from(site_of(true), sparse_of(position, true, true))
    moved = in_shared_frame(tile, views)
    # What is off most in the first fit is left out of the second.
    assert np.abs(moved.landmarks.position - position).max() < 1e-3
    assert moved.landmarks.height_sigma == pytest.approx(0.02 / 3.0, rel=1e-3)
    assert moved.gsd == pytest.approx(1.0 / 3.0, rel=1e-3)


def test_normals_follow_the_displacement_of_a_tile():
    """A flat tile that has to be bent into a paraboloid gets the paraboloid's normals."""
    true = true_poses()
    y, z = np.mgrid[-1:1:21j, -1:1:21j].reshape(2, -1)
    flat = np.stack([np.full_like(y, RADIUS), y, z], -1)
    bent = flat + np.stack([0.02 * y**2 + 0.01 * z, np.zeros_like(y), np.zeros_like(y)], -1)
    slope = np.stack([np.ones_like(y), -0.04 * y, np.full_like(y, -0.01)], -1)
    ties = np.arange(len(flat))
    start, view, keypoint = seen(bent, true)
    one = np.ones(len(flat))
    tile = TileMap(
        landmarks=TileLandmarks(
            position=flat,
            normal=np.tile([1.0, 0.0, 0.0], (len(flat), 1)),
            albedo=one,
            height_sigma=one,
            normal_sigma=one,
            albedo_sigma=one,
            views=one,
            weight=one,
            pixel=np.stack([-z, y], -1),
        ),
        ties=TileTiePoints(landmark=ties, start=start, view=view, keypoint=keypoint),
        gsd=0.1,
    )
    moved = in_shared_frame(tile, views_from(site_of(true), sparse_of(flat, true, true)))
    assert np.abs(moved.landmarks.position - bent).max() < 1e-6
    assert np.degrees(angle_between(moved.landmarks.normal, unit(slope))).max() < 0.05
    assert np.degrees(angle_between(tile.landmarks.normal, unit(slope))).max() > 2.0


def test_tiles_in_frames_of_their_own_agree_once_they_share_cameras(tmp_path):
    rng, true = np.random.default_rng(4), true_poses()
    start = shaken(true, rng, 2.0)
    frames = [
        Similarity(2.0, so3_exp(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2.0, 3.0])),
        Similarity(0.5, so3_exp(np.array([-0.4, 0.1, 0.0])), np.array([-7.0, 0.0, 4.0])),
    ]
    made = [
        tile_of(true, m, f, number=n)
        for n, (m, f) in enumerate(zip([(1, 0.15, 0), (1, -0.15, 0)], frames, strict=False))
    ]
    sparse = sparse_of(RADIUS * front(rng, 30), true, start)
    site = site_of(start, priors_px=10.0)  # loose beside the tie points, which are exact
    posed = PosedImages(inputs=Keyed(Inputs(site=site, images=[]), "inputs"), sparse=Keyed(sparse, "sparse"))
    tiles = tuple(Keyed(tile, f"{n}") for n, (tile, _) in enumerate(made))
    tools = Tools(progress=lambda *_: None, scratch=tmp_path)
    cameras = ShareCameras(tiles=tiles, posed=posed, priors=site.pose_priors).make(tools)
    assert cameras.tile_px.max() < 0.02
    views = replace(posed.views, body_from_cam=cameras.body_from_cam)
    moved = np.concatenate([in_shared_frame(tile, views).landmarks.position for tile, _ in made])
    truth = np.concatenate([position for _, position in made])
    common = align_similarity(moved, truth)
    assert np.linalg.norm(common(moved) - truth, axis=-1).max() < 0.02  # a pixel is 0.1
    assert common.scale == pytest.approx(1.0, abs=3e-3)


def test_a_tile_with_few_tie_points_is_left_out():
    true = true_poses()
    tile, position = tile_of(true, (1.0, 0.1, 0.0), Similarity(1.0, np.eye(3), np.zeros(3)), count=40)
    moved = in_shared_frame(tile, views_from(site_of(true), sparse_of(position, true, true)))
    assert len(moved.landmarks.position) == 0
    assert "5 tie points" in moved.failure
