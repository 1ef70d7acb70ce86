"""Dense matching: displacement of known warps, the pre-warp's surface, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from displaced_images import CAMERA, PADDED, REGION, displaced, error_px, texture
from photoclinometry.matching import MatchRequest
from photoclinometry.matching.flow import FlowMatcher, in_target, normalise, resample, smoothed_to_target_resolution
from photoclinometry.matching.interface import MatchSetup, padded_region
from photoclinometry.matching.prewarp import (
    predict_pixels,
)
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.image import Image
from photoclinometry.model.region import Region
from photoclinometry.model.sparse import SparseModel
from photoclinometry.surface.depth_fit import (
    fit_depth,
    landmark_depth,
    sparse_depth,
)
from scenes import synthetic_images, synthetic_scene


@pytest.mark.parametrize("gain", [1.0, 40.0, 0.01])
def test_a_smooth_displacement_is_found_to_a_tenth_of_a_pixel_whatever_the_gain(gain):
    request, true = displaced(gain=gain, offset=0.3 * gain)
    matches = FlowMatcher().match(request)
    assert matches.valid.mean() > 0.99
    assert np.median(error_px(matches, true)) < 0.1


def test_a_small_displacement_is_found_to_a_fiftieth_of_a_pixel():
    request, true = displaced(amplitude=0.3)
    assert np.median(error_px(FlowMatcher().match(request), true)) < 0.02


def test_a_target_of_half_the_resolution_meets_a_reference_as_coarse():
    """The target shows the reference's ground in pixels of twice the size, which blur by half of one besides."""
    from scipy.ndimage import gaussian_filter

    fine = texture((200, 200), sigma=0.7)
    coarse = gaussian_filter(fine, np.sqrt(0.75)).reshape(100, 2, 100, 2).mean((1, 3))
    prediction = PADDED.pixel_centers() / 2.0
    picture = fine[PADDED.slices]
    smoothed, valid = smoothed_to_target_resolution(prediction, picture, np.ones(picture.shape, bool))
    seen = resample(Image("b", coarse, np.ones(coarse.shape, bool)), prediction)[0]
    assert valid.all()
    assert np.std(smoothed - seen) < 0.35 * np.std(picture - seen)
    whole = MatchRequest(
        reference=Image("a", fine, np.ones(fine.shape, bool)),
        target=Image("b", coarse, np.ones(coarse.shape, bool)),
        region=REGION,
        padded=PADDED,
        prediction=prediction,
    )
    matches = FlowMatcher().match(whole)
    assert matches.valid.all()
    assert np.median(error_px(matches, prediction[whole.inner])) < 0.03
    assert np.median(matches.sigma_px) < 0.08  # 0.13 where the reference keeps its detail


