"""Relighting iterations: they find geometry, tell what they changed, stop, and go on where a run was killed."""

import json
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.matching.densify import DenseTracks, DensifyOptions
from photoclinometry.matching.flow import FlowMatcher
from photoclinometry.matching.interface import Matches
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import angle_between, so3_exp, unit
from photoclinometry.model.projection import keypoint_residuals
from photoclinometry.photometry.predict import brightness_residuals, observation_brightness
from photoclinometry.pipeline import joint_estimate
from photoclinometry.pipeline.options import RelightOptions
from photoclinometry.pipeline.relighting import (
    inconsistent_brightness,
    is_settled,
    keypoints_moved,
    normals_turned,
    rematch,
    with_dense,
)
from photoclinometry.pipeline.run import RunOptions, run
from scenes import synthetic_images, synthetic_scene

pytestmark = pytest.mark.usefixtures("no_figures", "photometry_as_stated")


def test_an_iteration_finds_keypoints_and_normals_that_the_map_had_wrong():
    """Positions off by 0.15 GSD, smooth over 5 px, and normals off by 3 degrees, as a first map leaves them."""
    from scipy.ndimage import gaussian_filter

    true = synthetic_scene(size=48, views=7)
    rng = np.random.default_rng(0)
    wave = gaussian_filter(rng.normal(size=(48, 48)), 5.0)
    away = unit(true.landmarks.position - true.views.body_from_cam.translation[0])
    position = true.landmarks.position + 0.15 * true.gsd * (wave / wave.std()).reshape(-1, 1) * away
    normal = unit(true.landmarks.normal + 0.05 * rng.normal(size=true.landmarks.normal.shape))
    start = replace(true, landmarks=replace(true.landmarks, position=position, normal=normal))
    found = rematch(start, synthetic_images(true), FlowMatcher(), DensifyOptions())
    assert len(found.landmarks) > 0.97 * len(true.landmarks)
    known = true.grid(np.arange(len(true.landmarks)))[
        tuple((found.landmarks.pixel - (true.region.row, true.region.col)).T)
    ]
    exact = found.with_estimate(
        true.views, replace(found.landmarks, position=true.landmarks.position[known.astype(int)])
    )
    error = np.linalg.norm(keypoint_residuals(exact), axis=-1)[found.tracks.view != 0]
    assert np.median(error) < 0.03
    off = angle_between(found.landmarks.normal, true.landmarks.normal[known.astype(int)])
    assert np.degrees(np.median(off)) < 1.5


def test_nothing_matches_nothing():
    scene = synthetic_scene(size=20, views=4)
    blank = [replace(image, brightness=np.zeros_like(image.brightness)) for image in synthetic_images(scene)]
    with pytest.raises(ReconstructionError, match=r"0 of the 400 landmarks .* in 3 views .* lower --densify.min-views"):
        rematch(scene, blank, FlowMatcher(), DensifyOptions(min_views=3))


def test_landmarks_that_wrong_suns_lose_are_told_with_the_suns():
    """Every Sun is turned half round the vertical: the map relights its reference where the views have shadow."""
    scene = synthetic_scene(size=20, views=4)
    views = replace(scene.views, sun=scene.views.sun * [-1.0, -1.0, 1.0])
    with pytest.raises(ReconstructionError, match="Sun directions are most likely wrong: check `sun` of several views"):
        rematch(replace(scene, views=views), synthetic_images(scene), NoMatcher(), DensifyOptions(min_views=3))


class NoMatcher:
    """Finds nothing."""

    name = "none"

    def match(self, request):
        shape = request.region.height, request.region.width
        return Matches(
            position=np.zeros((*shape, 2)),
            certainty=np.zeros(shape, np.float32),
            sigma_px=np.ones(shape, np.float32),
            valid=np.zeros(shape, bool),
        )


