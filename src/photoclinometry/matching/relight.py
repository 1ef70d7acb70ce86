"""Matching against the relit reference: the reference image as it would look under each view's own Sun.

Once there is a map, a view's brightness is predicted up to small errors of geometry. The reference image is multiplied
by the ratio of two modelled brightnesses: that under the view's Sun and from its camera, and the reference's own. The
result is as sharp as the reference image, and differs from the view by geometry and noise, no longer by light. Optical
flow (`flow.py`), or any other matcher, compares the two. Where the reference is in shadow, the model alone is drawn.

On a site simulated with Hapke's model, the Sun moved by 13 to 40 degrees, keypoint errors after one iteration (median /
90th percentile) are 0.22 / 0.51 px for flow on the images, 0.12 / 0.28 px against the model alone, and 0.10 / 0.25 px
with the ratio.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from photoclinometry.matching.flow import FlowMatcher, resample
from photoclinometry.matching.interface import Matcher, Matches, MatchRequest
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Scene
from photoclinometry.model.threads import PARALLEL_LOOPS
from photoclinometry.photometry.render import landmark_brightness, sunlit_share
from photoclinometry.photometry.sampled_brightness import SHADOW_SHARE
from photoclinometry.surface.depth_fit import landmark_depth
from photoclinometry.surface.map_rays import MapRays
from photoclinometry.surface.relief import reference_depth

LEVEL_WINDOW_PX = 6.0
"""Standard deviation of the Gaussian in which the levels of two pictures are compared, to fill masked pixels of one
from the other [px]: about the window of a match."""

LIT_SHARE = 0.99
"""A landmark with less than this share of its surroundings in sunlight lies at a shadow's edge, and is masked."""

LEAST_SHARE = 0.02
"""Where less than this share of the window is known, the level of the whole picture is used [-]: a few pixels do not
determine a level."""


@dataclass(frozen=True)
class RelightMatcher:
    """Any matcher, against the relit reference (`interface.Matcher`); only for views of the scene."""

    scene: Scene
    """With a reflectance model. Its normals and albedos set how sharp the pictures are (`photometry.shading`)."""
    matcher: Matcher = field(default_factory=FlowMatcher)
    name: str = "relight"

    @property
    def in_threads(self) -> bool:
        return getattr(self.matcher, "in_threads", False)

    @cached_property
    def _relit(self) -> RelitReference:
        return RelitReference(self.scene)

    def match(self, request: MatchRequest) -> Matches:
        """Matches of the relit reference. Raises InputError for another target or region than the scene's."""
        scene = self.scene
        if request.target.name not in scene.views.name or request.region != scene.region:
            raise InputError(f"{request.target.name}: not a view of the scene to relight, or another region")
        with PARALLEL_LOOPS:  # made once, by such loops
            relit_reference = self._relit
        over_region = relit_reference(scene.views.name.index(request.target.name), request.reference)
        relit, known = on_padded(*over_region, request)
        brightness, valid = resample(request.target, request.prediction)
        known &= valid
        if known.any():
            known &= brightness > SHADOW_SHARE * np.median(brightness[known])
        picture = fill_from(relit, known, brightness, LEVEL_WINDOW_PX)
        matches = self.matcher.match(replace(request, reference=_in_image(request, picture, valid)))
        return replace(matches, valid=matches.valid & known[request.inner])


def _in_image(request: MatchRequest, picture: np.ndarray, valid: np.ndarray) -> Image:
    """The reference image with another picture on the padded region."""
    image, region = request.reference, request.padded.slices
    brightness, mask = image.brightness.astype(np.float32), image.valid.copy()
    brightness[region], mask[region] = picture, valid
    return Image(image.name, brightness, mask)


