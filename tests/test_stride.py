"""Maps of every s-th pixel: the same ground as the whole map, at a part of its landmarks."""

from dataclasses import replace

import numpy as np
import pytest

from commands import phomo
from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.adjust.correlation import correlation_px
from photoclinometry.adjust.groups import setup_of
from photoclinometry.adjust.tie_points import with_tie_points
from photoclinometry.body.tile_map import tile_map
from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.io.scene_file import write_scene
from photoclinometry.io.site import RegionRequest
from photoclinometry.matching import Matches
from photoclinometry.matching import densify as densify_module
from photoclinometry.matching.densify import DensifyOptions, densify
from photoclinometry.matching.flow import FlowMatcher
from photoclinometry.matching.interface import MatchSetup, padded_region
from photoclinometry.matching.relight import RelightMatcher, RelitReference, map_depth
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.region import Region
from photoclinometry.output.figures.draw import region_extent
from photoclinometry.photometry.render import landmark_brightness, render_reference, render_view
from photoclinometry.pipeline.folder.run_folder import adopt_stages
from photoclinometry.pipeline.run import RunOptions, run
from photoclinometry.sfm.region import RegionOptions
from photoclinometry.simulate import truth as truth_module
from photoclinometry.simulate.truth import truth_maps
from photoclinometry.simulate.truth_file import read_truth
from photoclinometry.surface.map_rays import in_sunlight
from scenes import synthetic_images, synthetic_scene, thinned

SIZE, VIEWS = 49, 5


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=SIZE, views=VIEWS)


@pytest.fixture(scope="module")
def images(scene):
    return synthetic_images(scene)


@pytest.mark.parametrize(("stride", "shape"), [(1, (7, 10)), (2, (4, 5)), (3, (3, 4)), (6, (2, 2))])
def test_the_grid_has_every_sth_pixel_from_the_corner_on(stride, shape):
    region = Region(row=3, col=5, height=7, width=10, stride=stride)
    assert region.grid_shape == shape
    centers = region.pixel_centers()[region.grid_slices]
    assert centers.shape == (*shape, 2)
    pixel = (centers.reshape(-1, 2)[:, ::-1] - 0.5).astype(int)
    row, col = region.cells(pixel)
    np.testing.assert_array_equal(row * shape[1] + col, np.arange(len(pixel)))


@pytest.mark.parametrize("stride", [1, 2, 3])
def test_between_cells_a_ramp_is_a_ramp_and_a_gap_spoils_what_takes_it(stride):
    region = Region.of_image(11, 8, stride=stride)
    ramp = region.pixel_centers() @ np.array([0.3, -2.0])
    rows, cols = ((n - 1) * stride + 1 for n in region.grid_shape)  # up to the last row and column of cells
    found = region.between_cells(ramp[region.grid_slices])
    assert found.shape == (11, 8)
    np.testing.assert_allclose(found[:rows, :cols], ramp[:rows, :cols], atol=1e-12)
    np.testing.assert_array_equal(found[rows:], np.broadcast_to(found[rows - 1], found[rows:].shape))
    holed = ramp[region.grid_slices].copy()
    holed[1, 1] = np.nan
    lost = np.isnan(region.between_cells(holed))
    assert lost.sum() == (2 * stride - 1) ** 2
    assert lost[stride, stride]


@pytest.mark.parametrize("stride", [1, 2, 3, 4, 16])
def test_a_tile_of_any_stride_has_tie_points(scene, stride):
    """One for a square of about eight pixels, wherever its region begins."""
    thin = thinned(scene, stride)
    shifted = replace(thin.landmarks, pixel=thin.landmarks.pixel + 1)
    moved = replace(
        thin, landmarks=shifted, region=replace(thin.region, row=thin.region.row + 1, col=thin.region.col + 1)
    )
    for each in (thin, moved):
        ties = tile_map(each, np.arange(VIEWS), ()).ties
        assert len(ties.landmark) >= min(25, len(thin.landmarks))


def test_at_stride_1_nothing_lies_between_cells(scene):
    values = np.random.default_rng(0).normal(size=(SIZE, SIZE, 2))
    np.testing.assert_array_equal(scene.region.between_cells(values), values)


