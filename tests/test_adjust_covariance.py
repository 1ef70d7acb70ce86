"""Covariances against a dense inverse of numerical derivatives, scaling laws, and the error of the approximations."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from dense_covariances import PIVOT, covariance_of, dense_covariance, jacobian_by_differences, linearized_at_truth
from graphs import graph_of, residuals_of, some_tracks_missing
from jacobians import numerical_jacobian
from photoclinometry.adjust.covariance.linearized_graph import linearized_graph
from photoclinometry.adjust.covariance.marginals import ErrorModel, PositionSmoothness, marginals
from photoclinometry.adjust.covariance.windows import Links, covariances_given_views
from photoclinometry.adjust.graph.altimetry import Altimetry
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import Keypoints, ObservationTable
from photoclinometry.adjust.graph.priors import Exposure, PosePriors
from photoclinometry.adjust.graph.variables import Estimate
from range_factors import Ranges
from scenes import synthetic_scene


@pytest.fixture(scope="module")
def small():
    return some_tracks_missing(synthetic_scene(size=3, views=3))


def test_marginals_are_the_dense_inverse_of_numerical_derivatives(small):
    """Every block to a ten-thousandth of its sigmas."""
    at, built = linearized_at_truth(small)
    expected, views = dense_covariance(small, built)
    assert_equal_marginals(marginals(at), expected, views)


@pytest.mark.parametrize("arc", [np.zeros(3, int), np.array([0, 1, 0])], ids=["one arc", "two arcs"])
def test_suns_that_err_together_are_told_apart_better_than_they_are_known(small, arc):
    """Marginals are the dense inverse; the sum of two views' errors is known ten times worse than their difference."""
    views = replace(small.views, sun_sigma=np.full(3, 1e-4), sun_common_sigma=np.full(3, 1e-2), arc=arc)
    scene = replace(small, views=views)
    at, built = linearized_at_truth(scene)
    expected, size = dense_covariance(scene, built)
    found = marginals(at)
    assert_equal_marginals(found, expected, size)


@pytest.mark.parametrize("arc", [None, np.array([0, 1, 0])], ids=["one arc", "two arcs"])
def test_errors_that_measurements_share_are_eliminated_with_the_views(small, arc):
    """Two tracks of an altimeter and pose priors with common errors: marginals are the dense inverse."""
    arcs = 1 if arc is None else 2
    count = arcs + 2
    rng = np.random.default_rng(6)
    which = np.array([0, 4, 5, 7])
    shots = Altimetry(
        landmark=which,
        track=np.array([0, 0, 1, 1]),
        position=small.landmarks.position[which] + rng.normal(0.0, 5.0, (4, 3)),
        sigma=rng.uniform(2.0, 5.0, 4),
        shift_sigma=np.array([20.0, 30.0]),
        first=arcs,
    )
    priors = PosePriors(
        body_from_cam=small.views.body_from_cam,
        rotation_sigma=np.full(3, 1e-4),
        center_sigma=np.full(3, 20.0),
        common_rotation_sigma=1e-3,
        common_center_sigma=300.0,
        arc=arc,
    )
    assert priors.common_errors == arcs
    estimate = Estimate(small.views, small.landmarks, PIVOT, systematic=np.zeros((count, 10)))
    jacobian, views = jacobian_by_differences(small, graph_of(small))
    used = np.array([10 * n + i for n in range(count) for i in range(6 if n < arcs else 3)])
    base = views + 10 * count
    wide = np.insert(jacobian, [views] * len(used), 0.0, axis=1)
    extra = []
    for rows in [*shots.rows(estimate), *priors.rows(estimate)]:
        for f in range(len(rows.residual)):
            row = np.zeros((rows.residual.shape[1], base + 6 * len(small.landmarks)))
            for touch in rows.touches:
                first, size = {"view": (0, 10), "systematic": (views, 10), "landmark": (base, 6)}[touch.variable]
                start = first + size * touch.index[f]
                row[:, start : start + touch.jacobian.shape[2]] += touch.jacobian[f]
            extra.append(row)
    kept = np.r_[:views, views + used, base : base + 6 * len(small.landmarks)]
    expected = covariance_of(np.vstack([wide, np.vstack(extra)[:, kept]]))
    graph = graph_of(small, others=(shots, priors)).graph
    found = marginals(linearized_graph(graph, estimate))
    of_common = np.r_[:views, views + used]
    common = found.views[np.ix_(of_common, of_common)]
    size = np.sqrt(np.diag(expected)[: len(of_common)])
    np.testing.assert_allclose(
        common / np.outer(size, size), expected[: len(size), : len(size)] / np.outer(size, size), atol=1e-4
    )
    for j, block in enumerate(found.landmark):
        here = slice(len(size) + 6 * j, len(size) + 6 * (j + 1))
        own = np.sqrt(np.diag(expected)[here])
        np.testing.assert_allclose(block / np.outer(own, own), expected[here, here] / np.outer(own, own), atol=1e-4)


