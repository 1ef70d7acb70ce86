"""The stages from images to poses, and from poses to the place that is mapped."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.io.site import RegionRequest, Site
from photoclinometry.io.site_images import first_of, input_fingerprint, load_plausible_images
from photoclinometry.io.site_views import views_at
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.region import Region
from photoclinometry.model.scene import OWN, Views
from photoclinometry.model.sparse import SparseModel, among_more_views, without_views
from photoclinometry.model.warning import warn
from photoclinometry.photometry.inconsistent_views import InconsistentViews, find_inconsistent_views
from photoclinometry.pipeline.folder.run_folder import RunFolder
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, digest, say_found
from photoclinometry.sfm import SfmOptions, reconstruct_sparse
from photoclinometry.sfm.region import RegionOptions, choose_region

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """The measurements: images with their cameras and Sun directions."""

    site: Site
    """The site without region and pose priors, on which not all stages depend."""
    images: list[Image]
    """(K,) in the site's order."""
    unusable: Mapping[str, str] = field(default_factory=dict)
    """Views that show nothing, or whose brightness is impossible, by name, with the reason. No stage uses them."""

    @property
    def cameras(self) -> list[Camera]:
        return [view.camera for view in self.site.views]


@dataclass(frozen=True, kw_only=True)
class Place:
    """The place that is mapped."""

    reference: int
    """The reference view, among all of the site's."""
    region: Region


@dataclass(frozen=True, kw_only=True)
class PosedImages:
    """The images of a site, with rough poses of those that count as registered."""

    inputs: Keyed[Inputs]
    sparse: Keyed[SparseModel]
    frame: str = OWN
    """That of the sparse model, as of `Scene.frame`."""

    @property
    def views(self) -> Views:
        """(K,) all of the site's."""
        views = views_from(self.inputs.value.site, self.sparse.value)
        return replace(views, dark_level=np.array([image.dark_level for image in self.inputs.value.images]))

    @property
    def index(self) -> np.ndarray:
        """(K,) int: the number of each registered view when only these are counted, as in the scene."""
        return np.cumsum(self.sparse.value.registered) - 1

    @property
    def registered_images(self) -> list[Image]:
        """In the order of the scene's views."""
        return [self.inputs.value.images[k] for k in np.flatnonzero(self.sparse.value.registered)]

    def without(self, views: np.ndarray) -> PosedImages:
        """A copy in which some views (K,) bool count as not registered. The key does not depend on how they were
        found."""
        kept = Keyed(without_views(self.sparse.value, views), digest(self.sparse, views))
        return replace(self, sparse=kept)


@dataclass(frozen=True, kw_only=True)
class SparseReconstruction(Stage[SparseModel]):
    """Poses and sparse points of all views."""

    name = "sparse"
    result = SparseModel
    inputs: Keyed[Inputs]
    options: SfmOptions

    def make(self, tools: Tools) -> SparseModel:
        inputs = self.inputs.value
        used = np.array([image.name not in inputs.unusable for image in inputs.images])
        images = [inputs.images[k] for k in np.flatnonzero(used)]
        cameras = [inputs.cameras[k] for k in np.flatnonzero(used)]
        sun = inputs.site.sun_in_cam[used]
        found = reconstruct_sparse(images, cameras, tools.scratch, self.options, tools.progress, sun)
        say_found(
            f"{found.registered.sum()} of {len(inputs.images)} views, {len(found.points):,} points, "
            f"{found.mean_reprojection_px:.2f} px"
        )
        return among_more_views(found, used, [inputs.unusable.get(image.name, "") for image in inputs.images])


@dataclass(frozen=True, kw_only=True)
class ViewCheck(Stage[InconsistentViews]):
    """Views whose Sun or content contradicts the brightness of the others."""

    name = "inconsistent_views"
    result = InconsistentViews
    posed: PosedImages
    reflectance: Reflectance

    def make(self, tools: Tools) -> InconsistentViews:
        inputs, sparse = self.posed.inputs.value, self.posed.sparse.value
        found = find_inconsistent_views(
            sparse, inputs.images, self.posed.views, self.reflectance, inputs.site.brightness
        )
        say_found(f"{found.left_out.sum()} of {sparse.registered.sum()} views contradict the others")
        return found


