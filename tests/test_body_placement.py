"""Renderings of closed surfaces, and the poses of images that they give."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.body.placement import place_view
from photoclinometry.body.renderings import (
    OPTICS_PX,
    best_optics,
    disk_explained,
    disk_psnr,
    median_gain,
    psnr_by_optics,
)
from photoclinometry.body.sparse import FEWEST_POINTS
from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, angle_between, so3_exp, unit
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance import published
from photoclinometry.model.scene import Views
from photoclinometry.photometry.shape_rendering import ShadedSurface, rendered_shape, through_optics
from photoclinometry.simulate.trajectory import looking_at
from photoclinometry.surface.closed_mesh import icosahedron, refine
from photoclinometry.surface.mesh_rays import MeshRays

pytest.importorskip("embreex")

RADIUS, DISTANCE, FOCAL, SIZE = 10.0, 200.0, 2000.0, 240
CAMERA = Camera("PINHOLE", SIZE, SIZE, (FOCAL, FOCAL, SIZE / 2, SIZE / 2))
LAMBERT = published("lunar-lambert", "vesta")
GSD = DISTANCE / FOCAL


def ball(albedo=None):
    direction, faces = refine(*icosahedron(), 0.02, unit)
    return ShadedSurface(
        rays=MeshRays(RADIUS * direction, faces, 0.02 * RADIUS),
        normals=direction,
        albedo=np.full(len(direction), 0.2) if albedo is None else albedo(direction),
        reflectance=LAMBERT,
    )


def spots(direction):
    """Dark and bright spots of many sizes."""
    rng, value = np.random.default_rng(0), np.full(len(direction), 0.2)
    for middle, size in zip(unit(rng.normal(size=(400, 3))), rng.uniform(0.03, 0.12, 400), strict=True):
        value *= 1.0 + rng.uniform(-0.4, 0.6) * np.exp(-0.5 * (angle_between(direction, middle[None]) / size) ** 2)
    return value


@pytest.fixture(scope="module")
def spotted():
    return ball(spots)


@pytest.fixture(scope="module")
def drawn(spotted):
    """As seen at POSE under SUN."""
    return rendered_shape(spotted, CAMERA, POSE, SUN)


def view_at(pose, sun):
    return Views(
        name=("0",),
        cameras=(CAMERA,),
        body_from_cam=Rigid(pose.rotation[None], pose.translation[None]),
        sun=sun[None],
        scale=np.ones(1),
        bias=np.zeros(1),
        dark_level=np.zeros(1),
        sun_measured=(sun @ pose.rotation)[None],
        sun_sigma=np.full(1, 1e-3),
        sun_common_sigma=np.zeros(1),
        arc=np.zeros(1, int),
    )


POSE = looking_at(DISTANCE * unit(np.array([1.0, 0.2, 0.1])), np.zeros(3), 0.0, (0.0, 0.0, 1.0))
SUN = unit(np.array([1.0, 0.9, 0.3]))


def test_a_rendered_ball_has_the_brightness_of_its_equation():
    found = rendered_shape(ball(), CAMERA, POSE, SUN)
    ray = unit(CAMERA.ray_in_cam(np.array([[150.5, 100.5]])) @ POSE.rotation.T)[0]
    along = -ray @ POSE.translation - np.sqrt((ray @ POSE.translation) ** 2 - DISTANCE**2 + RADIUS**2)
    normal = unit(POSE.translation + along * ray)
    expected = 0.2 * LAMBERT(normal @ SUN, -normal @ ray, angle_between(SUN, -ray))
    assert found[100, 150] == pytest.approx(float(expected), rel=2e-3)
    assert np.isnan(found[0, 0])
    assert np.nanmin(found) == 0.0  # beyond the terminator


def test_an_image_is_placed_by_a_rendering_from_a_prior_that_is_off_by_many_pixels(spotted, drawn):
    image = Image("0", np.nan_to_num(drawn).astype(np.float32), np.ones((SIZE, SIZE), bool))
    turn = so3_exp(np.array([0.004, -0.003, 0.01]))
    off = Rigid(turn @ POSE.rotation, POSE.translation + [0.0, 0.6, -0.8])
    prior = PosePrior(cam_from_body=off.inverse(), rotation_sigma_rad=5e-3, translation_sigma=1.0)
    start = view_at(POSE, SUN).at_poses(Rigid(off.rotation[None], off.translation[None]))
    found = place_view(spotted, GSD, image, start, prior)
    assert found.matches > 3 * FEWEST_POINTS
    assert found.off_px < 0.3
    points = RADIUS * unit(POSE.translation + np.random.default_rng(1).normal(size=(50, 3)) * 60.0)
    placed = start.at_poses(found.pose)
    true = view_at(POSE, SUN)
    assert np.abs(start.project(0, points) - true.project(0, points)).max() > 8.0
    assert np.abs(placed.project(0, points) - true.project(0, points)).max() < 0.3


def test_an_image_of_something_else_is_not_placed(spotted):
    rng = np.random.default_rng(2)
    image = Image("0", rng.uniform(0.1, 1.0, (SIZE, SIZE)).astype(np.float32), np.ones((SIZE, SIZE), bool))
    prior = PosePrior(cam_from_body=POSE.inverse(), rotation_sigma_rad=2e-3, translation_sigma=1.0)
    found = place_view(spotted, GSD, image, view_at(POSE, SUN), prior)
    assert not found.is_placed


@pytest.mark.parametrize("wrong", ["beside the body", "of its night"])
def test_an_image_whose_prior_shows_sky_or_night_is_not_placed(wrong):
    picture = np.random.default_rng(2).uniform(0.1, 1.0, (SIZE, SIZE)).astype(np.float32)
    image = Image("0", picture, np.ones((SIZE, SIZE), bool))
    turned = Rigid(POSE.rotation @ so3_exp(np.array([0.3, 0.0, 0.0])), POSE.translation)
    pose, sun = (turned, SUN) if wrong == "beside the body" else (POSE, -SUN)
    prior = PosePrior(cam_from_body=pose.inverse(), rotation_sigma_rad=2e-3, translation_sigma=1.0)
    found = place_view(ball(), GSD, image, view_at(pose, sun), prior)
    assert (found.matches, found.is_placed) == (0, False)


def test_the_sun_turns_with_the_camera():
    view = view_at(POSE, SUN)
    turn = so3_exp(np.array([0.1, 0.2, 0.3]))
    moved = view.at_poses(Rigid((turn @ POSE.rotation)[None], POSE.translation[None]))
    assert moved.body_from_cam.rotation[0].T @ moved.sun[0] == pytest.approx(POSE.rotation.T @ SUN)


def test_the_optics_of_each_camera_are_found_from_its_images(drawn):
    """Two cameras that see the same, one through optics of 0.75 px and one sharply; a view without a pose tells
    nothing, and has what its camera has."""
    rng, quality = np.random.default_rng(1), []
    for width in (0.75, 0.0):
        seen = np.nan_to_num(through_optics(drawn, width)) + rng.normal(0.0, 1e-4, drawn.shape)
        image = Image("0", seen.astype(np.float32), np.ones(seen.shape, bool))
        quality.append(psnr_by_optics(image, drawn, absolute=True))
    other = replace(CAMERA, params=(FOCAL + 1.0, *CAMERA.params[1:]))
    best = best_optics((CAMERA, other, CAMERA), np.array([*quality, np.full(len(OPTICS_PX), np.nan)]))
    np.testing.assert_array_equal(OPTICS_PX[best], [0.75, 0.0, 0.75])
    assert quality[0].max() > quality[0][0] + 5.0


def test_uncalibrated_images_have_the_gain_of_their_lit_ground(drawn):
    """Whatever an eighth of the pixels shows; and nothing is known where all is dark."""
    rng = np.random.default_rng(0)
    seen = np.where(rng.random(drawn.shape) < 0.125, 9.0, 340.0 * np.nan_to_num(drawn))
    image = Image("0", seen.astype(np.float32), np.ones(seen.shape, bool))
    assert median_gain(image, drawn) == pytest.approx(340.0, rel=1e-5)
    assert disk_psnr(image, drawn, absolute=False) == pytest.approx(disk_psnr(image, 340.0 * drawn, absolute=True))
    assert median_gain(image, 0.0 * drawn) == 1.0


def test_the_share_that_is_explained_is_all_of_a_right_rendering_and_none_of_an_even_disk(spotted, drawn):
    """And less than none under the opposite Sun. What the rendering does not show lit has no part."""
    image = Image("0", np.nan_to_num(drawn, nan=7.0).astype(np.float32), np.ones(drawn.shape, bool))
    lit = drawn > 0
    assert disk_explained(image, drawn) == pytest.approx(1.0, abs=1e-5)
    even = np.where(lit, np.median(drawn[lit]), drawn)
    assert disk_explained(image, even) == pytest.approx(0.0, abs=1e-6)
    towards = unit(POSE.translation)
    opposite = 2.0 * (SUN @ towards) * towards - SUN
    assert disk_explained(image, rendered_shape(spotted, CAMERA, POSE, opposite)) < -0.3
    assert np.isnan(disk_explained(image, 0.0 * drawn))


def test_optics_spread_brightness_and_lose_none_of_it_inside_the_disk():
    drawn = np.full((41, 41), np.nan)
    drawn[5:-5, 5:-5] = 0.0
    drawn[20, 20] = 1.0
    seen = through_optics(drawn, 1.0)
    assert np.nansum(seen) == pytest.approx(1.0)
    assert seen[20, 20] == pytest.approx(1.0 / (2.0 * np.pi), rel=0.05)
    np.testing.assert_array_equal(np.isnan(seen), np.isnan(drawn))