def test_what_images_do_not_tell_is_as_uncertain_as_priors_leave_it():
    """Keypoints good to a thousandth of a pixel hold 1296 landmarks to views, and none of them to the body.

    By the ridge that landmarks are held with the place would be known to 170 m.
    """
    scene = synthetic_scene(size=36, views=5)
    every, sigma = np.ones(len(scene.landmarks), bool), np.full(len(scene.tracks), 1e-3)
    keypoints = Keypoints(name="all", table=ObservationTable(scene.tracks, 5), landmarks=every, sigma=sigma)
    exposure = Exposure(scale_sigma=np.ones(5), bias_sigma=np.ones(5))
    own = PosePriors(
        body_from_cam=scene.views.body_from_cam, rotation_sigma=np.full(5, 1e-5), center_sigma=np.full(5, 10.0)
    )
    estimate = Estimate(scene.views, scene.landmarks, PIVOT, systematic=np.zeros((1, 10)))

    def frame(priors):
        at = linearized_graph(FactorGraph([keypoints, exposure, priors]), estimate)
        return np.sqrt(np.diag(marginals(at, frame=every, keeps_frame=True).frame))

    alone, shared = frame(own), frame(replace(own, common_center_sigma=5e4))
    assert np.all(alone[3:6] < 50.0)
    np.testing.assert_allclose(shared[3:6], np.hypot(alone[3:6], 5e4), rtol=1e-3)
    np.testing.assert_allclose(shared[[0, 1, 2, 6]], alone[[0, 1, 2, 6]], rtol=1e-2)


def assert_equal_marginals(found, expected, views):
    """Every block to a ten-thousandth of its sigmas."""
    size = np.sqrt(np.diag(expected)[:views])
    np.testing.assert_allclose(
        found.views / np.outer(size, size), expected[:views, :views] / np.outer(size, size), atol=1e-4
    )
    for j, block in enumerate(found.landmark):
        here = slice(views + 6 * j, views + 6 * (j + 1))
        size = np.sqrt(np.diag(expected)[here])
        np.testing.assert_allclose(block / np.outer(size, size), expected[here, here] / np.outer(size, size), atol=1e-4)


def test_parameters_that_are_estimated_make_all_else_less_certain():
    """Marginals with parameters are the dense inverse of numerical derivatives, by these, too."""
    scene = some_tracks_missing(synthetic_scene(size=4, views=5))
    _, built = linearized_at_truth(scene)
    graph = graph_of(scene, reflectance_sigma=0.1).graph
    count = len(scene.reflectance.parameters)
    estimate = Estimate(scene.views, scene.landmarks, PIVOT)
    by_others, views = jacobian_by_differences(scene, built)
    others, reflectance = covariance_of(by_others), scene.reflectance

    def residuals(change):
        changed = replace(scene, reflectance=reflectance.with_parameters(reflectance.parameters * (1 + change)))
        return residuals_of(changed, built)(estimate)

    by_parameter = numerical_jacobian(residuals, count, 1e-4)
    prior = np.hstack([np.zeros((count, by_others.shape[1])), np.eye(count) / 0.1])
    whole = covariance_of(np.vstack([np.hstack([by_others, by_parameter]), prior]))
    found = marginals(linearized_graph(graph, replace(estimate, parameters=np.zeros(count))))
    assert_equal_marginals(found, whole[:-count, :-count], views)
    size = np.sqrt(np.diag(whole)[-count:])
    np.testing.assert_allclose(
        found.parameter / np.outer(size, size), whole[-count:, -count:] / np.outer(size, size), atol=1e-3
    )
    assert np.max(np.diag(whole)[:-count] / np.diag(others)) > 1.5, "the parameters matter"
    relative, given = relative_albedo(whole, scene, views, count)
    np.testing.assert_allclose(found.albedo_relative, relative, rtol=1e-3)
    variances = np.stack([found.landmark[:, 5, 5], found.albedo_relative], -1)
    np.testing.assert_allclose(variances - found.albedo_by_common, np.stack([given, given], -1), rtol=1e-3)


