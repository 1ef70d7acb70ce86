"""Rendering: exact at landmarks, close between them; near surfaces hide far ones; shadows have the right length."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter

from photoclinometry.model.errors import InputError
from photoclinometry.model.mesh import grid_faces
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.render import (
    as_resolved,
    draw_landmarks,
    draw_smoothly,
    landmark_brightness,
    render_reference,
    render_view,
)
from photoclinometry.surface.map_rays import in_sunlight
from photoclinometry.surface.rasterise import draw_triangles
from photoclinometry.surface.relief import (
    angles_from_sun,
    heights,
    local_frame,
    mean_plane,
    sun_from_angles,
)
from scenes import synthetic_images, synthetic_scene, with_coarse_view, with_landmarks


@pytest.fixture(scope="module")
def scene() -> Scene:
    return synthetic_scene()


def test_rendering_the_reference_view_is_exact_at_the_landmarks(scene):
    """Each landmark of the reference view lies on a pixel centre, where nothing is interpolated."""
    image, mask = render_view(scene, scene.reference)
    row, col = scene.landmarks.pixel.T
    assert mask[row, col].all()
    np.testing.assert_allclose(image[row, col], landmark_brightness(scene, scene.reference), rtol=1e-6)
    on_grid, on_grid_mask = render_reference(scene)
    np.testing.assert_allclose(image[scene.region.slices], on_grid, rtol=1e-6)
    assert on_grid_mask.all()


def test_rendering_other_views_matches_their_exact_images(scene):
    """To the geometry of the mesh, and, near the map's edge, to that nothing is known beyond."""
    for k, image in enumerate(synthetic_images(scene)):
        rendered, mask = render_view(scene, k)
        assert mask.sum() > 1000
        np.testing.assert_allclose(rendered[mask], image.brightness[mask], rtol=0.015)
        inside = binary_erosion(mask, iterations=4)
        np.testing.assert_allclose(rendered[inside], image.brightness[inside], rtol=0.004)


def test_waves_of_four_landmarks_keep_their_height_between_landmarks(scene):
    """Of which linear interpolation takes up to half: three tenths along rows and along columns."""
    row, col = scene.cells
    waves = 2.0 + np.cos(0.5 * np.pi * row) * np.cos(0.5 * np.pi * col)
    place, mask = draw_landmarks(scene, 3, np.stack([row, col], axis=-1))
    inside = binary_erosion(mask, iterations=6)
    expected = 2.0 + np.prod(np.cos(0.5 * np.pi * place), axis=-1)
    smooth, linear = (draw(scene, 3, waves)[0] for draw in (draw_smoothly, draw_landmarks))
    assert np.abs(smooth - expected)[inside].max() < 0.06
    assert np.abs(linear - expected)[inside].max() > 0.4


def test_smooth_values_are_those_of_landmarks_next_to_holes_and_never_negative(scene):
    there = np.random.default_rng(0).random(len(scene.landmarks)) > 0.1
    fewer = with_landmarks(scene, there)
    dark = np.where(fewer.cells[1] > 20, 0.0, 1.0)
    drawn, mask = draw_smoothly(fewer, scene.reference, dark)
    row, col = fewer.landmarks.pixel.T
    np.testing.assert_allclose(drawn[row, col], dark, atol=1e-9)
    assert drawn.min() == 0.0
    assert (mask == draw_landmarks(fewer, scene.reference, dark)[1]).all()
    np.testing.assert_allclose(draw_smoothly(fewer, 3, np.full(there.sum(), 0.7))[0][mask_of(fewer, 3)], 0.7)


def mask_of(scene, view):
    return draw_landmarks(scene, view, scene.landmarks.albedo)[1]


def speckled(scene, seed=0):
    """Albedos that differ by a third from landmark to landmark, which half the resolution does not show."""
    albedo = scene.landmarks.albedo * np.random.default_rng(seed).uniform(0.7, 1.3, len(scene.landmarks))
    return replace(scene, landmarks=replace(scene.landmarks, albedo=albedo))


def test_a_coarse_view_averages_over_its_pixels(scene):
    """Against the same camera's finer rendering, averaged over pixels of twice the size and half of one's blur."""
    fine = speckled(scene)
    assert fine.views.cameras[3].width % 2 == 0
    coarse = with_coarse_view(fine, 3)
    picture, mask = render_view(fine, 3)
    size = picture.shape[0] // 2
    wide = gaussian_filter(picture, np.sqrt(0.75)).reshape(size, 2, size, 2).mean((1, 3))
    inside = binary_erosion(mask.reshape(size, 2, size, 2).all((1, 3)), iterations=3)
    sampled = draw_landmarks(coarse, 3, landmark_brightness(coarse, 3))[0]
    error, without = (np.std((rendered - wide)[inside]) for rendered in (render_view(coarse, 3)[0], sampled))
    assert error < 0.25 * without
    np.testing.assert_array_equal(render_view(coarse, 2)[0], render_view(fine, 2)[0])


