"""Terrain models as GeoTIFF: heights on a map grid, as points of the body-fixed frame. Needs the extra `geo`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.errors import InputError
from photoclinometry.io.ply import PlyMap
from photoclinometry.raster import grid_faces


def read_dtm(path: Path | str) -> PlyMap:
    """The first band of a GeoTIFF as a mesh; cells without a value are left out.

    With a coordinate reference system, heights are above its ellipsoid, and positions come in the body-fixed
    frame: origin in the body's centre, z to the north pole, x to longitude zero, in metres. Without one, they are
    (x, y, height) as the file's transform gives them. Raises InputError.
    """
    rasterio = _rasterio(path)
    path = Path(path)
    try:
        with rasterio.open(path) as file:
            if file.count < 1 or min(file.shape) < 2:
                raise InputError(f"{path}: holds {file.count} bands of {file.shape} cells, expected a grid of heights")
            height = file.read(1, masked=True).astype(float) * file.scales[0] + file.offsets[0]
            transform, crs = file.transform, file.crs
    except rasterio.errors.RasterioError as error:
        raise InputError(f"{path}: cannot be read as a GeoTIFF: {error}; give a GeoTIFF of heights") from error
    present = ~np.ma.getmaskarray(height) & np.isfinite(height.filled(np.nan))
    if not present.any():
        raise InputError(f"{path}: no cell of the first band holds a height")
    rows, cols = np.indices(height.shape) + 0.5
    x = transform.a * cols + transform.b * rows + transform.c
    y = transform.d * cols + transform.e * rows + transform.f
    z = np.where(present, height.filled(0.0), 0.0)
    grid = np.stack([x, y, z], -1) if crs is None else _body_fixed(path, crs, x, y, z)
    faces = grid_faces(grid, present)
    if transform.determinant > 0:  # rows go north: the grid is a mirror image of what an image would be
        faces = faces[:, ::-1]
    index = np.cumsum(present.ravel()) - 1
    return PlyMap(grid[present], None, None, index[faces])


def _rasterio(path: Path | str) -> Any:
    try:
        import rasterio
        import rasterio.errors
    except ImportError as error:
        raise InputError(
            f"{path}: reading a GeoTIFF needs rasterio; install it with: pip install 'photoclinometry[geo]'"
        ) from error
    return rasterio


def _body_fixed(path: Path, crs: Any, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Positions (h, w, 3) [m] of map coordinates and heights (h, w)."""
    from rasterio.crs import CRS
    from rasterio.warp import transform

    a, b = _semi_axes(path, crs.to_dict(projjson=True))
    centred = CRS.from_dict(proj="geocent", a=a, b=b, units="m", no_defs=True)
    position = transform(crs, centred, x.ravel(), y.ravel(), z.ravel())
    return np.stack([np.reshape(axis, x.shape) for axis in position], -1)


def _semi_axes(path: Path, node: Any) -> tuple[float, float]:
    """Equatorial and polar radius [m] of the ellipsoid somewhere below a node of PROJJSON."""
    for key, value in node.items() if isinstance(node, dict) else ():
        if key == "ellipsoid":
            if "radius" in value:
                return float(value["radius"]), float(value["radius"])
            a = float(value["semi_major_axis"])
            flattening = 1.0 / value["inverse_flattening"] if value.get("inverse_flattening") else 0.0
            return a, float(value.get("semi_minor_axis", a * (1.0 - flattening)))
        if isinstance(value, dict):
            try:
                return _semi_axes(path, value)
            except InputError:
                continue
    raise InputError(f"{path}: the coordinate reference system names no ellipsoid; write one into the file")
