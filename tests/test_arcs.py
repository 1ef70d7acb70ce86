"""Arcs of attitude and orbit: Suns and pose priors of each have an error of their own, which simulated maps recover."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions, PosePriors, ScenePriors, adjust
from photoclinometry.adjust.graph.sun_directions import common_turns
from photoclinometry.evaluate.common_sun import common_sun_turn
from photoclinometry.io.site import read_site, write_site
from photoclinometry.io.site_views import views_at
from photoclinometry.model.errors import SiteError
from photoclinometry.model.geometry import Rigid, angle_between, so3_exp, tangent_basis
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance import published
from photoclinometry.registration.alignment import align_views
from photoclinometry.registration.georeference import agreement
from scenes import synthetic_scene
from sites import write_small_site

MODEL = published("lunar-lambert", "vesta")
TURNS = np.radians([[1.5, -1.0, 0.0], [-1.0, -1.5, 0.0]])
"""By which the Suns of two arcs are off [rad]: by 1.8 degrees each, 2.6 from each other."""
ARC = np.arange(8) % 2
INDEPENDENT = AdjustOptions(keypoint_correlation_px=1, brightness_correlation_px=1)


@pytest.fixture(scope="module", params=[2, 3])
def suns_off(request):
    """A scene, and as it is known: the Suns of two arcs off alike by TURNS, and each by a twentieth of a degree."""
    true = synthetic_scene(
        size=20, views=8, seed=request.param, reflectance=MODEL, brightness_noise=0.003, keypoint_noise_px=0.1
    )
    true = replace(true, body="vesta")
    noise = 1e-3 * np.random.default_rng([request.param, 7]).normal(size=(8, 3))
    measured = np.einsum("kij,kj->ki", so3_exp(TURNS)[ARC], true.views.sun_measured) + noise
    measured /= np.linalg.norm(measured, axis=1)[:, None]
    views = replace(true.views, sun_measured=measured, sun_common_sigma=np.full(8, np.radians(1.5)), arc=ARC)
    return true, replace(true, views=views.at_poses(views.body_from_cam))


def in_one_arc(scene):
    return replace(scene, views=replace(scene.views, arc=np.zeros(len(scene.views), int)))


def sun_error(found, true):
    """Errors of Suns along each axis, in the sigmas that are stated and in degrees, root mean squares."""
    views = found.views
    off = np.einsum("kir,ki->kr", tangent_basis(views.sun), true.views.sun)
    squares = np.einsum("kr,krs,ks->k", off, np.linalg.inv(found.uncertainty["sun"]), off)
    return np.sqrt(np.mean(squares) / 2.0), np.degrees(np.sqrt(np.mean(off**2)))


def test_suns_of_two_arcs_are_found_within_their_sigmas_and_by_one_common_error_they_are_not(suns_off):
    """Suns and turns to some tenths of a degree; as one arc they stay a degree and a half off, 4 sigmas."""
    true, start = suns_off
    found = adjust(start, AdjustOptions()).scene
    sigmas, degrees = sun_error(found, true)
    assert sigmas < 1.5
    assert degrees < 0.5
    turned = np.degrees(common_turns(found.views, np.array([0, 1])) + TURNS)
    assert np.abs(turned[:, :2]).max() < 0.3, "about the camera's axis Suns tell little"
    alone = adjust(in_one_arc(start), AdjustOptions()).scene
    sigmas, degrees = sun_error(alone, true)
    assert sigmas > 3.0
    assert degrees > 1.5
    normals = [np.mean(angle_between(each.landmarks.normal, true.landmarks.normal)) for each in (found, alone)]
    assert normals[1] > 1.5 * normals[0]


def test_what_is_wrong_with_all_arcs_is_told_from_what_is_wrong_with_each(suns_off):
    """Arcs that are off by 1.8 degrees each, as is stated, are off alike by no more than their mean is, and not
    clearly."""
    _, start = suns_off
    turn, sigma = common_sun_turn(start, MODEL, 300)
    assert np.all(np.abs(turn + TURNS.mean(0)) < 4.0 * np.hypot(sigma, np.radians(1.5)))


def test_numbers_of_arcs_do_not_matter(suns_off):
    """Any number of the one arc, and any pair of two, give the same estimate to the last bit."""
    _, start = suns_off
    options = AdjustOptions(uncertainty=False, max_reweightings=1)
    for arc, other in ((0 * ARC, 0 * ARC + 5), (ARC, 3 * ARC + 2)):
        results = [adjust(replace(start, views=replace(start.views, arc=each)), options).scene for each in (arc, other)]
        np.testing.assert_array_equal(results[0].landmarks.normal, results[1].landmarks.normal)
        np.testing.assert_array_equal(results[0].views.sun, results[1].views.sun)


SHIFTS = np.array([[700.0, -300.0, 400.0], [-200.0, 800.0, -500.0]])
"""By which the centres of two arcs of pose priors are off [m]."""
HALVES, FEW = np.arange(8) // 4, np.arange(8) // 6
"""Arcs of neighbouring cameras."""


def priors_off(arc):
    """A scene, and priors whose centres are off by SHIFTS and 20 m each, attitudes by 0.006 degrees each."""
    true = synthetic_scene(size=16, views=8, keypoint_noise_px=0.3, brightness_noise=0.01)
    rng, poses = np.random.default_rng(4), true.views.body_from_cam
    known = Rigid(
        poses.rotation @ so3_exp(1e-4 * rng.normal(size=(8, 3))),
        poses.translation + SHIFTS[arc] + 20.0 * rng.normal(size=(8, 3)),
    )
    return true, known


def test_priors_of_two_arcs_know_the_frame_as_well_as_is_stated():
    """Place and scale within three sigmas. As one arc the scale is off by five or more."""
    true, known = priors_off(HALVES)

    def off_in_sigmas(arc):
        priors = PosePriors(
            body_from_cam=known, rotation_sigma=np.full(8, 1e-4), center_sigma=np.full(8, 20.0),
            common_center_sigma=600.0, arc=arc,
        )  # fmt: skip
        found = adjust(true, INDEPENDENT, priors=ScenePriors(pose_priors=priors))
        moved = align_views(true.views, found.scene)
        middle = np.median(true.landmarks.position, axis=0)
        shift = moved(middle) - middle
        return np.r_[shift, np.log(moved.scale)] / np.sqrt(np.diag(found.frame_covariance)[3:])

    assert np.abs(off_in_sigmas(HALVES)).max() < 3.0
    assert np.abs(off_in_sigmas(None)).max() > 5.0


def test_priors_of_arcs_that_contradict_each_other_all_place_a_map():
    """Off from each other by 1.7 km, as is stated, none is left out; as one arc, the two of the smaller one are."""
    true, known = priors_off(FEW)
    inverse = known.inverse()
    priors = {name: PosePrior(inverse[k], 1e-4, 20.0, 0.0, 600.0) for k, name in enumerate(true.views.name)}
    of_arcs = replace(true, views=replace(true.views, arc=FEW))
    assert agreement(of_arcs, priors).used.all()
    np.testing.assert_array_equal(agreement(true, priors).used, FEW == 0)


def test_arcs_of_a_site_are_numbered_as_they_come(tmp_path):
    path = write_small_site(tmp_path)
    assert read_site(path).arcs.tolist() == [0, 0, 0, 0]
    for number, arc in ((1, "b"), (3, "a"), (2, "b")):
        image = f'image = "images/{number}.fits"'
        path.write_text(path.read_text().replace(f"[[views]]\n{image}", f'[[views]]\n{image}\narc = "{arc}"'))
    site = read_site(path)
    assert [view.arc for view in site.views] == [None, "b", "b", "a"]
    nowhere = Rigid(np.tile(np.eye(3), (4, 1, 1)), np.zeros((4, 3)))
    assert views_at(site, nowhere).arc.tolist() == [0, 1, 1, 2]
    write_site(path.with_name("again.toml"), site)
    assert [view.arc for view in read_site(path.with_name("again.toml")).views] == [None, "b", "b", "a"]
    path.write_text(path.read_text().replace('arc = "a"', "arc = 3"))
    with pytest.raises(SiteError, match="arc: expected text in quotes, found 3"):
        read_site(path)