def test_averages_for_coarse_views_keep_constants_and_skip_holes(scene):
    there = np.random.default_rng(0).random(len(scene.landmarks)) > 0.2
    coarse = with_coarse_view(with_landmarks(scene, there), 3, factor=3)
    np.testing.assert_allclose(as_resolved(coarse, 3, np.full(there.sum(), 0.7)), 0.7, rtol=1e-12)
    noise = np.random.default_rng(1).normal(size=there.sum())
    assert np.std(as_resolved(coarse, 3, noise)) < 0.35
    np.testing.assert_array_equal(as_resolved(coarse, 2, noise), noise)


def test_relighting_with_a_views_own_sun_changes_nothing(scene):
    again, _ = render_view(scene, 2, sun=3.0 * scene.views.sun[2])
    np.testing.assert_allclose(again, render_view(scene, 2)[0], rtol=1e-9)


def test_geometry_alone_cannot_be_rendered():
    with pytest.raises(InputError, match="reflectance model"):
        render_view(synthetic_scene(size=8, reflectance=None), 0)


def test_the_nearer_of_two_triangles_wins_in_any_order():
    pixel = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]] * 2)
    depth, value = np.repeat([2.0, 1.0], 3), np.repeat([20.0, 10.0], 3)
    for faces in ([[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]]):
        image, mask = draw_triangles(pixel, depth, value, np.array(faces), (12, 12))
        np.testing.assert_allclose(image[mask], 10.0)
    assert mask[4, 4]  # centre (4.5, 4.5) is inside x + y <= 10
    assert not mask[5, 5]
    assert mask.sum() == 55


def test_of_equally_near_triangles_the_first_wins_wherever_rounding_falls():
    pixel = np.tile(np.random.default_rng(0).uniform(-30.0, 130.0, (3, 2)), (2, 1)) + np.repeat([0.0, 0.7], 3)[:, None]
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    for order in (faces, faces[::-1]):
        image, mask = draw_triangles(pixel, np.ones(6), np.repeat([10.0, 20.0], 3), order, (100, 100))
        _, of_first = draw_triangles(pixel, np.ones(6), np.ones(6), order[:1], (100, 100))
        assert (mask & ~of_first).any()
        assert np.ptp(image[of_first]) < 1e-9


def test_several_values_are_drawn_as_each_alone():
    rng = np.random.default_rng(0)
    pixel, depth, value = rng.uniform(0.0, 20.0, (6, 2)), rng.uniform(1.0, 2.0, 6), rng.normal(size=(6, 3))
    faces = np.array([[0, 1, 2], [3, 4, 5], [0, 3, 5]])
    image, mask = draw_triangles(pixel, depth, value, faces, (20, 20))
    assert mask.any()
    for n in range(3):
        np.testing.assert_array_equal(image[..., n], draw_triangles(pixel, depth, value[:, n], faces, (20, 20))[0])


def test_interpolation_is_linear_on_the_triangle_and_not_in_the_image():
    """Half-way in the image between depths 1 and 3 is a quarter along the edge: 1/z is linear."""
    pixel = np.array([[0.5, 0.5], [4.5, 0.5], [0.5, 4.5]])
    image, _ = draw_triangles(
        pixel, np.array([1.0, 3.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([[0, 1, 2]]), (5, 5)
    )
    assert image[0, 2] == pytest.approx(0.25)


def test_cells_with_a_depth_jump_or_a_missing_corner_are_left_open():
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    position = np.stack([x, y, np.where(x >= 3, 100.0, 0.0)], -1)
    present = np.ones((5, 6), bool)
    faces = grid_faces(position, present)
    assert len(faces) == 2 * 4 * 4  # five columns of cells, one of which jumps
    flat = np.stack([x, y, 0 * x], -1)
    for corner, left in [((0, 0), 2 * 20 - 1), ((2, 2), 2 * 20 - 4)]:
        present = np.ones((5, 6), bool)
        present[corner] = False
        faces = grid_faces(flat, present)
        assert len(faces) == left
        a, b, c = np.moveaxis(flat.reshape(-1, 3)[faces], 1, 0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2
        assert area == pytest.approx(left / 2)  # no triangle lies over another


def test_missing_landmarks_leave_a_hole_of_their_size(scene):
    keep = np.ones(len(scene.landmarks), bool)
    keep[20 * 40 + 20] = False
    marks = scene.landmarks
    fewer = replace(
        scene,
        landmarks=replace(marks, **{k: getattr(marks, k)[keep] for k in ("position", "normal", "albedo", "pixel")}),
    )
    _, whole = draw_landmarks(scene, 0, scene.landmarks.albedo)
    _, open_ = draw_landmarks(fewer, 0, fewer.landmarks.albedo)
    row, col = marks.pixel[20 * 40 + 20]
    assert np.argwhere(whole & ~open_).tolist() == [[row, col]]


def test_mean_plane_ignores_spikes():
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-50, 50, (500, 2)), 0.1 * rng.normal(size=(500, 1))], -1)
    points[:25, 2] += 60.0
    center, normal = mean_plane(points)
    assert np.degrees(np.arccos(abs(normal[2]))) < 0.05
    assert abs(center[2]) < 0.1


