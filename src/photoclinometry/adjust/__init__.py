"""The joint estimate: one factor graph of keypoints, brightness, Sun directions, smoothness and priors.

`adjust` does the whole of it for a scene. The graph can be used by itself, too:

    graph = FactorGraph([Keypoints(...), Brightness(...), SunDirections(...), Gauge(...), Exposure(...)])
    solution = minimize(graph, start)
    sigmas = marginals(linearized_graph(graph, solution.estimate))
"""

from photoclinometry.adjust.altimeter_tracks import AltimetryFit
from photoclinometry.adjust.covariance.linearized_graph import linearized_graph
from photoclinometry.adjust.covariance.marginals import Marginals, marginals
from photoclinometry.adjust.estimate import Adjustment, adjust
from photoclinometry.adjust.graph.altimetry import Altimetry
from photoclinometry.adjust.graph.control_points import ControlPoints
from photoclinometry.adjust.graph.general import FactorGroup, JacobianBlock, Rows
from photoclinometry.adjust.graph.graph import FactorGraph, Linearization
from photoclinometry.adjust.graph.observations import Brightness, ImageGradients, Keypoints, ObservationTable
from photoclinometry.adjust.graph.priors import (
    Exposure,
    Gauge,
    KnownPoses,
    LandmarkPriors,
    PosePriors,
    ReflectancePrior,
)
from photoclinometry.adjust.graph.smoothness import Smoothness
from photoclinometry.adjust.graph.sun_directions import SunDirections
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.adjust.scene_priors import ScenePriors
from photoclinometry.adjust.solve.solver import Iteration, Solution, SolverOptions, minimize
from photoclinometry.adjust.tie_points import GroundControl, TiePoints

__all__ = [
    "AdjustOptions",
    "Adjustment",
    "Altimetry",
    "AltimetryFit",
    "Brightness",
    "ControlPoints",
    "Estimate",
    "Exposure",
    "FactorGraph",
    "FactorGroup",
    "Gauge",
    "GroundControl",
    "ImageGradients",
    "Iteration",
    "JacobianBlock",
    "Keypoints",
    "KnownPoses",
    "LandmarkPriors",
    "Linearization",
    "Marginals",
    "Noise",
    "ObservationTable",
    "PosePriors",
    "ReflectancePrior",
    "Rows",
    "ScenePriors",
    "Smoothness",
    "Solution",
    "SolverOptions",
    "SunDirections",
    "TiePoints",
    "adjust",
    "linearized_graph",
    "marginals",
    "minimize",
]