def relative_albedo(covariance, scene, views, parameters):
    """(J,) variances of albedos without the mean relative error that follows from views and parameters, and given
    these."""
    albedo = views + 6 * np.arange(len(scene.landmarks)) + 5
    common = np.r_[:views, len(covariance) - parameters : len(covariance)]
    of_common = covariance[np.ix_(common, common)]
    response = np.linalg.solve(of_common, covariance[np.ix_(common, albedo)]).T
    mean = np.mean(response / scene.landmarks.albedo[:, None], axis=0)
    rest = response - scene.landmarks.albedo[:, None] * mean
    given = np.diag(covariance)[albedo] - np.einsum("ja,ab,jb->j", response, of_common, response)
    return given + np.einsum("ja,ab,jb->j", rest, of_common, rest), given


def test_what_is_known_of_all_albedos_together_does_not_matter_to_relative_ones(larger):
    """Without and with parameters of which albedos follow as a whole: absolute albedos are less certain, relative ones
    hardly."""
    (larger, *_), none = larger, np.zeros(0)
    held, free = (graph_of(larger, reflectance_sigma=sigma).graph for sigma in (None, 0.5))
    known, unknown = (
        marginals(linearized_graph(graph, Estimate(larger.views, larger.landmarks, PIVOT, parameters)))
        for graph, parameters in ((held, none), (free, np.zeros(len(larger.reflectance.parameters))))
    )
    absolute = [np.median(np.sqrt(one.landmark[:, 5, 5])) for one in (known, unknown)]
    relative = [np.median(np.sqrt(one.albedo_relative)) for one in (known, unknown)]
    assert absolute[1] / absolute[0] > 3.0 * relative[1] / relative[0]
    assert relative[0] < absolute[0]


def held_by_gauge(scene, size=1.0):
    """The scene with no pose known but the first: 1e-4 rad and 10 m; and a landmark to 100 m; all times `size`."""
    first = np.r_[1.0, np.full(len(scene.views) - 1, np.inf)]
    graph = graph_of(scene, pose_sigma=size * first).graph
    at = linearized_graph(graph, Estimate(scene.views, scene.landmarks, PIVOT))
    return replace(at, prior=1e-4 * at.prior / size**2)


@pytest.fixture(scope="module")
def larger():
    scene = synthetic_scene(size=20, views=6)
    at, frame = held_by_gauge(scene), np.ones(len(scene.landmarks), bool)
    return scene, at, frame, marginals(at, frame=frame)


@pytest.mark.parametrize("size", [1.0, 10.0])
def test_covariances_are_those_in_the_map_frame_and_the_part_of_the_frame(larger, size):
    """The priors alone determine the frame, the images all else: the two are independent."""
    scene, _, frame, own = larger
    at = held_by_gauge(scene, size)
    found = marginals(at, frame=frame, keeps_frame=True)
    plain = marginals(at).landmark  # of a frame held loosely the ridge under landmarks says 0.2 %
    sigma = np.sqrt(np.einsum("jaa->ja", plain))
    outer = sigma[:, :, None] * sigma[:, None, :]
    np.testing.assert_allclose(found.landmark / outer, plain / outer, atol=1e-4 if size == 1.0 else 3e-3)
    assert found.of_frame is not None
    sizes = [np.einsum("jaa->ja", each) for each in (found.landmark, found.of_frame, own.landmark)]
    np.testing.assert_allclose(sizes[0][:, :3], (sizes[1] + sizes[2])[:, :3], rtol=4e-2)  # the gauge's landmark: 3 %
    assert np.median(sizes[1][:, 0] / sizes[2][:, 0]) > 3.0, "the frame matters"


def test_the_map_frame_does_not_depend_on_what_holds_the_map(larger):
    """The gauge ten times as loose: other sigmas in the priors' frame, in the map's the same within 2 %, which is what
    the landmarks' own errors do to the frame."""
    scene, at, frame, tight = larger
    at_loose = held_by_gauge(scene, 10.0)
    assert np.median(marginals(at_loose, exact=0).landmark[:, 0, 0]) > 4 * np.median(
        marginals(at, exact=0).landmark[:, 0, 0]
    )
    loose = marginals(at_loose, frame=frame)
    ours, theirs = (np.einsum("jaa->ja", found.landmark) for found in (loose, tight))
    np.testing.assert_allclose(ours, theirs, rtol=2e-2)
    np.testing.assert_allclose(np.diag(loose.views), np.diag(tight.views), rtol=2e-2)


