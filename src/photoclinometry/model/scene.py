"""The one data model: views, landmarks, tracks, and the scene that holds them.

Frames: B body-fixed (right-handed; any origin, orientation and scale until georeferenced), C camera
(x right, y down, z forward). Lengths are in the unit of B. Pixels follow COLMAP: (0.5, 0.5) is the
centre of the top-left pixel, so array index [row, col] is (col + 0.5, row + 0.5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace

import numpy as np

from photoclinometry.model import display
from photoclinometry.model.camera import Camera
from photoclinometry.model.compressed_rows import row_of_entry, row_starts
from photoclinometry.model.error_correlation import ErrorCorrelation, variance_of
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.region import Region

OWN, BODY_FIXED, SHARED = "own", "body-fixed", "shared"
"""Kinds of a scene's frame B."""

VIEW_ARRAYS = ("sun", "scale", "bias", "dark_level", "sun_measured", "sun_sigma", "sun_common_sigma", "arc")
"""Fields of `Views` with one row for each view, beside its name, camera and pose."""


@dataclass(frozen=True, kw_only=True)
class Views:
    """K exposures: the estimated quantities of each, and the measured Sun directions."""

    name: tuple[str, ...]
    """Image paths of `site.toml`."""
    cameras: tuple[Camera, ...]
    """The intrinsics of each view; views of one instrument share the object's value."""
    body_from_cam: Rigid
    """(K,) poses; `body_from_cam.translation` are the camera centres in B."""
    sun: np.ndarray
    """(K, 3) unit vectors from the body towards the Sun, in B."""
    scale: np.ndarray
    """(K,) lambda of Eq. 21: measured = scale * model + bias."""
    bias: np.ndarray
    """(K,) xi of Eq. 21, in the images' brightness."""
    dark_level: np.ndarray
    """(K,) dark level that was subtracted from uncalibrated images before (`Image.dark_level`)."""
    sun_measured: np.ndarray
    """(K, 3) unit vectors towards the Sun as measured, in C."""
    sun_sigma: np.ndarray
    """(K,) standard deviation of each view's own error of `sun_measured`, about each tangent axis [rad]."""
    sun_common_sigma: np.ndarray
    """(K,) standard deviation of the error that all views of an arc have in common, such as an error of the cameras'
    alignment: one small rotation of all their `sun_measured` in C, about each axis [rad]."""
    arc: np.ndarray
    """(K,) int: number of the arc of attitude and orbit from which each view's Sun and pose prior come. Arcs have
    errors of their own; zeros where all views belong to one."""

    def __len__(self) -> int:
        return len(self.name)

    def __repr__(self) -> str:
        return f"<Views: {len(self)}, {', '.join(self.name[:3])}{', ...' if len(self) > 3 else ''}>"

    @property
    def intrinsics(self) -> np.ndarray:
        """(K, 4) fx, fy, cx, cy [px]."""
        return np.array([c.intrinsics for c in self.cameras], float)

    @property
    def offset(self) -> np.ndarray:
        """(K,) brightness of the image files where the model predicts zero: dark level and bias."""
        return self.dark_level + self.bias

    def project(self, view: int, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of body-fixed points (..., 3) in one view."""
        return self.cameras[view].pixel_from_cam(self.body_from_cam[view].inverse()(points))

    def gsd(self, view: int, points: np.ndarray) -> float:
        """Length in B of one pixel of a view across the line of sight, at the median depth of points (J, 3)."""
        return float(np.median(self.depth(view, points)) / np.mean(self.cameras[view].focal_px))

    def depth(self, view: int, points: np.ndarray) -> np.ndarray:
        """(...,) of points (..., 3) of B along the optical axis of one view, in units of B."""
        pose = self.body_from_cam[view]
        return (points - pose.translation) @ pose.rotation[:, 2]

    def at_poses(self, body_from_cam: Rigid) -> Views:
        """The views at other poses (K,), under their measured Suns."""
        sun = np.einsum("kij,kj->ki", body_from_cam.rotation, self.sun_measured)
        return replace(self, body_from_cam=body_from_cam, sun=sun)

    def __getitem__(self, index: np.ndarray | list[int] | slice) -> Views:
        """The views at `index`, in that order."""
        chosen = np.arange(len(self))[index]
        return Views(
            name=tuple(self.name[k] for k in chosen),
            cameras=tuple(self.cameras[k] for k in chosen),
            body_from_cam=self.body_from_cam[chosen],
            **{key: getattr(self, key)[chosen] for key in VIEW_ARRAYS},
        )


def join_views(first: Views, second: Views) -> Views:
    """All views of `first`, then all of `second`."""
    a, b = first.body_from_cam, second.body_from_cam
    return Views(
        name=first.name + second.name,
        cameras=first.cameras + second.cameras,
        body_from_cam=Rigid(np.concatenate([a.rotation, b.rotation]), np.concatenate([a.translation, b.translation])),
        **{key: np.concatenate([getattr(first, key), getattr(second, key)]) for key in VIEW_ARRAYS},
    )


@dataclass(frozen=True, kw_only=True)
class Landmarks:
    """J surface points; each was made from one pixel of the reference view."""

    position: np.ndarray
    """(J, 3) in B."""
    normal: np.ndarray
    """(J, 3) outward unit vectors in B."""
    albedo: np.ndarray
    """(J,) normal albedo (I/F), or relative albedo (DN)."""
    pixel: np.ndarray
    """(J, 2) int32: (row, col) of the reference image."""

    def __len__(self) -> int:
        return len(self.albedo)

    def __repr__(self) -> str:
        return f"<Landmarks: {len(self)}>"

    def __getitem__(self, index: np.ndarray | slice) -> Landmarks:
        """The landmarks at `index`, in that order, or where a mask (J,) is true."""
        return Landmarks(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """N observations of J landmarks in K views, landmark by landmark (compressed rows)."""

    start: np.ndarray
    """(J + 1,) int64: observations of landmark j are start[j]:start[j + 1]."""
    view: np.ndarray
    """(N,) int32 index into the views."""
    keypoint: np.ndarray
    """(N, 2) float64 [px]."""
    keypoint_sigma: np.ndarray
    """(N,) float64 [px]."""
    brightness: np.ndarray
    """(N,) float64, interpolated at the keypoint. Defined only where `lit`."""
    lit: np.ndarray
    """(N,) bool: the brightness is a measurement (valid pixels, not in shadow)."""

    def __len__(self) -> int:
        return len(self.view)

    @classmethod
    def of_keypoints(
        cls, start: np.ndarray, view: np.ndarray, keypoint: np.ndarray, sigma_px: np.ndarray | float
    ) -> Tracks:
        """Keypoints alone, without brightness. sigma_px: (N,), or one for all."""
        count = len(view)
        return cls(
            start=start,
            view=view,
            keypoint=keypoint,
            keypoint_sigma=np.full(count, sigma_px),
            brightness=np.zeros(count),
            lit=np.zeros(count, bool),
        )

    def __repr__(self) -> str:
        return f"<Tracks: {len(self)} observations of {len(self.start) - 1} landmarks>"

    @property
    def landmark(self) -> np.ndarray:
        """(N,) int64 landmark index of each observation."""
        return row_of_entry(self.start)

    def of_landmarks(self, chosen: np.ndarray) -> tuple[Tracks, np.ndarray]:
        """The tracks of landmarks at indices (j,), in that order, and where in these (N,) each observation was."""
        count = np.diff(self.start)[chosen]
        start = row_starts(count)
        picked = np.arange(start[-1]) + np.repeat(self.start[:-1][chosen] - start[:-1], count)
        names = ("view", "keypoint", "keypoint_sigma", "brightness", "lit")
        return Tracks(start=start, **{name: getattr(self, name)[picked] for name in names}), picked

    def of_views(self, chosen: np.ndarray) -> Tracks:
        """The tracks in views at indices (k,), in that order, of the same landmarks. `view` counts among these."""
        number = np.full(max(self.view.max(initial=-1), chosen.max(initial=-1)) + 1, -1, np.int32)
        number[chosen] = np.arange(len(chosen))
        kept = number[self.view] >= 0
        count = np.bincount(self.landmark[kept], minlength=len(self.start) - 1)
        names = ("keypoint", "keypoint_sigma", "brightness", "lit")
        return Tracks(
            start=row_starts(count), view=number[self.view[kept]], **{name: getattr(self, name)[kept] for name in names}
        )


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """The ground around a map as the reference view sees it, roughly: it casts shadows, but is no part of the map. It
    is known from sparse points, and from the shadows in the images."""

    depth: np.ndarray
    """(rows, cols) along the reference camera's optical axis, in units of B, at every `stride`-th pixel of its image
    from the first on; NaN where nothing is known."""
    stride: int
    """[px]."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Everything that is known about a site: the result of a run."""

    name: str
    """The site's."""
    body: str | None
    """Name of the body, in lower case; None where it is not known."""
    brightness: str
    """"iof": radiance factor I/F; "dn": linear uncalibrated numbers."""
    reflectance: Reflectance | None
    """The reflectance model of the brightness; None for geometry alone."""
    views: Views
    """K registered views: poses, Suns, exposures."""
    landmarks: Landmarks
    """J points of the map: positions, normals, albedos."""
    tracks: Tracks
    """N observations of landmarks in views: keypoints and brightness."""
    reference: int
    """Index of the reference view."""
    region: Region
    """Pixels of the reference image, on whose grid the landmarks lie."""
    uncertainty: dict[str, np.ndarray] = field(default_factory=dict)
    """Standard deviations or covariances by name, first axis J or K; empty until computed.
    `evaluate/sigma_calibration.py` lists names and axes, `adjust/covariance/uncertainty.py` the frame."""
    error_correlation: ErrorCorrelation | None = None
    """Of the errors of positions; None where it was not found."""
    surroundings: Surroundings | None = None
    """Where they are known."""
    frame: str = OWN
    """OWN: origin, axes and unit of length are determined from images alone, or not stated. BODY_FIXED: those of pose
    priors, origin in the body's centre, z to the north pole, x to longitude 0, in metres. SHARED: those of a larger
    model made from images alone, of which the scene is a part."""

    @property
    def unit(self) -> str | None:
        """The unit of length, where it is known."""
        return "m" if self.frame == BODY_FIXED else None

    @property
    def gsd(self) -> float:
        """Ground sample distance: length in B of one reference pixel across the line of sight."""
        return self.views.gsd(self.reference, self.landmarks.position)

    @property
    def spacing(self) -> float:
        """Length in B between neighbouring landmarks, across the line of sight."""
        return self.region.stride * self.gsd

    @property
    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Row and column (J,) of the landmarks in the map's grid."""
        return self.region.cells(self.landmarks.pixel)

    def grid(self, values: np.ndarray, fill: float = np.nan) -> np.ndarray:
        """Per-landmark values (J, ...) as an image (rows, cols, ...) of the map's grid, `fill` where none."""
        out = np.full((*self.region.grid_shape, *np.shape(values)[1:]), fill, float)
        out[self.cells] = values
        return out

    def grid_of_observations(self, values: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """Per-observation values (N, ...) as `grid`: those of the observations at indices `chosen`, all of one view."""
        of_landmarks = np.full((len(self.landmarks), *np.shape(values)[1:]), np.nan)
        of_landmarks[self.tracks.landmark[chosen]] = values[chosen]
        return self.grid(of_landmarks)

    def __repr__(self) -> str:
        return display.scene_line(self)

    def _repr_html_(self) -> str:
        return display.scene_card(self)

    def of_views(self, used: np.ndarray) -> Scene:
        """The scene with views `used` (k,) alone, in that order, without uncertainties.

        All landmarks stay. The first of the views is the reference where the scene's own is not among them.
        """
        return replace(
            self,
            views=self.views[used],
            tracks=self.tracks.of_views(used),
            reference=int(np.argmax(used == self.reference)),
            uncertainty={},
        )

    def of_every(self, step: int) -> Scene:
        """The scene with the landmarks of every `step`-th row and column of its grid alone, without uncertainties."""
        row, col = self.cells
        chosen = np.flatnonzero((row % step == 0) & (col % step == 0))
        return replace(
            self,
            region=replace(self.region, stride=step * self.region.stride),
            landmarks=self.landmarks[chosen],
            tracks=self.tracks.of_landmarks(chosen)[0],
            uncertainty={},
        )

    def without_observations(self) -> Scene:
        """The scene as if no view had seen its landmarks."""
        return replace(self, tracks=self.tracks.of_views(np.zeros(0, int)))

    def sigma_of(self, landmarks: np.ndarray, gradient: np.ndarray) -> float:
        """Standard deviation of a quantity of the positions of landmarks, to first order.

        landmarks: (n,) indices; gradient: (n, 3) the quantity's derivatives by their positions in B. The unit is the
        quantity's. It includes the correlation of neighbours' errors (`model.error_correlation`). `surface.measure` has
        lengths, height differences, slopes and volumes. Infinite where one of the positions is not known. Raises
        InputError where the scene states no uncertainties of positions, or no correlation of their errors.
        """
        if "position" not in self.uncertainty or self.error_correlation is None:
            raise InputError(
                f"scene {self.name!r} does not state how errors of its positions go together; run the site again "
                "(with --adjust.uncertainty)"
            )
        landmarks, gradient = np.atleast_1d(landmarks), np.atleast_2d(np.asarray(gradient, float))
        covariance = self.uncertainty["position"][landmarks]
        if not np.isfinite(covariance).all():
            return math.inf
        cell = np.stack(self.region.cells(self.landmarks.pixel[landmarks]), -1)
        position, spacing = self.landmarks.position[landmarks], float(self.region.stride)
        return math.sqrt(variance_of(self.error_correlation, covariance, position, cell, gradient, spacing))

    def with_estimate(self, views: Views, landmarks: Landmarks) -> Scene:
        """The scene with other values of the same K views and J landmarks."""
        return replace(self, views=views, landmarks=landmarks)
