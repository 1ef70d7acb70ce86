"""Two pictures of one texture, displaced by a smooth warp that is known, for matchers to find."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from photoclinometry.matching import MatchRequest
from photoclinometry.matching.interface import padded_region
from photoclinometry.model.camera import Camera
from photoclinometry.model.image import Image
from photoclinometry.model.region import Region

CAMERA = Camera("PINHOLE", 200, 200, (10_000.0, 10_000.0, 100.0, 100.0))
REGION = Region(row=50, col=50, height=100, width=100)
PADDED = padded_region(REGION, 24, CAMERA)


def texture(shape, seed=0, sigma=1.5):
    """Brightness of about one, with noise of `sigma` pixels and of four times as many."""
    noise = np.random.default_rng(seed).normal(size=shape)
    rough = gaussian_filter(noise, sigma) * sigma + gaussian_filter(noise, 4 * sigma) * 4 * sigma
    return (1.0 + 0.25 * rough / rough.std()).astype(np.float32)


def displaced(amplitude=1.5, gain=1.0, offset=0.0):
    """A reference, a target of which it is a smooth warp, and where the region's pixels truly lie in it.

    Interpolated by splines of fifth order, so that no matcher's own way of interpolating hides its error.
    """
    target = texture((240, 240))
    whole = Region.of_image(200, 200).pixel_centers()
    true = whole + 20.37
    true[..., 0] += amplitude * np.sin(whole[..., 1] / 17.0)
    true[..., 1] += amplitude * np.cos(whole[..., 0] / 23.0)
    warped = map_coordinates(target.astype(float), np.moveaxis(true[..., ::-1] - 0.5, -1, 0), order=5)
    reference = (gain * warped + offset).astype(np.float32)
    request = MatchRequest(
        reference=Image("a", reference, np.ones(reference.shape, bool)),
        target=Image("b", target, np.ones(target.shape, bool)),
        region=REGION,
        padded=PADDED,
        prediction=PADDED.pixel_centers() + 20.37,
    )
    return request, true[REGION.slices]


def error_px(matches, true):
    """Of the valid matches."""
    return np.linalg.norm(matches.position - true, axis=-1)[matches.valid]