@pytest.mark.parametrize("stride", [2, 3, 4])
def test_a_mesh_joins_neighbours_on_the_grid(scene, stride):
    thin = thinned(scene, stride)
    rows, cols = thin.region.grid_shape
    assert len(thin.landmarks) == rows * cols
    faces = landmark_faces(thin)
    assert len(faces) == 2 * (rows - 1) * (cols - 1)
    corners = thin.landmarks.pixel[faces]
    np.testing.assert_array_equal(np.ptp(corners, axis=1), np.full((len(faces), 2), stride))


def test_a_map_on_its_grid_lies_where_its_pixels_are():
    """Each cell is drawn around the pixel that it was made from."""
    region = Region(row=10, col=20, height=7, width=9, stride=3)
    left, right, bottom, top = region_extent(region)
    rows, cols = region.grid_shape
    x = left + (np.arange(cols) + 0.5) * (right - left) / cols
    y = top + (np.arange(rows) + 0.5) * (bottom - top) / rows
    np.testing.assert_allclose(x, [20.5, 23.5, 26.5])
    np.testing.assert_allclose(y, [10.5, 13.5, 16.5])
    whole = replace(region, stride=1)
    assert region_extent(whole) == (20, 29, 17, 10)


@pytest.mark.parametrize("stride", [2, 3])
def test_a_rendering_is_that_of_the_whole_map_but_for_interpolation(scene, stride):
    """Waves of 8 to 25 pixels, brightness linear between landmarks: a few percent at the median, and no offset."""
    thin = thinned(scene, stride)
    for view in range(VIEWS):
        full, covered = render_view(scene, view)
        coarse, mask = render_view(thin, view)
        assert mask.sum() > 0.85 * covered.sum()
        error = (coarse - full)[mask & covered] / full[covered].mean()
        assert np.median(np.abs(error)) < 0.01 * stride
        assert abs(error.mean()) < 0.01
    picture, mask = render_reference(thin)
    assert picture.shape == thin.region.grid_shape
    np.testing.assert_array_equal(picture[mask], landmark_brightness(thin, 0))


def test_cast_shadows_are_those_of_the_whole_map(scene):
    """Under a low Sun; but at the shadows' edges, which are known to a cell."""
    low = np.array([1.0, 0.3, 0.12])
    full = scene.grid(in_sunlight(scene, low).astype(float))
    assert 0.1 < 1.0 - full.mean() < 0.9
    for stride, least in ((2, 0.93), (3, 0.88)):
        thin = thinned(scene, stride)
        lit = thin.grid(in_sunlight(thin, low).astype(float))
        assert (lit == full[thin.region.grid_slices]).mean() > least


@pytest.mark.parametrize("stride", [1, 2, 3])
def test_depth_between_landmarks_follows_the_ground(scene, stride):
    thin = thinned(scene, stride)
    padded = padded_region(scene.region, 6, scene.views.cameras[0])
    depth = map_depth(thin, padded)[scene.region.slices_in(padded)]
    true = scene.grid(scene.views.depth(0, scene.landmarks.position))
    grid = thin.region.grid_slices
    np.testing.assert_array_equal(depth[grid], true[grid])
    inside = np.s_[: -stride - 1, : -stride - 1]
    assert np.median(np.abs(depth - true)[inside]) < 0.04 * scene.gsd


@pytest.mark.parametrize("stride", [2, 3])
def test_the_relit_reference_has_every_pixel(scene, images, stride):
    """The view's image, resampled exactly, is what the relit reference should show, and nearer to it than the image."""
    thin = thinned(scene, stride)
    expected = scene.grid(landmark_brightness(scene, 2))
    relit, mask = RelitReference(thin)(2, images[0])
    assert relit.shape == (SIZE, SIZE)
    assert mask.mean() > 0.9
    own = images[0].brightness[scene.region.slices]
    error, unlit = (np.median(np.abs(p - expected)[mask]) for p in (relit, own))
    assert error < 0.25 * unlit


def test_at_stride_1_the_relit_reference_is_the_image_times_the_ratio(scene, images):
    relit, mask = RelitReference(scene)(2, images[0])
    there, here = (landmark_brightness(scene, k, with_scale_and_bias=False) for k in (2, 0))
    row, col = scene.landmarks.pixel.T
    expected = scene.grid(images[0].brightness[row, col] * there / here).astype(np.float32)
    assert mask.all()
    np.testing.assert_array_equal(relit, expected)