def test_half_the_noise_half_the_sigma(small):
    """Of all that measurements alone determine: the landmarks, once priors and smoothness say nothing."""
    at, _ = linearized_at_truth(small, links=False)
    finer, _ = linearized_at_truth(small, factor=0.5, links=False)
    free = {"common_prior": 1e-12 * at.common_prior}
    coarse, fine = (
        marginals(replace(at, **free)),
        marginals(replace(finer, **{"common_prior": 4e-12 * at.common_prior})),
    )
    np.testing.assert_allclose(fine.views * 4, coarse.views, rtol=1e-3, atol=1e-3 * abs(coarse.views).max())


def test_twice_the_views_divide_variances_given_the_views_by_two():
    """Every view there twice: what each landmark knows of itself doubles, smoothness apart."""
    scene = synthetic_scene(size=6, views=4)
    at, _ = linearized_at_truth(scene, links=False)
    observed = at.observed
    twice = observed._replace(
        start=2 * observed.start,
        **{name: np.repeat(getattr(observed, name), 2, axis=0)
           for name in ("seen_by", "keypoint", "brightness", "gradient", "keypoint_weight", "brightness_weight")},
    )  # fmt: skip
    sure = {"common_prior": 1e30 * np.eye(len(at.common_prior)), "prior": np.zeros((36, 6, 6))}
    once = marginals(replace(at, **sure)).landmark
    np.testing.assert_allclose(marginals(replace(at, observed=twice, **sure)).landmark * 2, once, rtol=1e-6, atol=1e-9)


def test_one_thread_finds_what_several_find(larger, monkeypatch):
    _, at, frame, _ = larger
    found = []
    for count in (1, 3):
        monkeypatch.setattr(numba, "get_num_threads", lambda count=count: count)
        found.append(marginals(at, exact=0, patch=64, frame=frame))
    for name in ("views", "landmark", "parameter", "albedo_relative", "albedo_by_common"):
        np.testing.assert_array_equal(getattr(found[1], name), getattr(found[0], name))


def test_patches_and_windows_are_near_the_exact_answer(larger):
    """400 landmarks in patches of 64: sigmas of views 5 % smaller to a fifth larger (median 10 %),
    of landmarks within 2 % in the median, but of normals, which share the uncertain tilt of so small a map."""
    _, at, frame, exact = larger
    found = marginals(at, exact=0, patch=64, frame=frame)
    views = np.sqrt(np.diag(found.views) / np.diag(exact.views))
    assert views.min() > 0.95
    assert np.median(views) < 1.1
    ratio = np.sqrt(np.einsum("jaa->ja", found.landmark) / np.einsum("jaa->ja", exact.landmark))
    assert np.all(abs(np.median(ratio, 0) - 1) < [0.02, 0.02, 0.02, 0.3, 0.3, 0.02])


def test_larger_patches_come_nearer(larger):
    _, at, frame, exact = larger

    def apart(patch):
        found = marginals(at, exact=0, patch=patch, frame=frame)
        return np.mean(np.sqrt(np.diag(found.views) / np.diag(exact.views)) - 1.0)

    assert apart(16) > apart(64) > apart(256) > -1e-3


def test_an_error_model_of_the_weights_changes_nothing_and_variances_are_linear_in_it(small):
    at, _ = linearized_at_truth(small)
    known = replace(at, common_prior=1e30 * np.eye(len(at.common_prior)))
    plain = marginals(known).landmark
    priors, *parts = [
        marginals(known, ErrorModel(keypoint=np.full(len(known), k), brightness=b, smoothness=s)).landmark
        for k, b, s in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    ]
    size = np.sqrt(np.einsum("jaa->ja", plain))
    size = size[:, :, None] * size[:, None, :]
    np.testing.assert_allclose((sum(parts) - 2 * priors) / size, plain / size, atol=5e-3)
    assert all(np.linalg.eigvalsh(part / size)[:, 0].min() > -1e-2 for part in parts)


