"""GeoTIFF: a terrain model as heights on a map. Needs the extra `geo` (rasterio), imported here only."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.errors import InputError


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
    """Mean radius of the map's ellipsoid [m], or None if the file names no body."""


def read_dtm(path: Path | str) -> Dtm:
    """The first band of a projected, north-up GeoTIFF, scale and offset applied. Raises InputError."""
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
                factor = _metres_per_unit(path, file)
                band = file.read(1, masked=True)
                scale, offset, transform, crs = file.scales[0], file.offsets[0], file.transform, file.crs
    except RasterioError as error:
        raise InputError(f"{path}: cannot be read as a GeoTIFF ({error}); export it again") from error
    height = np.ma.getdata(band).astype(np.float64) * scale + offset
    valid = ~np.ma.getmaskarray(band) & np.isfinite(height)
    if not valid.any():
        raise InputError(f"{path}: no pixel has a height (all are no-data); export the terrain model again")
    return Dtm(
        height=height,
        valid=valid,
        corner=(factor * transform.c, factor * transform.f),
        pixel=(factor * transform.a, -factor * transform.e),
        radius=_mean_radius(crs),
    )


def _metres_per_unit(path: Path | str, file) -> float:
    """Of the map's coordinates. Raises InputError for maps that heights cannot be taken from as they are."""
    transform, crs = file.transform, file.crs
    if transform.is_identity:
        raise InputError(f"{path}: has no map coordinates; export it as a georeferenced GeoTIFF")
    if transform.b or transform.d or transform.a <= 0 or transform.e >= 0:
        raise InputError(f"{path}: is rotated or not north up; make it so with gdalwarp")
    if crs and crs.is_geographic:
        raise InputError(
            f"{path}: is a map in degrees; project it about the site first, for example with gdalwarp -t_srs "
            "'+proj=stere +lat_0=LAT +lon_0=LON +R=RADIUS'"
        )
    return crs.linear_units_factor[1] if crs and crs.is_projected else 1.0


def _mean_radius(crs) -> float | None:
    """(a + a + b) / 3 of the ellipsoid that the reference system names; its flattening is 0 for a sphere."""
    found = re.search(r'(?:SPHEROID|ELLIPSOID)\["[^"]*",\s*([0-9.eE+]+),\s*([0-9.eE+]+)', crs.to_wkt() if crs else "")
    if found is None:
        return None
    major, inverse_flattening = float(found[1]), float(found[2])
    return major * (1.0 - 1.0 / (3.0 * inverse_flattening)) if inverse_flattening else major
