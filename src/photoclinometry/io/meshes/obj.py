"""Wavefront OBJ meshes: written with normals and a texture, read as vertices and faces only.

http://paulbourke.net/dataformats/obj/
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.io.images import write_png
from photoclinometry.io.meshes.ply import fan_triangles
from photoclinometry.io.reading import read_bytes
from photoclinometry.model.errors import InputError


def read_obj(path: Path | str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64 and triangles (F, 3) int64; larger polygons are cut into fans. Raises InputError."""
    path = Path(path)
    vertex_lines, face_lines, seen = [], [], []
    for line in read_bytes(path).splitlines():
        if line.startswith(b"v "):
            vertex_lines.append(line)
        elif line.startswith(b"f "):
            face_lines.append(line)
            seen.append(len(vertex_lines))
    try:
        vertices = _vertices(vertex_lines)
        faces = _faces(face_lines, seen)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{path}: is not a complete OBJ file ({error}); export it again") from error
    if len(vertices) == 0 or len(faces) == 0:
        raise InputError(
            f"{path}: is not an OBJ mesh ({len(vertices)} vertices, {len(faces)} faces); export a mesh as OBJ or PLY"
        )
    if not np.isfinite(vertices).all():
        raise InputError(f"{path}: some vertices are not finite; remove them")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: faces refer to vertices that do not exist; export it again")
    return vertices, faces


def write_obj(
    path: Path | str,
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    normal: np.ndarray,
    texture: tuple[np.ndarray, np.ndarray] | None = None,
) -> None:
    """A mesh of vertices (V, 3), exact, triangles (F, 3) counter-clockwise from outside and unit normals (V, 3).

    texture: a picture (h, w) uint8, and where the vertices are in it (V, 2), in [0, 1] right and down from the upper
    left corner; written beside the mesh as a PNG of its name, with a material (.mtl). Raises RunFolderError.
    """
    path = Path(path)
    columns = [("v", vertices, "%.17g"), ("vn", normal, "%.7g")]
    corner = "{0}//{0}"
    header = ""
    if texture is not None:
        picture, uv = texture
        columns.append(("vt", np.stack([uv[:, 0], 1.0 - uv[:, 1]], -1), "%.9g"))
        corner = "{0}/{0}/{0}"
        header = f"mtllib {path.stem}.mtl\nusemtl surface\n"
        write_png(path.with_suffix(".png"), picture)
        write_text(path.with_suffix(".mtl"), f"newmtl surface\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {path.stem}.png\n")
    with atomic_path(path) as temporary, open(temporary, "w", encoding="ascii") as stream:
        stream.write(header)
        for key, values, number in columns:
            np.savetxt(stream, values, fmt=" ".join([key, *[number] * values.shape[1]]))
        corners = [corner.format(n) for n in range(1, len(vertices) + 1)]
        stream.writelines(f"f {corners[a]} {corners[b]} {corners[c]}\n" for a, b, c in faces.tolist())


def _vertices(lines: list[bytes]) -> np.ndarray:
    """(V, 3) float64. Raises ValueError."""
    words = [line.split()[1:4] for line in lines]
    for number, coordinates in enumerate(words, 1):
        if len(coordinates) < 3:
            raise ValueError(f"vertex {number} has {len(coordinates)} coordinates, not 3")
    return np.array(words, np.float64).reshape(-1, 3)


def _faces(lines: list[bytes], seen: list[int]) -> np.ndarray:
    """(F, 3) rows of the vertices. Corners are `v`, `v/vt/vn` or `v//vn`, counted from 1, or backwards from -1, the
    last vertex before the face.

    seen: how many vertices stand before each face.
    """
    corners = [[word.split(b"/", 1)[0] for word in line.split()[1:]] for line in lines]
    index = np.array([word for corner in corners for word in corner], np.int64)
    if (index == 0).any():
        raise ValueError("a face refers to vertex 0, but vertices count from 1")
    lengths = np.array([len(corner) for corner in corners], np.int64)
    index = np.where(index > 0, index - 1, index + np.repeat(np.array(seen, np.int64), lengths))
    return fan_triangles(lengths, index)
