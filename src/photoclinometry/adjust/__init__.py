"""The joint estimate: one factor graph of keypoints, brightness, Sun directions, smoothness and priors."""

from photoclinometry.adjust.estimate import Adjustment, adjust
from photoclinometry.adjust.graph.observations import ImageGradients
from photoclinometry.adjust.graph.priors import PosePriors
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.adjust.solve.solver import Iteration, SolverOptions
from photoclinometry.adjust.tie_points import GroundControl, TiePoints

__all__ = [
    "AdjustOptions",
    "Adjustment",
    "GroundControl",
    "ImageGradients",
    "Iteration",
    "Noise",
    "PosePriors",
    "SolverOptions",
    "TiePoints",
    "adjust",
]
