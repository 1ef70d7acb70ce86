"""Keypoints of the relief: alike under any Sun, so that views of opposite light match."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.image import Image
from photoclinometry.model.sparse import without_views
from photoclinometry.sfm import reconstruct_sparse
from photoclinometry.sfm.pictures import brightness_picture, relief_picture
from sparse_views import ALL_VALID, CAMERA, OPTIONS, lit_site, relief_of, rotation_errors_deg


def flat_shading(azimuth_deg, height):
    """(300, 300) brightness of heights that are seen from above, to first order in their slopes."""
    azimuth = np.radians(azimuth_deg)
    down, right = np.gradient(height)
    slope = np.cos(azimuth) * right + np.sin(azimuth) * down
    return Image("a.fits", (1.0 - 0.5 * slope)[100:400, 100:400].astype(np.float32), ALL_VALID)


def correlation(a, b):
    inner = np.s_[30:-30, 30:-30]
    return np.corrcoef(a[inner].ravel().astype(float), b[inner].ravel().astype(float))[0, 1]


@pytest.mark.parametrize(("apart", "brightness", "least"), [(180, -0.99, 0.99), (120, -0.4, 0.35), (90, 0.0, 0.2)])
def test_the_picture_of_the_relief_hardly_depends_on_the_sun(apart, brightness, least):
    """Brightness is reversed by opposite Suns and unrelated under perpendicular ones; the relief's picture is alike."""
    height, azimuths = relief_of(3), (25.0, 25.0 + apart)
    images = [flat_shading(azimuth, height) for azimuth in azimuths]
    suns = [np.array([np.cos(a), np.sin(a), -1.0]) / np.sqrt(2) for a in np.radians(azimuths)]
    reliefs = [relief_picture(image, sun) for image, sun in zip(images, suns, strict=True)]
    assert correlation(*map(brightness_picture, images)) == pytest.approx(brightness, abs=0.2)
    assert correlation(*reliefs) > least


def test_the_picture_is_dark_where_the_ground_is_high():
    """For hills along the Sun's direction. The sign is a convention; it must be the same for all views."""
    hills = np.sin(2 * np.pi * np.arange(300) / 9.0) * np.ones((300, 1))
    for sun in (0.8, -0.8):
        brightness = 1.0 - 0.1 * np.sign(sun) * np.gradient(hills, axis=1)
        image = Image("a.fits", brightness.astype(np.float32), ALL_VALID)
        assert correlation(relief_picture(image, np.array([sun, 0.0, -0.6])), hills) < -0.98


def test_a_sun_behind_the_camera_shows_no_relief():
    image = flat_shading(0.0, relief_of(3))
    assert relief_picture(image, np.array([0.05, 0.1, -np.sqrt(1 - 0.0125)])) is None


def test_views_of_opposite_light_register_by_their_relief(tmp_path, caplog):
    images, suns, poses = lit_site([20, 25, 30, 200, 205, 210])
    options = replace(OPTIONS, threads=1)
    alone = reconstruct_sparse(images, [CAMERA] * 6, tmp_path / "a", options)
    assert alone.registered.sum() == 3
    with caplog.at_level(logging.INFO):
        found = reconstruct_sparse(images, [CAMERA] * 6, tmp_path / "b", options, sun_in_cam=suns)
    assert found.registered.all()
    assert sorted(found.how_brought_in()) == np.flatnonzero(~alone.registered).tolist()
    assert "registers by keypoints of the relief, which match it with 3 more views" in caplog.text
    aside = np.arange(6) == next(iter(found.how_brought_in()))
    assert len(without_views(found, aside).how_brought_in()) == 2
    assert rotation_errors_deg(found.body_from_cam, poses).max() < 0.5


def test_views_that_match_by_brightness_are_not_matched_again(tmp_path):
    images, suns, _ = lit_site([20, 25, 30, 35])
    options = replace(OPTIONS, threads=1)
    alone = reconstruct_sparse(images, [CAMERA] * 4, tmp_path / "a", options)
    told = reconstruct_sparse(images, [CAMERA] * 4, tmp_path / "b", options, sun_in_cam=suns)
    assert alone.registered.all()
    np.testing.assert_array_equal(alone.points, told.points)
    assert told.how_brought_in() == {}


def test_relief_does_not_register_another_place(tmp_path):
    images, suns, _ = lit_site([20, 25, 30, 205])
    strangers, their_suns, _ = lit_site([22, 28, 200], seed=7, prefix="b")
    found = reconstruct_sparse(
        images + strangers, [CAMERA] * 7, tmp_path, OPTIONS, sun_in_cam=np.concatenate([suns, their_suns])
    )
    assert found.registered.tolist() == [True] * 4 + [False] * 3
