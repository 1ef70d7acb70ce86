from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photoclinometry.io.images import read_image
from photoclinometry.io.site import read_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, angle_between, so3_log
from photoclinometry.model.region import Region
from photoclinometry.simulate.camera_model import Detector
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.presets import PRESETS
from photoclinometry.simulate.raycast import Raycaster
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.trajectory import looking_at
from photoclinometry.simulate.truth import nearest_surface, truth_maps, visibility
from photoclinometry.simulate.truth_file import read_truth, write_truth
from photoclinometry.simulate.views import draw_views, pose_priors

SMALL = SimulationOptions(views=3, image_size=64, seed=5)
REGION = Region(row=10, col=12, height=30, width=36)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return simulate_site(SMALL, tmp_path_factory.mktemp("site") / "small")


@pytest.fixture(scope="module")
def truth(site):
    return read_truth(site.with_name("truth.h5"))


def image_path(found, name):
    return next(view.image for view in found.views if view.name == name)


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_the_site_reads_back_and_shows_ground_everywhere(site, truth):
    found = read_site(site)
    images = load_images(found)
    assert [v.name for v in found.views] == list(truth.views.name)
    assert found.region.size_px == (32, 32)
    for image in images:
        assert read_image(image_path(found, image.name)).valid.all()
        assert 0.05 < image.brightness.mean() < 0.4


@pytest.mark.parametrize("brightness", ["iof", "dn"])
def test_same_options_give_the_same_bytes(tmp_path, brightness):
    options = replace(SMALL, brightness=brightness)
    first, second = (simulate_site(options, tmp_path / name).parent for name in "ab")
    assert files(first) == files(second)


def test_other_lighting_shows_the_same_ground_from_the_same_places(truth, tmp_path):
    strong = simulate_site(replace(SMALL, lighting="strong"), tmp_path / "strong")
    other = read_truth(strong.with_name("truth.h5"))
    np.testing.assert_array_equal(other.surface.height, truth.surface.height)
    np.testing.assert_array_equal(other.views.body_from_cam.rotation, truth.views.body_from_cam.rotation)
    assert angle_between(other.views.sun, truth.views.sun).max() > 0.1


def test_any_pinhole_camera_can_be_simulated(tmp_path):
    """Oblong pixels and images, a boresight far from the middle: all of every frame is ground, at the preset's GSD."""
    options = replace(SMALL, image_size=64, image_height=40, intrinsics=(2000.0, 2200.0, 12.0, 35.0))
    site = read_site(simulate_site(options, tmp_path / "oblong"))
    camera = site.views[0].camera
    assert (camera.width, camera.height, camera.params) == (64, 40, (2000.0, 2200.0, 12.0, 35.0))
    truth = read_truth(tmp_path / "oblong" / "truth.h5")
    assert np.mean(np.linalg.norm(truth.views.body_from_cam.translation, axis=1)) == pytest.approx(60 * 2100, rel=0.05)
    for k, name in enumerate(truth.views.name):
        maps = truth_maps(truth, name, Region.of_image(40, 64))
        assert maps.hit.all()
        region = Region.of_image(40, 64)
        np.testing.assert_allclose(truth.views.project(k, maps.position), region.pixel_centers(), atol=1e-6)
        assert truth.views.project(k, np.zeros(3)) == pytest.approx([12.0, 35.0], abs=40.0)  # pointing errors of 15 px


def test_uncalibrated_images_are_a_scale_and_bias_away_from_calibrated_ones(truth, tmp_path):
    quiet = replace(SMALL, detector=Detector(noise=False))
    iof = simulate_site(quiet, tmp_path / "iof").parent
    dn = simulate_site(replace(quiet, brightness="dn"), tmp_path / "dn").parent
    views = read_truth(dn / "truth.h5").views
    assert np.ptp(views.bias) > 0
    for k in range(3):
        a = read_image(iof / f"images/{k:03d}.fits").brightness
        b = read_image(dn / f"images/{k:03d}.png").brightness
        np.testing.assert_allclose(b, views.scale[k] * a + views.bias[k], atol=0.51)


