import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.simulate.camera_model import Detector, expose, hot_pixel_charge, pixel_average, smear_kernel


def test_noise_has_the_variance_of_photons_reading_and_rounding():
    detector = Detector(full_well_e=20_000.0, read_noise_e=40.0, bits=10, exposure_spread=0.0)
    radiance = np.full((400, 400), 0.2)
    image = expose(radiance, detector, np.random.default_rng(0))
    electrons_per_iof = 0.6 * 20_000.0 / 0.2
    electrons_per_dn = electrons_per_iof / image.gain
    variance = (0.2 * electrons_per_iof + 40.0**2 + electrons_per_dn**2 / 12) / electrons_per_iof**2
    assert image.iof.mean() == pytest.approx(0.2, abs=4 * np.sqrt(variance / 160_000))
    assert image.iof.var() == pytest.approx(variance, rel=0.02)  # its own spread is 0.35 percent


def test_shot_noise_grows_with_the_root_of_the_signal():
    ramp = np.repeat([[0.02, 0.08, 0.32]], 30_000, axis=0)
    image = expose(ramp, Detector(read_noise_e=0.0), np.random.default_rng(0))
    np.testing.assert_allclose(np.diff(np.log2(image.iof.std(0))), [1.0, 1.0], atol=0.05)


def test_without_noise_the_radiance_comes_back():
    radiance = np.random.default_rng(0).uniform(0.0, 0.3, (50, 50))
    image = expose(radiance, Detector(noise=False), np.random.default_rng(1))
    np.testing.assert_allclose(image.iof, radiance, atol=1e-7)


def test_dn_are_linear_with_a_gain_and_offset_per_image():
    radiance = np.random.default_rng(0).uniform(0.0, 0.3, (200, 200))
    images = [expose(radiance, Detector(), np.random.default_rng(seed)) for seed in (1, 2)]
    assert images[0].gain != images[1].gain
    assert images[0].offset != images[1].offset
    for image in images:
        gain, offset = np.polyfit(radiance.ravel(), image.uint16.ravel().astype(float), 1)
        assert gain == pytest.approx(image.gain, rel=1e-3)
        assert offset == pytest.approx(image.offset, abs=5.0)
        assert (image.dn == np.round(image.dn)).all()


def test_saturated_pixels_are_marked():
    radiance = np.full((50, 50), 0.1)
    radiance[20, 30] = 2.0
    image = expose(radiance, Detector(), np.random.default_rng(0))
    assert np.argwhere(image.saturated).tolist() == [[20, 30]]
    assert np.isnan(image.iof[20, 30])
    assert image.uint16[20, 30] == 65535
    assert image.uint16.max(initial=0, where=~image.saturated) < 2**14


def test_hot_pixels_and_cosmic_rays_add_charge_in_few_places():
    detector = Detector(noise=False, hot_pixels=1e-3, cosmic_rays=20.0)
    radiance = np.full((200, 200), 0.1)
    hot = hot_pixel_charge(radiance.shape, detector, np.random.default_rng(0))
    image = expose(radiance, detector, np.random.default_rng(1), hot)
    struck = ~np.isclose(np.nan_to_num(image.iof, nan=9.0), 0.1, atol=1e-6)
    assert struck[hot > 0].all()
    assert 20 < struck.sum() < 600


def test_pixels_average_their_samples_behind_the_point_spread_function():
    """A sample point's light spreads with the variance of the PSF plus that of a square pixel, 1/12."""
    s, margin, sigma = 8, 4, 0.5
    fine = np.zeros(((15 + 2 * margin) * s,) * 2)
    fine[fine.shape[0] // 2, fine.shape[1] // 2] = s * s
    image = pixel_average(fine, s, margin, sigma)
    assert image.shape == (15, 15)
    assert image.sum() == pytest.approx(1.0, rel=1e-3)
    x = np.arange(15) + 0.5
    profile = image.sum(0)
    mean = profile @ x
    assert mean == pytest.approx(7.5, abs=0.5 / s + 1e-3)
    assert profile @ (x - mean) ** 2 == pytest.approx(sigma**2 + 1 / 12, rel=0.05)


@pytest.mark.parametrize("angle_deg", [0.0, 37.0, 90.0, 130.0])
def test_motion_spreads_a_point_evenly_along_its_path(angle_deg):
    """The variance along the path is length^2 / 12, the centre stays: what a truth of mid-exposure asks for."""
    along = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    kernel = smear_kernel(tuple(9.0 * along))
    half = len(kernel) // 2
    offset = np.stack(np.meshgrid(*[np.arange(-half, half + 1)] * 2), -1)
    assert kernel.sum() == pytest.approx(1.0)
    assert kernel.min() >= 0
    np.testing.assert_allclose(np.tensordot(kernel, offset), 0.0, atol=1e-12)
    across = np.array([-along[1], along[0]])
    assert np.sum(kernel * (offset @ along) ** 2) == pytest.approx(81.0 / 12.0, abs=0.26)  # sharing adds 1/4 at most
    assert np.sum(kernel * (offset @ across) ** 2) < 0.26


def test_smeared_pixels_are_the_mean_over_the_motion():
    """A plane wave that runs along the motion fades by sinc(length / wavelength)."""
    s, margin = 4, 6
    x = (np.arange((32 + 2 * margin) * s) + 0.5) / s
    fine = np.tile(1.0 + 0.5 * np.sin(2 * np.pi * x / 11.0), (len(x), 1))
    still, moved = pixel_average(fine, s, margin, 0.0), pixel_average(fine, s, margin, 0.0, (4.0, 0.0))
    fade = np.polyfit(still.ravel() - 1.0, moved.ravel() - 1.0, 1)
    assert fade[0] == pytest.approx(np.sinc(4.0 / 11.0), abs=4e-3)
    across = pixel_average(fine, s, margin, 0.0, (0.0, 4.0))
    np.testing.assert_allclose(across, still, atol=1e-12)


def test_a_constant_stays_constant():
    fine = np.full((40, 40, 3), 0.7)
    np.testing.assert_allclose(pixel_average(fine, 2, 3, 0.6), 0.7, rtol=1e-12)
    np.testing.assert_allclose(pixel_average(fine, 2, 3, 0.6, (2.0, 3.0)), 0.7, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bits": 24}, "bits"),
        ({"bits": 8}, "offset_dn 100 to 300 .* 0 to 128"),
        ({"offset_dn": (300.0, 100.0)}, "offset_dn"),
        ({"exposure_level": 0.0}, "exposure_level"),
        ({"smear_px": -1.0}, "smear"),
        ({"smear_px": 100.0}, "smear_px is 100; give 0 to 64"),
        ({"hot_pixels": 1.5}, "hot_pixels is 1.5; give 0 or more, below 1"),
    ],
)
def test_impossible_detectors_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        Detector(**change)
