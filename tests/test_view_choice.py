"""Which views see a place of the body: angles and lengths worked out by hand, limits, the choice, and the command."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import photoclinometry as pcm
from archives import FORMATS, needs_formats
from commands import phomo
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.site import RegionRequest, SiteView, read_site, write_site
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import angle_between
from photoclinometry.registration.place import place_at, semi_axes
from photoclinometry.registration.view_choice import ViewLimits, choose_views, diverse, write_chosen_site
from photoclinometry.registration.viewing import light_and_sight, sighting, sightings
from posed_views import CAMERA, direction, site_of, site_under_many_suns, view

RADIUS = 250.0
SPHERE = (RADIUS, RADIUS, RADIUS)


def test_a_camera_straight_above_sees_without_emission_at_distance_times_pixel_angle():
    """5 km from the centre of a sphere of 250 m, 1/10000 of a radian a pixel: 0.475 m. The Sun 40 degrees aside."""
    place = place_at(30.0, 20.0, SPHERE)
    seen = sighting(view("a", 5000.0 * direction(30.0, 20.0), direction(70.0, 20.0)), place)
    assert seen.emission_deg == pytest.approx(0.0, abs=1e-9)
    assert seen.distance_m == pytest.approx(4750.0)
    assert seen.gsd_m == pytest.approx(0.475)
    assert seen.sub_spacecraft_deg == pytest.approx(0.0, abs=1e-9)
    assert seen.pixel == pytest.approx((500.0, 400.0))
    aside = np.degrees(angle_between(direction(30.0, 20.0), direction(70.0, 20.0)))
    assert seen.incidence_deg == pytest.approx(aside)
    assert seen.phase_deg == pytest.approx(aside)


def test_angles_of_a_camera_and_a_sun_on_either_side():
    """On the equator: camera far to the east at 30 degrees, Sun in the west at 40: phase 70, emission 30 and a bit."""
    place = place_at(0.0, 0.0, SPHERE)
    seen = sighting(view("a", 1e7 * direction(30.0, 0.0), direction(-40.0, 0.0)), place)
    assert seen.incidence_deg == pytest.approx(40.0)
    assert seen.emission_deg == pytest.approx(30.0, abs=1e-2)
    assert seen.phase_deg == pytest.approx(70.0, abs=1e-2)
    assert seen.sub_spacecraft_deg == pytest.approx(30.0)
    near = sighting(view("a", 1000.0 * direction(30.0, 0.0), direction(-40.0, 0.0)), place)
    across, along = 1000.0 * np.sin(np.radians(30.0)), 1000.0 * np.cos(np.radians(30.0)) - RADIUS
    assert near.emission_deg == pytest.approx(np.degrees(np.arctan2(across, along)))
    assert near.distance_m == pytest.approx(np.hypot(across, along))


def test_normals_of_an_ellipsoid_are_steeper_than_its_radii():
    """x²/a² + z²/c² = 1 at 45 degrees of planetocentric latitude: the normal has (z/c²) / (x/a²) = 4 for a = 2 c."""
    place = place_at(0.0, 45.0, (200.0, 200.0, 100.0))
    assert place.position[0] == pytest.approx(place.position[2])
    assert np.sum((place.position / (200.0, 200.0, 100.0)) ** 2) == pytest.approx(1.0)
    assert place.normal[2] / place.normal[0] == pytest.approx(4.0)


def test_a_place_behind_the_limb_is_not_seen():
    """From 500 m over a sphere of 250 m, the limb is arccos(250 / 750) = 70.5 degrees from the point below."""
    limb = np.degrees(np.arccos(RADIUS / 750.0))
    wide = Camera("PINHOLE", 1000, 1000, (500.0, 500.0, 500.0, 500.0))
    site = site_of(view("a", 750.0 * direction(0.0, 0.0), direction(10.0, 0.0), wide))
    before = sightings(site, place_at(limb - 0.1, 0.0, SPHERE))
    assert [s.name for s in before.seen] == ["a"]
    assert before.seen[0].emission_deg == pytest.approx(90.0, abs=0.2)
    behind = sightings(site, place_at(limb + 0.1, 0.0, SPHERE))
    assert (behind.seen, behind.beyond_limb, behind.outside_image) == ((), 1, 0)


def test_a_place_beside_the_image_or_behind_the_camera_is_not_seen():
    center = 5000.0 * direction(0.0, 0.0)
    aside = view("a", center, direction(10.0, 0.0), turned=(0.0, 0.06, 0.0))  # half a field of view is 0.05 rad
    behind = view("b", center, direction(10.0, 0.0), turned=(0.0, np.pi, 0.0))
    found = sightings(site_of(aside, behind), place_at(0.0, 0.0, SPHERE))
    assert (found.seen, found.beyond_limb, found.outside_image) == ((), 0, 2)


degrees = st.floats(-180.0, 180.0)
latitudes = st.floats(-89.0, 89.0)


@settings(max_examples=60, deadline=None)
@given(degrees, latitudes, degrees, latitudes, degrees, latitudes, st.floats(1.2, 100.0))
def test_laws_of_the_angles(lon, lat, sun_lon, sun_lat, camera_lon, camera_lat, radii):
    """Phase is between the difference and the sum of incidence and emission; and nothing depends on the axes' turn."""
    place = place_at(lon, lat, SPHERE)
    one = view("a", radii * RADIUS * direction(camera_lon, camera_lat), direction(sun_lon, sun_lat))
    seen = sighting(one, place)
    if seen is None:
        return
    assert abs(seen.incidence_deg - seen.emission_deg) <= seen.phase_deg + 1e-6
    assert seen.phase_deg <= seen.incidence_deg + seen.emission_deg + 1e-6
    assert seen.emission_deg >= seen.sub_spacecraft_deg - 1e-6  # the camera is nearer than infinity
    moved = view("a", radii * RADIUS * direction(camera_lon + 33.0, camera_lat), direction(sun_lon + 33.0, sun_lat))
    again = sighting(moved, place_at(lon + 33.0, lat, SPHERE))
    assert again is not None
    for key in ("gsd_m", "emission_deg", "incidence_deg", "phase_deg", "distance_m"):
        assert getattr(again, key) == pytest.approx(getattr(seen, key), abs=1e-6, rel=1e-6)