def test_suns_and_pose_priors_of_the_site_are_off_by_about_what_they_state(tmp_path):
    site = read_site(simulate_site(replace(SMALL, pose_sigma=(0.01, 20.0)), tmp_path / "priors"))
    truth = read_truth(tmp_path / "priors" / "truth.h5")
    for k, view in enumerate(site.views):
        pose = truth.views.body_from_cam[k]
        assert 0 < angle_between(pose.rotation @ view.sun, truth.views.sun[k]) < 4e-3
        prior = view.pose_prior
        assert prior.rotation_sigma_rad == pytest.approx(np.radians(0.01))
        assert prior.translation_sigma == 20.0
        off = prior.cam_from_body @ pose
        assert 0 < np.linalg.norm(so3_log(off.rotation)) < 5 * np.radians(0.01)


def test_pose_priors_scatter_by_what_they_state():
    """Attitudes about each axis of C, centres along each of B, of 600 views; independent of each other."""
    options = replace(SMALL, views=600, pose_sigma=(0.01, 20.0))
    _, views = draw_views(options, PRESETS["demo"])
    true = views.body_from_cam
    found = [prior.cam_from_body.inverse() for prior in pose_priors(options, true)]
    turn = np.array([so3_log(true.rotation[k].T @ pose.rotation) for k, pose in enumerate(found)])
    shift = np.array([pose.translation - true.translation[k] for k, pose in enumerate(found)])
    errors = np.concatenate([turn / np.radians(0.01), shift / 20.0], 1)
    np.testing.assert_allclose(np.cov(errors.T), np.eye(6), atol=0.2)  # its own spread is 0.06 on the diagonal
    np.testing.assert_allclose(errors.mean(0), 0.0, atol=0.2)


