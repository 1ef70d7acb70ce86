"""The truth of a simulated site, at points and averaged to the resolution of the images."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numba import njit

from photoclinometry.model.errors import InputError
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Views
from photoclinometry.simulate.camera_model import PSF_REACH, pixel_average
from photoclinometry.simulate.observe import cast, sample_points
from photoclinometry.simulate.photometry import Photometry
from photoclinometry.simulate.raycast import Raycaster
from photoclinometry.simulate.surface import Surface, height_and_slopes

_SUPERSAMPLING = 4
"""Rays per pixel, along each side, that averages are taken over."""
_ON_SURFACE = 0.1
"""Distance from the surface along the line of sight at which points count as on it [samples of the surface]."""
_FARTHEST = 12
"""Farthest samples around a point's vertical foot among which the nearest is sought [samples]."""
_MAX_STEPS, _MAX_HALVINGS = 40, 12
"""Bounds on the Gauss-Newton steps to the nearest point, and on the halvings of a step; few are needed."""
_STILL = 1e-9
"""Last step to the nearest point [samples]."""
_WHOLE = 1.0 - 1e-9
"""Mean of a mask that is True everywhere, up to rounding."""

BLOCK = 2**16
"""Pixels that are processed at a time, in whole rows of a region: 300 MB."""


@dataclass(frozen=True, kw_only=True)
class SiteFacts:
    """A simulated site without its noise and its surface."""

    name: str
    body: str
    views: Views
    """True poses and Suns; `scale` and `bias` turn I/F into the images' brightness."""
    psf_sigma_px: float
    brightness: str
    """"iof" or "dn"."""
    photometry: Photometry
    """Reflectance model of the ground: a `Reflectance`, or `Hapke`."""

    def view_index(self, name: str) -> int:
        """Index of the view of that name. Raises InputError if there is none."""
        if name not in self.views.name:
            known = f"{self.views.name[0]} ... {self.views.name[-1]}"
            raise InputError(f"the truth of site {self.name!r} has no view {name!r} (it has {known})")
        return self.views.name.index(name)


@dataclass(frozen=True, kw_only=True)
class Truth(SiteFacts):
    """A simulated place without its noise. B is the surface's tangent frame [m]."""

    surface: Surface


@dataclass(frozen=True)
class TruthMaps:
    """Truth behind the pixels of a region's map grid (h, w) in one view; defined where `hit`."""

    position: np.ndarray
    """(h, w, 3) where the ray through the pixel's centre meets the surface, in B [m]."""
    normal: np.ndarray
    """(h, w, 3) at that point."""
    albedo: np.ndarray
    """(h, w) normal albedo at that point."""
    normal_mean: np.ndarray
    """(h, w, 3) unit vectors: normals averaged over point-spread function and pixel."""
    albedo_mean: np.ndarray
    """(h, w) likewise."""
    shadow: np.ndarray
    """(h, w) share of the pixel, 0 to 1, that the Sun of this view does not light; averaged likewise."""
    hit: np.ndarray
    """(h, w) bool: all rays that this pixel averages meet the surface."""


