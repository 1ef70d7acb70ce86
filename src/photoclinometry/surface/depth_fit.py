"""A smooth depth at every pixel of the reference view, fitted to sparse points or to dense landmarks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.region import Region
from photoclinometry.model.robust import REWEIGHTINGS, robust_sigma
from photoclinometry.model.sampling import sample
from photoclinometry.model.sparse import SparseModel

MIN_POINTS = 12
"""Fewer points near the region do not determine a surface: a plane and a curvature take six numbers."""

SPARSE_SPACING_PX = 8
"""Nodes of the surface through sparse points: these are tens of pixels apart."""

CAUCHY_LIMIT = 2.4
"""Residual, in standard deviations, at which Cauchy's weight is a half: the estimate is then 95 % as efficient as least
squares for normal errors."""


@dataclass(frozen=True)
class SurfaceModel:
    """Scatter of samples about the surface, and roughness of the surface. Their ratio sets the smoothness."""

    noise_gsd: float
    """Standard deviation of a sample's depth [ground sample distances]."""
    curvature_per_px: float = 0.01
    """Standard deviation of the change of slope from pixel to pixel: 0.01 is that of rough terrain."""


SPARSE_POINTS = SurfaceModel(noise_gsd=0.7)
"""Keypoints of the sparse stage have errors of 0.2 to 0.25 px (decision 0011): about 0.7 GSD of depth where rays are 20
degrees apart. Half and double of it make no difference to maps (decision 0054)."""

DENSE_LANDMARKS = SurfaceModel(noise_gsd=0.15)
"""Dense matches have errors of 0.06 px: about 0.15 GSD of depth at the same angle. With 0.15 instead of 0.7, errors of
matches of the second pass are 0.061 px instead of 0.063. Half and double of it make no difference to maps (decision
0054)."""


def sparse_depth(sparse: SparseModel, reference: int, region: Region, camera: Camera) -> np.ndarray:
    """Depth (region.height, region.width) in the reference camera, from its sparse points.

    region: usually padded. Points up to half a region outside are used too, so that its edges are not
    extrapolated. Raises ReconstructionError with fewer than MIN_POINTS points there.
    """
    index, xy = sparse.seen_by(reference)
    depth = sparse.body_from_cam[reference].inverse()(sparse.points[index])[:, 2]
    low = np.array([region.col - region.width / 2, region.row - region.height / 2])
    high = low + 2 * np.array([region.width, region.height])
    near = np.all((xy > low) & (xy < high), axis=-1) & (depth > 0)
    if near.sum() < MIN_POINTS:
        raise ReconstructionError(
            f"only {near.sum()} sparse points near the region (at least {MIN_POINTS} make a surface); choose a "
            "region with more texture, or raise the number of features"
        )
    return fit_depth(xy[near], depth[near], region, camera, SPARSE_SPACING_PX)


def landmark_depth(
    position: np.ndarray, pixel: np.ndarray, pose: Rigid, region: Region, camera: Camera, spacing: int = 4
) -> np.ndarray:
    """Depth (region.height, region.width) from dense landmarks (J, 3) with their reference pixels (J, 2).

    pose: body_from_cam of the reference. Holes are filled smoothly. Detail finer than `spacing` px is lost, which is
    intended: it is mostly noise of the matches.
    """
    depth = pose.inverse()(position)[:, 2]
    return fit_depth(pixel[:, ::-1] + 0.5, depth, region, camera, spacing, DENSE_LANDMARKS)


def fit_depth(
    xy: np.ndarray,
    depth: np.ndarray,
    region: Region,
    camera: Camera,
    spacing: int,
    model: SurfaceModel = SPARSE_POINTS,
) -> np.ndarray:
    """Robust smooth depth at every pixel of a region, from samples at scattered pixels.

    Minimises over the nodes z of a grid of `spacing` px that covers region and samples

        sum rho((bilinear(z, xy_i) - depth_i) / noise) + sum (second differences of z / (curvature spacing^2))^2

    with rho Cauchy's loss, by reweighting; noise and curvature are the model's, lengths in ground sample distances
    (depth / focal), so that a second difference is a change of slope.
    xy: (n, 2) [px]; depth: (n,) along the optical axis. Returns (region.height, region.width).
    """
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    gsd = np.median(depth) / np.mean(camera.focal_px)
    offset = np.median(depth)
    value = (depth - offset) / (model.noise_gsd * gsd)
    origin, shape = _grid(xy, region, spacing)
    at_points = _bilinear_matrix((xy - origin) / spacing, shape)
    bend = _second_differences(shape) * (model.noise_gsd / (model.curvature_per_px * spacing**2))
    smooth = (bend.T @ bend).tocsc()
    weight = np.ones(len(value))
    nodes = np.zeros(shape[0] * shape[1])
    for _ in range(REWEIGHTINGS):
        normal = (at_points.T @ diags(weight) @ at_points + smooth).tocsc()
        nodes = splu(normal, permc_spec="MMD_AT_PLUS_A").solve(at_points.T @ (weight * value))
        residual = at_points @ nodes - value
        scale = max(1.0, robust_sigma(residual))
        weight = 1.0 / (1.0 + (residual / (CAUCHY_LIMIT * scale)) ** 2)
    grid = nodes.reshape(shape)
    fine = sample(grid, (region.pixel_centers() - origin) / spacing + 0.5)
    return offset + fine * model.noise_gsd * gsd


def _grid(xy: np.ndarray, region: Region, spacing: int) -> tuple[np.ndarray, tuple[int, int]]:
    """Pixel position (2,) of the first node, and (rows, cols) of a grid that covers region and samples."""
    corner = np.array([region.col, region.row], float)
    low = np.minimum(xy.min(0), corner) - spacing
    high = np.maximum(xy.max(0), corner + (region.width, region.height)) + spacing
    cols, rows = np.ceil((high - low) / spacing).astype(int) + 1
    return low, (int(rows), int(cols))


def _bilinear_matrix(uv: np.ndarray, shape: tuple[int, int]) -> Any:
    """(n, rows * cols) sparse matrix that interpolates a grid at columns uv[:, 0] and rows uv[:, 1]."""
    from scipy.sparse import csr_matrix

    col, row = np.clip(np.floor(uv).astype(int), 0, np.array(shape[::-1]) - 2).T
    u, v = uv[:, 0] - col, uv[:, 1] - row
    weights = [(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v]
    nodes = [(row + dr) * shape[1] + col + dc for dr in (0, 1) for dc in (0, 1)]
    index = np.tile(np.arange(len(uv)), 4)
    size = (len(uv), shape[0] * shape[1])
    return csr_matrix((np.concatenate(weights), (index, np.concatenate(nodes))), shape=size)


def _second_differences(shape: tuple[int, int]) -> Any:
    """Sparse operator: second differences along rows, columns, and mixed ones, which count twice in the square."""
    from scipy.sparse import eye, identity, kron, vstack

    def first(n: int) -> Any:
        return eye(n - 1, n, k=1) - eye(n - 1, n)

    def second(n: int) -> Any:
        return first(n - 1) @ first(n)

    rows, cols = shape
    along = kron(second(rows), identity(cols))
    across = kron(identity(rows), second(cols))
    mixed = np.sqrt(2.0) * kron(first(rows), first(cols))
    return vstack([along, across, mixed]).tocsr()
