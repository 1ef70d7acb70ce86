"""Figures of a scene against its images: exact scenes have no error, noise is found at its size."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.evaluate import (
    completeness,
    evaluate_scene,
    view_table,
)
from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import published
from photoclinometry.model.scene import Scene
from scenes import synthetic_images, synthetic_scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return synthetic_scene(size=30)


def test_an_exact_scene_explains_its_images(scene):
    """PSNR above 50 dB is the mesh's interpolation error; everything else is zero."""
    images = synthetic_images(scene)
    metrics = evaluate_scene(scene, images[::-1])
    assert metrics["photometric_error_mean_percent"] == pytest.approx(0.0, abs=1e-9)
    assert metrics["keypoint_residual_rms_px"] == pytest.approx(0.0, abs=1e-7)
    assert metrics["completeness_percent"] == 100.0
    assert metrics["psnr_min_db"] > 50.0
    rows = view_table(scene, images)
    assert [row["name"] for row in rows] == list(scene.views.name)
    assert rows[1]["keypoints"] == 900


def test_photometric_error_finds_brightness_noise_with_and_without_bias():
    scene = synthetic_scene(size=20, reflectance=published("mcewen"), brightness_noise=0.02)
    metrics = evaluate_scene(scene)
    assert metrics["photometric_error_mean_percent"] == pytest.approx(2.0, rel=0.1)
    without = metrics["photometric_error_without_scale_and_bias_mean_percent"]
    assert metrics["photometric_error_mean_percent"] < without < 4.0
    assert "psnr_mean_db" not in metrics


def test_completeness_counts_lit_pixels_only(scene):
    lit = np.zeros((30, 30), bool)
    lit[:, :15] = True
    keep = scene.landmarks.pixel[:, 0] < scene.region.row + 15
    marks = scene.landmarks
    half = replace(
        scene,
        landmarks=replace(marks, **{k: getattr(marks, k)[keep] for k in ("position", "normal", "albedo", "pixel")}),
    )
    assert completeness(half, lit) == 0.5


def test_geometry_alone_is_evaluated_without_photometry():
    scene = synthetic_scene(size=12, reflectance=None)
    metrics = evaluate_scene(scene, synthetic_images(scene))
    assert not any(key.startswith(("photometric", "psnr")) for key in metrics)
    assert "completeness_percent" in metrics


def test_an_image_of_another_size_is_refused(scene):
    image = synthetic_images(scene)[0]
    with pytest.raises(InputError, match="another site"):
        evaluate_scene(scene, [replace(image, brightness=image.brightness[:-1], valid=image.valid[:-1])])
