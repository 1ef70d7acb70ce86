"""Rays at meshes, closed surfaces through points, plans of tiles, and the surface merged from tiles."""

from dataclasses import replace

import numpy as np
import pytest

from fault_place import small_disk
from photoclinometry.body.coarse_shape import ClosedMesh, oriented
from photoclinometry.body.merge import Cloud, merged
from photoclinometry.body.options import TilePlanOptions
from photoclinometry.body.overlap import Overlap, overlap_of, shared_images, sigma_factors
from photoclinometry.body.plan import planned
from photoclinometry.body.poisson import closed_surface
from photoclinometry.body.tile_map import TileLandmarks, TileMap, TileTiePoints
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import OutputError, ReconstructionError
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.scene import Views
from photoclinometry.registration.view_choice import most_diverse
from photoclinometry.simulate.trajectory import looking_at
from photoclinometry.surface.closed_mesh import icosahedron, is_watertight, largest_component, refine, signed_volume
from photoclinometry.surface.mesh_rays import MeshRays, depth_image, emission_image, sight_of_views

pytest.importorskip("embreex")

RADIUS, DISTANCE, FOCAL, SIZE = 10.0, 200.0, 1200.0, 160
CAMERA = Camera("PINHOLE", SIZE, SIZE, (FOCAL, FOCAL, SIZE / 2, SIZE / 2))


@pytest.fixture(scope="module")
def ball():
    direction, faces = refine(*icosahedron(), 0.06, unit)
    return ClosedMesh(vertices=RADIUS * direction, faces=faces, spacing=0.06 * RADIUS)


def rays_at(mesh):
    return MeshRays(mesh.vertices, mesh.faces, mesh.spacing)


def views_from(directions, suns, focal=FOCAL):
    """Views of the origin from unit vectors (K, 3)."""
    poses = [looking_at(DISTANCE * np.array(d), np.zeros(3), 0.0, (0.1, 0.2, 1.0)) for d in directions]
    count, camera = len(poses), Camera("PINHOLE", SIZE, SIZE, (focal, focal, SIZE / 2, SIZE / 2))
    return Views(
        name=tuple(f"{k}" for k in range(count)),
        cameras=(camera,) * count,
        body_from_cam=Rigid(np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])),
        sun=np.array(suns),
        scale=np.ones(count),
        bias=np.zeros(count),
        dark_level=np.zeros(count),
        sun_measured=np.array(suns),
        sun_sigma=np.full(count, 1e-3),
        sun_common_sigma=np.zeros(count),
        arc=np.zeros(count, int),
    )


def ring(count, latitude_deg, phase_deg=20.0):
    """Directions of cameras and Suns around the equator at a latitude."""
    longitude = np.radians(np.arange(count) * 360.0 / count)

    def towards(turn, latitude):
        return np.stack(
            [np.cos(latitude) * np.cos(turn), np.cos(latitude) * np.sin(turn), np.full(count, np.sin(latitude))], -1
        )

    latitude = np.radians(latitude_deg)
    return towards(longitude, latitude), towards(longitude + np.radians(phase_deg), latitude)


def test_depth_and_emission_of_a_ball_are_those_of_its_equation(ball):
    pose = looking_at(np.array([DISTANCE, 0.0, 0.0]), np.zeros(3), 0.0, (0.0, 0.0, 1.0))
    depth, emission = (draw(rays_at(ball), CAMERA, pose) for draw in (depth_image, emission_image))
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2
    ray = np.stack([x / FOCAL, y / FOCAL, np.ones_like(x)], -1)
    square = np.sum(ray**2, -1)
    inside = DISTANCE**2 - square * (DISTANCE**2 - RADIUS**2)
    well = inside > 0.2 * RADIUS**2
    expected = (DISTANCE - np.sqrt(np.maximum(inside, 0.0))) / square
    assert (
        np.abs(depth - expected)[well].max() < 0.03
    )  # facets cut off (1.4 0.06)^2 / 8 radii, up to 2.2 times that at an angle
    assert np.isnan(depth[inside < -0.1]).all()
    assert (emission[inside < -0.1] == np.pi / 2).all()
    sine = np.sqrt(np.maximum(DISTANCE**2 / RADIUS**2 * (1.0 - 1.0 / square), 0.0))
    assert np.degrees(np.abs(emission - np.arcsin(np.minimum(sine, 1.0)))[well]).max() < 3.0


