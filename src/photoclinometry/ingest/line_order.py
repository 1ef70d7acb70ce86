"""The order of lines and samples in a file, by its label, its camera, or the person."""

from __future__ import annotations

from dataclasses import replace

from photoclinometry.ingest.known_camera import KnownCamera
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.archives.product import Product
from photoclinometry.model.errors import ImageError
from photoclinometry.model.image import Image


def in_camera_order(product: Product, known: KnownCamera | None, options: IngestOptions) -> Product:
    """The product with its lines in the order of the known camera's files; of an unknown camera, first line on top.

    The lines of an ISIS cube stay. `--lines` overrides the label. For a known camera whose labels are not in the
    table, the order of the table is assumed. Raises ImageError if a label contradicts the camera's other files.
    """
    if product.kind == "ISIS":
        return product
    stated = (product.lines_up, product.samples_left)
    if known is not None and known.displayed:
        return _displayed(product, options)
    if known is None:
        if product.samples_left:
            raise ImageError(f"{product.path}: its samples run from right to left; mirror it first")
        turn = product.lines_up if options.lines_up is None else options.lines_up
        return _turned(product) if turn else product
    if not known.display:
        return _turned(product) if options.lines_up else product
    if options.lines_up is not None:
        return product if options.lines_up == known.display[0][0] else _turned(product)
    if None not in stated and stated not in known.display:
        raise ImageError(
            f"{product.path}: the label has the first line {'at the bottom' if stated[0] else 'on top'} and the first "
            f"sample {'right' if stated[1] else 'left'}, unlike all files of {known.name}; if its lines have the usual "
            f"order nevertheless, pass --lines {'up' if known.display[0][0] else 'down'}"
        )
    return product


def _displayed(product: Product, options: IngestOptions) -> Product:
    """The product as its label displays it; directions that it does not give are down and right."""
    lines_up = product.lines_up if options.lines_up is None else options.lines_up
    product = _turned(product) if lines_up else product
    image = product.image
    if not product.samples_left:
        return product
    return replace(product, image=Image(image.name, image.brightness[:, ::-1], image.valid[:, ::-1]))


def _turned(product: Product) -> Product:
    image = product.image
    return replace(product, image=Image(image.name, image.brightness[::-1], image.valid[::-1]))
