"""GeoTIFF: a terrain model as heights on a map. Needs the extra `geo` (rasterio)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.meshes.ply import PlyMap
from photoclinometry.io.rasters.globe import body_fixed, semi_axes
from photoclinometry.model.errors import InputError
from photoclinometry.model.mesh import grid_faces


@dataclass(frozen=True)
class Dtm:
    """Heights over a map whose rows go south and whose columns go east."""

    height: np.ndarray
    """(h, w) float64, in the file's unit of height."""
    valid: np.ndarray
    """(h, w) bool: there is a height."""
    corner: tuple[float, float]
    """(easting, northing) of the outer corner of the top-left pixel [m]."""
    pixel: tuple[float, float]
    """(width, height) of a pixel [m], both positive."""
    radius: float | None
    """Mean radius of the map's ellipsoid [m]; None if the file has no reference system."""


@dataclass(frozen=True)
class _Band:
    """The first band of a file, scale and offset applied, on the grid of the file."""

    height: np.ndarray
    valid: np.ndarray
    transform: Any
    """rasterio's Affine, map from pixel."""
    crs: Any
    """rasterio's CRS, or None."""


def read_dtm(path: Path | str) -> Dtm:
    """The first band of a projected, north-up GeoTIFF, scale and offset applied. Raises InputError."""
    band = _read_band(path)
    transform, factor = band.transform, _metres_per_unit(path, band)
    axes = semi_axes(band.crs)
    return Dtm(
        height=band.height,
        valid=band.valid,
        corner=(factor * transform.c, factor * transform.f),
        pixel=(factor * transform.a, -factor * transform.e),
        radius=(2.0 * axes[0] + axes[1]) / 3.0 if axes else None,
    )


def read_dtm_mesh(path: Path | str) -> PlyMap:
    """The first band of a GeoTIFF as a mesh without the cells that have no value.

    If the file has a coordinate reference system, heights are above its ellipsoid, and positions are returned in the
    body-fixed frame [m]: origin in the body's centre, z to the north pole, x to longitude zero. Otherwise positions
    are (x, y, height) by the file's transform. Raises InputError.
    """
    band = _read_band(path)
    transform = band.transform
    rows, cols = np.indices(band.height.shape) + 0.5
    x = transform.a * cols + transform.b * rows + transform.c
    y = transform.d * cols + transform.e * rows + transform.f
    z = np.where(band.valid, band.height, 0.0)
    grid = np.stack([x, y, z], -1)
    if band.crs is not None:
        axes = semi_axes(band.crs)
        if axes is None:
            raise InputError(f"{path}: the coordinate reference system names no ellipsoid; write one into the file")
        grid = body_fixed(band.crs, axes, grid.reshape(-1, 3)).reshape(grid.shape)
    faces = grid_faces(grid, band.valid)
    if transform.determinant > 0:  # rows go north: faces turn clockwise
        faces = faces[:, ::-1]
    index = np.cumsum(band.valid.ravel()) - 1
    return PlyMap(grid[band.valid], None, None, index[faces])


def _read_band(path: Path | str) -> _Band:
    try:
        import rasterio
        from rasterio.errors import NotGeoreferencedWarning, RasterioError
    except ImportError as error:
        raise InputError(
            f"{path}: GeoTIFF needs rasterio: pip install 'photoclinometry[geo]', or give the surface as OBJ or PLY"
        ) from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path) as file:
                if file.count < 1 or min(file.shape) < 2:
                    raise InputError(f"{path}: holds {file.count} bands of {file.shape} pixels, expected heights")
                band = file.read(1, masked=True)
                scale, offset, transform, crs = file.scales[0], file.offsets[0], file.transform, file.crs
    except InputError:
        raise
    except (RasterioError, ValueError) as error:  # CRSError and UnicodeDecodeError are no RasterioError
        raise InputError(f"{path}: cannot be read as a GeoTIFF ({error}); export it again") from error
    with np.errstate(invalid="ignore", over="ignore"):
        height = np.ma.getdata(band).astype(np.float64) * scale + offset
    valid = ~np.ma.getmaskarray(band) & np.isfinite(height)
    if not valid.any():
        raise InputError(f"{path}: no pixel has a height (all are no-data); export the terrain model again")
    return _Band(height, valid, transform, crs)


def _metres_per_unit(path: Path | str, band: _Band) -> float:
    """Metres in the unit of the map's coordinates. Raises InputError for maps that are not projected and north up."""
    transform, crs = band.transform, band.crs
    if transform.is_identity:
        raise InputError(f"{path}: has no map coordinates; export it as a georeferenced GeoTIFF")
    if transform.b or transform.d or transform.a <= 0 or transform.e >= 0:
        raise InputError(f"{path}: is rotated or not north up; resample it with gdalwarp")
    if crs and crs.is_geographic:
        raise InputError(
            f"{path}: is a map in degrees; project it about the site first, for example with gdalwarp -t_srs "
            "'+proj=stere +lat_0=LAT +lon_0=LON +R=RADIUS'"
        )
    return crs.linear_units_factor[1] if crs and crs.is_projected else 1.0
