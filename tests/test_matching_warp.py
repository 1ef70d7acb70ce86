"""A network's dense warps as matches: exact for affine warps; which matches are kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from displaced_images import CAMERA, displaced, error_px
from photoclinometry.matching.flow import FlowMatcher
from photoclinometry.matching.interface import padded_region
from photoclinometry.matching.warp import Warp, WarpMatcher, WarpOptions, on_grid, pixel_centers, stretch
from photoclinometry.model.region import Region

LINEAR, SHIFT = np.array([[1.02, 0.03], [-0.02, 0.98]]), np.array([1.3, -0.7])
"""An affine warp of pixels: x' = LINEAR x + SHIFT."""


def affine_warp(shape, grid, linear, shift, certainty=0.9):
    """The warp x' = linear x + shift [px] between pictures of a shape, on a grid of cells."""
    size = np.array(shape[::-1])
    xy = pixel_centers(grid) * (size / np.array(grid[::-1]))
    return Warp(position=2.0 * (xy @ linear.T + shift) / size - 1.0, certainty=np.full(grid, certainty))


def affine_network(grid, linear=LINEAR, shift=SHIFT, back_off=(0.0, 0.0), certainty=0.9):
    """Answers with an affine warp and its inverse, the latter off by some pixels, whatever the pictures show."""
    inverse = np.linalg.inv(linear)

    def network(a, b):
        return (
            affine_warp(a.shape, grid, linear, shift, certainty),
            affine_warp(a.shape, grid, inverse, back_off - inverse @ shift),
        )

    return network


def still(**options):
    """A request whose prediction is a shift by 20 px, and a matcher that confirms it."""
    matcher = WarpMatcher(affine_network((40, 30), np.eye(2), np.zeros(2)), WarpOptions(**options))
    return displaced(amplitude=0.0)[0], matcher


@pytest.mark.parametrize("grid", [(148, 148), (40, 56), (300, 200), (2, 2)])
@pytest.mark.parametrize("row_col", [(50, 50), (0, 0), (120, 100)])
def test_an_affine_warp_gives_exact_positions_on_any_grid_up_to_the_images_edge(grid, row_col):
    request, _ = displaced()
    region = Region(row=row_col[0], col=row_col[1], height=80, width=100)
    padded = padded_region(region, 24, CAMERA)
    steep = np.array([[1.1, -0.2], [0.1, 0.9]])
    prediction = padded.pixel_centers() @ steep.T + 20.0
    request = replace(request, region=region, padded=padded, prediction=prediction)
    matches = WarpMatcher(affine_network(grid), WarpOptions()).match(request)

    corner = np.array([padded.col, padded.row])
    landing = (region.pixel_centers() - corner) @ LINEAR.T + SHIFT
    true = (landing + corner) @ steep.T + 20.0
    size = np.array([padded.width, padded.height])
    np.testing.assert_allclose(matches.position[matches.valid], true[matches.valid], atol=1e-6)
    # Nothing is predicted beyond the outermost pixels' centres.
    known = np.all((landing >= 0.5) & (landing <= size - 0.5), axis=-1)
    assert not matches.valid[~known].any()
    seen = known & np.all((true > 1) & (true < 239), axis=-1)
    assert matches.valid[seen].all()
    assert seen.mean() > 0.8
    np.testing.assert_allclose(matches.certainty[seen], 0.9, rtol=1e-6)


def test_the_standard_deviation_is_half_a_cell_in_target_pixels_and_the_round_trip():
    request, _ = displaced(amplitude=0.0)
    # 148 px over 74 x 37 cells: sqrt(2 * 4) px a cell. The target is seen twice as close.
    request = replace(request, prediction=2.0 * request.padded.pixel_centers() - 60.0)
    plain = WarpMatcher(affine_network((74, 37)), WarpOptions(sigma_cells=0.5)).match(request)
    np.testing.assert_allclose(plain.sigma_px[plain.valid], 2.0 * 0.5 * np.sqrt(8.0), rtol=1e-5)
    off = WarpMatcher(affine_network((74, 37), back_off=(0.3, 0.4)), WarpOptions(sigma_cells=0.5)).match(request)
    np.testing.assert_allclose(off.sigma_px[off.valid], 2.0 * np.sqrt(2.0 + 0.25), rtol=1e-5)


