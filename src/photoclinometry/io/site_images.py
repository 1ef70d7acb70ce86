"""The images of a site: read, checked against their cameras, and freed of dark sky."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from photoclinometry.io.dark_level import dark_levels, darkest_pixels, without_dark_level
from photoclinometry.io.exposure import off_body_mask, why_it_shows_nothing
from photoclinometry.io.images import read_image
from photoclinometry.io.plausible import impossible_views
from photoclinometry.io.site import Site, SiteView, site_document
from photoclinometry.model.errors import ImageError
from photoclinometry.model.progress import Progress
from photoclinometry.model.scene import Image

log = logging.getLogger(__name__)

_LISTED = 5
"""Missing images that an error names; the others are counted."""


def load_images(site: Site, progress: Progress | None = None) -> list[Image]:
    """The images of all views, each named as its view, uncalibrated ones less their dark level; `valid` is False on
    dark sky.

    progress: called with "images", images read and images in all after each. Raises ImageError for images that are
    missing, unreadable, of another size than their camera, empty, dark, or the same as another.
    """
    return _less_dark_levels(*_read_images(site, progress))


def _read_images(site: Site, progress: Progress | None) -> tuple[list[Image], np.ndarray]:
    """The images of all views as they are, and their dark levels (K,), 0 for calibrated ones. Raises ImageError."""
    missing = [str(view.image) for view in site.views if not view.image.exists()]
    if missing:
        listed = ", ".join(missing[:_LISTED]) + (", ..." if len(missing) > _LISTED else "")
        raise ImageError(
            f"{site.path}: {len(missing)} of {len(site.views)} images do not exist: {listed}; "
            "image paths are relative to this file"
        )
    images, darkest, seen = [], [], {}
    for number, view in enumerate(site.views, start=1):
        image = read_view_image(site, view)
        _check_image(view, image)
        content = hashlib.sha256(image.brightness.tobytes()).digest()
        if content in seen:
            raise ImageError(
                f"{site.path}: {seen[content]} and {view.name} are the same image (all pixels equal); "
                "remove one of the two views"
            )
        seen[content] = view.name
        if site.brightness == "dn":
            darkest.append(darkest_pixels(image))
        images.append(Image(view.name, image.brightness, image.valid & ~off_body_mask(image)))
        if progress is not None:
            progress("images", number, len(site.views))
    levels = dark_levels(darkest, [view.camera for view in site.views]) if darkest else np.zeros(len(images))
    return images, levels


def _less_dark_levels(images: list[Image], levels: np.ndarray) -> list[Image]:
    if not levels.any():
        return images
    log.info("dark levels of %g to %g are taken from the images' brightness", levels.min(), levels.max())
    return [without_dark_level(image, float(level)) for image, level in zip(images, levels, strict=True)]


def load_plausible_images(site: Site, progress: Progress | None = None) -> tuple[list[Image], dict[str, str]]:
    """The images as of `load_images`, and those whose brightness, as it is in their files, cannot be that of ground, by
    name, with the reason.

    Raises SiteError and ImageError, also where too many cannot (`plausible.impossible_views`).
    """
    images, levels = _read_images(site, progress)
    impossible = impossible_views(site, images)
    return _less_dark_levels(images, levels), impossible


def read_view_image(site: Site, view: SiteView) -> Image:
    """The image of a view, sky included, named after its file; `valid` is False where it is masked.

    Raises ImageError.
    """
    image = read_image(view.image, linear=site.linear, remedy="write linear = true in site.toml")
    valid = image.valid & view.masking.usable(image.valid.shape)
    return Image(image.name, np.where(valid, image.brightness, np.float32(0)), valid)


def input_fingerprint(site: Site) -> str:
    """SHA-256 (hex) of the content of a site and of its image files, to notice changed inputs.

    Comments and layout of the TOML file do not enter, nor the folder's place. Raises ImageError.
    """
    import tomli_w

    digest = hashlib.sha256(tomli_w.dumps(site_document(site)).encode())
    for of_image in image_digests(site):
        digest.update(of_image)
    for mask in dict.fromkeys(mask for view in site.views for mask in view.masking.files):
        digest.update(_digest(mask))
    return digest.hexdigest()


def image_digests(site: Site) -> Iterator[bytes]:
    """SHA-256 of each view's image file. Raises ImageError."""
    return (_digest(view.image) for view in site.views)


def _digest(file: Path) -> bytes:
    try:
        with open(file, "rb") as stream:
            return hashlib.file_digest(stream, "sha256").digest()
    except OSError as error:
        raise ImageError(f"{file}: cannot be read: {error.strerror}; check the path") from error


def _check_image(view: SiteView, image: Image) -> None:
    """Raises ImageError if the image has another size than the camera, no valid pixel, or no signal above its noise."""
    height, width = image.brightness.shape
    if (width, height) != (view.camera.width, view.camera.height):
        raise ImageError(
            f"{view.image}: is {width} x {height} pixels, but its camera in site.toml is "
            f"{view.camera.width} x {view.camera.height}; correct the camera or the image"
        )
    if not image.valid.any():
        raise ImageError(f"{view.image}: has no valid pixel (all NaN, blank, saturated or masked); remove this view")
    nothing = why_it_shows_nothing(image)
    if nothing:
        raise ImageError(f"{view.image}: {nothing}; remove this view")
