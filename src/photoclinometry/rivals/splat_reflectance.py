"""Gaussian splatting with a reflectance model: Gaussians have an albedo and a normal, and a view's Sun shades them.

After AstroSplat (Nolan, Driver and Christian 2026, arXiv:2603.11969): the harmonics of `splat` are replaced by

    brightness = scale_k albedo rho(n, s_k, e) + bias_k                                  (paper Eqs. 29 and 30)

with the run's reflectance model, Suns and exposures. The normal is the Gaussian's third axis, which starts across the
surface, so that shading turns the Gaussian itself. Cast shadows are not drawn.
"""

from __future__ import annotations

from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.photometry.predict import reflectance_of
from photoclinometry.rivals.gaussians.colour import ReflectanceColour
from photoclinometry.rivals.outcome import Outcome
from photoclinometry.rivals.problem import Problem
from photoclinometry.rivals.splat import SplatOptions, splatted


def run_splat_reflectance(
    problem: Problem, options: SplatOptions | None = None, progress: Progress = no_progress
) -> Outcome:
    """The map and the predictions of Gaussians with normals and albedos."""
    colour = ReflectanceColour(reflectance=reflectance_of(problem.scene))
    return splatted(problem, options or SplatOptions(), colour, "splat-reflectance", progress)