@pytest.mark.parametrize("step", [2.0, 4.0])
def test_sigmas_are_those_of_positions_in_the_target(step):
    """Errors are those of the ground, so many target pixels to one of the reference: sigmas grow as they do."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    target = gaussian_filter(texture((240, 240), sigma=3.0).astype(float), 1.0)
    rng = np.random.default_rng(1)

    def seen(step):
        size = int(200 * step)
        where = (Region.of_image(size, size).pixel_centers() / step)[..., ::-1] + 19.5
        image = map_coordinates(target, np.moveaxis(where, -1, 0), order=5)
        # noise of the ground, alike to a matcher that averages a finer view
        return Image("b", image + 0.01 * step * rng.standard_normal(image.shape), np.ones(image.shape, bool))

    def stated(step):
        prediction = PADDED.pixel_centers() * step
        request = MatchRequest(
            reference=seen(1.0), target=seen(step), region=REGION, padded=PADDED, prediction=prediction
        )
        matches = FlowMatcher().match(request)
        return np.median(matches.sigma_px), np.median(error_px(matches, prediction[request.inner]))

    sigma, error = np.divide(stated(step), stated(1.0))
    assert sigma == pytest.approx(step, rel=0.3)
    assert error == pytest.approx(step, rel=0.5)


def test_sigmas_of_an_oblique_view_are_the_rms_of_both_axes():
    squeezed = Region.of_image(6, 8).pixel_centers() * (0.5, 1.0)
    squeezed[2, 3] = np.nan
    expected = 0.1 * np.sqrt((0.25 + 1.0) / 2.0)
    np.testing.assert_allclose(in_target(np.full((6, 8), 0.1), squeezed), expected)


def test_a_target_as_fine_leaves_the_reference_as_it_is():
    picture = texture((148, 148))
    found, _ = smoothed_to_target_resolution(PADDED.pixel_centers(), picture, np.ones(picture.shape, bool))
    assert found is picture


def test_a_perfect_prediction_is_kept():
    request, true = displaced()
    perfect = request.prediction.copy()
    perfect[request.inner] = true
    found = FlowMatcher().match(replace(request, prediction=perfect))
    assert np.median(error_px(found, true)) < 0.03


def test_sigmas_tell_the_size_of_errors_under_noise():
    request, true = displaced()
    rng = np.random.default_rng(1)
    noisy = [
        replace(i, brightness=i.brightness + 0.02 * rng.normal(size=i.brightness.shape).astype(np.float32))
        for i in (request.reference, request.target)
    ]
    matches = FlowMatcher().match(replace(request, reference=noisy[0], target=noisy[1]))
    z = (matches.position - true)[matches.valid] / matches.sigma_px[matches.valid][:, None]
    assert 0.3 < np.sqrt(np.median(z**2) / 0.455) < 2.0


def test_pictures_of_different_places_do_not_match():
    """Of smooth textures a quarter of the pixels look alike somewhere near by chance; 0.16 to 0.32, by the texture."""
    request, _ = displaced()
    share = []
    for seed in range(1, 9):
        stranger = Image("c", texture((240, 240), seed=seed), np.ones((240, 240), bool))
        share.append(FlowMatcher().match(replace(request, target=stranger)).valid.mean())
    assert np.mean(share) < 0.25


def test_invalid_pixels_and_the_outside_of_the_target_do_not_match():
    request, _ = displaced()
    valid = np.ones((240, 240), bool)
    valid[:, :110] = False
    brightness = np.where(valid, request.target.brightness, np.nan).astype(np.float32)
    matches = FlowMatcher().match(replace(request, target=Image("b", brightness, valid)))
    assert not matches.valid[:, :36].any()  # columns 110 and less of the target, less the displacement
    assert matches.valid[:, 48:].mean() > 0.95
    assert np.isfinite(matches.position).all()
    outside = FlowMatcher().match(replace(request, prediction=request.prediction + 500.0))
    assert not outside.valid.any()


def test_a_point_behind_the_target_camera_does_not_match():
    request, _ = displaced()
    prediction = request.prediction.copy()
    prediction[:60] = np.nan
    matches = FlowMatcher().match(replace(request, prediction=prediction))
    assert not matches.valid[:30].any()
    assert matches.valid[-30:].all()


def test_a_closer_target_is_smoothed_to_the_references_resolution():
    fine = Image("fine", texture((400, 400), sigma=1.0), np.ones((400, 400), bool))
    xy = 2.5 * Region(row=20, col=20, height=100, width=100).pixel_centers()
    plain = resample(fine, xy / 2.5)[0].std()
    smoothed, valid = resample(fine, xy)
    assert valid.all()
    assert smoothed.std() < plain


def test_normalised_pictures_have_no_gain_or_offset():
    picture, valid = texture((80, 80)), np.ones((80, 80), bool)
    np.testing.assert_allclose(normalise(picture, valid, 6.0), normalise(30 * picture + 7, valid, 6.0), atol=2e-3)


def test_a_prediction_of_the_wrong_size_is_refused():
    request, _ = displaced()
    with pytest.raises(InputError, match="prediction has shape"):
        replace(request, prediction=request.prediction[1:])


def test_the_margin_is_cut_at_the_image():
    region = padded_region(Region(row=5, col=150, height=20, width=50), 24, CAMERA)
    assert (region.row, region.col, region.height, region.width) == (0, 126, 49, 74)


def test_predicted_pixels_are_projections_of_the_surface():
    scene = synthetic_scene(size=20, views=3)
    pose, cameras = scene.views.body_from_cam, scene.views.cameras
    depth = scene.grid(pose[0].inverse()(scene.landmarks.position)[:, 2])
    for view in (1, 2):
        found = predict_pixels(depth, scene.region, cameras[0], pose[0], cameras[view], pose[view])
        true = scene.views.project(view, scene.landmarks.position).reshape(20, 20, 2)
        np.testing.assert_allclose(found, true, atol=1e-6)
    behind = Rigid(pose[1].rotation * [1, -1, -1], pose[1].translation)
    assert np.isnan(predict_pixels(depth, scene.region, cameras[0], pose[0], cameras[1], behind)).all()


def test_depth_is_recovered_through_noise_and_outliers():
    rng = np.random.default_rng(0)
    gsd, middle = 60.0, 60.0 * 10_000.0

    def relief(xy):
        return gsd * 6.0 * np.sin(xy[..., 0] / 25.0) * np.cos(xy[..., 1] / 30.0)

    xy = rng.uniform(20, 180, (900, 2))
    depth = middle + relief(xy) + gsd * rng.normal(scale=0.4, size=900)
    depth[::10] += gsd * rng.choice([-300, 60, 1000], 90)
    found = fit_depth(xy, depth, REGION, CAMERA, spacing=8)
    error = (found - middle - relief(REGION.pixel_centers())) / gsd
    assert np.sqrt(np.mean(error**2)) < 0.4


def test_holes_in_dense_landmarks_are_filled_smoothly():
    scene = synthetic_scene(size=60, views=2)
    pose, camera = scene.views.body_from_cam[0], scene.views.cameras[0]
    row, col = scene.landmarks.pixel.T - scene.region.row
    keep = np.hypot(row - 30, col - 30) > 4
    found = landmark_depth(
        scene.landmarks.position[keep], scene.landmarks.pixel[keep], pose, scene.region, camera, spacing=2
    )
    true = scene.grid(pose.inverse()(scene.landmarks.position)[:, 2])
    error = np.abs(found - true) / scene.gsd
    assert np.median(error) < 0.15
    assert error.max() < 1.5


def test_too_few_sparse_points_are_refused():
    pose = Rigid(np.eye(3)[None], np.zeros((1, 3)))
    sparse = SparseModel(
        registered=np.ones(1, bool),
        body_from_cam=pose,
        points=np.tile([0.0, 0.0, 1e4], (5, 1)),
        point_start=np.arange(6),
        point_view=np.zeros(5, np.int32),
        point_xy=np.full((5, 2), 100.0),
        mean_reprojection_px=0.0,
    )
    with pytest.raises(ReconstructionError, match="only 5 sparse points"):
        sparse_depth(sparse, 0, REGION, CAMERA)


def test_smooth_shaded_relief_matches_to_a_quarter_of_a_pixel_from_other_sides():
    """The hard case, no texture finer than 8 px: what remains is that shading depends on the viewer."""
    scene = synthetic_scene(size=100, views=4)
    lit = replace(scene, views=replace(scene.views, sun=np.tile(scene.views.sun[:1], (4, 1))))
    images, views = synthetic_images(lit), lit.views
    setup = MatchSetup(
        images=images,
        cameras=views.cameras,
        body_from_cam=views.body_from_cam,
        reference=0,
        region=lit.region,
        margin_px=24,
    )
    few = slice(None, None, 23)  # as many as sparse points
    depth = views.body_from_cam[0].inverse()(lit.landmarks.position[few])[:, 2]
    rough = fit_depth(lit.landmarks.pixel[few, ::-1] + 0.5, depth, setup.padded, views.cameras[0], spacing=8)
    for target in (1, 2, 3):
        matches = FlowMatcher().match(setup.request(target, rough))
        true = views.project(target, lit.landmarks.position).reshape(100, 100, 2)
        assert matches.valid.mean() > 0.95
        assert np.median(error_px(matches, true)) < 0.25


@pytest.mark.data
def test_real_images_match_along_their_epipolar_lines():
    """Vesta, 5.6 degrees of rotation: the Sampson distance to the published poses stays below 0.3 px."""
    import cv2
    import pycolmap

    from photoclinometry.matching.epipolar import fundamental_matrix, sampson_error

    folder = Path(__file__).parents[2] / "shared" / "data" / "vesta-opnav022"
    if not folder.exists():
        pytest.skip(f"no real images at {folder}")
    published = pycolmap.Reconstruction(str(folder / "published"))
    names = ["00000000.png", "00000001.png"]
    by_name = {image.name: image for image in published.images.values()}
    poses = [by_name[name].cam_from_world().inverse() for name in names]
    pose = Rigid(np.stack([p.rotation.matrix() for p in poses]), np.stack([p.translation for p in poses]))
    camera = next(iter(published.cameras.values()))
    cameras = [Camera("PINHOLE", 1024, 1024, tuple(camera.params))] * 2
    pictures = [cv2.imread(str(folder / "images" / n), cv2.IMREAD_GRAYSCALE) for n in names]
    images = [Image(n, p.astype(np.float32), p < 255) for n, p in zip(names, pictures, strict=True)]
    region = Region(row=400, col=400, height=160, width=160)
    setup = MatchSetup(images=images, cameras=cameras, body_from_cam=pose, reference=0, region=region, margin_px=24)
    points = np.array([p.xyz for p in published.points3D.values()])
    local = pose[0].inverse()(points)
    xy = cameras[0].pixel_from_cam(local)
    near = np.all(np.abs(xy - 480) < 150, axis=-1) & (local[:, 2] < np.median(local[:, 2]))
    depth = fit_depth(xy[near], local[near, 2], setup.padded, cameras[0], spacing=16)
    matches = FlowMatcher().match(setup.request(1, depth))
    fundamental = fundamental_matrix(cameras[0], pose[0], cameras[1], pose[1])
    across = np.sqrt(sampson_error(fundamental, region.pixel_centers(), matches.position))
    assert matches.valid.mean() > 0.95
    assert np.median(across[matches.valid]) < 0.3


def test_the_matcher_of_the_docs_finds_a_displacement():
    page = (Path(__file__).parents[1] / "docs" / "howto" / "own-matcher.md").read_text()
    names: dict = {}
    exec(page.split("```python\n")[1].split("```")[0], names)
    request, true = displaced()
    matches = names["BlockMatcher"]().match(request)
    assert matches.valid.mean() > 0.95
    assert np.median(error_px(matches, true)) < 0.3
    assert np.median(np.linalg.norm(request.prediction[request.inner] - true, axis=-1)) > 1.0
