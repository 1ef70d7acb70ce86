"""Closed triangle meshes: whether they are closed, their volume and normals, and refinement to short, even edges."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit

import photoclinometry.model.kernel_cache  # noqa: F401
from photoclinometry.model.geometry import unit

Place = Callable[[np.ndarray], np.ndarray]
"""Points (n, 3) near a surface -> points (n, 3) on it."""

LONGEST = 1.4
"""Longest edge of a refined mesh relative to the requested spacing: edges are 0.7 to 1.4 spacings long, 1 in the
mean."""
_RELAXATION = 0.5
"""Share of the way to the mean of its neighbours that a vertex moves in one pass."""
_PASSES = 3
"""Passes of `relax` after each halving; more change the edges by per cents only."""
_MAX_HALVINGS = 40
"""An edge is halved this often at most: 1e12 times longer edges are faults."""


def half_edges(faces: np.ndarray) -> np.ndarray:
    """(F, 3, 2) the edges a b, b c, c a of faces (F, 3)."""
    return faces[:, [[0, 1], [1, 2], [2, 0]]]


def unique_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (E, 2), each once with the smaller vertex first, and the edge (F, 3) of every half edge."""
    pairs = half_edges(faces).reshape(-1, 2).astype(np.int64)
    size = int(faces.max()) + 1
    key, index = np.unique(pairs.min(1) * size + pairs.max(1), return_inverse=True)
    return np.stack(np.divmod(key, size), -1), index.reshape(-1, 3)


def is_watertight(faces: np.ndarray) -> bool:
    """Whether every edge belongs to exactly two faces, which pass it in opposite directions."""
    pairs = half_edges(faces).reshape(-1, 2).astype(np.int64)
    size = int(faces.max()) + 1
    along = np.sort(pairs[:, 0] * size + pairs[:, 1])
    against = np.sort(pairs[:, 1] * size + pairs[:, 0])
    return bool((along == against).all() and (np.diff(along) > 0).all())


def parts_of(faces: np.ndarray, vertices: int) -> np.ndarray:
    """(F,) int: the connected part of each face (F, 3); faces with a common vertex are in one part. vertices: number of
    vertices."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges, _ = unique_edges(faces)
    joined = coo_matrix((np.ones(len(edges), bool), edges.T), shape=(vertices, vertices))
    return connected_components(joined, directed=False)[1][faces[:, 0]]


def largest_component(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices and faces of the connected part with the most faces."""
    part = parts_of(faces, len(vertices))
    kept = faces[part == np.bincount(part).argmax()]
    used, renumbered = np.unique(kept, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(faces.dtype)


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume inside a closed mesh; negative if its faces look inwards."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def centroid(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(3,) centre of mass of the inside of a closed mesh, at even density."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    weight = np.einsum("ij,ij->i", a, np.cross(b, c))
    return (weight[:, None] * (a + b + c)).sum(0) / (4.0 * weight.sum())


def area_vectors(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F, 3) normals of the faces, as long as their areas."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a)


def surface_area(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The sum of the areas of all faces."""
    return float(np.linalg.norm(area_vectors(vertices, faces), axis=1).sum())


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F, 3) unit vectors; 0 of faces without area, which marching cubes leave where corners coincide."""
    area = area_vectors(vertices, faces)
    length = np.linalg.norm(area, axis=-1, keepdims=True)
    return area / np.where(length > 0.0, length, 1.0)


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V, 3) unit vectors: means over the faces around each vertex, weighted by area."""
    return unit(_around_vertices(vertices, faces)[:, :3])


def vertex_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V,) a third of the area of the faces around each vertex."""
    return _around_vertices(vertices, faces)[:, 3] / 3.0


@njit(cache=True)
def _around_vertices(vertices, faces):
    """(V, 7) sums over the faces around each vertex: area vectors, areas, and middles times areas."""
    out = np.zeros((len(vertices), 7))
    row = np.empty(7)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        row[0] = 0.5 * ((b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1]))
        row[1] = 0.5 * ((b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2]))
        row[2] = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
        row[3] = math.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2])
        for d in range(3):
            row[4 + d] = row[3] * (a[d] + b[d] + c[d]) / 3.0
        for k in range(3):
            for d in range(7):
                out[faces[f, k], d] += row[d]
    return out


def icosahedron() -> tuple[np.ndarray, np.ndarray]:
    """Vertices (12, 3) on the unit sphere and faces (20, 3) that look outwards."""
    g = 0.5 * (1.0 + 5.0**0.5)
    pair = np.array([[-1, g], [1, g], [-1, -g], [1, -g]], float)
    zero = np.zeros((4, 1))
    vertices = np.concatenate([np.c_[pair, zero], np.c_[zero, pair], np.c_[pair[:, 1:], zero, pair[:, :1]]])
    faces = [
        *([0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6]),
        *([7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10]),
        *([8, 6, 7], [9, 8, 1]),
    ]
    return unit(vertices), np.array(faces, np.int32)