def test_views_see_the_half_that_faces_them_and_the_sun_lights_the_half_that_faces_it(ball):
    views = views_from([[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    faces = np.arange(len(ball.faces))
    middle = ball.vertices[ball.faces].mean(1)
    normal = unit(middle)
    (seen,) = sight_of_views(rays_at(ball), views, faces, middle, normal)
    towards = unit(np.array([DISTANCE, 0.0, 0.0]) - middle)
    facing = np.sum(normal * towards, -1)
    clear = np.abs(facing) > 0.05
    assert (seen.seen == (facing > 0))[clear].all()
    assert (seen.lit == (normal[:, 1] > 0))[np.abs(normal[:, 1]) > 0.05].all()
    assert np.allclose(seen.emission, np.arccos(facing))
    assert np.allclose(seen.incidence, np.arccos(normal[:, 1]))


def test_a_neck_hides_what_lies_behind_it(ball):
    """Two balls beside each other: the far one is hidden from a camera in line with both."""
    count = len(ball.vertices)
    shift = np.array([3.0 * RADIUS, 0.0, 0.0])
    both = ClosedMesh(
        vertices=np.concatenate([ball.vertices, ball.vertices - shift]),
        faces=np.concatenate([ball.faces, ball.faces + count]),
        spacing=ball.spacing,
    )
    views = views_from([[1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    middle = both.vertices[both.faces].mean(1)
    normal = np.concatenate([unit(middle[: len(ball.faces)]), unit(middle[len(ball.faces) :] + shift)])
    (seen,) = sight_of_views(rays_at(both), views, np.arange(len(both.faces)), middle, normal)
    far = np.arange(len(middle)) >= len(ball.faces)
    assert not seen.seen[far & (np.linalg.norm(middle[:, 1:], axis=1) < 0.8 * RADIUS)].any()
    assert seen.lit[~far & (normal[:, 0] > 0.1)].all()
    assert not seen.lit[far].any()


def test_a_closed_surface_goes_through_points_of_a_ball(tmp_path):
    rng = np.random.default_rng(1)
    normal = unit(rng.normal(size=(3000, 3)))
    vertices, faces = closed_surface(RADIUS * normal, normal, 0.5, tmp_path)
    assert is_watertight(faces)
    assert np.abs(np.linalg.norm(vertices, axis=1) - RADIUS).max() < 0.05 * RADIUS
    assert signed_volume(vertices, faces) == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.01)


def test_a_full_disk_is_told_from_points_that_make_no_surface(tmp_path, capfd):
    """The points just fit on it, and not the surface; COLMAP leaves a part of that, and raises nothing."""
    normal = unit(np.random.default_rng(1).normal(size=(3000, 3)))
    refused = pytest.raises(OutputError, match=r"work/surface\.ply: cannot be written: File too large")
    with small_disk(80_000), refused:
        closed_surface(RADIUS * normal, normal, 0.5, tmp_path / "work")
    assert (tmp_path / "work" / "points.ply").stat().st_size > 60_000
    assert capfd.readouterr().err == ""


def test_points_of_a_plane_make_no_closed_surface(tmp_path):
    x, y = np.mgrid[:30, :30].reshape(2, -1).astype(float)
    points = np.stack([x, y, np.zeros_like(x)], -1)
    with pytest.raises(ReconstructionError, match="no closed surface"):
        closed_surface(points, np.tile([0.0, 0.0, 1.0], (len(x), 1)), 1.0, tmp_path)


def test_normals_of_points_point_to_the_cameras_and_lone_points_are_dropped():
    rng = np.random.default_rng(2)
    normal = unit(rng.normal(size=(2000, 3)))
    points = np.concatenate([RADIUS * normal, [[5.0 * RADIUS, 0.0, 0.0]]])
    towards = np.concatenate([unit(normal + 0.3 * rng.normal(size=normal.shape)), [[1.0, 0.0, 0.0]]])
    kept, found, spacing = oriented(points, towards)
    assert np.linalg.norm(kept, axis=1).max() < 1.01 * RADIUS
    assert len(kept) > 1990
    assert np.degrees(np.arccos(np.sum(found * unit(kept), -1))).mean() < 8.0
    assert 0.05 * RADIUS < spacing < 0.4 * RADIUS


def test_the_largest_component_is_kept():
    vertices, faces = icosahedron()
    larger = refine(vertices, faces, 0.5, unit)
    both = np.concatenate([vertices + 10.0, larger[0]]), np.concatenate([faces, larger[1] + len(vertices)])
    found = largest_component(*both)
    assert np.array_equal(found[0], larger[0])
    assert len(found[1]) == len(larger[1])


def test_most_diverse_takes_the_first_then_the_least_alike():
    at = np.array([0.0, 0.1, 5.0, 2.0, 5.1])
    assert most_diverse(np.abs(at[:, None] - at), [0], 3).tolist() == [0, 3, 4]
    assert most_diverse(np.abs(at[:, None] - at), [0, 2], 3).tolist() == [0, 2, 3]
    assert most_diverse(np.abs(at[:, None] - at), [0], 9).tolist() == [0, 1, 2, 3, 4]


@pytest.fixture(scope="module")
def plan_of_ball(ball):
    rings = [ring(12, latitude) for latitude in (-55.0, 0.0, 55.0)]
    views = views_from(*(np.concatenate(part) for part in zip(*rings, strict=True)))
    options = TilePlanOptions(tile_px=40, min_views=4)
    return planned(ball, views, 100 + np.arange(len(views)), options), views, options


def test_a_plan_covers_what_enough_views_see_lit(plan_of_ball, ball):
    plan, _, options = plan_of_ball
    wanted = plan.views_of_face >= options.min_views
    assert plan.area["seen"] > 0.9
    assert plan.area["planned"] > 0.97 * plan.area["seen"]
    assert sum(plan.area[name] for name in ("seen", "dark", "unseen")) == pytest.approx(1.0)
    assert wanted[plan.tile_of_face >= 0].all()
    assert sum(tile.new_area for tile in plan.tiles) <= sum(tile.area for tile in plan.tiles)


def test_images_narrower_than_the_body_are_planned_to_their_borders_and_on(ball):
    """Ground in an image's margin is mapped by no region of it; another view's is taken there."""
    directions = refine(*icosahedron(), 0.3, unit)[0]  # each point of the ground in eight images
    views = views_from(directions, directions, focal=4000.0)
    options = TilePlanOptions(tile_px=128, overlap=0.25, max_incidence_deg=90.0)
    plan = planned(ball, views, np.arange(len(views)), options)
    assert plan.area["planned"] > 0.93 * plan.area["seen"]


def test_a_face_projects_into_the_region_of_its_tile_less_margins(plan_of_ball, ball):
    plan, views, options = plan_of_ball
    middle = ball.vertices[ball.faces].mean(1)
    for number, tile in enumerate(plan.tiles):
        own = plan.tile_of_face == number
        pixel = views.project(tile.reference - 100, middle[own])
        margin = int(options.overlap * tile.region.width)
        low = np.array([tile.region.col, tile.region.row]) + margin
        high = low + tile.region.width - 2 * margin
        assert own.any()
        assert ((pixel >= low) & (pixel <= high)).all()
        assert tile.reference in tile.views
        assert options.min_views <= len(tile.views) <= options.max_views


def test_ground_that_no_sun_lights_is_named_dark(ball):
    directions, _ = ring(12, 0.0)
    views = views_from(directions, np.tile([1.0, 0.0, 0.0], (12, 1)))
    plan = planned(ball, views, np.arange(12), TilePlanOptions(tile_px=40))
    assert plan.area["dark"] > 0.25
    middle = ball.vertices[ball.faces].mean(1)
    assert (middle[plan.tile_of_face >= 0, 0] > 0).all()


def patch(direction, angle_deg, offset=0.0, albedo=0.1, spacing=0.25, sigma=0.02):
    """Landmarks of a ball of RADIUS + offset around a direction."""
    points, _ = refine(*icosahedron(), spacing / RADIUS, unit)
    near = points[points @ unit(np.array(direction, float)) > np.cos(np.radians(angle_deg))]
    count = len(near)
    return TileMap(
        landmarks=TileLandmarks(
            position=(RADIUS + offset) * near,
            normal=near,
            albedo=np.full(count, albedo),
            height_sigma=np.full(count, sigma),
            normal_sigma=np.full(count, 0.01),
            albedo_sigma=np.full(count, 0.02),
            views=np.full(count, 9),
            weight=np.ones(count),
            pixel=np.zeros((count, 2), int),
        ),
        ties=TileTiePoints.none(),
        gsd=spacing,
    )


def test_factors_of_albedos_agree_in_the_overlap():
    tiles = [patch((1, 0, 0), 40, albedo=0.10), patch((1, 1, 0), 40, albedo=0.12), patch((0, 1, 0), 40, albedo=0.09)]
    cloud = Cloud.of(tiles)
    assert cloud.factor / cloud.factor[0] == pytest.approx([1.0, 1.2, 0.9], rel=1e-6)
    assert np.prod(cloud.factor) == pytest.approx(1.0)
    assert np.ptp(cloud.albedo) < 1e-9


def test_tiles_that_do_not_overlap_keep_their_albedos():
    tiles = [patch((1, 0, 0), 20), patch((-1, 0, 0), 20, albedo=0.2)]
    cloud = Cloud.of(tiles)
    assert cloud.factor == pytest.approx([1.0, 1.0])
    assert cloud.sigma_factor == pytest.approx([1.0, 1.0, 1.0])


def two_maps(rng, shared, stated_over_true):
    """Sigma factors of two maps of flat ground whose errors have `shared` of their variance in common."""
    y, x = np.mgrid[:40, :40].reshape(2, -1)
    count, sigma = len(x), np.array([0.1, 0.02, 0.01])

    def errors(size):
        own, common = rng.normal(size=(2, count, size)), rng.normal(size=(1, count, size))
        return np.sqrt(shared) * common + np.sqrt(1.0 - shared) * own

    position = np.tile(np.stack([x, y, np.zeros(count)], -1).astype(float), (2, 1))
    position[:, 2] += sigma[0] * errors(1).reshape(-1)
    tilt = sigma[1] / np.sqrt(2.0) * errors(2).reshape(-1, 2)
    normal = unit(np.column_stack([tilt, np.ones(2 * count)]))
    albedo = 0.1 * (1.0 + sigma[2] * errors(1).reshape(-1))
    overlap = Overlap(first=np.arange(count), second=count + np.arange(count))
    stated = np.tile(stated_over_true * sigma, (2 * count, 1))
    return sigma_factors(overlap, position, normal, albedo, stated, np.full(count, shared))


def test_sigmas_that_are_infinite_tell_nothing_even_where_two_tiles_have_all_images_in_common():
    """Nor does arithmetic warn of them, which would be an error here."""
    up = np.tile([0.0, 0.0, 1.0], (200, 1))
    overlap = Overlap(first=np.arange(100), second=100 + np.arange(100))
    stated = np.full((200, 3), np.inf)
    assert (sigma_factors(overlap, up, up, np.ones(200), stated, np.ones(100)) == 1.0).all()


@pytest.mark.parametrize("shared", [0.0, 0.6])
def test_sigmas_grow_to_the_errors_that_overlapping_tiles_show(shared):
    rng = np.random.default_rng(0)
    assert two_maps(rng, shared, 0.4) == pytest.approx(np.full(3, 2.5), rel=0.08)
    assert (two_maps(rng, shared, 1.5) == 1.0).all()  # too large ones stay


def test_errors_of_tiles_are_correlated_by_the_images_that_both_have():
    views = [np.array([0, 1, 2, 3]), np.array([2, 3, 4, 5]), np.array([7]), np.empty(0, int)]
    expected = np.array([[1.0, 0.5, 0, 0], [0.5, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]])
    assert shared_images(views) == pytest.approx(expected)


def test_pairs_of_landmarks_are_of_two_tiles_at_one_place_that_face_alike():
    up, down = np.array([0.0, 0, 1]), np.array([0.0, 0, -1])
    position = np.array([[0, 0, 0], [0.5, 0, 0], [0.6, 0, 0], [0.1, 0, 0], [3.0, 0, 0]])
    found = overlap_of(position, np.array([up, up, up, down, up]), np.array([0, 0, 1, 1, 1]), 1.0)
    assert {*zip(found.first.tolist(), found.second.tolist(), strict=True)} == {(0, 2), (1, 2)}


def test_the_merged_surface_is_the_mean_of_its_tiles_weighted_by_their_sigmas(ball):
    good, poor = patch((1, 0, 0), 60, offset=0.03, sigma=0.01), patch((1, 0, 0), 60, offset=-0.05, sigma=0.02)
    found = merged(Cloud.of([good, poor]), ball.vertices, ball.faces)
    inside = unit(ball.vertices)[:, 0] > np.cos(np.radians(50))
    height = np.linalg.norm(found.vertices[inside], axis=1) - RADIUS
    assert height == pytest.approx(0.03 * 0.8 - 0.05 * 0.2, abs=5e-4)  # weights 4 to 1
    assert found.step[inside] == pytest.approx(np.sqrt(0.8 * 0.2) * 0.08, rel=0.05)
    stated = np.hypot(0.8 * 0.01, 0.2 * 0.02)
    assert found.height_sigma[inside] == pytest.approx(found.sigma_factor[0] * stated, rel=0.05)
    assert found.sigma_factor[0] == pytest.approx(0.08 / np.hypot(0.01, 0.02) / np.sqrt(0.455), rel=0.01)
    assert (found.tile[inside] == 0).all()
    assert (found.views[inside] == 9).all()


def test_waves_of_slopes_that_a_map_resolves_are_kept(ball):
    """A wave of 6 GSD in the normals, from pole to pole: means over 0.4 GSD leave exp(-2 pi^2 0.4^2 / 6^2) = 0.92 of
    it, over 0.6 GSD 0.82."""
    tile = patch((1, 0, 0), 60)
    length = 6.0 * tile.gsd

    def tilted(points):
        wave = 0.1 * np.sin(2.0 * np.pi * points[:, 2] / length)
        return unit(unit(points) + wave[:, None] * (0.0, 1.0, 0.0))

    wavy = replace(tile.landmarks, normal=tilted(tile.landmarks.position))
    found = merged(Cloud.of([replace(tile, landmarks=wavy)]), ball.vertices, ball.faces)
    inside = unit(ball.vertices)[:, 0] > np.cos(np.radians(40))
    plain = unit(ball.vertices[inside])
    given, left = (normals[:, 1] - plain[:, 1] for normals in (tilted(ball.vertices[inside]), found.normals[inside]))
    assert np.sum(left * given) / np.sum(given**2) == pytest.approx(0.92, abs=0.03)


def test_heights_that_images_do_not_determine_count_for_nothing(ball):
    good, none = patch((1, 0, 0), 60, offset=0.03, sigma=0.01), patch((1, 0, 0), 60, offset=-5.0, sigma=np.inf)
    unknown = replace(none.landmarks, albedo_sigma=none.landmarks.height_sigma)
    found = merged(Cloud.of([good, replace(none, landmarks=unknown)]), ball.vertices, ball.faces)
    inside = unit(ball.vertices)[:, 0] > np.cos(np.radians(50))
    assert np.linalg.norm(found.vertices[inside], axis=1) - RADIUS == pytest.approx(0.03, abs=5e-4)
    assert found.height_sigma[inside] == pytest.approx(0.01, rel=0.01)
    assert found.albedo_sigma[inside] == pytest.approx(0.02, rel=0.01)


def test_albedos_that_images_do_not_determine_count_for_nothing(ball):
    """Of every second landmark the albedo is any number, with a sigma that says so."""
    tile = patch((1, 0, 0), 60)
    dark = np.arange(len(tile.landmarks)) % 2 == 1
    told = replace(
        tile.landmarks,
        albedo=np.where(dark, 90.0, tile.landmarks.albedo),
        albedo_sigma=np.where(dark, np.where(np.arange(len(dark)) % 4 == 1, np.nan, 40.0), 0.02),
    )
    found = merged(Cloud.of([replace(tile, landmarks=told)]), ball.vertices, ball.faces)
    known = np.isfinite(found.albedo)
    assert known.sum() > 100
    assert found.albedo[known] == pytest.approx(0.1)


def test_where_no_tile_is_nothing_is_claimed(ball):
    found = merged(Cloud.of([patch((1, 0, 0), 60)]), ball.vertices, ball.faces)
    away = unit(ball.vertices)[:, 0] < np.cos(np.radians(70))
    assert np.array_equal(found.vertices[away], ball.vertices[away])
    assert (found.views[away] == 0).all()
    assert (found.tile[away] == -1).all()
    for values in (found.albedo, found.height_sigma, found.normal_sigma, found.albedo_sigma):
        assert np.isnan(values[away]).all()


def test_a_thin_wall_keeps_its_two_sides():
    """Landmarks of the far side, nearer than a GSD, do not pull a vertex over."""
    x, y = np.mgrid[-5:5.01:0.25, -5:5.01:0.25].reshape(2, -1)
    tiles = []
    for z, up in ((0.1, 1.0), (-0.1, -1.0)):
        count = len(x)
        side = TileLandmarks(
            position=np.stack([x, y, np.full(count, z)], -1),
            normal=np.tile([0.0, 0.0, up], (count, 1)),
            **{name: np.full(count, 0.1) for name in ("albedo", "height_sigma", "normal_sigma", "albedo_sigma")},
            views=np.full(count, 5),
            weight=np.ones(count),
            pixel=np.zeros((count, 2), int),
        )
        tiles.append(TileMap(landmarks=side, ties=TileTiePoints.none(), gsd=0.25))
    flat = np.array([[0.0, 0.0, 0.2], [1.0, 0.0, 0.2], [0.0, 1.0, 0.2]])
    found = merged(Cloud.of(tiles), flat, np.array([[0, 1, 2]]))
    assert found.vertices[:, 2] == pytest.approx(0.1)