def test_smoothness_of_positions_holds_these_and_nothing_else(small):
    at, _ = linearized_at_truth(small)
    of_normals, of_positions = (ErrorModel(keypoint=np.ones(len(at)), smoothness=each) for each in (1.0, 0.2))
    own = marginals(at, of_normals).landmark
    joined = marginals(
        at, replace(of_normals, position_smoothness=PositionSmoothness(at=at, errors=of_positions))
    ).landmark
    np.testing.assert_array_equal(joined[:, :3, :3], marginals(at, of_positions).landmark[:, :3, :3])
    assert (np.einsum("jaa->ja", joined - own)[:, :3] < 0.0).all()
    np.testing.assert_array_equal(joined[:, 3:, 3:], own[:, 3:, 3:])


def test_errors_that_all_neighbours_share_are_not_smoothed_away():
    """Common keypoint errors give depths the sigma of a single landmark, however stiff the smoothness between them."""
    at, _ = linearized_at_truth(synthetic_scene(size=8, views=6))
    known = replace(at, common_prior=1e30 * np.eye(len(at.common_prior)))
    only_keypoints = {"brightness": 0.0, "smoothness": 0.0}
    ones = np.ones(len(known))
    alone = marginals(known, ErrorModel(keypoint=ones, **only_keypoints)).landmark
    shared = marginals(known, ErrorModel(keypoint=ones, keypoint_common=1.0, **only_keypoints)).landmark
    assert np.median(shared[:, 2, 2]) > 1.5 * np.median(alone[:, 2, 2])


def test_what_nothing_measures_is_infinitely_uncertain_and_leaves_the_rest_alone():
    """A landmark whose brightness never counts: no albedo, no normal without smoothness, a position by keypoints."""
    at, _ = linearized_at_truth(synthetic_scene(size=3, views=4), links=False)
    dark = at.observed.brightness_weight.copy()
    dark[at.observed.start[3] : at.observed.start[4]] = 0.0
    found = marginals(replace(at, observed=at.observed._replace(brightness_weight=dark))).landmark
    assert np.isinf(np.diag(found[3])).tolist() == [False, False, False, True, True, True]
    assert np.isfinite(np.delete(found, 3, axis=0)).all()
    assert np.linalg.eigvalsh(found[3, :3, :3])[0] > 0


@pytest.mark.parametrize("exact", [1000, 0], ids=["exact", "patches"])
def test_general_factors_of_a_landmark_and_a_view_count(small, exact):
    """Two measured ranges: the marginals are the dense inverse with their rows in it."""
    ranges = Ranges(np.array([1, 2]), np.array([2, 7]), np.array([5e5, 6e5]), 3.0)
    estimate = Estimate(small.views, small.landmarks, PIVOT)
    built = graph_of(small, others=[ranges])
    (rows,) = ranges.rows(estimate)
    dense = np.zeros((2, 30 + 54))
    for n in range(2):
        view, landmark = rows.touches
        dense[n, 10 * view.index[n] :][:10] = view.jacobian[n, 0]
        dense[n, 30 + 6 * landmark.index[n] :][:6] = landmark.jacobian[n, 0]
    expected, views = dense_covariance(small, built, [dense])
    found = marginals(linearized_graph(built.graph, estimate), exact=exact, patch=9)
    if exact:
        assert_equal_marginals(found, expected, views)
    else:
        np.testing.assert_allclose(np.diag(found.views), np.diag(expected)[:views], rtol=1e-3)
    without, _ = dense_covariance(small, graph_of(small))
    assert np.max(np.diag(without)[:views] / np.diag(expected)[:views]) > 1.5, "the ranges matter"


def test_a_landmark_of_a_single_brightness_leaves_the_rest_of_its_window_alone():
    """Normal and albedo have one measurement between the three of them: what is eliminated has no inverse."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 8, 6))
    own = np.einsum("nri,nrj->nij", root, root)
    row = np.array([25.0, -7.0, 12.0, 140.0, 30.0, -90.0])
    own[2] = 1e4 * np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) + np.outer(row, row)
    none = np.zeros(0, int)
    alone = Links(np.zeros(5, int), none, none, np.zeros(5, int), none, np.zeros((0, 5)))
    found = covariances_given_views(own, alone, [(0, 4)])
    for n in (0, 1, 3):
        np.testing.assert_allclose(found[n], np.linalg.inv(own[n]), rtol=1e-6)
    np.testing.assert_allclose(found[2, :3, :3], 1e-4 * np.eye(3), atol=1e-8)