class RelitReference:
    """The reference region as other views would see it.

        (image - bias) * modelled radiance in the view / modelled radiance in the reference

    Where the reference is in shadow it is scale * modelled radiance in the view. Between landmarks the model is
    interpolated; the image has a value at every pixel. Masked (False): no landmark, hidden from the view's camera, or
    in the view's shadow, attached or cast (by ray casting on the map).
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._rays = MapRays(scene)
        self._in_reference = self._modelled(scene.reference)

    def __call__(self, view: int, image: Image) -> tuple[np.ndarray, np.ndarray]:
        """Up to gain and offset: picture (h, w) float32, and mask (h, w). image: the reference's."""
        scene = self.scene
        reference, views = scene.reference, scene.views
        seen = self._rays.free_up_to(views.body_from_cam.translation[view])
        both = np.stack([np.where(seen, self._modelled(view), np.nan), self._in_reference], -1)
        modelled_view, modelled_reference = np.moveaxis(scene.region.between_cells(scene.grid(both)), -1, 0)
        measured = image.brightness[scene.region.slices] - views.bias[reference]
        row, col = scene.landmarks.pixel.T
        dark = SHADOW_SHARE * np.median(image.brightness[row, col] - views.bias[reference])
        usable = np.isfinite(modelled_reference) & image.valid[scene.region.slices] & (measured > dark)
        ratio = measured * modelled_view / np.where(usable, modelled_reference, 1.0)
        relit = np.where(usable, ratio, views.scale[reference] * modelled_view)
        mask = np.isfinite(relit)
        return np.where(mask, relit, 0.0).astype(np.float32), mask

    def _modelled(self, view: int) -> np.ndarray:
        """Modelled radiance (J,) of the landmarks in a view; NaN in shadow and at the edge of one."""
        radiance = landmark_brightness(self.scene, view, with_scale_and_bias=False)
        lit = self._rays.unoccluded_towards(self.scene.views.sun[view])
        return np.where(_in_light(radiance, sunlit_share(self.scene, lit)), radiance, np.nan)


def _in_light(radiance: np.ndarray, sunlit: np.ndarray) -> np.ndarray:
    """(J,) bool: neither in attached nor in cast shadow, nor at the edge of one."""
    return (radiance > SHADOW_SHARE * np.median(radiance)) & (sunlit > LIT_SHARE)


def on_padded(picture: np.ndarray, mask: np.ndarray, request: MatchRequest) -> tuple[np.ndarray, np.ndarray]:
    """A picture and its mask (h, w) over the region, zero and False on the margin around it."""
    around = np.zeros((2, request.padded.height, request.padded.width), np.float32)
    inner = request.region.slices_in(request.padded)
    around[0][inner], around[1][inner] = picture, mask
    return around[0], around[1] > 0


def fill_from(picture: np.ndarray, known: np.ndarray, other: np.ndarray, window: float) -> np.ndarray:
    """The picture (h, w) where it is known, elsewhere the `other` one with the picture's local level and contrast.

    Masked pixels filled so add no displacement between the two pictures: neither by themselves nor by an edge.
    window: standard deviation [px] of the Gaussian in which levels are compared.
    """
    import cv2

    def weighted(values: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(np.where(known, values, 0.0).astype(np.float32), (0, 0), window)

    if not known.any():
        return other
    share = weighted(np.ones_like(picture))
    picture_level, other_level = (
        np.where(share > LEAST_SHARE, weighted(v) / np.maximum(share, LEAST_SHARE), np.median(v[known]))
        for v in (picture, other)
    )
    spread = np.std(other[known] - other_level[known])
    contrast = np.std(picture[known] - picture_level[known]) / spread if spread > 0.0 else 0.0
    filled = picture_level + contrast * (other - other_level)
    return np.where(known, picture, filled).astype(np.float32)


def map_depth(scene: Scene, padded: Region) -> np.ndarray:
    """Depth (padded.height, padded.width) in the reference camera: at landmarks' pixels, that of the landmarks.

    Between landmarks it is a smooth surface through them plus its differences from the landmarks, interpolated; on the
    margin the smooth surface alone. A map's detail is kept, since it is no longer noise of single matches. padded: the
    scene's region with a margin.
    """
    landmarks, region, pose = scene.landmarks, scene.region, scene.views.body_from_cam[scene.reference]
    depth = landmark_depth(landmarks.position, landmarks.pixel, pose, padded, scene.views.cameras[scene.reference])
    at_landmarks = reference_depth(scene)
    row, col = (landmarks.pixel - (padded.row, padded.col)).T
    if region.stride > 1:
        difference = region.between_cells(scene.grid(at_landmarks - depth[row, col]))
        depth[region.slices_in(padded)] += np.nan_to_num(difference)
    depth[row, col] = at_landmarks
    return depth