def truth_maps(truth: Truth, view: str, region: Region, raycaster: Raycaster | None = None) -> TruthMaps:
    """Maps over the map grid of a region of a view, named as in the site; the region may reach beyond the image.

    raycaster: that of `truth.surface`, if it was made already (0.1 us per sample of the surface).
    Raises InputError for an unknown view.
    """
    raycaster = raycaster or Raycaster(truth.surface)
    parts = region.row_blocks(max(1, BLOCK // (region.stride * region.width)))
    blocks = [_true_rows(truth, view, part, raycaster) for part in parts]
    names = [f.name for f in fields(TruthMaps)]
    return TruthMaps(**{name: np.concatenate([getattr(block, name) for block in blocks]) for name in names})


def _true_rows(truth: Truth, view: str, region: Region, raycaster: Raycaster) -> TruthMaps:
    """`truth_maps` of a region of few rows, to limit memory: there are many rays per pixel."""
    k = truth.view_index(view)
    camera, pose, sun = truth.views.cameras[k], truth.views.body_from_cam[k], truth.views.sun[k]
    center = cast(raycaster, camera, pose, sun, region.pixel_centers()[region.grid_slices])

    s, margin = _SUPERSAMPLING, math.ceil(PSF_REACH * truth.psf_sigma_px)
    fine = cast(raycaster, camera, pose, sun, sample_points(region, s, margin))

    def mean(values: np.ndarray) -> np.ndarray:
        return pixel_average(values.astype(float), s, margin, truth.psf_sigma_px)[region.grid_slices]

    normal = mean(fine.normal)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return TruthMaps(
        position=center.position,
        normal=center.normal,
        albedo=center.albedo,
        normal_mean=np.divide(normal, length, out=np.zeros_like(normal), where=length > 0),
        albedo_mean=mean(fine.albedo),
        shadow=np.clip(mean(fine.hit & ~fine.lit), 0.0, 1.0),  # averages go beyond by rounding
        hit=center.hit & (mean(fine.hit) > _WHOLE),
    )


def visibility(
    truth: Truth, view: str, points: np.ndarray, raycaster: Raycaster | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) bool: points (n, 3) of B on the surface that a view sees; and (n,) bool: those of them that the Sun lights.

    A point is seen if it lies within the frame and nothing hides it. raycaster: as for `truth_maps`. Raises InputError
    for an unknown view.
    """
    k = truth.view_index(view)
    raycaster = raycaster or Raycaster(truth.surface)
    camera, center = truth.views.cameras[k], truth.views.body_from_cam.translation[k]
    rays = np.asarray(points, float) - center
    hits = raycaster.trace(center, rays, truth.views.sun[k])
    pixel = truth.views.project(k, points)
    inside = (pixel >= 0).all(-1) & (pixel <= (camera.width, camera.height)).all(-1)
    before = (1.0 - np.where(hits.hit, hits.distance, 0.0)) * np.linalg.norm(rays, axis=-1)
    seen = hits.hit & inside & (np.abs(before) < _ON_SURFACE * truth.surface.spacing)
    return seen, seen & hits.lit


def nearest_surface(surface: Surface, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance (n,) [m] from points (n, 3) to the surface, above positive, and the foot (n, 3).

    The nearest sample around each point's vertical foot is refined by Gauss-Newton steps on the bicubic
    surface; for points within about ten samples of it. The foot of a point beside the grid is on its edge.
    """
    points = np.ascontiguousarray(points, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points must have shape (n, 3), got {points.shape}")
    distance, foot = np.empty(len(points)), np.empty_like(points)
    frame = np.array([*surface.origin, surface.spacing], float)
    _nearest(surface.height, frame, points, distance, foot)
    return distance, foot


@njit(cache=True, nogil=True)
def _distance2(height, spacing, u, v, pu, pv, pz):
    z, _, _ = height_and_slopes(height, u, v)
    return ((u - pu) ** 2 + (v - pv) ** 2) * spacing * spacing + (z - pz) ** 2


@njit(cache=True, nogil=True)
def _nearest(height, frame, points, distance, foot):
    """`nearest_surface` into distance (n,) and foot (n, 3). height: (rows, cols) [m]; frame: x and y of the first
    sample, and the spacing; points: (n, 3).
    """
    rows, cols = height.shape
    spacing = frame[2]
    for n in range(len(points)):
        pu, pv, pz = (points[n, 0] - frame[0]) / spacing, (points[n, 1] - frame[1]) / spacing, points[n, 2]
        u, v = min(max(pu, 0.0), cols - 1.0), min(max(pv, 0.0), rows - 1.0)
        best = _distance2(height, spacing, u, v, pu, pv, pz)
        reach = min(int(math.sqrt(best) / spacing) + 1, _FARTHEST)
        ju, iv = int(u + 0.5), int(v + 0.5)
        for i in range(max(iv - reach, 0), min(iv + reach + 1, rows)):
            for j in range(max(ju - reach, 0), min(ju + reach + 1, cols)):
                d = ((j - pu) ** 2 + (i - pv) ** 2) * spacing * spacing + (height[i, j] - pz) ** 2
                if d < best:
                    best, u, v = d, float(j), float(i)
        for _ in range(_MAX_STEPS):
            z, z_u, z_v = height_and_slopes(height, u, v)
            z_u, z_v = z_u / spacing, z_v / spacing
            x, y, dz = (pu - u) * spacing, (pv - v) * spacing, pz - z
            right_u, right_v = x + z_u * dz, y + z_v * dz
            a, b, c = 1.0 + z_u * z_u, z_u * z_v, 1.0 + z_v * z_v
            det = a * c - b * b
            step_u = (c * right_u - b * right_v) / (det * spacing)
            step_v = (a * right_v - b * right_u) / (det * spacing)
            scale, moved = 1.0, False
            for _ in range(_MAX_HALVINGS):
                u1 = min(max(u + scale * step_u, 0.0), cols - 1.0)
                v1 = min(max(v + scale * step_v, 0.0), rows - 1.0)
                d = _distance2(height, spacing, u1, v1, pu, pv, pz)
                if d < best:
                    moved = abs(u1 - u) + abs(v1 - v) > _STILL
                    best, u, v = d, u1, v1
                    break
                scale *= 0.5
            if not moved:
                break
        below, _, _ = height_and_slopes(height, pu, pv)
        distance[n] = math.copysign(math.sqrt(best), pz - below)
        z, _, _ = height_and_slopes(height, u, v)
        foot[n, 0], foot[n, 1], foot[n, 2] = frame[0] + u * spacing, frame[1] + v * spacing, z