def request_of(scene, images, region, depth):
    views = scene.views
    poses = views.body_from_cam
    setup = MatchSetup(
        images=images, cameras=views.cameras, body_from_cam=poses, reference=0, region=region, margin_px=12
    )
    return setup.request(1, depth)


def test_views_are_matched_at_every_pixel_and_answered_on_the_grid(scene, images):
    thin = thinned(scene, 3)
    depth = map_depth(thin, padded_region(thin.region, 12, scene.views.cameras[0]))
    whole, found = (FlowMatcher().match(request_of(scene, images, r, depth)) for r in (scene.region, thin.region))
    for name in ("position", "certainty", "sigma_px", "valid"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name)[::3, ::3])


def test_against_the_reference_relit_from_a_strided_map_matches_are_true(scene, images):
    thin = thinned(scene, 3)
    depth = map_depth(thin, padded_region(thin.region, 12, scene.views.cameras[0]))
    matches = RelightMatcher(thin).match(request_of(scene, images, thin.region, depth))
    true = thin.grid(scene.views.project(1, thin.landmarks.position))
    assert matches.valid.mean() > 0.9
    assert np.median(np.linalg.norm(matches.position - true, axis=-1)[matches.valid]) < 0.1


def exact_matches(scene, region):
    xy = scene.tracks.keypoint.reshape(SIZE, SIZE, VIEWS, 2)[region.grid_slices]
    noise = 0.1 * np.random.default_rng(0).normal(size=(SIZE, SIZE, VIEWS, 2))[region.grid_slices]
    shape = region.grid_shape
    return {
        view: Matches(
            position=xy[:, :, view] + noise[:, :, view],
            certainty=np.ones(shape, np.float32),
            sigma_px=np.full(shape, 0.1, np.float32),
            valid=np.arange(np.prod(shape)).reshape(shape) % 7 != view,
        )
        for view in range(1, VIEWS)
    }


def dense(scene, region):
    views = scene.views
    matches = exact_matches(scene, region)
    return densify(region, 0, matches, views.cameras, views.body_from_cam, DensifyOptions(min_views=4))


