"""The products that a whole body can be exported as. A format is one entry of SHAPE_FORMATS."""

from __future__ import annotations

from photoclinometry.output.export.formats import Format
from photoclinometry.output.export.shape.maps import write_body_maps
from photoclinometry.output.export.shape.meshes import write_shape_meshes
from photoclinometry.output.export.shape.models import write_dsk_model, write_icq_model
from photoclinometry.output.export.shape.placed import PlacedShape
from photoclinometry.output.export.shape.planes import write_planes
from photoclinometry.output.export.shape.properties import write_properties


def _no_unit(placed: PlacedShape) -> str | None:
    return None if placed.shape.unit == "m" else "its unit of length is unknown; give --unit-m"


def _no_outside(placed: PlacedShape) -> str | None:
    """Maps and grids are drawn from the origin."""
    reason = _no_unit(placed)
    if reason is None and not placed.holds_origin:
        return "the origin is not inside of it; move the model about its centre"
    return reason


def _not_star_shaped(placed: PlacedShape) -> str | None:
    reason = _no_unit(placed)
    if reason is None and not placed.star_shaped:
        return "some directions from the origin meet the surface more than once, and ICQ models are star-shaped"
    return reason


def _no_body(placed: PlacedShape) -> str | None:
    return _no_unit(placed) or placed.unknown_to_spice


_ALL = (
    Format(name="obj", about="meshes of 49k, 196k, ... facets", write=write_shape_meshes),
    Format(name="ply", about="the same with all that is known at the vertices", write=write_shape_meshes),
    Format(name="gltf", about="the same for viewers", write=write_shape_meshes),
    Format(name="icq", about="Gaskell's model for SPC", write=write_icq_model, lacks=_not_star_shaped),
    Format(
        name="dsk", about="SPICE's shape kernel", write=write_dsk_model, lacks=_no_body, extra="geo", package="spiceypy"
    ),
    Format(
        name="maps",
        about="GeoTIFFs, cylindrical and polar",
        write=write_body_maps,
        lacks=_no_outside,
        extra="geo",
        package="rasterio",
    ),
    Format(name="fits", about="FITS planes as AltWG has them", write=write_planes, lacks=_no_outside),
    Format(name="properties", about="volume, centre of mass, inertia", write=write_properties),
)

SHAPE_FORMATS: dict[str, Format] = {product.name: product for product in _ALL}
"""In the order in which they are written."""
