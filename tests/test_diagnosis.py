"""Figures of diagnosis: answers by hand, and what faults that are made do to them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.diagnosis import (
    RINGS,
    albedo_shading_correlation,
    keypoints_by_radius,
    residuals_by_brightness,
    view_diagnosis,
)
from photoclinometry.evaluate.evaluate import evaluate_scene, view_table
from photoclinometry.evaluate.illumination import light_spans_deg, smallest_arc, view_angles_deg
from photoclinometry.model.geometry import so3_exp, unit
from photoclinometry.model.projection import projected_keypoints
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.photometry.predict import observation_brightness, shading
from scenes import FOCAL_PX, GSD, synthetic_scene


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=40, views=6)


@pytest.mark.parametrize(
    ("azimuths", "arc"), [((10.0, 350.0, 20.0), 30.0), ((0.0, 120.0, 240.0), 240.0), ((77.0,), 0.0), ((5.0, 5.0), 0.0)]
)
def test_the_smallest_arc_goes_across_north(azimuths, arc):
    assert np.degrees(smallest_arc(np.radians(azimuths))) == pytest.approx(arc, abs=1e-9)


def test_angles_of_level_ground_are_those_of_its_vertical(scene):
    """Under Suns of 30 and 50 degrees of incidence, 70 degrees of azimuth apart."""
    points = scene.landmarks
    ground = replace(points, position=points.position * [1.0, 1.0, 0.0], normal=np.tile([0.0, 0.0, 1.0], (1600, 1)))
    flat = replace(scene, landmarks=ground)
    incidence, azimuth = np.radians([30.0, 50.0]), np.radians([20.0, 90.0])
    suns = np.stack([np.sin(incidence) * np.sin(azimuth), np.sin(incidence) * np.cos(azimuth), np.cos(incidence)], -1)
    sun = suns[np.arange(len(flat.views)) % 2]
    flat = replace(flat, views=replace(flat.views, sun=sun))
    found = view_angles_deg(flat)
    np.testing.assert_allclose(found["incidence"], np.where(np.arange(len(sun)) % 2, 50.0, 30.0), atol=1e-6)
    to_camera = unit(flat.views.body_from_cam.translation - flat.landmarks.position.mean(0))
    np.testing.assert_allclose(found["emission"], np.degrees(np.arccos(to_camera[:, 2])), atol=0.2)
    np.testing.assert_allclose(found["phase"], np.degrees(np.arccos(np.sum(to_camera * sun, -1))), atol=0.2)
    spans = light_spans_deg(flat)
    assert spans["sun_azimuth_span_deg"] == pytest.approx(70.0, abs=1e-6)
    assert spans["suns_span_deg"] == pytest.approx(np.degrees(np.arccos(suns[0] @ suns[1])))
    assert spans["incidence_span_deg"] == pytest.approx(20.0, abs=1e-6)


def test_a_sun_that_moved_is_told_in_degrees_and_in_its_sigmas(scene):
    """By 2 degrees about one axis, stated to 0.6 by itself and 0.8 with the others: 2 sigmas along one of two axes."""
    views, sun = scene.views, scene.views.sun.copy()
    across = unit(np.cross(sun[2], [1.0, 0.0, 0.0]))
    sun[2] = so3_exp(np.radians(2.0) * across) @ sun[2]
    views = replace(views, sun=sun, sun_sigma=np.full(6, np.radians(0.6)), sun_common_sigma=np.full(6, np.radians(0.8)))
    rows = view_diagnosis(replace(scene, views=views))
    np.testing.assert_allclose([row["sun_moved_deg"] for row in rows], [0, 0, 2.0, 0, 0, 0], atol=1e-5)
    assert rows[2]["sun_moved_sigmas"] == pytest.approx(2.0 / np.sqrt(2.0))
    assert (
        "sun_moved_sigmas"
        not in view_diagnosis(
            replace(scene, views=replace(views, sun_sigma=np.zeros(6), sun_common_sigma=np.zeros(6)))
        )[0]
    )


def test_the_ground_sample_distance_of_a_view_grows_with_its_distance(scene):
    row, far = view_diagnosis(scene)[0], scene.views.body_from_cam.translation.copy()
    assert row["gsd_in_scene_unit"] == pytest.approx(GSD, rel=0.01)
    middle = scene.landmarks.position.mean(0)
    far[1] += far[1] - middle
    pose = replace(scene.views.body_from_cam, translation=far)
    moved = replace(scene, frame=BODY_FIXED, views=replace(scene.views, body_from_cam=pose))
    depth = np.linalg.norm(far[1] - middle)
    assert view_diagnosis(moved)[1]["gsd_m"] == pytest.approx(depth / FOCAL_PX, rel=0.01)


def test_distortion_is_a_trend_of_keypoints_with_radius(scene):
    """Keypoints that are all over the detector, off outwards by 1 px times the cube of the radius."""
    camera, projected = scene.views.cameras[0], projected_keypoints(scene)
    middle = np.array(camera.principal_px)
    side = int(2.2 * np.abs(projected - middle).max())  # a detector that the map fills
    small = replace(camera, width=side, height=side)
    farthest = np.linalg.norm(np.maximum(middle, side - middle))
    off = projected - middle
    radius = np.linalg.norm(off, axis=1)
    keypoint = projected + (radius**2 / farthest**3)[:, None] * off
    spoilt = replace(
        scene,
        views=replace(scene.views, cameras=(small,) * 6),
        tracks=replace(scene.tracks, keypoint=keypoint),
    )
    found = keypoints_by_radius(spoilt)
    for name, values in found.items():
        assert len(values) == RINGS, name
        known = [value for value in values if value is not None]
        assert len(known) >= 2
        assert (np.diff(known) > 0.0).all()
    ring = (RINGS * radius / farthest).astype(int) == 1
    expected = np.median(radius[ring] ** 3) / farthest**3
    assert found["keypoint_outwards_by_radius_px"][1] == pytest.approx(expected, rel=0.01)


def test_an_offset_is_a_trend_of_residuals_with_brightness(scene):
    """5 % of the median brightness in all images, by the brightness of each fifth."""
    predicted = observation_brightness(scene)
    offset = 0.05 * np.median(predicted)
    with_offset = replace(scene, tracks=replace(scene.tracks, brightness=predicted + offset))
    (found,) = residuals_by_brightness(with_offset).values()
    lit = np.sort(predicted[scene.tracks.lit])
    fifths = np.array_split(lit, 5)
    np.testing.assert_allclose(found, [100.0 * offset / np.median(part) for part in fifths], rtol=1e-2)
    exact = replace(scene, tracks=replace(scene.tracks, brightness=predicted))
    np.testing.assert_allclose(residuals_by_brightness(exact)["brightness_residual_by_quintile_percent"], 0.0)


def too_steep(scene, factor):
    """Slopes times a factor, with the albedos that then explain the brightness best."""
    normal = unit(scene.landmarks.normal * [factor, factor, 1.0])
    tracks = scene.tracks
    rho = shading(tracks.landmark, tracks.view, scene.views, scene.landmarks.position, normal, scene.reflectance)[2]
    count = len(scene.landmarks)
    albedo = np.bincount(tracks.landmark, rho * tracks.brightness, count) / np.bincount(tracks.landmark, rho**2, count)
    return replace(scene, landmarks=replace(scene.landmarks, normal=normal, albedo=albedo))


def test_shading_left_in_albedos_correlates_with_them():
    """Suns of one side: of right slopes the correlation is near zero, of flat ones positive, of steep ones negative."""
    scene = synthetic_scene(size=40, views=6)
    one_side = replace(scene.views, sun=np.tile(scene.views.sun[:1], (6, 1)))
    scene = replace(scene, views=one_side)
    scene = replace(scene, tracks=replace(scene.tracks, brightness=observation_brightness(scene)))
    right, flat, steep = (albedo_shading_correlation(too_steep(scene, factor)) for factor in (1.0, 0.5, 1.5))
    assert abs(right) < 0.2
    assert flat > 0.6
    assert steep < -0.6
    assert albedo_shading_correlation(replace(scene, reflectance=None)) is None


def test_the_figures_are_in_the_tables_and_in_metrics_json(scene, mapped):
    assert {"suns_span_deg", "sun_azimuth_span_deg", "albedo_shading_correlation"} <= evaluate_scene(scene).keys()
    assert view_diagnosis(scene)[0].items() <= view_table(scene)[0].items()
    content = json.loads((mapped.run / "metrics.json").read_text())
    assert set(content["diagnosis"]) == {
        "keypoint_residual_by_radius_px",
        "keypoint_outwards_by_radius_px",
        "brightness_residual_by_quintile_percent",
    }
    page = mapped.result.report.read_text(encoding="utf-8")
    assert "Residuals by place and brightness" in page
    assert "sun moved [°]" in page