def assert_same_tracks(a, b):
    for name in ("position", "pixel", "start", "view", "keypoint", "keypoint_sigma"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert getattr(a, name).dtype == getattr(b, name).dtype


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("block", [1, 7 * SIZE * VIEWS])
def test_rows_densified_in_blocks_are_those_of_one(scene, monkeypatch, stride, block):
    region = replace(scene.region, stride=stride)
    whole = dense(scene, region)
    monkeypatch.setattr(densify_module, "BLOCK", block)
    assert_same_tracks(dense(scene, region), whole)


def test_landmarks_of_a_stride_are_those_of_the_whole_map(scene):
    """But for which matches are valid, each landmark is found by itself."""
    every = replace(scene.region, stride=3)
    matches = exact_matches(scene, scene.region)
    thin = {
        view: Matches(**{k: getattr(m, k)[every.grid_slices] for k in ("position", "certainty", "sigma_px", "valid")})
        for view, m in matches.items()
    }
    views, options = scene.views, DensifyOptions(min_views=4)
    whole = densify(scene.region, 0, matches, views.cameras, views.body_from_cam, options)
    found = densify(every, 0, thin, views.cameras, views.body_from_cam, options)
    kept = ((whole.pixel - (every.row, every.col)) % 3 == 0).all(1)
    np.testing.assert_array_equal(found.pixel, whole.pixel[kept])
    np.testing.assert_array_equal(found.position, whole.position[kept])
    np.testing.assert_array_equal(np.diff(found.start), np.diff(whole.start)[kept])


@pytest.mark.parametrize("stride", [2, 3])
def test_the_ground_that_shares_an_error_is_as_large_at_any_stride(stride):
    from scipy.ndimage import gaussian_filter

    field = gaussian_filter(np.random.default_rng(0).normal(size=(240, 240)), 4.0)
    row, col = np.indices(field.shape)
    pixel = np.stack([row, col], -1) + 13
    view = np.zeros(field.shape, int)
    whole = correlation_px(field.ravel(), view.ravel(), pixel.reshape(-1, 2))
    values, of, at = (a[::stride, ::stride] for a in (field, view, pixel))
    assert correlation_px(values.ravel(), of.ravel(), at.reshape(-1, 2), stride) == pytest.approx(whole, rel=0.1)


def test_fewer_landmarks_share_an_error_the_farther_apart_they_are(scene):
    """Errors shared over 12 px: a square of 12 x 12 landmarks, or of 3 x 3 at every fourth pixel; one at least."""
    for stride, side in ((1, 12.0), (4, 3.0)):
        thin, _, members = with_tie_points(thinned(scene, stride), None)
        setup = setup_of(thin, members, AdjustOptions())
        assert setup.correlation(12.0) == side
        assert setup.correlation(1.0) == 1.0


@pytest.mark.parametrize("stride", [2, 3])
def test_the_estimate_of_a_strided_map_recovers_the_ground(stride):
    true = synthetic_scene(size=60, views=6)
    noisy = synthetic_scene(size=60, views=6, keypoint_noise_px=0.1, brightness_noise=0.005)
    start, end = thinned(noisy, stride), thinned(true, stride)
    found = adjust(start, AdjustOptions(uncertainty=False)).scene
    error = np.linalg.norm(found.landmarks.position - end.landmarks.position, axis=-1) / true.gsd
    assert np.median(error) < 0.2
    turned = np.degrees(angle_between(found.landmarks.normal, end.landmarks.normal))
    assert np.median(turned) < 1.0


def test_true_maps_of_a_stride_are_those_of_the_whole_region(mapped):
    truth = read_truth(mapped.truth)
    region = Region(row=60, col=70, height=11, width=14)
    whole = truth_maps(truth, truth.views.name[0], region)
    thin = truth_maps(truth, truth.views.name[0], replace(region, stride=3))
    for name in ("position", "normal", "albedo", "normal_mean", "albedo_mean", "shadow", "hit"):
        np.testing.assert_array_equal(getattr(thin, name), getattr(whole, name)[::3, ::3])


@pytest.mark.parametrize("stride", [1, 3])
def test_true_maps_found_in_blocks_are_those_of_one(mapped, monkeypatch, stride):
    truth = read_truth(mapped.truth)
    region = Region(row=60, col=70, height=11, width=14, stride=stride)
    whole = truth_maps(truth, truth.views.name[1], region)
    monkeypatch.setattr(truth_module, "BLOCK", 5 * region.width)
    blocks = truth_maps(truth, truth.views.name[1], region)
    for name in ("position", "normal", "albedo", "normal_mean", "albedo_mean", "shadow", "hit"):
        np.testing.assert_array_equal(getattr(blocks, name), getattr(whole, name))


@pytest.mark.usefixtures("no_figures", "photometry_as_stated")
@pytest.mark.parametrize("stride", [2, 3])
def test_a_run_at_a_stride_recovers_the_truth(mapped, tmp_path, stride):
    size = 32 * stride
    site = mapped.changed_site(tmp_path / "site", region=RegionRequest(None, None, (size, size), stride))
    adopt_stages(mapped.run, tmp_path / "run", ("sparse",))
    options = RunOptions(
        region=RegionOptions(stride=5),
        densify=DensifyOptions(min_views=5),
        adjust=AdjustOptions(uncertainty=False),
    )
    result = run(site, tmp_path / "run", options)
    scene = result.scene
    assert scene.region.stride == stride  # what the site says wins
    assert scene.region.grid_shape == (32, 32)
    assert len(scene.landmarks) > 0.9 * 32 * 32
    metrics = evaluate_against_truth(scene, read_truth(mapped.truth)).metrics
    assert metrics["surface_distance_mean_gsd"] < 0.25
    assert metrics["normal_error_mean_deg"] < 4.0
    assert metrics["albedo_error_mean_percent"] < 3.0
    assert metrics["completeness_truly_lit_percent"] > 90.0


def test_info_tells_the_stride(mapped, tmp_path, capsys):
    site = mapped.changed_site(tmp_path / "site", region=RegionRequest(None, None, (32, 32), 2))
    assert phomo("info", site) == 0
    assert "stride [px] 2" in " ".join(capsys.readouterr().out.split())
    write_scene(mapped.copy(tmp_path / "run") / "scene.h5", thinned(synthetic_scene(size=9), 2))
    assert phomo("info", tmp_path / "run") == 0
    assert "a landmark at every 2 of them" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("stride", [0, -2, 1.5])
def test_a_stride_that_is_no_number_of_pixels_is_refused(stride):
    with pytest.raises(InputError, match=r"stride is .*; give a whole number, 1 to 65535"):
        RegionOptions(stride=stride)