@pytest.mark.parametrize(("off", "kept"), [(0.95, True), (1.05, False)])
def test_matches_with_a_long_round_trip_are_dropped(off, kept):
    request, _ = displaced(amplitude=0.0)
    network = affine_network((40, 30), np.eye(2), np.zeros(2), back_off=(off, 0.0))
    assert WarpMatcher(network, WarpOptions(max_round_trip_px=1.0)).match(request).valid.all() == kept


def test_matches_of_low_certainty_are_dropped():
    request, matcher = still(min_certainty=0.95)
    assert not matcher.match(request).valid.any()
    request, matcher = still(min_certainty=0.85)
    assert matcher.match(request).valid.all()


def test_only_matches_on_masked_or_unpredicted_pixels_are_dropped():
    request, matcher = still()
    mask = request.target.valid.copy()
    mask[100:110, 100:120] = False  # the region's pixels [30:40, 30:50]
    prediction = request.prediction.copy()
    prediction[24 + 60, 24 + 70] = np.nan
    spoilt = np.where(mask, request.target.brightness, np.nan).astype(np.float32)
    target = replace(request.target, brightness=spoilt, valid=mask)
    dark = request.reference.valid.copy()
    dark[50 + 5, 50 + 8] = False
    reference = replace(request.reference, valid=dark)
    matches = matcher.match(replace(request, reference=reference, target=target, prediction=prediction))
    assert not matches.valid[5, 8]
    assert not matches.valid[30:40, 30:50].any()
    assert not matches.valid[60, 70]
    far = np.ones(matches.valid.shape, bool)
    far[28:42, 28:52] = far[58:63, 68:73] = far[5, 8] = False
    assert matches.valid[far].all()
    assert np.isfinite(matches.position).all()


def test_the_network_sees_the_same_ground_in_both_pictures_whatever_their_gains():
    shown = []

    def network(a, b):
        shown.extend([a, b])
        return affine_network((40, 30))(a, b)

    for gain in (1.0, 250.0):
        WarpMatcher(network, WarpOptions()).match(displaced(amplitude=0.0, gain=gain, offset=3.0 * gain)[0])
    a, b, louder, _ = shown
    assert a.dtype == np.float32
    assert (a.min(), a.max()) == (0.0, 1.0)
    np.testing.assert_allclose(a, b, atol=2e-3)  # splines of fifth and of third order
    np.testing.assert_allclose(a, louder, atol=1e-4)


def test_masked_pixels_do_not_change_the_stretch():
    brightness = np.random.default_rng(0).uniform(1.0, 2.0, (50, 60)).astype(np.float32)
    valid = np.ones(brightness.shape, bool)
    valid[:5] = False
    spoilt = np.where(valid, brightness, np.nan).astype(np.float32)
    expected = stretch(brightness[5:], valid[5:])
    np.testing.assert_array_equal(stretch(spoilt, valid)[5:], expected)
    np.testing.assert_allclose(stretch(spoilt, valid)[:5], np.median(expected), atol=1e-6)
    np.testing.assert_array_equal(stretch(spoilt, np.zeros_like(valid)), 0.5)
    np.testing.assert_array_equal(stretch(np.ones((4, 4), np.float32), np.ones((4, 4), bool)), 0.0)


def test_a_ramp_stays_one_on_other_grids():
    ramp = pixel_centers((30, 20)) @ np.array([0.3, -0.7]) + 2.0
    cells = on_grid(ramp, (45, 70))
    centres = pixel_centers((45, 70)) * (20 / 70, 30 / 45)
    np.testing.assert_allclose(cells, centres @ np.array([0.3, -0.7]) + 2.0, atol=1e-12)
    np.testing.assert_array_equal(on_grid(ramp, ramp.shape), ramp)


def test_the_network_of_the_docs_finds_a_shift():
    page = (Path(__file__).parents[1] / "docs" / "howto" / "own-matcher.md").read_text()
    names: dict = {}
    exec(page.split("```python\n")[2].split("```")[0], names)
    request, true = displaced(amplitude=0.0)
    request = replace(request, prediction=request.prediction + (2.4, -1.7))
    matches = names["matcher"].match(request)
    assert matches.valid.mean() > 0.95
    assert np.median(error_px(matches, true)) < 0.3
    assert np.median(error_px(FlowMatcher().match(request), true)) < 0.1