def test_few_views_are_chosen_for_light_as_different_as_there_is():
    """Of twelve Suns along an arc, three: the one straight above, which has one end, the other end, the middle."""
    choice = choose_views(site_under_many_suns(), 10.0, 5.0, (RADIUS,), ViewLimits(count=3))
    first, middle, last = (s.name for s in choice.chosen)
    assert (first, last) == ("00.fits", "11.fits")
    assert middle in ("05.fits", "06.fits")
    apart = light_and_sight(choice.chosen)
    assert apart[np.triu_indices(3, 1)].min() > np.radians(45.0)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1000), st.integers(3, 15))
def test_the_choice_has_the_count_and_no_view_twice(seed, count):
    rng = np.random.default_rng(seed)
    place = place_at(0.0, 0.0, SPHERE)
    angles = rng.uniform(-40, 40, (10, 4))
    views = [view(f"{k}", 5000.0 * direction(*a[:2]), direction(*a[2:])) for k, a in enumerate(angles)]
    seen = [sighting(v, place) for v in [*views, *views[:2]]]  # the same light twice
    chosen = diverse(seen, count)
    assert len(chosen) == min(count, len(seen))
    assert len({id(s) for s in chosen}) == len(chosen)
    positions = [next(k for k, s in enumerate(seen) if s is c) for c in chosen]
    assert positions == sorted(positions)


def test_limits_leave_out_views_and_say_how_many():
    choice = choose_views(
        site_under_many_suns(), 10.0, 5.0, (RADIUS,), ViewLimits(max_incidence_deg=30.0, gsd_m=(0.4, 0.5))
    )
    assert all(s.incidence_deg <= 30.0 for s in choice.chosen)
    assert choice.left_out == {"--max-emission-deg": 0, "--max-incidence-deg": 6, "--gsd-m": 0}
    assert choose_views(site_under_many_suns(), 10.0, 5.0, (RADIUS,), ViewLimits(gsd_m=(0.1, 0.2))).chosen == ()


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"max_emission_deg": 95.0}, "max_emission_deg is 95; give above 0, up to 90"),
        ({"max_incidence_deg": float("nan")}, "max_incidence_deg is nan"),
        ({"gsd_m": (2.0, 1.0)}, "gsd_m is 2 1; give the finest, then the coarsest"),
        ({"gsd_m": (0.0, float("inf"))}, "gsd_m is .0.0, inf.: 0; give above 0"),
        ({"count": 2}, "count is 2; give a whole number, 3 or more"),
    ],
)
def test_limits_that_cannot_be_are_refused(limits, message):
    with pytest.raises(InputError, match=message):
        ViewLimits(**limits)


@pytest.mark.parametrize(
    ("place", "message"),
    [((400.0, 0.0), "400 0 is not a longitude"), ((0.0, 91.0), "0 91 is not"), ((float("nan"), 0.0), "nan 0 is not")],
)
def test_places_that_are_none_are_refused(place, message):
    with pytest.raises(InputError, match=message):
        choose_views(site_under_many_suns(), *place, (RADIUS,))


