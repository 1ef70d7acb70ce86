"""glTF 2.0: a mesh with normals, albedo and texture as one binary file (GLB).

https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html. Positions are in single precision, so they are relative to
the middle of the mesh, and a node translates them in double precision. A second node turns z to y, glTF's upward axis.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry import __version__
from photoclinometry.io.atomic import write_bytes
from photoclinometry.io.images import png_bytes

_FLOAT, _INDEX = 5126, 5125
"""componentType of 32-bit floats and unsigned integers."""
_VERTICES, _FACES = 34962, 34963
"""target of buffer views: ARRAY_BUFFER and ELEMENT_ARRAY_BUFFER."""
_CLAMP_TO_EDGE = 33071
"""Wrapping mode of a texture."""
_Z_TO_Y = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
"""Quaternion x, y, z, w of a quarter turn about x."""


def write_glb(
    path: Path | str,
    position: np.ndarray,
    faces: np.ndarray,
    *,
    normal: np.ndarray,
    albedo: np.ndarray | None = None,
    gray: np.ndarray | None = None,
    texture: tuple[np.ndarray, np.ndarray] | None = None,
) -> None:
    """A mesh of vertices (V, 3), triangles (F, 3) counter-clockwise from outside and unit normals (V, 3).

    albedo: (V,) as the attribute _ALBEDO. gray: (V,) linear light in [0, 1], as the vertices' colours. texture: a
    picture (h, w) uint8, and where the vertices are in it (V, 2), in [0, 1] right and down from the upper left corner.
    Raises RunFolderError.
    """
    middle = 0.5 * (position.min(0) + position.max(0))
    content = _Content()
    attributes = {
        "POSITION": content.array(position - middle, "VEC3", bounds=True),
        "NORMAL": content.array(normal, "VEC3"),
    }
    if albedo is not None:
        attributes["_ALBEDO"] = content.array(albedo, "SCALAR")
    if gray is not None:
        attributes["COLOR_0"] = content.array(np.repeat(gray[:, None], 3, 1), "VEC3")
    material: dict[str, Any] = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}
    extra: dict[str, Any] = {}
    if texture is not None:
        picture, uv = texture
        attributes["TEXCOORD_0"] = content.array(uv, "VEC2")
        extra["images"] = [{"bufferView": content.view(png_bytes(picture)), "mimeType": "image/png"}]
        extra |= {
            "samplers": [{"wrapS": _CLAMP_TO_EDGE, "wrapT": _CLAMP_TO_EDGE}],
            "textures": [{"source": 0, "sampler": 0}],
        }
        material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    indices = content.array(faces.reshape(-1), "SCALAR", indices=True)
    document = {
        "asset": {"version": "2.0", "generator": f"photoclinometry {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "frame, z turned to y", "rotation": _Z_TO_Y, "children": [1]},
            {"name": "mesh", "translation": middle.tolist(), "mesh": 0},
        ],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        "materials": [material],
        "accessors": content.accessors,
        "bufferViews": content.views,
        "buffers": [{"byteLength": len(content.data)}],
        **extra,
    }
    write_bytes(path, _glb(json.dumps(document).encode(), bytes(content.data)))


class _Content:
    """The binary part of a file, with the views and accessors that describe it."""

    def __init__(self):
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, content: bytes, **about: int) -> int:
        """Index of a new buffer view; each begins at a multiple of four bytes."""
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content), **about})
        self.data += content + b"\0" * (-len(content) % 4)
        return len(self.views) - 1

    def array(self, values: np.ndarray, kind: str, *, bounds: bool = False, indices: bool = False) -> int:
        """Index of a new accessor to values (n,) or (n, k)."""
        values = values.astype("<u4" if indices else "<f4")
        about: dict[str, Any] = {
            "bufferView": self.view(values.tobytes(), target=_FACES if indices else _VERTICES),
            "componentType": _INDEX if indices else _FLOAT,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            about |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        self.accessors.append(about)
        return len(self.accessors) - 1


def _glb(document: bytes, content: bytes) -> bytes:
    document += b" " * (-len(document) % 4)
    chunks = ((b"JSON", document), (b"BIN\0", content))
    body = b"".join(struct.pack("<I4s", len(chunk), kind) + chunk for kind, chunk in chunks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