def test_an_error_that_all_pose_priors_have_in_common_is_one_for_all_views():
    """A rotation of the cameras and a shift, which the priors state; their own errors stay what they are without it."""
    views = draw_views(replace(SMALL, views=4), PRESETS["demo"])[1].body_from_cam
    alone, both = (
        pose_priors(replace(SMALL, views=4, pose_sigma=(0.01, 20.0), pose_common_sigma=common), views)
        for common in (None, (0.05, 900.0))
    )
    own, off = ([prior.cam_from_body.inverse() for prior in priors] for priors in (alone, both))
    turn = np.array([so3_log(a.rotation.T @ b.rotation) for a, b in zip(own, off, strict=True)])
    shift = np.array([b.translation - a.translation for a, b in zip(own, off, strict=True)])
    np.testing.assert_allclose(np.ptp(turn, axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(shift, axis=0), 0.0, atol=1e-6)
    assert 100.0 < np.linalg.norm(shift[0]) < 5.0 * 900.0
    assert {(p.common_rotation_sigma_rad, p.common_translation_sigma) for p in both} == {(np.radians(0.05), 900.0)}
    with pytest.raises(InputError, match="--pose-common-sigma goes with --pose-sigma"):
        replace(SMALL, pose_common_sigma=(0.05, 900.0))


def test_smear_blurs_the_images_and_leaves_the_truth(truth, tmp_path):
    quiet = replace(SMALL, detector=Detector(noise=False))
    moved = replace(SMALL, detector=Detector(noise=False, smear_px=5.0))
    still, blurred = (simulate_site(o, tmp_path / n).parent for o, n in ((quiet, "still"), (moved, "moved")))
    for name in truth.views.name:
        a, b = (read_image(folder / name).brightness for folder in (still, blurred))
        roughness = [np.abs(np.diff(i, axis=0)).mean() + np.abs(np.diff(i, axis=1)).mean() for i in (a, b)]
        assert roughness[1] < 0.9 * roughness[0]
        assert b.mean() == pytest.approx(a.mean(), rel=0.02)
    copy = read_truth(blurred / "truth.h5")
    np.testing.assert_array_equal(copy.views.body_from_cam.translation, truth.views.body_from_cam.translation)


def test_truth_survives_its_file(truth, tmp_path):
    write_truth(tmp_path / "copy.h5", truth)
    copy = read_truth(tmp_path / "copy.h5")
    np.testing.assert_array_equal(copy.surface.height, truth.surface.height)
    np.testing.assert_array_equal(copy.surface.albedo, truth.surface.albedo)
    np.testing.assert_array_equal(copy.views.sun_measured, truth.views.sun_measured)
    assert copy.views.cameras == truth.views.cameras
    assert copy.photometry == truth.photometry
    assert (copy.surface.spacing, copy.surface.origin) == (truth.surface.spacing, truth.surface.origin)


def test_truth_positions_project_to_their_pixels(truth):
    for k, name in enumerate(truth.views.name):
        maps = truth_maps(truth, name, REGION)
        assert maps.hit.all()
        pixel = truth.views.project(k, maps.position)
        np.testing.assert_allclose(pixel, REGION.pixel_centers(), atol=1e-6)


def test_truth_maps_are_the_surface_there_and_its_averages_are_near(truth):
    maps = truth_maps(truth, truth.views.name[1], REGION, Raycaster(truth.surface))
    xy = maps.position[..., :2]
    np.testing.assert_allclose(maps.position[..., 2], truth.surface.height_at(xy), atol=1e-4)
    np.testing.assert_allclose(maps.normal, truth.surface.normal_at(xy), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(maps.normal_mean, axis=-1), 1.0)
    assert np.degrees(np.median(angle_between(maps.normal, maps.normal_mean))) < 8.0
    assert maps.albedo_mean.mean() == pytest.approx(maps.albedo.mean(), rel=0.01)
    assert maps.albedo_mean.std() <= maps.albedo.std()
    assert ((maps.shadow >= 0) & (maps.shadow <= 1)).all()


def test_a_view_sees_its_own_pixels_and_not_what_is_hidden_or_outside(truth):
    """What a view sees lies on its rays, so it sees all of it, and lit is what its map of shadows says. From low above
    the horizon much is hidden, as marching along the lines of sight finds, too."""
    name = truth.views.name[1]
    maps = truth_maps(truth, name, REGION)
    points = maps.position.reshape(-1, 3)
    seen, lit = visibility(truth, name, points)
    assert seen.all()
    clear = (maps.shadow == 0) | (maps.shadow == 1)
    assert (lit.reshape(clear.shape) == (maps.shadow == 0))[clear].all()
    assert not visibility(truth, name, points + [0.0, 0.0, 50.0])[0].any()
    assert not visibility(truth, name, points + [5e3, 0.0, 0.0])[0].any()

    low = looking_at(np.array([600e3, 80e3, 200e3]), points[len(points) // 2], 0.0)
    poses = Rigid(np.array([low.rotation] * 3), np.array([low.translation] * 3))
    grazing = replace(truth, views=replace(truth.views, body_from_cam=poses))
    t = 1.0 - np.linspace(4e-5, 0.02, 4000)[:, None]  # the last 12 km, 3 m apart, 25 m before the point
    seen, _ = visibility(grazing, name, points)
    assert 0.05 < seen.mean() < 0.95
    for n in range(0, len(points), 37):
        path = low.translation + t * (points[n] - low.translation)
        within = np.abs(path[:, :2]).max(1) < -truth.surface.origin[0]
        clearance = (path[:, 2] - truth.surface.height_at(path[:, :2]))[within]
        if abs(clearance.min()) > 1.0:
            assert seen[n] == (clearance.min() > 0)


def test_images_follow_from_the_truth(site, truth):
    """I/F predicted from truth averaged over pixels differs from the images by noise and by what varies
    within a pixel."""
    from photoclinometry.model.reflectance import photometric_angles

    region = Region.of_image(64, 64)
    maps = truth_maps(truth, truth.views.name[0], region)
    center = truth.views.body_from_cam.translation[0]
    angles = photometric_angles(truth.views.sun[0], center, maps.position, maps.normal_mean)
    predicted = maps.albedo_mean * truth.photometry(*angles) * (1 - maps.shadow)
    image = read_image(site.parent / truth.views.name[0]).brightness
    assert np.median(np.abs(image / predicted - 1)) < 0.02


def test_nearest_surface_agrees_with_a_dense_search(truth):
    rng = np.random.default_rng(0)
    surface = truth.surface
    xy = rng.uniform(-800.0, 800.0, (40, 2))
    foot = np.concatenate([xy, surface.height_at(xy)[:, None]], -1)
    away = rng.uniform(-60.0, 60.0, 40)
    points = foot + away[:, None] * surface.normal_at(xy)
    distance, nearest = nearest_surface(surface, points)
    np.testing.assert_allclose(np.linalg.norm(points - nearest, axis=1), np.abs(distance), atol=1e-6)
    np.testing.assert_allclose(surface.height_at(nearest[:, :2]), nearest[:, 2], atol=1e-6)
    assert (np.abs(distance) <= np.abs(away) + 1e-6).all()
    clear = np.abs(away) > 1.0
    assert (np.sign(distance) == np.sign(away))[clear].mean() > 0.9
    offset = np.stack(np.meshgrid(*[np.linspace(-90.0, 90.0, 361)] * 2), -1).reshape(-1, 2)
    for n in range(40):
        near = points[n, :2] + offset
        dense = np.concatenate([near, surface.height_at(near)[:, None]], -1)
        assert np.abs(distance[n]) <= np.linalg.norm(dense - points[n], axis=1).min() + 0.02


def test_folders_with_something_in_them_are_left_alone(site, tmp_path):
    with pytest.raises(InputError, match="--overwrite"):
        simulate_site(SMALL, site.parent)
    (tmp_path / "diary.txt").write_text("dear diary")
    with pytest.raises(InputError, match="holds no simulated site"):
        simulate_site(SMALL, tmp_path, overwrite=True)
    with pytest.raises(InputError, match="is a file"):
        simulate_site(SMALL, tmp_path / "diary.txt")


def test_a_failed_simulation_leaves_nothing_behind(tmp_path):
    def interrupt(what, done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_site(SMALL, tmp_path / "out", interrupt)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"preset": "corneila"}, "known: demo, cornelia"),
        ({"lighting": "dim"}, "known: moderate, strong"),
        ({"reflectance": "phong"}, "known"),
        ({"brightness": "gamma"}, "iof"),
        ({"views": 2}, "views is 2; give a whole number, 3 to"),
        ({"seed": -1}, "seed"),
        ({"supersampling": 0}, "supersampling"),
        ({"image_size": 8}, "image_size is 8; give a whole number, 32 to"),
        ({"image_height": 8}, "image_height is 8; give a whole number, 32 to"),
        ({"intrinsics": (-1.0, 2000.0, 32.0, 32.0)}, "intrinsics .*: -1; give above 0"),
        ({"intrinsics": (32.0, 32.0, 2000.0, 2000.0)}, "order of intrinsics is fx fy cx cy"),
        ({"gsd": 10.0}, "go with --surface"),
        ({"surface_center": (0.0, 0.0)}, "go with --surface"),
        ({"surface_unit": "ft"}, "surface_unit"),
        ({"surface": Path("a.obj"), "gsd": -1.0}, "gsd is -1; give above 0, below 1000000"),
        ({"max_emission_deg": 70.0}, "0 to 60"),
    ],
)
def test_impossible_options_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        SimulationOptions(**change)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_works_small_with_hapke(name, tmp_path):
    options = SimulationOptions(
        preset=name, views=3, image_size=48, supersampling=1, reflectance="hapke", lighting="strong"
    )
    truth = read_truth(simulate_site(options, tmp_path / name).with_name("truth.h5"))
    image = read_image(tmp_path / name / truth.views.name[0]).brightness
    assert image.mean() > 0.0
    assert truth.surface.albedo.mean() == pytest.approx(PRESETS[name].mean_albedo, rel=1e-3)


def test_truth_errors_say_what_to_do(truth, tmp_path):
    with pytest.raises(InputError, match="phomo simulate"):
        read_truth(tmp_path / "nothing.h5")
    (tmp_path / "text.h5").write_text("no HDF5")
    with pytest.raises(InputError, match="is not a truth file, or is damaged"):
        read_truth(tmp_path / "text.h5")
    with pytest.raises(InputError, match="no view"):
        truth_maps(truth, "images/999.fits", REGION)
