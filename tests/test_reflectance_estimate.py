"""Models that start from neutral parameters: the joint estimate finds the true ones, and keeps them within bounds."""

from dataclasses import replace

import numpy as np
import pytest

from matched import OPTIONS, matched_problem
from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.evaluate.evaluate import landmark_photometric_error
from photoclinometry.io.scene_file import read_scene
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.reflectance import Reflectance, published, starting_model
from photoclinometry.model.reflectance.reflectance import RELATIVE_SIGMA
from photoclinometry.photometry.albedo import with_model
from photoclinometry.pipeline.joint_estimate import JointEstimate
from photoclinometry.pipeline.run import RunOptions, run
from photoclinometry.simulate.site import simulate_site
from runs import SITE
from scenes import synthetic_scene


def test_parameters_are_found_from_neutral_ones():
    """Within 3 of their standard deviations, among them two that start from zero."""
    true = Reflectance("minnaert-magnitudes", (0.55, 0.15, 2.0, 0.3, -0.2))
    start, _ = matched_problem(24, 10, reflectance=true)
    start = replace(start, reflectance=starting_model("minnaert-magnitudes"))
    found = adjust(start, replace(OPTIONS, reflectance_sigma=RELATIVE_SIGMA, uncertainty=True))
    assert found.converged
    off = found.scene.reflectance.parameters - true.parameters
    assert np.all(np.abs(off) < 3 * found.parameter_sigma)
    assert off[0] < 0.5 * (true.values[0] - start.reflectance.values[0])
    assert abs(off[1]) < 0.5 * true.values[1]


def test_the_prior_that_parameters_state_is_taken_as_stated_by_default():
    assert AdjustOptions().reflectance_sigma == RELATIVE_SIGMA


def test_an_estimate_with_hardly_a_prior_stays_within_bounds():
    """Bright, smooth ground, near the bounds of w and theta-bar."""
    start, _ = matched_problem(16, 8, reflectance=Reflectance("hapke", (0.97, 0.03, 0.2, 0.5, 1.6, 0.06)))
    start = replace(start, reflectance=Reflectance("hapke", (0.9, 0.1, 0.3, 0.5, 1.6, 0.06)))
    found = adjust(start, replace(OPTIONS, reflectance_sigma=2.0, uncertainty=False))
    assert np.isfinite(found.scene.reflectance.parameter_vector).all()
    assert np.isfinite(found.scene.landmarks.normal).all()


def test_the_photometry_of_another_model_is_estimated_on_the_geometry_as_it_is():
    """Ground of other parameters than is known beforehand: brightness is explained then.
    A scene that has the model already stays as it is."""
    known = published("akimov+", "vesta")
    true = known.with_parameters(known.parameters * [0.8, 1.0, 1.3, 1.0, 1.0, 1.0])
    scene = replace(synthetic_scene(size=16, views=8, reflectance=true), reflectance=published("hapke", "vesta"))
    estimate = JointEstimate(options=replace(AdjustOptions(), reflectance_sigma=0.5), reflectance=known)
    found = estimate.in_own_model(scene)
    assert found.reflectance.name == "akimov+"
    np.testing.assert_allclose(found.landmarks.position, scene.landmarks.position, atol=1e-3)
    assert angle_between(found.landmarks.normal, scene.landmarks.normal).max() < 1e-3
    start = with_model(scene, known)
    assert landmark_photometric_error(found).mean() < 0.3 * landmark_photometric_error(start).mean()
    assert estimate.in_own_model(found) is found


@pytest.mark.slow
def test_a_site_is_simulated_and_mapped_with_a_model_from_the_table(no_figures, tmp_path):
    site = simulate_site(replace(SITE, reflectance="minnaert-magnitudes"), tmp_path / "site")
    result = run(site, tmp_path / "run", RunOptions(reflectance="minnaert-magnitudes", matcher="flow"))
    kept = read_scene(tmp_path / "run" / "scene.h5").reflectance
    assert kept == result.scene.reflectance
    assert kept.parameter_names == ("k0", "b", "beta", "gamma", "delta")
    np.testing.assert_allclose(kept.values[0], 0.5, atol=0.1)
    assert "reflectance_beta" in result.metrics