def test_changes_are_those_of_keypoints_and_normals_in_common():
    before = synthetic_scene(size=12, views=4)
    turned = before.landmarks.normal @ so3_exp(np.array([0.0, 0.0, 0.02])).T
    moved = replace(
        before,
        landmarks=replace(before.landmarks, normal=turned),
        tracks=replace(before.tracks, keypoint=before.tracks.keypoint + (0.3, -0.4)),
    )
    angle = angle_between(turned, before.landmarks.normal)
    assert keypoints_moved(before, moved) == pytest.approx(0.5, abs=1e-9)
    assert normals_turned(before, moved) == pytest.approx(np.median(angle), rel=1e-9)
    part = with_dense(moved, some_of(moved, 3))
    assert keypoints_moved(before, part) == pytest.approx(0.5, abs=1e-9)
    assert normals_turned(before, part) == pytest.approx(np.median(angle[::3]))


def some_of(scene, step):
    """Every `step`-th landmark with its tracks, as densify would give it."""
    chosen = np.arange(0, len(scene.landmarks), step)
    picked = np.isin(scene.tracks.landmark, chosen)
    count = np.diff(scene.tracks.start)[chosen]
    return DenseTracks(
        position=scene.landmarks.position[chosen] + 1.0,
        pixel=scene.landmarks.pixel[chosen],
        start=np.concatenate([[0], np.cumsum(count)]),
        view=scene.tracks.view[picked],
        keypoint=scene.tracks.keypoint[picked],
        keypoint_sigma=scene.tracks.keypoint_sigma[picked],
    )


def test_new_tracks_keep_each_pixels_normal_and_albedo():
    scene = synthetic_scene(size=12, views=4)
    found = with_dense(scene, some_of(scene, 5))
    np.testing.assert_array_equal(found.landmarks.normal, scene.landmarks.normal[::5])
    np.testing.assert_array_equal(found.landmarks.albedo, scene.landmarks.albedo[::5])
    np.testing.assert_array_equal(found.landmarks.position, scene.landmarks.position[::5] + 1.0)
    assert len(found.tracks) == 4 * len(found.landmarks)
    assert not found.tracks.lit.any()


def test_iterations_end_when_matches_stay():
    assert not is_settled(2, 0.04, settled_px=0.03)
    assert is_settled(2, 0.04, settled_px=0.05)
    assert not is_settled(1, 0.04, settled_px=0.05)


def test_a_view_under_a_wrong_sun_is_named_and_no_other():
    scene = synthetic_scene(size=16, views=7, brightness_noise=0.02)
    assert inconsistent_brightness(scene) == []
    sun = scene.views.sun.copy()
    sun[2] = so3_exp(np.array([0.0, 0.0, np.pi / 2])) @ sun[2]
    (name, misfit), *others = inconsistent_brightness(replace(scene, views=replace(scene.views, sun=sun)))
    assert name == scene.views.name[2]
    assert misfit > 0.1
    assert not others
    dark = replace(scene.tracks, brightness=np.where(scene.tracks.view == 2, 1e-6, scene.tracks.brightness))
    (name, misfit), *others = inconsistent_brightness(replace(scene, tracks=dark))
    assert (name, others) == (scene.views.name[2], [])
    assert misfit == pytest.approx(1.0, abs=1e-3), "what is dark where light was predicted is wholly off, not by more"
    assert inconsistent_brightness(replace(scene, reflectance=None)) == []


