"""What a plan says before images are taken: places, views, ground, sigmas, and what one more image brings."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import photoclinometry as pcm
from commands import phomo
from fault_place import small_disk
from photoclinometry.evaluate.sigma_calibration import scene_errors
from photoclinometry.io.site import Site, SiteView, read_site
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, angle_between, unit
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Landmarks, Views
from photoclinometry.model.sigma import sigma_of_length
from photoclinometry.plan.assumed_ground import representative_ground
from photoclinometry.plan.candidates import candidates, drop_percent, gains
from photoclinometry.plan.exposures import cropped_views
from photoclinometry.plan.forecast import KINDS, with_frame
from photoclinometry.plan.options import CandidateOptions, PlanOptions
from photoclinometry.plan.place import planned_views
from photoclinometry.plan.run import _figures, plan_site
from photoclinometry.plan.table import looking_from, read_table
from photoclinometry.simulate.truth import truth_maps
from photoclinometry.simulate.truth_file import read_truth
from sites import write_small_site

HEADER = "view,x_m,y_m,z_m,sun_x,sun_y,sun_z,focal_px,width_px,height_px"
TARGET = "target_x_m,target_y_m,target_z_m"
RADIUS = 1000.0
NIGHT = "night,0,0,11000,0.9,0,-0.4,2000,160,160\nbehind,0,0,-9000,0,0,1,2000,160,160\n"
"""Two views of a table that do not see the pole, looking at the origin."""
SUNS = ((0, 40), (60, 50), (140, 35), (200, 55), (260, 45), (320, 30), (20, 60))
CAMERAS = ((0, 0), (30, 18), (100, 15), (170, 20), (240, 16), (310, 19), (70, 24))


def direction(azimuth_deg, zenith_deg):
    azimuth, zenith = np.radians([azimuth_deg, zenith_deg])
    return np.array([np.sin(zenith) * np.sin(azimuth), np.sin(zenith) * np.cos(azimuth), np.cos(zenith)])


def table_text(views=7, height=10_000.0, beside=""):
    """Views of the north pole of a sphere, whose local frame has the axes of B (x east, y north)."""
    lines = [f"{HEADER},{TARGET}"]
    for k in range(views):
        center, sun = RADIUS * np.array([0, 0, 1.0]) + height * direction(*CAMERAS[k]), direction(*SUNS[k])
        lines.append(",".join([f"v{k}", *(f"{x:.6f}" for x in (*center, *sun)), "2000,160,160", f"0,0,{RADIUS}"]))
    return "\n".join(lines) + "\n" + beside


def options(**changes):
    """Of a small patch whose reflectance is known; to compare models takes as long as all else."""
    return PlanOptions(
        point=(0.0, 0.0, RADIUS),
        normal=(0.0, 0.0, 1.0),
        patch_px=28,
        tie_points=500,
        ground="lunar-lambert",
        reflectance="lunar-lambert",
        **changes,
    )


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "poses.csv"
    path.write_text(table_text())
    return path


def vesta(path, views=slice(None)):
    """The table's views as those of a body with published reflectance."""
    site = read_table(path)
    return replace(site, body="vesta", views=site.views[views])


@pytest.fixture(scope="module")
def planned(table):
    return plan_site(vesta(table), options(), with_candidates=False)


def test_landmarks_that_nothing_measures_leave_the_other_sigmas_of_a_frame():
    """Of four: two whose sigmas the frame adds to, one that it takes nothing from, one that is not measured."""
    sigma, known = np.array([3.0, 0.0, 2.0, np.inf]), np.array([5.0, 1.0, 0.5, np.inf])
    own = np.array([3.0, 0.0, 1.0, np.inf])
    np.testing.assert_allclose(with_frame(sigma, known, own), [5.0, 1.0, 2.0, np.inf])


def test_a_plan_finishes_with_the_model_that_a_run_would_choose(table):
    """On Hapke's ground views that are kept out prefer Hapke's model, whose albedos have a poorly known level; a model
    that is given stays."""
    by_evidence, given = (
        plan_site(vesta(table), replace(options(), reflectance=name, ground="hapke"), with_candidates=False)
        for name in ("auto", "lunar-lambert")
    )
    assert by_evidence.as_dict()["assumed"]["reflectance"] == "hapke"
    assert given.as_dict()["assumed"]["reflectance"] == "lunar-lambert"
    assert by_evidence.sigmas["albedo_sigma_median_percent"] > 2.0 * given.sigmas["albedo_sigma_median_percent"]


