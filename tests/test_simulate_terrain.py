import numpy as np
import pytest

from photoclinometry.simulate.albedo import from_log, slope_streaks
from photoclinometry.simulate.terrain import (
    SATURATION,
    Grid,
    Landforms,
    crater_population,
    diffused_profiles,
    fractal_noise,
    fresh_profile,
    power_law_sizes,
    settle,
    stamp,
)

GRID = Grid(spacing=10.0, half=100)


def one_crater(radius=300.0, profile=1):
    return Landforms(np.zeros((1, 2)), np.array([radius]), np.array([profile]), np.zeros(1), np.zeros((1, 4)))


def test_fresh_craters_are_a_fifth_as_deep_as_wide_with_a_raised_rim():
    z = fresh_profile(np.array([0.0, 0.9999, 1.0001, 3.0]))
    assert z[1] - z[0] == pytest.approx(0.4, abs=1e-3)  # 0.2 diameters
    assert z[1:3] == pytest.approx([0.08, 0.08], abs=1e-3)
    assert z[3] == 0


def test_creep_keeps_the_volume_and_wears_the_crater_down():
    r = np.linspace(0.0, 3.5, 225)
    fresh, worn, old = diffused_profiles(np.array([1e-4, 0.03, 0.2]))
    volume = [np.trapezoid(z * r, r) for z in (fresh, worn, old)]
    assert volume[1:] == pytest.approx([volume[0]] * 2, abs=5e-4)
    depth = [z.max() - z[0] for z in (fresh, worn, old)]
    assert depth[0] > 1.2 * depth[1] > 1.5 * depth[2] > 0


def test_creep_of_a_hump_follows_the_heat_kernel():
    """Far inside the reach, the worn profile is the fresh one convolved with a Gaussian of variance 2 age."""
    age, n = 0.02, 401
    x = np.linspace(-3.5, 3.5, n)
    radius = np.hypot(*np.meshgrid(x, x))
    kernel = np.exp(-(radius**2) / (4 * age))
    expected = np.sum(fresh_profile(radius) * kernel) / kernel.sum()
    assert diffused_profiles(np.array([age]))[0][0] == pytest.approx(expected, abs=2e-3)


def test_a_stamped_crater_has_its_profile_whichever_way_one_walks():
    height = np.zeros(GRID.shape, np.float32)
    stamp(height, np.zeros_like(height), GRID, one_crater())
    middle = GRID.half
    east, north = height[middle, middle:], height[middle:, middle]
    np.testing.assert_allclose(east, north, atol=1e-3)
    assert east[0] - east.max() == pytest.approx(-0.4 * 300.0, rel=0.1)  # a little worn


def test_sizes_follow_the_power_law():
    sizes = power_law_sizes(np.random.default_rng(0), 10.0, 1000.0, 2.0, 200_000)
    assert 10.0 <= sizes.min() <= sizes.max() <= 1000.0
    for bound in (20.0, 50.0, 200.0):
        share = (bound**-2 - 1000.0**-2) / (10.0**-2 - 1000.0**-2)
        assert np.mean(sizes > bound) == pytest.approx(share, rel=0.05)


def test_crater_density_is_the_share_of_saturation_asked():
    grid = Grid(10.0, 2000)
    craters = crater_population(grid, np.random.default_rng(0), density=0.05, smallest=50.0, largest=5000.0)
    area = (2 * grid.half_extent) ** 2
    for diameter in (60.0, 150.0, 400.0):
        expected = 0.05 * SATURATION * (diameter**-2.0 - 5000.0**-2.0) * area
        found = np.sum(2 * craters.radius > diameter)
        assert found == pytest.approx(expected, abs=4 * np.sqrt(expected))


def test_fractal_noise_has_unit_variance_and_the_slope_of_its_spectrum():
    grid = Grid(1.0, 511)
    field = fractal_noise(grid, np.random.default_rng(0), 0.8, 1e4, 3.0)
    assert field.std() == pytest.approx(1.0, abs=1e-3)
    power = np.abs(np.fft.rfft2(field * np.hanning(1023)[:, None] * np.hanning(1023))) ** 2
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(1023), np.fft.rfftfreq(1023), indexing="ij"))
    means = [power[(k > a) & (k < 1.3 * a)].mean() for a in (0.01, 0.1)]
    assert np.log10(means[1] / means[0]) == pytest.approx(-(2 * 0.8 + 2), abs=0.3)


def test_settling_keeps_volume_and_ends_slopes_beyond_repose():
    height = np.random.default_rng(0).normal(0, 6.0, (80, 80)).astype(np.float32)
    before, volume = np.abs(np.diff(height, axis=1)).max(), height.sum(dtype=float)
    settle(height, 10.0, repose_deg=35.0, passes=200)
    limit = 10.0 * np.tan(np.radians(35.0))
    assert before > 2 * limit
    assert max(np.abs(np.diff(height, axis=a)).max() for a in (0, 1)) < 1.05 * limit
    assert height.sum(dtype=float) == pytest.approx(volume, abs=0.5)


def test_streaks_run_down_the_slope_and_leave_level_ground_alone():
    x, _ = np.meshgrid(GRID.axis, GRID.axis)
    height = np.where(x < 0, -0.7 * x, 0.0)  # falls towards the east, then is level
    streaks = slope_streaks(height, GRID, np.random.default_rng(0), 0.2, 300.0)
    slope, level = streaks[20:-20, 40:80], streaks[20:-20, 120:]
    assert slope.std() > 0.05
    assert not level.any()
    assert np.diff(slope, axis=1).std() < 0.5 * np.diff(slope, axis=0).std()


def test_albedo_has_the_mean_asked_and_stays_within_its_spread():
    wild = np.random.default_rng(0).normal(0, 2.0, (50, 50))
    albedo = from_log(wild, 0.3, spread=0.4)
    assert albedo.mean() == pytest.approx(0.3, rel=1e-5)
    assert albedo.max() / albedo.min() <= np.exp(0.8) + 1e-6
