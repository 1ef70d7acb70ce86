"""Heights from slopes, the least-squares surface of given normals near control heights; and slopes from heights."""

from __future__ import annotations

import numpy as np

from photoclinometry.surface.depth_fit import CAUCHY_LIMIT

REWEIGHTINGS = 4
"""Iterations of reweighted least squares: single control heights may be wrong."""


def integrate_normals(
    ray: np.ndarray,
    normal: np.ndarray,
    spacing: float,
    normal_sigma: float,
    cell: np.ndarray,
    control: np.ndarray,
    control_sigma: float,
) -> np.ndarray:
    """Depths (h, w) along rays such that steps between neighbours are perpendicular to the normals.

    Minimises over the depths z

        sum over neighbours a, b (n . (z_b r_b - z_a r_a) / (spacing normal_sigma))^2
            + sum over controls rho((z_c - control_c) / control_sigma),     n = (n_a + n_b) / |n_a + n_b|

    with rho Cauchy's loss. It is the integration of slopes of Gaskell et al. (2008), solved at once instead of by
    relaxation, on rays instead of on a plane.

    ray: (h, w, 3) of the reference camera, z = 1 along its axis, in any frame; NaN in holes. normal: (h, w, 3) in that
    frame; spacing: length of a step; normal_sigma [rad]; cell: (n, 2) rows and columns of the controls; control: (n,)
    depths; control_sigma: in the unit of depths. NaN in holes, and in parts of the grid without a control.
    """
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import splu

    there = np.array(np.isfinite(ray).all(-1) & np.isfinite(normal).all(-1))
    index = np.cumsum(there.ravel()).reshape(there.shape) - 1
    first, second, value_first, value_second = [], [], [], []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        both = there[a] & there[b]
        mean = normal[a][both] + normal[b][both]
        mean /= np.linalg.norm(mean, axis=-1, keepdims=True) * spacing * normal_sigma
        first.append(index[a][both])
        second.append(index[b][both])
        value_first.append(-np.sum(mean * ray[a][both], -1))
        value_second.append(np.sum(mean * ray[b][both], -1))
    i, j = np.concatenate(first), np.concatenate(second)
    count, rows = int(there.sum()), np.arange(len(i))
    values = np.concatenate([*value_first, *value_second])
    slopes = coo_matrix((values, (np.r_[rows, rows], np.r_[i, j])), shape=(len(i), count)).tocsr()
    inside = there[cell[:, 0], cell[:, 1]]
    node, depth = index[cell[inside, 0], cell[inside, 1]], control[inside]
    label = connected_components(coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count)), directed=False)[1]
    tied = np.isin(label, label[node])
    known = coo_matrix((np.ones(len(node)), (np.arange(len(node)), node)), shape=(len(node), count)).tocsr()[:, tied]
    smooth, middle = slopes[:, tied].T @ slopes[:, tied], float(np.median(depth))
    offset = slopes[:, tied].T @ (slopes[:, tied] @ np.full(int(tied.sum()), middle))
    weight, solved = np.ones(len(node)), np.zeros(int(tied.sum()))
    for _ in range(REWEIGHTINGS):
        strength = weight / control_sigma**2
        system = (smooth + known.T @ diags(strength) @ known).tocsc()
        solved = splu(system, permc_spec="MMD_AT_PLUS_A").solve(known.T @ (strength * (depth - middle)) - offset)
        residual = (known @ solved - (depth - middle)) / control_sigma
        weight = 1.0 / (1.0 + (residual / CAUCHY_LIMIT) ** 2)
    found = np.full(count, np.nan)
    found[tied] = middle + solved
    heights = np.full(there.shape, np.nan)
    heights[there] = found
    return heights


def surface_normals(position: np.ndarray, center: np.ndarray) -> np.ndarray:
    """Unit normals (h, w, 3) of a grid of points (h, w, 3), towards a camera at `center`; NaN next to holes.

    From central differences, one-sided at the edges.
    """
    down, across = np.gradient(position, axis=(0, 1))
    normal = np.cross(across, down)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.where(np.sum(normal * (center - position), -1, keepdims=True) < 0, -normal, normal)
