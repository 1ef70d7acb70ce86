"""The joint estimate: one factor graph of keypoints, brightness, Sun directions and smoothness."""

from photoclinometry.adjust.companions import Anchors
from photoclinometry.adjust.estimate import Adjustment, adjust
from photoclinometry.adjust.known import PosePriors
from photoclinometry.adjust.layout import ImageSlopes
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.adjust.solver import Iteration, SolverOptions

__all__ = [
    "AdjustOptions",
    "Adjustment",
    "Anchors",
    "ImageSlopes",
    "Iteration",
    "Noise",
    "PosePriors",
    "SolverOptions",
    "adjust",
]
