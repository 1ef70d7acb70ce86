"""Landmarks that go along in an estimate and are in no map: their keypoints hold the poses.

Anchors are of structure from motion, all over the images. Copies are there where brightness says where landmarks lie
(`ImageSlopes`): their matches, found with the map, must not say it too, but of where views stand they know more than
brightness does, which errs alike over many pixels where the ground is not quite the model's. So every few landmarks,
one is there twice: in the map, without its matches, and as a copy with a position of its own, which has nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from photoclinometry.adjust.layout import ImageSlopes
from photoclinometry.model.scene import Landmarks, Scene, Tracks

COPY_STEP = 4
"""Every so many rows and columns of the map's grid a landmark has a copy, which stands for all in between: matches
that err alike over 12 px and more lose nothing, and the estimate grows by a sixteenth."""


@dataclass(frozen=True, kw_only=True)
class Anchors:
    """Sparse landmarks all over the images: only their keypoints count, and hold the poses that the map's own region,
    a small part of the field of view, determines poorly."""

    position: np.ndarray
    """(P, 3) in B."""
    tracks: Tracks
    """Of the P landmarks; brightness is not used."""


class Roles(NamedTuple):
    """What the landmarks of an estimate are in it."""

    mapped: np.ndarray
    """(J,) bool: the map's own, which come first."""
    direct: np.ndarray
    """(J,) bool: those of them whose brightness follows them."""
    copy: np.ndarray
    """(J,) bool; neither mapped nor copies are the anchors."""

    @property
    def anchor(self) -> np.ndarray:
        """(J,) bool."""
        return ~self.mapped & ~self.copy


def with_companions(
    scene: Scene, anchors: Anchors | None, slopes: ImageSlopes | None
) -> tuple[Scene, ImageSlopes | None, Roles]:
    """The scene with its anchors and copies after its own landmarks, slopes of all its observations, and who is who."""
    own = len(scene.landmarks)
    direct = np.zeros(own, bool) if slopes is None else slopes.of_landmarks(scene.tracks)
    row, col = scene.cells
    copied = np.flatnonzero(direct & (row % COPY_STEP == 0) & (col % COPY_STEP == 0))
    observed, pixel = len(scene.tracks), scene.landmarks.pixel[copied]
    if len(copied):
        tracks, _ = scene.tracks.of_landmarks(copied)
        scene = _joined(scene, scene.landmarks.position[copied], tracks, pixel)
    if anchors is not None:
        scene = _joined(scene, anchors.position, anchors.tracks, np.zeros((len(anchors.position), 2), np.int32))
    if slopes is not None:
        beyond = ((0, len(scene.tracks) - observed), (0, 0))
        slopes = ImageSlopes(np.pad(slopes.at, beyond), np.pad(slopes.slope, beyond))
    index = np.arange(len(scene.landmarks))
    roles = Roles(
        mapped=index < own,
        direct=np.pad(direct, (0, len(index) - own)),
        copy=(index >= own) & (index < own + len(copied)),
    )
    return scene, slopes, roles


def _joined(scene: Scene, position: np.ndarray, tracks: Tracks, pixel: np.ndarray) -> Scene:
    """The scene with other landmarks after its own, never lit, their normals and albedos without meaning."""
    own, landmarks, count = scene.tracks, scene.landmarks, len(position)
    up = landmarks.normal.mean(0)
    return replace(
        scene,
        landmarks=Landmarks(
            position=np.concatenate([landmarks.position, position]),
            normal=np.concatenate([landmarks.normal, np.tile(up / np.linalg.norm(up), (count, 1))]),
            albedo=np.concatenate([landmarks.albedo, np.ones(count)]),
            pixel=np.concatenate([landmarks.pixel, pixel]),
        ),
        tracks=Tracks(
            start=np.concatenate([own.start, own.start[-1] + tracks.start[1:]]),
            view=np.concatenate([own.view, tracks.view]),
            keypoint=np.concatenate([own.keypoint, tracks.keypoint]),
            keypoint_sigma=np.concatenate([own.keypoint_sigma, tracks.keypoint_sigma]),
            brightness=np.concatenate([own.brightness, np.zeros(len(tracks))]),
            lit=np.concatenate([own.lit, np.zeros(len(tracks), bool)]),
        ),
    )