def refine(
    vertices: np.ndarray, faces: np.ndarray, spacing: float, place: Place | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with edges of `spacing` in the mean and LONGEST spacings at most.

    place: moves new points onto the surface, and the vertices then slide along it until edges are even. Without, the
    given vertices stay, and new points lie on a smooth surface through these (`curved_middle`).
    """
    aim = LONGEST * spacing
    longest = float(_edge_lengths(vertices, unique_edges(faces)[0]).max())
    for _ in range(_MAX_HALVINGS):
        at_last = longest == aim
        longest = max(0.5 * longest, aim)
        before = len(vertices)
        vertices, faces = split_long_edges(vertices, faces, longest, place)
        if at_last and len(vertices) == before:
            break
        # Sliding makes some edges a little longer again. The last splits are not followed by it, or would not end.
        if place is not None and not at_last and len(vertices) > before:
            for _ in range(_PASSES if longest > aim else 1):
                vertices = place(relax(vertices, faces))
    return vertices, faces


def split_long_edges(
    vertices: np.ndarray, faces: np.ndarray, longest: float, place: Place | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with every edge longer than `longest` cut in two; a closed mesh stays closed."""
    edges, index = unique_edges(faces)
    long = _edge_lengths(vertices, edges) > longest
    if not long.any():
        return vertices, faces
    a, b = edges[long].T
    if place is None:
        middle = curved_middle(vertices, vertex_normals(vertices, faces), a, b)
    else:
        middle = place(0.5 * (vertices[a] + vertices[b]))
    number = np.full(len(edges), -1, np.int64)
    number[long] = len(vertices) + np.arange(len(a))
    vertices = np.concatenate([vertices, middle])
    return vertices, _cut_faces(vertices, faces, number[index])


def _cut_faces(vertices: np.ndarray, faces: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Faces (F', 3) for faces (F, 3) whose half edges have new points in their middle (F, 3), -1 for none."""
    cut = middle >= 0
    count = cut.sum(1)
    # Faces are turned so that the first edge alone is cut, or the last alone is not.
    first = np.where(count == 1, cut.argmax(1), np.where(count == 2, (~cut).argmax(1) + 1, 0))
    turn = (first[:, None] + np.arange(3)) % 3
    faces, middle = np.take_along_axis(faces, turn, 1), np.take_along_axis(middle, turn, 1)
    parts = [faces[count == 0]]
    (a, b, c), m = faces[count == 1].T, middle[count == 1][:, 0]
    parts += [np.stack([a, m, c], -1), np.stack([m, b, c], -1)]
    (a, b, c), (m, n, _) = faces[count == 2].T, middle[count == 2].T
    shorter = _distance(vertices, a, n) < _distance(vertices, m, c)
    parts.append(np.stack([m, b, n], -1))
    parts.append(np.stack([a, m, np.where(shorter, n, c)], -1))
    parts.append(np.stack([np.where(shorter, a, m), n, c], -1))
    (a, b, c), (m, n, o) = faces[count == 3].T, middle[count == 3].T
    parts += [np.stack(corner, -1) for corner in ((a, m, o), (m, b, n), (o, n, c), (m, n, o))]
    return np.concatenate(parts).astype(np.int32)


def curved_middle(vertices: np.ndarray, normals: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Middles (n, 3) of curves from vertices a to b (n,) that are perpendicular to the normals at both.

    Those of the cubic edges of PN triangles (Vlachos et al. 2001, doi:10.1145/364338.364387).
    """
    step = vertices[b] - vertices[a]
    along_a = np.sum(step * normals[a], -1, keepdims=True)
    along_b = np.sum(step * normals[b], -1, keepdims=True)
    return 0.5 * (vertices[a] + vertices[b]) - 0.125 * (along_a * normals[a] - along_b * normals[b])


def relax(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V, 3) vertices moved along the surface, half of the way to the mean of the faces around them by area."""
    total = _around_vertices(vertices, faces)
    move = total[:, 4:] / total[:, 3:4] - vertices
    normal = unit(total[:, :3])
    return vertices + _RELAXATION * (move - np.sum(move * normal, -1, keepdims=True) * normal)


def _edge_lengths(vertices: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return _distance(vertices, edges[:, 0], edges[:, 1])


def _distance(vertices: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vertices[a] - vertices[b], axis=-1)