def test_a_body_of_unknown_size_needs_radii():
    assert semi_axes("Bennu") == (283.065, 271.215, 249.72)
    assert semi_axes("tatooine", (2.0, 1.0)) == (2.0, 2.0, 1.0)
    with pytest.raises(InputError, match=r"size of body 'tatooine' is not known \(known: bennu, .*--radii-m"):
        choose_views(site_under_many_suns(body="tatooine"), 10.0, 5.0)
    with pytest.raises(InputError, match="radii -1"):
        semi_axes("bennu", (-1.0,))


def test_without_pose_priors_it_is_said_what_to_ingest():
    bare = [replace(v, pose_prior=None) for v in site_under_many_suns(3).views]
    with pytest.raises(InputError, match=r"none of its 3 views has a pose prior.*phomo ingest.*--kernels.*--sumfiles"):
        choose_views(site_of(*bare), 10.0, 5.0)
    found = sightings(site_of(*bare[:2], *site_under_many_suns(4).views), place_at(10.0, 5.0, SPHERE))
    assert (len(found.seen), found.without_prior) == (4, 2)


def test_poses_in_another_unit_are_not_taken_for_metres():
    with pytest.raises(InputError, match=r"00\.fits.*5 m from the body's centre, inside the body.*in metres"):
        choose_views(site_of(view("00.fits", 5.0 * direction(0, 0), direction(1, 0))), 0.0, 0.0)


def test_a_place_that_nobody_sees_is_told_why():
    with pytest.raises(InputError, match="no view sees 190 5: from 12 it lies beyond the limb, beside 0 images"):
        choose_views(site_under_many_suns(), 190.0, 5.0, (RADIUS,))


def test_the_chosen_site_names_the_same_images_cameras_suns_and_priors(tmp_path):
    site = replace(site_under_many_suns(), path=tmp_path / "all" / "site.toml")
    site = replace(site, views=tuple(replace(v, image=site.path.parent / v.name) for v in site.views))
    choice = choose_views(site, 10.0, 5.0, (RADIUS,), ViewLimits(count=5))
    out = tmp_path / "chosen" / "site.toml"
    write_chosen_site(out, site, choice)
    read = read_site(out)
    assert [v.name for v in read.views] == [f"../all/{s.name}" for s in choice.chosen]
    for v in read.views:
        was = next(w for w in site.views if w.image.name == v.image.name)
        assert v.image.resolve() == was.image.resolve()
        assert v.camera == was.camera
        np.testing.assert_allclose(v.sun, was.sun, atol=1e-12)
        np.testing.assert_allclose(
            v.pose_prior.cam_from_body.rotation, was.pose_prior.cam_from_body.rotation, atol=1e-12
        )
    seen = {f"../all/{s.name}": s for s in choice.chosen}[read.region.reference]
    assert read.region == RegionRequest(read.region.reference, pytest.approx(seen.pixel), (400, 400), None)
    with pytest.raises(RunFolderError, match="exists; choose another --out"):
        write_chosen_site(out, site, choice)


@pytest.mark.parametrize(("width", "side"), [(101, 80), (60, None)])
def test_near_the_edge_of_an_image_the_region_is_smaller_and_at_the_edge_left_open(tmp_path, width, side):
    """The cameras look at the body's centre, so the place is in the middle, or a few pixels aside."""
    camera = replace(CAMERA, width=width, height=width, params=(1e4, 1e4, width / 2, width / 2))
    site = site_of(*(replace(v, camera=camera) for v in site_under_many_suns(3).views))
    region = write_chosen_site(tmp_path / "site.toml", site, choose_views(site, 10.0, 5.0, (RADIUS,))).region
    if side is None:
        assert region is None
    else:
        assert side <= region.size_px[0] <= width
        assert read_site(tmp_path / "site.toml").region == region


def test_too_few_for_a_map_are_told_with_the_limits_that_leave_them_out(tmp_path):
    choice = choose_views(site_under_many_suns(), 10.0, 5.0, (RADIUS,), ViewLimits(max_incidence_deg=6.0))
    with pytest.raises(
        InputError, match=r"2 of the 12 views .* a map needs 3 at least \(--max-incidence-deg leaves out 10\)"
    ):
        write_chosen_site(tmp_path / "site.toml", site_under_many_suns(), choice)
    assert not (tmp_path / "site.toml").exists()


