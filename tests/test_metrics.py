"""Metrics computed by hand, and their tables."""

import numpy as np
import pytest

from photoclinometry.evaluate.metrics import (
    albedo_error,
    along_and_sideways,
    landmark_error,
    normal_error,
    photometric_error,
    psnr,
    spread,
)
from photoclinometry.evaluate.tables import markdown, metric_rows


def test_photometric_error_by_hand():
    """Residuals 3 and 4 around a mean of 10: sqrt(25 / 2) / 10; one landmark has no observation."""
    error = photometric_error(np.array([11.0, 17.0, 5.0]), np.array([8.0, 12.0 + 1.0, 5.0]), np.array([0, 0, 2]), 3)
    assert error[0] == pytest.approx(np.sqrt(12.5) / 10.5)
    assert np.isnan(error[1])
    assert error[2] == 0.0


def test_an_error_of_position_has_a_part_along_the_normal_and_one_sideways():
    """A point 3 too low and 4 aside of its place on ground that looks along z: an error of 5, of the surface 3."""
    along, sideways = along_and_sideways(np.array([[0.0, 4.0, -3.0]]), np.array([[0.0, 0.0, 1.0]]))
    assert along == pytest.approx([-3.0])
    assert sideways == pytest.approx([4.0])


def test_psnr_by_hand():
    """Of a peak of 4, errors 0.4 and 0 on two pixels: MSE = 0.01 / 2, 23.01 dB; the masked pixel is ignored."""
    image, rendered = np.array([[4.0, 2.0, 1.0]]), np.array([[3.6, 2.0, 9.0]])
    mask = np.array([[True, True, False]])
    assert psnr(image, rendered, mask, 4.0) == pytest.approx(10 * np.log10(200.0))
    assert psnr(image, image, mask, 4.0) == np.inf
    assert np.isnan(psnr(image, image, ~mask & mask, 4.0))


def test_normal_and_albedo_errors_by_hand():
    normal = np.array([0.0, np.sin(1e-9), np.cos(1e-9)])
    assert normal_error(normal, np.array([0.0, 0.0, 5.0])) == pytest.approx(1e-9)  # arccos would give 0
    assert albedo_error(np.array(0.33), np.array(0.30)) == pytest.approx(0.1)


def test_landmark_error_by_hand():
    """The nearest of two points, 3-4-5; and the surface between them is nearer than either."""
    reference = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
    assert landmark_error(np.array([[3.0, 4.0, 0.0], [9.0, 0.0, 0.0]]), reference) == pytest.approx([5.0, 1.0])


def test_spread_ignores_gaps_and_signs():
    found = spread(np.array([3.0, -4.0, np.nan]), "error", "m")
    assert found == pytest.approx(
        {"error_mean_m": 3.5, "error_median_m": 3.5, "error_rms_m": np.sqrt(12.5), "error_p90_m": 3.9}
    )
    assert spread(np.array([np.nan]), "error", "m") == {}


def test_tables_read_units_from_keys():
    metrics = {**spread(np.array([1.0, 2.0]), "normal_error", "deg"), "psnr_mean_db": 40.25, "views": 29}
    spreads, singles = metric_rows(metrics)
    assert spreads == [("normal error", "°", "1.5", "1.5", "1.581", "1.9")]
    assert singles == [("PSNR mean", "40.25 dB"), ("views", "29")]
    assert "| normal error | ° | 1.5 |" in markdown(metrics, "Site")
