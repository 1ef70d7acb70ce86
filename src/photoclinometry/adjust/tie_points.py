"""Landmarks of an estimate that are not in the map: their keypoints hold the poses.

Sparse tie points are those of structure from motion, all over the images. Pose-only tie points exist where brightness
determines the map (`ImageGradients`). The matches there were found with the map, so that they must not determine it,
too. They determine the poses better than brightness does, whose errors are correlated over many pixels where the ground
differs from the model. Every few landmarks, therefore, one appears twice: in the map, without its matches, and as a
pose-only tie point, which has the matches and a position of its own. Ground control points are places of known
position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust.graph.observations import ImageGradients
from photoclinometry.model.scene import Landmarks, Scene, Tracks

POSE_ONLY_STEP = 4
"""Spacing of the direct landmarks that have a pose-only tie point, in rows and columns of the map's grid. The errors of
matches are correlated over 12 px and more, so that nothing is lost, and the estimate grows by a sixteenth."""


@dataclass(frozen=True, kw_only=True)
class TiePoints:
    """Sparse landmarks all over the images: only their keypoints count, and hold the poses that the map's own region,
    a small part of the field of view, determines poorly."""

    position: np.ndarray
    """(P, 3) in B."""
    tracks: Tracks
    """Of the P landmarks; brightness is not used."""


@dataclass(frozen=True, kw_only=True)
class GroundControl:
    """P places of known position that were measured in images."""

    name: tuple[str, ...]
    """(P,)."""
    position: np.ndarray
    """(P, 3) known, in B."""
    sigma: np.ndarray
    """(P, 3) standard deviations along the axes of B."""
    tracks: Tracks
    """Their keypoints with standard deviations; brightness is not used."""


@dataclass(frozen=True, kw_only=True)
class Members:
    """The roles of the J landmarks of an estimate; the map's come first."""

    of_map: np.ndarray
    """(J,) bool."""
    direct: np.ndarray
    """(J,) bool: those of the map whose brightness follows them."""
    pose_only: np.ndarray
    """(J,) bool: pose-only tie points."""
    sparse: np.ndarray
    """(J,) bool: sparse tie points."""
    control: np.ndarray
    """(J,) bool: ground control points."""

    @property
    def count(self) -> int:
        """Landmarks of the map."""
        return int(np.count_nonzero(self.of_map))


def with_tie_points(
    scene: Scene,
    gradients: ImageGradients | None,
    sparse: TiePoints | None = None,
    control: GroundControl | None = None,
) -> tuple[Scene, ImageGradients | None, Members]:
    """The scene with all tie points after its own landmarks, gradients of all its observations, and the landmarks'
    roles."""
    own, observed = len(scene.landmarks), len(scene.tracks)
    direct = np.zeros(own, bool) if gradients is None else gradients.of_landmarks(scene.tracks)
    row, col = scene.cells
    copied = np.flatnonzero(direct & (row % POSE_ONLY_STEP == 0) & (col % POSE_ONLY_STEP == 0))
    nowhere = np.zeros((0, 2), np.int32)
    parts: list[tuple[np.ndarray, Tracks | None, np.ndarray]] = [
        (scene.landmarks.position[copied], scene.tracks.of_landmarks(copied)[0], scene.landmarks.pixel[copied]),
        (np.zeros((0, 3)), None, nowhere) if sparse is None else _off_the_map(sparse),
        (np.zeros((0, 3)), None, nowhere) if control is None else _off_the_map(control),
    ]
    scene = _joined(scene, [(position, tracks, pixel) for position, tracks, pixel in parts if tracks and len(position)])
    if gradients is not None:
        gradients = gradients.padded(len(scene.tracks) - observed)
    kind = np.repeat(np.arange(4), [own, *(len(position) for position, *_ in parts)])
    return (
        scene,
        gradients,
        Members(
            of_map=kind == 0,
            direct=np.pad(direct, (0, len(kind) - own)),
            pose_only=kind == 1,
            sparse=kind == 2,
            control=kind == 3,
        ),
    )


def _off_the_map(points: TiePoints | GroundControl) -> tuple[np.ndarray, Tracks, np.ndarray]:
    return points.position, points.tracks, np.zeros((len(points.position), 2), np.int32)


def _joined(scene: Scene, others: Sequence[tuple[np.ndarray, Tracks, np.ndarray]]) -> Scene:
    """The scene with other landmarks after its own, never lit, their normals and albedos without meaning."""
    if not others:
        return scene
    own, landmarks = scene.tracks, scene.landmarks
    up = landmarks.normal.mean(0)
    count = sum(len(position) for position, *_ in others)
    observed = sum(len(tracks) for _, tracks, _ in others)
    starts = [own.start]
    for _, tracks, _ in others:
        starts.append(starts[-1][-1] + tracks.start[1:])
    of_others = [tracks for _, tracks, _ in others]
    return replace(
        scene,
        landmarks=Landmarks(
            position=np.concatenate([landmarks.position, *(position for position, *_ in others)]),
            normal=np.concatenate([landmarks.normal, np.tile(up / np.linalg.norm(up), (count, 1))]),
            albedo=np.concatenate([landmarks.albedo, np.ones(count)]),
            pixel=np.concatenate([landmarks.pixel, *(pixel for *_, pixel in others)]),
        ),
        tracks=Tracks(
            start=np.concatenate(starts),
            view=np.concatenate([own.view, *(tracks.view for tracks in of_others)]),
            keypoint=np.concatenate([own.keypoint, *(tracks.keypoint for tracks in of_others)]),
            keypoint_sigma=np.concatenate([own.keypoint_sigma, *(tracks.keypoint_sigma for tracks in of_others)]),
            brightness=np.concatenate([own.brightness, np.zeros(observed)]),
            lit=np.concatenate([own.lit, np.zeros(observed, bool)]),
        ),
    )
