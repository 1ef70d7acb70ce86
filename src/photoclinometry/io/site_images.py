"""The images of a site: read, checked against their cameras, and freed of dark sky."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.dark_level import dark_levels, darkest_pixels, without_dark_level
from photoclinometry.io.exposure import off_body_mask, why_it_shows_nothing
from photoclinometry.io.images import read_image
from photoclinometry.io.jpeg_blocks import shows_jpeg_blocks
from photoclinometry.io.plausible import impossible_views
from photoclinometry.io.site import Site, SiteView, site_document
from photoclinometry.model.errors import ImageError
from photoclinometry.model.gamma import LINEAR, gamma_corrected
from photoclinometry.model.image import Image
from photoclinometry.model.lens import NEGLIGIBLE_PX, NO_DISTORTION, observed_pixels
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.sampling import resampled

log = logging.getLogger(__name__)

_LISTED = 5
"""Missing images that an error names; the others are counted."""
_NO_PIXEL = "has no valid pixel (all NaN, blank, saturated, masked or sky)"


@dataclass(frozen=True, kw_only=True)
class SiteImages:
    """The images of a site, with those from which no map can be made."""

    images: list[Image]
    """(K,) of all views, as of `load_images`."""
    empty: dict[str, str]
    """Views without a valid pixel or without anything to be seen, by name, with the reason as a clause."""
    impossible: dict[str, str]
    """Other views, whose brightness as it is in their files cannot be that of ground; as `empty`."""
    compressed: tuple[str, ...]
    """Names of views whose images show the blocks of JPEG."""


def load_images(site: Site, progress: Progress = no_progress) -> list[Image]:
    """The images of all views, each named as its view, uncalibrated ones less their dark level; `valid` is False on
    dark sky.

    progress: called with "images", images read and images in all after each. Raises ImageError for images that are
    missing, unreadable, of another size than their camera, empty, dark, or the same as another.
    """
    found = _read_images(site, progress)
    for view in site.views:
        if view.name in found.nothing:
            raise ImageError(f"{view.image}: {found.nothing[view.name]}; remove this view")
    return _less_dark_levels(found.images, found.levels)


def load_plausible_images(site: Site, progress: Progress = no_progress) -> SiteImages:
    """The images as of `load_images`, and those of which no map can be made.

    Raises SiteError and ImageError, also where too few others remain (`plausible.impossible_views`).
    """
    found = _read_images(site, progress)
    remedy = "remove this view, or correct its image or mask"
    empty = {name: f"it {reason}; {remedy}" for name, reason in found.nothing.items()}
    return SiteImages(
        images=_less_dark_levels(found.images, found.levels),
        empty=empty,
        impossible=impossible_views(site, found.images, empty),
        compressed=found.compressed,
    )


@dataclass(frozen=True, kw_only=True)
class _Read:
    """The images of all K views as they are."""

    images: list[Image]
    levels: np.ndarray
    """(K,) dark levels, 0 of calibrated images."""
    nothing: dict[str, str]
    """Reasons why some show nothing, by name."""
    compressed: tuple[str, ...]
    """Names of those with the blocks of JPEG."""


def _read_images(site: Site, progress: Progress) -> _Read:
    """Raises ImageError."""
    _check_existence(site)
    images, nothing, darkest, seen, compressed = [], {}, {}, {}, []
    for number, view in enumerate(site.views, start=1):
        of_file = _read_linear(site, view)
        whole = undistorted(of_file, view)
        _check_size(view, whole)
        if shows_jpeg_blocks(of_file):
            compressed.append(view.name)
        image = Image(view.name, whole.brightness, whole.valid & ~off_body_mask(whole))
        reason = why_it_shows_nothing(whole) if image.valid.any() else _NO_PIXEL
        if reason:
            nothing[view.name] = reason
        else:
            _check_difference(site, view, whole, seen)
            if site.brightness == "dn":
                darkest[number - 1] = darkest_pixels(whole)
        images.append(image)
        progress("images", number, len(site.views))
    levels = np.zeros(len(images))
    if darkest:
        levels[list(darkest)] = dark_levels(list(darkest.values()), [site.views[k].camera for k in darkest])
    return _Read(images=images, levels=levels, nothing=nothing, compressed=tuple(compressed))


def first_of(names: Sequence[str]) -> str:
    """The first few of many names."""
    return ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")


def _check_existence(site: Site) -> None:
    """Raises ImageError if images are missing."""
    missing = [str(view.image) for view in site.views if not view.image.exists()]
    if missing:
        raise ImageError(
            f"{site.path}: {len(missing)} of {len(site.views)} images do not exist: {first_of(missing)}; "
            "image paths are relative to this file"
        )


def _check_difference(site: Site, view: SiteView, image: Image, seen: dict[bytes, str]) -> None:
    """Raises ImageError if the image is the same as one before; else adds its digest to `seen`, names by digest."""
    content = hashlib.sha256(image.brightness.tobytes()).digest()
    if content in seen:
        raise ImageError(
            f"{site.path}: {seen[content]} and {view.name} are the same image (all pixels equal); "
            "remove one of the two views"
        )
    seen[content] = view.name


def _less_dark_levels(images: list[Image], levels: np.ndarray) -> list[Image]:
    if not levels.any():
        return images
    log.info("dark levels of %g to %g are taken from the images' brightness", levels.min(), levels.max())
    return [without_dark_level(image, float(level)) for image, level in zip(images, levels, strict=True)]


def read_view_image(site: Site, view: SiteView) -> Image:
    """The image of a view, sky included, named after its file, linear and without distortion; `valid` is False where
    it is masked.

    Raises ImageError.
    """
    return undistorted(_read_linear(site, view), view)


def _read_linear(site: Site, view: SiteView) -> Image:
    """The image of a view as of `read_view_image`, with the pixels of its file. Raises ImageError."""
    decoded = view.gamma != LINEAR
    image = read_image(view.image, linear=site.linear or decoded, remedy="write linear = true in site.toml")
    valid = image.valid & view.masking.usable(image.valid.shape)
    brightness = np.where(valid, image.brightness, np.float32(0))
    if decoded:
        brightness = gamma_corrected(brightness, view.gamma, 1.0).astype(np.float32)
    return Image(image.name, brightness, valid)


def undistorted(image: Image, view: SiteView) -> Image:
    """The image of a view as its pinhole camera shows it: resampled by splines, where its lens distorts noticeably."""
    if view.lens == NO_DISTORTION or image.valid.shape != (view.camera.height, view.camera.width):
        return image
    seen, farthest = observed_pixels(view.camera, view.lens)
    return Image(image.name, *resampled(image.brightness, image.valid, seen)) if farthest > NEGLIGIBLE_PX else image


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


def _check_size(view: SiteView, image: Image) -> None:
    """Raises ImageError if the image has another size than the camera."""
    height, width = image.brightness.shape
    if (width, height) != (view.camera.width, view.camera.height):
        raise ImageError(
            f"{view.image}: is {width} x {height} pixels, but its camera in site.toml is "
            f"{view.camera.width} x {view.camera.height}; correct the camera or the image"
        )
