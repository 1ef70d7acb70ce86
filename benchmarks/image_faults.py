"""Faults that images and their geometry have in practice, put into a clean site: each is one function of a site.

A spoiled site has the same views and region. Pixel values keep their unit and their files' format, so that an 8-bit
PNG is rounded as it would be.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photoclinometry.io.site import RegionRequest, Site, SiteView, write_site
from photoclinometry.model.geometry import so3_exp, tangent_basis

JPEG_QUALITY = 75
GAMMA = 1.1
CORNER_SHIFT_PX, CORNER_LOSS = 2.0, 0.05
"""Radial distortion and vignetting at the corners of the images."""
HITS = 200
"""Cosmic rays in each image."""
FOCAL = 1.005
BLUR_PX = 2.0
"""Standard deviation of the blur of one image."""
OPTICS_PX, WIDER = 0.5, 1.2
"""Width of the point-spread function of simulated images, and how many times wider it is made [px, -]."""
SUN_OFF_DEG = 3.0
STRAY, FLAT_FIELD, GRADIENT = 0.02, 0.01, 0.05
"""Of the mean brightness; standard deviation of the gain; half the change of gain from side to side of one image."""
FLAT_FIELD_PX = 20.0
"""Width of the patches of the gain's errors: those of a flat field whose lamp was not even."""


