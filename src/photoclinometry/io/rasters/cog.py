"""Cloud-optimised GeoTIFF: bands of a north-up map, with overviews. Needs the extra `geo` (rasterio)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry import __version__
from photoclinometry.io.atomic import write_bytes

BLOCK = 256
"""Width and height of a tile [px]; larger maps get overviews, each half the size of the one before."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """Description and unit of one band."""

    description: str
    unit: str
    """As written into the file; empty for pure numbers."""


@dataclass(frozen=True, kw_only=True)
class RasterPlace:
    """The place of a raster on a map."""

    corner: tuple[float, float]
    """(x, y) of the outer corner of the top-left pixel, in the unit of the map."""
    pixel: float
    """Width and height of a pixel, in the unit of the map."""
    crs: Any
    """rasterio's CRS; None for a map in an unknown unit."""


def write_cog(
    path: Path | str,
    values: np.ndarray,
    valid: np.ndarray,
    bands: tuple[Band, ...],
    *,
    place: RasterPlace,
    about: dict[str, str],
) -> None:
    """Bands (h, w, n) of a map as single-precision numbers, with NaN as no-data where not `valid` (h, w).

    Rows go down, columns right. about: tags of the file, by key. Raises RunFolderError.
    """
    import rasterio
    import rasterio.shutil
    from rasterio.io import MemoryFile

    height, width, count = values.shape
    profile = {"driver": "GTiff", "dtype": "float32", "width": width, "height": height, "count": count}
    transform = rasterio.Affine(place.pixel, 0.0, place.corner[0], 0.0, -place.pixel, place.corner[1])
    with MemoryFile() as memory, MemoryFile(ext=".tif") as whole:
        with memory.open(**profile, crs=place.crs, transform=transform, nodata=np.nan) as file:
            for number, band in enumerate(bands, start=1):
                file.write(np.where(valid, values[..., number - 1], np.nan).astype(np.float32), number)
                file.set_band_description(number, band.description)
            file.units = tuple(band.unit for band in bands)
            file.update_tags(TIFFTAG_SOFTWARE=f"photoclinometry {__version__}", **about)
        # In memory, since on a full disk GDAL reports success, or fails with errors of its own.
        rasterio.shutil.copy(
            memory.name,
            whole.name,
            driver="COG",
            blocksize=BLOCK,
            compress="DEFLATE",
            predictor="FLOATING_POINT",
            overview_resampling="AVERAGE",
        )
        write_bytes(path, whole.read())
