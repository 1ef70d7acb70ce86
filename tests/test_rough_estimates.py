"""Estimates that are made again: each starts from the noise that the one before has found."""

from dataclasses import replace

import pytest

from adjustments import not_adjusted
from photoclinometry.adjust import AdjustOptions
from photoclinometry.pipeline import joint_estimate
from photoclinometry.pipeline.folder.run_folder import adopt_stages
from photoclinometry.pipeline.joint_estimate import HELD_SIGMA, ROUGH_REWEIGHTING, EstimateSettings, JointEstimate
from photoclinometry.pipeline.options import RelightOptions
from photoclinometry.pipeline.run import RunOptions, run
from scenes import synthetic_scene

BEFORE = ["sparse", "inconsistent_views", "region", "dense"]


@pytest.fixture
def calls(monkeypatch):
    """Of the joint estimate, each of which finds another noise: its options, the noise given, and that found."""
    made = []

    def stand_in(scene, options, noise=None, **_):
        found = not_adjusted(scene, brightness_sigma=0.001 * (1 + len(made)))
        made.append((options, noise, found.noise))
        return found

    monkeypatch.setattr(joint_estimate, "adjust", stand_in)
    return made


def test_the_noise_of_each_map_is_what_the_next_one_is_relit_with(
    mapped, tmp_path, calls, no_figures, photometry_as_stated
):
    adopt_stages(mapped.run, tmp_path / "run", BEFORE)
    options = RunOptions(reflectance="lunar-lambert", relight=RelightOptions(settled_px=0.0, direct=False))
    run(mapped.site, tmp_path / "run", options)
    (_, given, found), *relit, (last, *_) = calls
    assert given is None
    assert len(relit) == options.relight.iterations - 1
    for _, given, next_found in relit:
        assert given == found
        found = next_found
    assert last.max_reweightings == AdjustOptions().max_reweightings


@pytest.mark.parametrize("allowed", [1, 4])
def test_rough_estimates_reweight_twice_or_as_often_as_is_allowed(calls, allowed):
    estimate = JointEstimate(options=replace(AdjustOptions(), max_reweightings=allowed))
    estimate(synthetic_scene(size=4, views=3), EstimateSettings(rough=True))
    estimate(synthetic_scene(size=4, views=3), EstimateSettings())
    assert [options.max_reweightings for options, *_ in calls] == [min(ROUGH_REWEIGHTING, allowed), allowed]


def test_settings_change_only_the_options_that_they_name():
    given = AdjustOptions(keypoint_sigma_factor=1.5, max_reweightings=4)
    assert EstimateSettings().applied_to(given) == given
    assert EstimateSettings(keypoint_sigma_factor=2.0, reweighting=3).applied_to(given) == replace(
        given, keypoint_sigma_factor=3.0, max_reweightings=3
    )
    assert EstimateSettings(rough=True, photometry_alone=True).applied_to(given) == replace(
        given,
        uncertainty=False,
        solver=given.solver.roughly(),
        max_reweightings=ROUGH_REWEIGHTING,
        position_sigma_gsd=HELD_SIGMA,
        normal_sigma_rad=HELD_SIGMA,
    )
    assert EstimateSettings(rough=True, all_steps=True, reweighting=1).applied_to(given) == replace(
        given, uncertainty=False, solver=given.solver.roughly(all_steps=True), max_reweightings=1
    )
