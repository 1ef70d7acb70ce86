"""What a joint estimate begins with: a map moved away from the truth, points around it, options."""

import numpy as np

from photoclinometry.adjust import AdjustOptions, TiePoints
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.model.scene import Tracks

INDEPENDENT = AdjustOptions(keypoint_correlation_px=1, brightness_correlation_px=1)
"""Every measurement has an error of its own, as those of made-up scenes have."""


def start_of(scene, seed=1):
    """The scene with poses, Suns, positions, normals and albedos moved away from the truth."""
    rng = np.random.default_rng(seed)
    camera = np.zeros((len(scene.views), 10))
    camera[1:, :3] = 3e-5 * rng.normal(size=(len(scene.views) - 1, 3))
    camera[:, 6:8] = 1e-3 * rng.normal(size=(len(scene.views), 2))
    landmark = rng.normal(size=(len(scene.landmarks), 6)) * np.r_[[20.0] * 3, [0.1] * 2, 0.01]
    moved = Estimate(scene.views, scene.landmarks, np.zeros(3)).step(camera, landmark)
    return scene.with_estimate(moved.views, moved.landmarks)


def anchors_around(scene, count=150):
    """Exact points over an area four times as wide as the map, seen in every view with little noise."""
    rng = np.random.default_rng(4)
    span = np.ptp(scene.landmarks.position[:, :2], axis=0).max()
    position = np.column_stack([rng.uniform(-2 * span, 2 * span, (count, 2)), 60.0 * rng.normal(size=count)])
    views = len(scene.views)
    keypoint = np.stack([scene.views.project(k, position) for k in range(views)], 1).reshape(-1, 2)
    tracks = Tracks(
        start=np.arange(0, count * views + 1, views),
        view=np.tile(np.arange(views, dtype=np.int32), count),
        keypoint=keypoint + 0.1 * rng.normal(size=keypoint.shape),
        keypoint_sigma=np.full(count * views, 0.1),
        brightness=np.zeros(count * views),
        lit=np.zeros(count * views, bool),
    )
    return TiePoints(position=position, tracks=tracks)