@dataclass(frozen=True, kw_only=True)
class Images:
    """A site with the pixels of its images."""

    site: Site
    pixels: tuple[np.ndarray, ...]
    """(height, width) each, float; NaN where nothing was measured, as where the detector was saturated."""
    top: float
    """The largest value that the files can hold, or that any image has."""

    def changed(self, change: Callable[[np.ndarray], np.ndarray]) -> Images:
        """With every image changed."""
        return replace(self, pixels=tuple(self._measured(each, change) for each in self.pixels))

    def with_one(self, k: int, change: Callable[[np.ndarray], np.ndarray]) -> Images:
        """With image k changed."""
        each = self._measured(self.pixels[k], change)
        return replace(self, pixels=(*self.pixels[:k], each, *self.pixels[k + 1 :]))

    def _measured(self, pixels: np.ndarray, change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """An image changed where it was measured. What was not counts as saturated for its neighbours."""
        there = np.isfinite(pixels)
        return np.where(there, change(np.where(there, pixels, self.top)), np.nan)

    def with_views(self, change: Callable[[int, SiteView], SiteView]) -> Images:
        """With what is known of the views changed."""
        views = tuple(change(k, view) for k, view in enumerate(self.site.views))
        return replace(self, site=replace(self.site, views=views))


Fault = Callable[[Images, np.random.Generator], Images]


def jpeg(clean: Images, rng: np.random.Generator) -> Images:
    """Saved as JPEG, 8 bits, on the way."""
    import cv2

    def saved(pixels: np.ndarray) -> np.ndarray:
        byte = np.clip(np.round(255.0 * pixels / clean.top), 0, 255).astype(np.uint8)
        _, file = cv2.imencode(".jpg", byte, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        return cv2.imdecode(file, cv2.IMREAD_UNCHANGED).astype(float) * clean.top / 255.0

    return clean.changed(saved)


def gamma(clean: Images, rng: np.random.Generator, exponent: float = GAMMA) -> Images:
    """A response that is not linear: brighter in the middle of its range."""
    return clean.changed(lambda pixels: clean.top * np.clip(pixels / clean.top, 0.0, None) ** (1.0 / exponent))


def distortion(clean: Images, rng: np.random.Generator, corner_px: float = CORNER_SHIFT_PX) -> Images:
    """Radial distortion that was left in: barrel or pincushion."""
    import cv2

    sign = rng.choice([-1.0, 1.0])

    def distorted(pixels: np.ndarray) -> np.ndarray:
        x, y, radius = _from_centre(pixels.shape)
        corner = np.hypot(*pixels.shape) / 2.0
        stretch = 1.0 + sign * corner_px / corner * radius**2
        height, width = pixels.shape
        source = [
            ((value * stretch) + size / 2.0 - 0.5).astype(np.float32) for value, size in ((x, width), (y, height))
        ]
        return cv2.remap(pixels, *source, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)

    return clean.changed(distorted)


def vignetting(clean: Images, rng: np.random.Generator) -> Images:
    """Corners darker than the centre."""
    return clean.changed(lambda pixels: pixels * (1.0 - CORNER_LOSS * _from_centre(pixels.shape)[2] ** 2))


def hits(clean: Images, rng: np.random.Generator) -> Images:
    """Single bright pixels, each image its own."""

    def hit(pixels: np.ndarray) -> np.ndarray:
        out = pixels.copy()
        where = rng.choice(out.size, HITS, replace=False)
        out.ravel()[where] += rng.uniform(0.1, 1.0, HITS) * clean.top
        return np.minimum(out, clean.top)

    return clean.changed(hit)


def focal(clean: Images, rng: np.random.Generator) -> Images:
    """A focal length that is too long."""
    off = FOCAL if rng.random() < 0.5 else 1.0 / FOCAL

    def longer(_: int, view: SiteView) -> SiteView:
        fx, fy, *principal = view.camera.params
        return replace(view, camera=replace(view.camera, params=(off * fx, off * fy, *principal)))

    return clean.with_views(longer)


def blur(clean: Images, rng: np.random.Generator) -> Images:
    """One image out of focus or smeared."""
    return clean.with_one(_any_view(clean, rng), blurred)


def blurred(pixels: np.ndarray, sigma_px: float = BLUR_PX) -> np.ndarray:
    """Pixels as an image out of focus has them."""
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(pixels, sigma_px, mode="nearest")


def wide_optics(clean: Images, rng: np.random.Generator) -> Images:
    """All images are less sharp than the optics are said to be."""
    more = OPTICS_PX * np.sqrt(WIDER**2 - 1.0)
    return clean.changed(lambda pixels: blurred(pixels, more))


def one_sun(clean: Images, rng: np.random.Generator) -> Images:
    """One Sun in a wrong direction."""
    wrong, off = _any_view(clean, rng), rng.uniform(0.0, 2.0 * np.pi)

    def turned(k: int, view: SiteView) -> SiteView:
        if k != wrong:
            return view
        axis = np.array([np.cos(off), np.sin(off)]) @ tangent_basis(view.sun).T
        return replace(view, sun=so3_exp(np.deg2rad(SUN_OFF_DEG) * axis) @ view.sun)

    return clean.with_views(turned)


def all_suns(clean: Images, rng: np.random.Generator) -> Images:
    """A common error of all Suns, as by an unknown alignment of the camera."""
    axis = rng.normal(size=3)
    turn = so3_exp(np.deg2rad(SUN_OFF_DEG) * axis / np.linalg.norm(axis))
    return clean.with_views(lambda _, view: replace(view, sun=turn @ view.sun))


def stray_light(clean: Images, rng: np.random.Generator) -> Images:
    """A veil of even light, as much in every image."""
    return clean.changed(lambda pixels: np.minimum(pixels + STRAY * pixels.mean(), clean.top))


def flat_field(clean: Images, rng: np.random.Generator) -> Images:
    """The detector's gain is uneven; the same for all images."""
    from scipy.ndimage import gaussian_filter

    uneven = gaussian_filter(rng.normal(size=clean.pixels[0].shape), FLAT_FIELD_PX / 2.0, mode="wrap")
    return clean.changed(lambda pixels: pixels * (1.0 + FLAT_FIELD * uneven / uneven.std()))


def gradient(clean: Images, rng: np.random.Generator) -> Images:
    """One image is brighter on one side: scattered light, or film developed unevenly."""
    k, off = _any_view(clean, rng), rng.uniform(0.0, 2.0 * np.pi)

    def tilted(pixels: np.ndarray) -> np.ndarray:
        x, y, _ = _from_centre(pixels.shape)
        along = (np.cos(off) * x + np.sin(off) * y) / (max(pixels.shape) / 2.0)
        return np.minimum(pixels * (1.0 + GRADIENT * along), clean.top)

    return clean.with_one(k, tilted)


FAULTS: dict[str, Fault] = {
    "jpeg": jpeg,
    "gamma": gamma,
    "distortion": distortion,
    "vignetting": vignetting,
    "hits": hits,
    "focal": focal,
    "blur": blur,
    "wide-optics": wide_optics,
    "one-sun": one_sun,
    "all-suns": all_suns,
    "stray-light": stray_light,
    "flat-field": flat_field,
    "gradient": gradient,
}


def read_images(site: Site) -> Images:
    """A site's images. Those of 8 or 16 bits can hold what their type can, others what the brightest has."""
    raw = [_read(view.image) for view in site.views]
    integer = np.issubdtype(raw[0].dtype, np.integer)
    top = float(np.iinfo(raw[0].dtype).max) if integer else float(max(np.nanmax(each) for each in raw))
    return Images(site=site, pixels=tuple(each.astype(float) for each in raw), top=top)


def write_spoiled(images: Images, clean: Site, folder: Path, region: RegionRequest | None = None) -> Path:
    """The site.toml of a site with these images, in a folder that is emptied first. region: in place of the site's."""
    shutil.rmtree(folder, ignore_errors=True)
    write_images(images, clean, folder)
    site_file = folder / "site.toml"
    write_site(site_file, replace(images.site, region=region or images.site.region, path=site_file))
    return site_file


def write_images(images: Images, clean: Site, folder: Path) -> None:
    """The images below a folder, under their names and in their formats."""
    import cv2

    from photoclinometry.io.images import write_fits

    for view, pixels in zip(clean.views, images.pixels, strict=True):
        file = folder / view.name
        if file.suffix == ".fits":
            write_fits(file, pixels.astype(np.float32))
        else:
            file.parent.mkdir(parents=True, exist_ok=True)
            kind = _read(view.image).dtype
            cv2.imwrite(str(file), np.clip(np.round(pixels), 0, np.iinfo(kind).max).astype(kind))


def _read(path: Path) -> np.ndarray:
    """(height, width) as the file has it."""
    import cv2
    from astropy.io import fits

    if path.suffix == ".fits":
        with fits.open(path) as content:
            return np.array(content[0].data)
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(f"{path}: not an image")
    return pixels if pixels.ndim == 2 else pixels[..., 0]


def _from_centre(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x and y of pixels from the centre [px], and their distance, which is 1 at the corners."""
    y, x = (np.arange(size) + 0.5 - size / 2.0 for size in shape)
    x, y = np.meshgrid(x, y)
    return x, y, np.hypot(x, y) / (np.hypot(*shape) / 2.0)


def _any_view(clean: Images, rng: np.random.Generator) -> int:
    return int(rng.integers(len(clean.pixels)))