def test_heights_are_above_the_plane_towards_the_cameras(scene):
    """The test site is level: its heights are z up to a constant and a tilt of a few tenths of a degree."""
    z = scene.grid(scene.landmarks.position[:, 2])
    height = scene.grid(heights(scene))
    assert np.corrcoef(height.ravel(), z.ravel())[0, 1] > 0.95
    assert local_frame(scene).rotation[2, 2] > 0.99


def test_sun_angles_count_clockwise_from_up_in_the_reference_image(scene):
    frame = local_frame(scene)
    sun = sun_from_angles(frame, np.deg2rad(90.0), np.deg2rad(30.0))
    in_cam = scene.views.body_from_cam[scene.reference].rotation.T @ sun
    assert in_cam[0] > 0.8  # from the right
    assert in_cam[2] < -0.4  # towards the camera
    np.testing.assert_allclose(np.rad2deg(angles_from_sun(frame, sun)), [90.0, 30.0], atol=1e-9)


def _wall(scene: Scene, height: float) -> Scene:
    """Level ground seen from straight above, and in the middle a wall of two columns, which rays of such steps meet."""
    camera, region = scene.views.cameras[0], scene.region
    pose = scene.views.body_from_cam[0]
    rays = camera.ray_in_cam(region.pixel_centers()).reshape(-1, 3)
    distance = 600e3
    depth = np.full(len(rays), distance)
    depth[np.isin(scene.landmarks.pixel[:, 1] - region.col, (20, 21))] -= height
    marks = replace(
        scene.landmarks,
        position=pose(rays * depth[:, None]),
        normal=np.broadcast_to(-pose.rotation[:, 2], (len(rays), 3)),
    )
    return replace(scene, landmarks=marks)


def test_a_wall_casts_a_shadow_of_the_length_that_trigonometry_gives(scene):
    """Height 5 GSD, Sun 45 degrees high from the right: five pixels to the left lie in shadow."""
    wall = _wall(scene, 5 * 60.0)
    pose = wall.views.body_from_cam[0]
    lit = wall.grid(in_sunlight(wall, pose.rotation @ np.array([1.0, 0.0, -1.0]) / np.sqrt(2))) > 0
    middle = lit[10:30]
    assert middle[:, 22:].all()
    assert middle[:, :14].all()
    assert not middle[:, 16:19].any()
    assert in_sunlight(wall, -pose.rotation[:, 2]).all()


def test_a_rough_slope_that_the_sun_lights_does_not_shade_itself(scene):
    """Ground that rises by 0.74 to a column, half a GSD up and down from one to the next; the ray by 1.37."""
    wall = _wall(scene, 0.0)
    pose, region = wall.views.body_from_cam[0], wall.region
    col = wall.landmarks.pixel[:, 1] - region.col
    depth = pose.inverse()(wall.landmarks.position)[:, 2]
    closer = depth - 60.0 * (0.74 * (col - 20) + 0.5 * (-1.0) ** col)
    position = pose(pose.inverse()(wall.landmarks.position) * (closer / depth)[:, None])
    slope = replace(wall, landmarks=replace(wall.landmarks, position=position))
    assert in_sunlight(slope, pose.rotation @ np.array([0.59, 0.0, -0.807])).all()
    assert not in_sunlight(slope, pose.rotation @ np.array([0.9, 0.0, -0.436])).all()


def test_a_gentle_site_under_a_high_sun_has_no_cast_shadow(scene):
    assert in_sunlight(scene, scene.views.sun[0]).all()
    image, _ = render_reference(scene, cast_shadows=True)
    np.testing.assert_array_equal(image, render_reference(scene)[0])


def test_a_low_sun_leaves_shadow_at_the_bias_and_soft_edges_between(scene):
    low = sun_from_angles(local_frame(scene), 0.3, np.deg2rad(5.0))
    with_shadow, _ = render_reference(scene, sun=low, cast_shadows=True)
    without, _ = render_reference(scene, sun=low)
    lit = scene.grid(in_sunlight(scene, low)) > 0
    near_lit, near_shadow = binary_dilation(lit, np.ones((3, 3))), binary_dilation(~lit, np.ones((3, 3)))
    bias = scene.views.bias[0]
    assert 0.02 < (~near_lit).mean() < 0.9
    assert (with_shadow[~near_lit] == bias).all()
    np.testing.assert_array_equal(with_shadow[~near_shadow], without[~near_shadow])
    edge = near_lit & near_shadow & (without > bias)
    assert ((with_shadow[edge] > bias) & (with_shadow[edge] < without[edge])).all()