def test_a_table_gives_poses_and_suns(table):
    """What a camera looks at projects to its image's middle. Suns turn back as written."""
    site = read_table(table)
    for k, view in enumerate(site.views):
        pose = view.pose_prior.cam_from_body
        np.testing.assert_allclose(view.camera.pixel_from_cam(pose(np.array([0, 0, RADIUS]))), (80.0, 80.0), atol=1e-9)
        np.testing.assert_allclose(pose.rotation.T @ view.sun, direction(*SUNS[k]), atol=1e-6)


def test_a_camera_without_attitude_and_target_looks_at_the_origin(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(HEADER + "\na,3000,-1000,2000,0,0,1,100,64,48\n")
    view = read_table(path).views[0]
    in_cam = view.pose_prior.cam_from_body(np.zeros(3))
    np.testing.assert_allclose(view.camera.pixel_from_cam(in_cam), (32.0, 24.0), atol=1e-9)


def test_an_attitude_in_a_table_is_that_of_a_site(tmp_path, table):
    """The quaternion of x_C = R x_B + t, scalar first."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_euler("xyz", [0.3, -2.0, 1.1])
    quaternion = ",".join(map(str, turn.as_quat(scalar_first=True)))
    row = ",".join(table_text(1).splitlines()[1].split(",")[:10])
    path = tmp_path / "attitude.csv"
    path.write_text(f"{HEADER},qw,qx,qy,qz\n{row},{quaternion}\n")
    pose = read_table(path).views[0].pose_prior.cam_from_body
    np.testing.assert_allclose(pose.rotation, turn.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(pose.inverse().translation, (0.0, 0.0, 11_000.0), atol=1e-6)


def test_the_boresight_of_the_first_view_gives_the_place():
    """A camera over a sphere that looks straight down at 30 degrees east, 20 degrees north."""
    lon, lat = np.radians([30.0, 20.0])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    camera = Camera("PINHOLE", 200, 200, (3000.0, 3000.0, 100.0, 100.0))
    east = unit(np.cross((0, 0, 1), up))
    views = []
    for k, aside in enumerate((0.0, 400.0, -400.0)):
        pose = looking_from(6.0 * RADIUS * up + aside * east, RADIUS * up).inverse()
        views.append(SiteView(f"{k}", None, camera, pose.rotation @ unit(up + east), pose_prior=PosePrior(pose, 1, 1)))
    site = Site("ball", "ball", "iof", tuple(views), None, "ball", body_radius_m=RADIUS)
    found = planned_views(site, PlanOptions())
    assert (found.place.lon_deg, found.place.lat_deg) == pytest.approx((30.0, 20.0))
    np.testing.assert_allclose(found.body_from_local.rotation @ (0, 0, 1), up, atol=1e-12)
    np.testing.assert_allclose(found.body_from_local.rotation @ (1, 0, 0), east, atol=1e-12)
    incidence = [math.degrees(angle_between(sun, np.array([0, 0, 1.0]))) for sun in found.views.sun]
    assert incidence == pytest.approx([45.0] * 3)
    assert found.gsd_m == pytest.approx(5.0 * RADIUS / 3000.0)


def test_views_that_do_not_see_the_place_are_named_with_the_reason(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(table_text(beside=NIGHT + "beside,0,4000,11000,0,0,1,2000,160,160,0,4000,0\n"))
    found = planned_views(read_table(path), options())
    assert set(found.not_seen) == {"night", "behind", "beside"}
    assert "it is night there" in found.not_seen["night"]
    assert "beyond the limb" in found.not_seen["behind"]
    assert "beside the image" in found.not_seen["beside"]


def test_a_site_without_poses_says_what_to_add(tmp_path):
    site = read_site(write_small_site(tmp_path))
    with pytest.raises(InputError, match=r"none of its 4 views has a pose.*pose priors.*table of poses and Suns"):
        plan_site(site)


def test_a_table_alone_asks_for_the_place(table):
    with pytest.raises(InputError, match=r"nothing of the body's size.*--at LON LAT.*--point"):
        plan_site(read_table(table))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("view,x_m\na,1\n", "no column 'y_m'"),
        (HEADER + "\n", "has no view"),
        (table_text(1) + table_text(1).splitlines()[1] + "\n", "occurs twice"),
        (HEADER + "\na,1,2,3,0,0,0,100,64,64\n", "zero vector"),
        (HEADER + "\na,0,0,0,0,0,1,100,64,64\n", "at the point that it looks at"),
        (HEADER + "\na,1,2,x,0,0,1,100,64,64\n", "z_m is 'x'"),
    ],
)
def test_a_wrong_table_is_refused(tmp_path, text, says):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        read_table(path)


def test_the_ground_has_the_stated_slope():
    """Gradients between points two samples apart, both axes."""
    surface = representative_ground(100.0, 2.0, 2.0, 12.0, 0.2, seed=3)
    rows, cols = (np.diff(surface.height[::2, ::2].astype(float), axis=axis) / 2.0 for axis in (0, 1))
    assert surface.spacing == 1.0
    assert math.degrees(math.atan(math.sqrt(np.mean(rows**2) + np.mean(cols**2)))) == pytest.approx(12.0, rel=0.05)
    assert surface.albedo.mean() == pytest.approx(0.2, rel=0.02)


def test_cut_images_show_the_same_ground(table):
    """Pixels move by one whole number in each view, and the map is inside."""
    views = planned_views(vesta(table), options()).views
    cut, shows = cropped_views(views, 60.0)
    assert shows.all()
    points = np.random.default_rng(0).uniform(-60.0, 60.0, (50, 3)) * (1, 1, 0.1)
    for k in range(len(views)):
        moved = views.project(k, points) - cut.project(k, points)
        np.testing.assert_allclose(moved, np.round(moved[:1]) * np.ones((50, 1)), atol=1e-9)
        pixel = cut.project(k, points)
        assert np.all((pixel > 0) & (pixel < (cut.cameras[k].width, cut.cameras[k].height)))


def test_a_plan_states_sigmas_that_its_map_keeps(planned):
    """The small map is off from the ground that was drawn by what it states: normals and albedos within half."""
    found, scene = planned.forecast, planned.forecast.scene
    truth = found.ground.truth
    maps = truth_maps(truth, scene.views.name[scene.reference], scene.region, found.ground.tracer)
    at = scene.cells
    true = Landmarks(
        position=maps.position[at],
        normal=maps.normal_mean[at],
        albedo=maps.albedo_mean[at],
        pixel=scene.landmarks.pixel,
    )
    off = scene_errors(scene, truth.views, true, float(np.median(true.albedo / scene.landmarks.albedo)))
    normal = np.degrees(np.sqrt(np.mean(np.sum(off["normal"] ** 2, -1))))
    albedo = 100.0 * np.sqrt(np.mean((off["albedo"] / scene.landmarks.albedo) ** 2))
    assert normal == pytest.approx(planned.sigmas["normal_sigma_rms_deg"], rel=0.5)
    assert albedo == pytest.approx(planned.sigmas["albedo_sigma_rms_percent"], rel=0.5)
    assert found.direct
    assert planned.light["lit_views_per_landmark_mean"] > 6.0


def test_three_views_show_no_noise(table):
    """Three brightnesses are fitted by a normal and an albedo: sigmas of nothing are refused."""
    with pytest.raises(InputError, match=r"lit in 3\.0 views each.*plan with four views or more"):
        plan_site(vesta(table, slice(0, 3)), options(min_views=3), with_candidates=False)


def test_rougher_ground_has_larger_sigmas_of_normals(planned, table):
    rough = plan_site(vesta(table), options(slope_deg=25.0), with_candidates=False)
    assert rough.sigmas["normal_sigma_mean_deg"] > 1.2 * planned.sigmas["normal_sigma_mean_deg"]


def test_pose_priors_add_the_error_of_their_frame(table, planned, tmp_path):
    """Camera centres known to 300 m: heights in the frame are worse than within the map."""
    head, *rows = table_text().splitlines()
    path = tmp_path / "priors.csv"
    path.write_text(
        "\n".join([f"{head},center_sigma_m,rotation_sigma_deg", *(f"{row},300,0.1" for row in rows)]) + "\n"
    )
    found = plan_site(vesta(path), options(), with_candidates=False)
    assert found.sigmas["height_sigma_mean_gsd"] == pytest.approx(planned.sigmas["height_sigma_mean_gsd"], rel=0.05)
    assert found.sigmas["in_frame_height_sigma_mean_gsd"] > 3.0 * found.sigmas["height_sigma_mean_gsd"]
    assert not any("in_frame" in name for name in planned.sigmas)


def test_another_image_under_the_same_sun_brings_less_than_one_under_another(planned):
    found = planned.forecast
    view = planned.planned.views[[planned.planned.reference]]
    azimuth = SUNS[planned.planned.reference][0]
    tried, _ = candidates(
        planned.planned, CandidateOptions(sun_azimuths=8, sun_elevations_deg=(30.0,), view_azimuths=0)
    )
    far = [c for c in tried if abs((float(c.name.split()[1].split("/")[0]) - azimuth) % 360.0 - 90.0) < 1.0]
    same = replace(far[0], name="same", view=view)
    again, other = gains(found, [same, far[0]])
    assert other.drop_percent["normal"] > again.drop_percent["normal"] > -1.0
    assert set(other.drop_percent) == set(KINDS)
    assert again.angles["emission_deg"] == pytest.approx(0.0, abs=0.1)


def test_a_candidate_that_does_not_show_the_map_brings_nothing(planned):
    views = planned.planned.views
    tried, _ = candidates(
        planned.planned, CandidateOptions(sun_azimuths=1, sun_elevations_deg=(45.0,), view_azimuths=0)
    )
    away = Rigid(views.body_from_cam.rotation[:1], views.body_from_cam.translation[:1] + (5000.0, 0.0, 0.0))
    moved: Views = replace(tried[0].view, body_from_cam=away)
    (gain,) = gains(planned.forecast, [replace(tried[0], view=moved)])
    assert gain.drop_percent == {}


def test_a_candidate_of_a_table_that_does_not_see_the_place_is_named_and_not_tried(planned, tmp_path):
    path = tmp_path / "candidates.csv"
    path.write_text(table_text(1, beside=NIGHT))
    tried, not_seen = candidates(planned.planned, CandidateOptions(table=path))
    assert [candidate.name for candidate in tried] == ["v0"]
    assert set(not_seen) == {"night", "behind"}
    assert "it is night there" in not_seen["night"]
    assert "beyond the limb" in not_seen["behind"]

    path.write_text("\n".join(line for line in path.read_text().splitlines() if not line.startswith("v0")))
    with pytest.raises(
        InputError, match=r"candidates\.csv: none of the 2 candidates sees the place\. night: it is night"
    ):
        candidates(planned.planned, CandidateOptions(table=path))


def test_of_thousands_of_views_that_do_not_see_the_place_the_error_names_a_few(tmp_path):
    path, behind = tmp_path / "poses.csv", NIGHT.splitlines()[1]
    path.write_text(table_text(2) + "".join(f"{k}{behind}\n" for k in range(2000)))
    with pytest.raises(InputError, match=r"2 of 2002 views see the place, .* and 1995 more\. Choose another") as raised:
        planned_views(read_table(path), options())
    assert "4behind" in str(raised.value)
    assert len(str(raised.value)) < 600


def test_a_landmark_that_only_the_new_image_measures_changes_no_drop():
    assert drop_percent(np.array([1.0, 1.0, np.inf]), np.array([0.8, 0.8, 5.0])) == pytest.approx(20.0)


def test_figures_of_sigmas_are_of_the_landmarks_that_are_measured():
    found = _figures("height_sigma_gsd", np.array([1.0, np.inf, np.inf, 2.0, 3.0]))
    assert found["height_sigma_median_gsd"] == found["height_sigma_mean_gsd"] == 2.0


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("x_m", "1e200", r"x_m,y_m,z_m are \[1e\+200.*expected numbers up to 1e\+15"),
        ("width_px", "0.5", "width_px is 0.5, expected a whole number of pixels up to 65535"),
        ("height_px", "1e9", r"height_px is 1e\+09, expected a whole number of pixels"),
        ("focal_px", "1e-300", "focal_px is 1e-300, expected a number from 1e-09 to"),
    ],
)
def test_numbers_that_cannot_be_planned_with_are_refused(tmp_path, column, value, words):
    head, first, *others = table_text(3).splitlines()
    values = dict(zip(head.split(","), first.split(","), strict=True)) | {column: value}
    path = tmp_path / "a.csv"
    path.write_text("\n".join([head, ",".join(values.values()), *others]))
    with pytest.raises(InputError, match=rf"a\.csv, line 2: {words}"):
        read_table(path)


@pytest.mark.parametrize("columns", [("sun_x", "sun_y", "sun_z"), ("qw", "qx", "qy", "qz")])
def test_directions_of_no_length_are_refused(tmp_path, columns):
    """The squares of such numbers are zero."""
    head, first, *_ = table_text(3).splitlines()
    values = dict(zip(head.split(","), first.split(","), strict=True)) | dict.fromkeys(columns, "1e-200")
    path = tmp_path / "a.csv"
    path.write_text(",".join(values) + "\n" + ",".join(values.values()))
    with pytest.raises(InputError, match=r"a\.csv, line 2: .* is the zero (vector|quaternion)"):
        read_table(path)


def test_a_full_disk_ends_the_command_with_one_line(table, planned, tmp_path, capsys, photometry_as_stated):
    """`planned` compiles and caches the kernels, whose files would not fit on the small disk, either."""
    arguments = ["--point", 0, 0, RADIUS, "--normal", 0, 0, 1, "--patch-px", 28, "--tie-points", 500, "--no-candidates"]
    with small_disk(300):
        assert phomo("plan", table, "--out", tmp_path / "plan", *arguments) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"phomo: {tmp_path}/plan/plan.json: cannot be written: File too large")
    assert not (tmp_path / "plan").exists()


def test_the_command_writes_a_plan_in_80_columns(table, tmp_path, capsys, photometry_as_stated):
    table_of_candidates = tmp_path / "more.csv"
    table_of_candidates.write_text(table_text(3).replace("\nv", "\na-long-name-of-an-image-000"))
    out = tmp_path / "plan"
    arguments = ["--point", 0, 0, RADIUS, "--normal", 0, 0, 1, "--patch-px", 28, "--tie-points", 500]
    assert phomo("plan", table, "--out", out, *arguments, "--candidates.table", table_of_candidates) == 0
    printed = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in printed[:-1]) <= 80
    assert printed[-1] == str(out)
    content = json.loads((out / "plan.json").read_text())
    assert len(content["candidates"]) == 3
    assert content["candidates"] == sorted(content["candidates"], key=lambda c: -c["drop_percent"]["normal"])
    assert content["sigmas"]["height_sigma_mean_gsd"] > 0
    assert {"sigmas.png", "light.png", "candidates.png"} <= {file.name for file in out.iterdir()}


def test_a_folder_with_something_else_is_refused_before_anything_is_computed(table, tmp_path):
    (tmp_path / "precious.txt").write_text("mine")
    with pytest.raises(InputError, match="holds no plan"):
        pcm.plan(table, out=tmp_path)


@pytest.mark.slow
def test_a_plan_foresees_what_a_run_states(mapped):
    """From the geometry alone of the shared site, its ground assumed as steep as it is: medians within a factor of 1.6.

    With the model that the run has chosen, as `test_a_plan_finishes_with_the_model_that_a_run_would_choose` has it.
    benchmarks/plan.py compares larger sites.
    """
    site, truth, scene = read_site(mapped.site), read_truth(mapped.truth), mapped.result.scene
    poses = truth.views.body_from_cam
    views = tuple(
        replace(view, pose_prior=PosePrior(poses[k].inverse(), math.inf, math.inf)) for k, view in enumerate(site.views)
    )
    found = plan_site(
        replace(site, views=views),
        PlanOptions(
            point=(0.0, 0.0, 0.0),
            normal=(0.0, 0.0, 1.0),
            patch_px=32,
            ground="lunar-lambert",
            slope_deg=25.0,
            reflectance=scene.reflectance.name,
        ),
        with_candidates=False,
    )
    stated = {"normal": np.degrees(sigma_of_length(scene.uncertainty["normal"], 2))}
    stated["albedo"] = 100.0 * sigma_of_length(scene.uncertainty["albedo"], 1) / scene.landmarks.albedo
    for kind, values in stated.items():
        assert np.median(found.forecast.sigmas()[kind]) == pytest.approx(np.median(values), rel=0.6)