@dataclass(frozen=True, kw_only=True)
class ChooseRegion(Stage[Place]):
    """The reference view and the region of its image to map."""

    name = "region"
    result = Place
    posed: PosedImages
    request: RegionRequest | None
    """What the site asks for."""
    options: RegionOptions

    def make(self, tools: Tools) -> Place:
        inputs, sparse, sun = self.posed.inputs.value, self.posed.sparse.value, self.posed.views.sun
        reference, region = choose_region(sparse, inputs.images, inputs.cameras, sun, self.request, self.options)
        say_found(f"{region.width} x {region.height} px of {self.posed.views.name[reference]}")
        return Place(reference=reference, region=region)


def read_inputs(folder: RunFolder, site: Site) -> Keyed[Inputs]:
    """The images of a site, with a digest of their content and of the site's statements about them.

    Views that show nothing, or whose brightness cannot be that of ground, are named, to be left out. Raises SiteError,
    ImageError.
    """
    alone = without_priors(site)
    with folder.timed("images"):
        found = load_plausible_images(alone, folder.progress)
        say_found(f"{len(found.images)} of {site.name}")
    for name, reason in found.empty.items():
        warn(log, "view-empty", "%s is left out: %s", name, reason, view=name)
    for name, reason in found.impossible.items():
        warn(log, "brightness-impossible", "%s is left out: %s", name, reason, view=name)
    if found.compressed:
        warn(
            log, "image-compressed",
            "%d of %d images show the blocks of JPEG (%s): compression takes the shading of single pixels, and "
            "surfaces were up to four times as far from the truth. Get images that were compressed without loss",
            len(found.compressed), len(found.images), first_of(found.compressed),
        )  # fmt: skip
    unusable = found.empty | found.impossible
    return Keyed(Inputs(site=alone, images=found.images, unusable=unusable), input_fingerprint(alone))


def without_priors(site: Site) -> Site:
    """The site without region and pose priors, on which not all stages depend."""
    return replace(site, region=None, views=tuple(replace(view, pose_prior=None) for view in site.views))


@dataclass(frozen=True, kw_only=True)
class ChosenViews:
    """The views that a map is made from, and remarks on the others."""

    used: PosedImages
    left_out: dict[str, str]
    """Names of the others except held-out ones, with the reason why they are left out."""
    doubtful: tuple[str, ...] = ()
    """Names of used views whose Suns the sparse points contradict."""


def choose_views(
    folder: RunFolder, posed: PosedImages, held_out: np.ndarray, reflectance: Reflectance | None
) -> ChosenViews:
    """The views that the map is made of.

    Left out are views that did not register, or that contradict the others. held_out: (K,) bool. reflectance: None
    where views are not checked.
    """
    names = posed.views.name
    unregistered = posed.sparse.value.why_unregistered()
    left_out = {names[k]: reason for k, reason in unregistered.items() if not held_out[k]}
    used = posed.without(held_out)
    if reflectance is None:
        return ChosenViews(used=used, left_out=left_out)
    found = folder.result_of(ViewCheck(posed=used, reflectance=reflectance)).value
    return ChosenViews(
        used=posed.without(held_out | found.left_out),
        left_out=left_out | {names[k]: str(found.reason[k]) for k in np.flatnonzero(found.left_out)},
        doubtful=tuple(names[k] for k in np.flatnonzero(found.doubtful)),
    )


def check_reference(site: Site, left_out: Mapping[str, str]) -> None:
    """Raises InputError where the reference view that the site names is left out."""
    chosen = site.region.reference if site.region else None
    if chosen is not None and chosen in left_out:
        raise InputError(
            f"{site.path}: region: reference: {chosen!r} is left out: {left_out[chosen]}; or name another view"
        )


def views_from(site: Site, sparse: SparseModel) -> Views:
    """All K views of the site with the poses of the sparse model, in the site's order."""
    return views_at(site, sparse.body_from_cam)