def test_the_command_lists_chooses_and_writes(tmp_path, capsys):
    write_site(tmp_path / "site.toml", site_under_many_suns())
    code = phomo("views", tmp_path, "--at", 10, 5, "--radii-m", 250, "--count", 4, "--out", tmp_path / "near")
    said = capsys.readouterr()
    assert code == 0
    lines = said.out.splitlines()
    assert lines[0].split() == ["image", "m/px", "emis.", "inc.", "phase", "sub-sc", "km"]
    assert sum(line.startswith("*") for line in lines) == 4
    assert lines[1].split()[-1] == "4.75"
    assert max(map(len, lines[:-1])) <= 80
    assert lines[-1] == str(tmp_path / "near" / "site.toml")
    assert len(read_site(tmp_path / "near" / "site.toml").views) == 4
    assert "12 views see 10 E, 5 N; 4 are chosen" in said.err


def test_from_python_it_is_the_same_choice(tmp_path):
    write_site(tmp_path / "site.toml", site_under_many_suns())
    choice = pcm.choose_views(str(tmp_path / "site.toml"), 10.0, 5.0, out=tmp_path / "near.toml", count=4)
    of_limits = choose_views(site_under_many_suns(), 10.0, 5.0, None, ViewLimits(count=4))
    assert [s.name for s in choice.chosen] == [s.name for s in of_limits.chosen]
    assert [v.image.name for v in read_site(tmp_path / "near.toml").views] == [s.name for s in choice.chosen]


@pytest.mark.data
@needs_formats
def test_a_real_image_of_bennu_sees_the_place_that_its_sumfile_points_at(tmp_path):
    """The place where the boresight meets the ellipsoid is seen at the principal point; its antipode is not seen. The
    phase angle is about 6 degrees, as the mission page has it."""
    sumfile = FORMATS / "spc" / "M605862153F5.SUM"
    image = FORMATS / "spc" / "ocams20190314t190123s972_map_iofl2pan_77236.png"
    options = IngestOptions(sumfiles=(sumfile,), body="bennu", lines="up")
    site = read_three(ingest([image], tmp_path / "site", options).exposures[0])
    pose = site.views[0].pose_prior.cam_from_body
    center, axes = pose.inverse().translation, np.array(semi_axes("bennu"))
    ray = pose.rotation[2]
    a, b, c = np.sum((ray / axes) ** 2), np.sum(ray * center / axes**2), np.sum((center / axes) ** 2) - 1.0
    hit = center + (-b - np.sqrt(b * b - a * c)) / a * ray
    lon, lat = np.degrees(np.arctan2(hit[1], hit[0])), np.degrees(np.arcsin(hit[2] / np.linalg.norm(hit)))
    seen = choose_views(site, lon, lat).sightings.seen[0]
    assert seen.pixel == pytest.approx(site.views[0].camera.principal_px, abs=1e-3)
    assert seen.distance_m == pytest.approx(np.linalg.norm(hit - center))
    assert seen.gsd_m == pytest.approx(seen.distance_m / 14729, rel=2e-3)
    assert 3.0 < seen.phase_deg < 9.0
    with pytest.raises(InputError, match="from 1 it lies beyond the limb"):
        choose_views(site, lon + 180.0, -lat)


@pytest.mark.data
@needs_formats
def test_real_cubes_of_bennu_are_listed_for_the_place_that_the_spacecraft_touched(tmp_path, capsys):
    """NFTCam, seconds from the ground on 2020-10-20, and NavCam, over it half a year before, see one place; MapCam saw
    the other side. The kernels' ellipsoid is within metres of the ground there."""
    folder = FORMATS / "osirisRexImages"
    cubes = (folder / "20200303T213031S138_ncm_L0-reduced.cub", folder / "20201020T214241S004_nft_L0-reduced.cub")
    cubes += (FORMATS / "phocube" / "20190425T211232S312_map_iofL2pan-crop.cub",)
    assert phomo("ingest", *cubes, "--uncalibrated", "--out", tmp_path / "site") == 0
    capsys.readouterr()
    assert phomo("views", tmp_path / "site", "--at", 45.48, 53.73) == 0
    said = capsys.readouterr()
    head, first, second = said.out.splitlines()
    assert head.split()[0] == "image"
    assert first.split()[:3] == ["*", "20200303T213031S138_ncm_L0-reduced", "0.610"]
    assert second.split()[:3] == ["*", "20201020T214241S004_nft_L0-reduced", "0.00806"]
    assert "2 views see 45.48 E, 53.73 N" in said.err
    assert "Of the others, 1 have it beyond the limb, 0 have it beside the image" in said.err


def read_three(exposure):
    """A site of one exposure."""
    v = SiteView("a", exposure.path, exposure.camera, exposure.sun, pose_prior=exposure.prior)
    return site_of(v)