def test_a_sound_view_under_a_low_sun_is_not_named():
    """Normals are 2 degrees wrong, which is four times as large a share of its brightness as of others'."""
    scene = synthetic_scene(size=24, views=7)
    up, sun = unit(scene.landmarks.normal.mean(0)), scene.views.sun.copy()
    across = unit(sun[2] - (sun[2] @ up) * up)
    sun[2] = np.sin(np.radians(70.0)) * across + np.cos(np.radians(70.0)) * up
    lit = replace(scene, views=replace(scene.views, sun=sun))
    true = replace(lit, tracks=replace(lit.tracks, brightness=observation_brightness(lit)))
    wrong = np.random.default_rng(0).normal(size=true.landmarks.normal.shape)
    normal = unit(true.landmarks.normal + np.radians(2.0) * wrong)
    found = replace(true, landmarks=replace(true.landmarks, normal=normal))
    residual, view = np.abs(brightness_residuals(found)), found.tracks.view
    share = [np.median(residual[view == k]) / np.median(found.tracks.brightness[view == k]) for k in range(7)]
    assert share[2] > max(0.03, 3.0 * np.median(share))
    assert inconsistent_brightness(found) == []


def iterations_of(folder):
    return [row["iteration"] for row in json.loads((folder / "metrics.json").read_text())["relighting_iterations"]]


def run_until_the_third_estimate(site, folder, options, calls):
    """A run that is killed when it begins its third estimate; calls: of `adjust_nothing`."""
    stand_in = joint_estimate.adjust

    def killed(scene, options, **kwargs):
        if len(calls) == 2:
            raise KeyboardInterrupt
        return stand_in(scene, options, **kwargs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_estimate, "adjust", killed)
        with pytest.raises(KeyboardInterrupt):
            run(site, folder, options)


def test_a_run_killed_in_an_iteration_goes_on_in_it(mapped, tmp_path, adjust_nothing):
    folder = mapped.copy(tmp_path / "run")
    options = RunOptions(reflectance="akimov", relight=RelightOptions(iterations=2, settled_px=0.0, direct=False))
    run_until_the_third_estimate(mapped.site, folder, options, adjust_nothing)
    first = run(mapped.site, folder, options)
    assert [options.uncertainty for options in adjust_nothing] == [False, False, True]  # uncertainties are found once
    assert iterations_of(folder) == [0, 1, 2]
    again = run(mapped.site, folder, options)
    assert len(adjust_nothing) == 3
    assert iterations_of(folder) == [0, 1, 2]
    np.testing.assert_array_equal(again.scene.tracks.keypoint, first.scene.tracks.keypoint)


def test_more_iterations_go_on_from_the_first_map(mapped, tmp_path, adjust_nothing):
    """The last iteration made before does not count: as one of more, its keypoints are held more loosely."""
    folder = mapped.copy(tmp_path / "run")
    one, two = (RelightOptions(iterations=n, settled_px=0.0, direct=False) for n in (1, 2))
    run(mapped.site, folder, RunOptions(reflectance="akimov", relight=one))
    run(mapped.site, folder, RunOptions(reflectance="akimov", relight=two))
    assert [options.uncertainty for options in adjust_nothing] == [False, True, False, True]
    assert [options.keypoint_sigma_factor for options in adjust_nothing] == [1.0, 1.0, 5.0, 1.0]
    assert iterations_of(folder) == [0, 1, 2]


def test_fewer_iterations_than_were_begun_go_on_from_the_first_map(mapped, tmp_path, adjust_nothing):
    """The iteration that a longer run left has no uncertainties, which only the last one finds."""
    folder = mapped.copy(tmp_path / "run")
    two = RunOptions(reflectance="akimov", relight=RelightOptions(iterations=2, settled_px=0.0, direct=False))
    run_until_the_third_estimate(mapped.site, folder, two, adjust_nothing)
    one = replace(two, relight=replace(two.relight, iterations=1))
    run(mapped.site, folder, one)
    run(mapped.site, folder, one)
    assert [options.uncertainty for options in adjust_nothing] == [False, False, True]


def test_flow_and_geometry_alone_have_no_iterations(mapped, tmp_path, adjust_nothing):
    folder = mapped.copy(tmp_path / "run")
    run(mapped.site, folder, RunOptions(matcher="flow"))
    assert iterations_of(folder) == [0]
    run(mapped.site, folder, RunOptions(reflectance="none"))
    assert iterations_of(folder) == [0]
    assert len(adjust_nothing) == 2
