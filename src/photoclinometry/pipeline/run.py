"""The whole of it: a site in, a map out. `run` reads like the list of stages in DESIGN.md."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, field, fields, replace
from pathlib import Path
from typing import Literal

import numpy as np

from photoclinometry import __version__
from photoclinometry.adjust import AdjustOptions, TiePoints
from photoclinometry.evaluate.held_out import Resected, held_out_mask, held_out_views, resect_views, views_in_frame_of
from photoclinometry.io import held_out as held_out_file
from photoclinometry.io.site import Site, read_site
from photoclinometry.io.site_images import input_fingerprint, load_images
from photoclinometry.matching.densify import DenseTracks, DensifyOptions, densify
from photoclinometry.matching.flow import FlowMatcher, FlowOptions
from photoclinometry.matching.interface import MARGIN_PX, Matcher, padded_region, request_match
from photoclinometry.matching.roma import RomaOptions, fingerprint, roma_matcher
from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import ModelChoice, Reflectance, has_published, published, starting_model
from photoclinometry.model.scene import Image, Landmarks, Region, Scene, Tracks, Views
from photoclinometry.model.sparse import SparseModel, without_views
from photoclinometry.photometry.inconsistent_views import InconsistentViews, find_inconsistent_views
from photoclinometry.photometry.initialize import (
    initial_albedo,
    landmark_spacing_px,
    normals_from_neighbours,
    sample_brightness,
)
from photoclinometry.pipeline.estimator import Estimator
from photoclinometry.pipeline.pose_priors import enough, prior_fingerprint
from photoclinometry.pipeline.products import Progress, RunResult, write_config, write_products
from photoclinometry.pipeline.relighting import RelightOptions, adjust_in_rounds
from photoclinometry.pipeline.run_folder import RunFolder, digest, open_run
from photoclinometry.sfm import SfmOptions, reconstruct_sparse
from photoclinometry.sfm.region import RegionOptions, choose_region
from photoclinometry.surface.depth_fit import landmark_depth, sparse_depth
from photoclinometry.surface.surroundings import surroundings_of

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Everything that shapes a run. Every field has a default that suits most sites."""

    reflectance: ModelChoice = "auto"
    """Reflectance model. auto: lunar-lambert where brightness is I/F and the body has published coefficients, else
    mcewen. none: geometry alone (dense structure from motion)."""
    match_rounds: int = 2
    """Times that the views are matched before the first map: after a pre-warp by the sparse surface, then by the dense
    one."""
    matcher: Literal["relight", "flow", "roma"] = "relight"
    """relight: with a first map, match the views again, each with the reference relit for it, and adjust again. flow:
    leave it at the first map, whose matches are of optical flow on the images themselves. roma: as relight, but the
    first map's matches are RoMa's (--roma.weights, --roma.dinov2); with --relight.rounds 0 it is left at them."""
    hold_out: tuple[str, ...] = ()
    """Views to leave out of the map, and measure it on: only their poses are found, from the finished map."""
    pose_priors: bool = True
    """Where three views or more have pose priors (`cam_from_body`), put the map into their frame, body-fixed and in
    metres, and let them have their say in the estimate."""
    check_views: bool = True
    """Leave out views whose Sun direction, or what they show, contradicts the brightness of the others."""
    sfm: SfmOptions = field(default_factory=SfmOptions)
    region: RegionOptions = field(default_factory=RegionOptions)
    flow: FlowOptions = field(default_factory=FlowOptions)
    roma: RomaOptions = field(default_factory=RomaOptions)
    relight: RelightOptions = field(default_factory=RelightOptions)
    densify: DensifyOptions = field(default_factory=DensifyOptions)
    adjust: AdjustOptions = field(default_factory=AdjustOptions)


@dataclass(frozen=True, kw_only=True)
class _Place:
    """The reference view, among all views, and the region, as a stage's result."""

    reference: int
    region: np.ndarray
    """row, col, height, width, stride."""


def run(site_file: Path, out: Path, options: RunOptions | None = None, progress: Progress | None = None) -> RunResult:
    """Maps a site: from `site.toml` and images to everything in the run folder `out`.

    A folder that holds part of the same run is gone on with. Raises InputError (what was given is wrong) and
    ReconstructionError (the images do not determine a map).
    """
    options = options or RunOptions()
    report_progress = progress or (lambda what, done, total: None)
    site = read_site(site_file)
    chosen = site.region.reference if site.region else None
    held_out = held_out_mask([view.name for view in site.views], options.hold_out, chosen)
    reflectance = choose_reflectance(options.reflectance, site.brightness, site.body)
    matcher = first_matcher(options)
    folder = open_run(out)
    config = {"site": str(Path(site_file).resolve()), **asdict(options)}
    write_config(folder, config)
    with folder.timed("images"):
        images = load_images(site, lambda done, total: report_progress("images", done, total))
    cameras = [view.camera for view in site.views]

    key = digest("sparse", __version__, input_fingerprint(_images_alone(site)), options.sfm)
    sparse: SparseModel = folder.stage(
        "sparse",
        key,
        lambda: reconstruct_sparse(
            images, cameras, folder.path / "stages" / "sfm", options.sfm, report_progress, site.sun_in_cam
        ),
        SparseModel,
    )
    views = views_from(site, sparse)
    left_out = {views.name[k]: reason for k, reason in sparse.why_unregistered().items()}
    held = np.flatnonzero(held_out & sparse.registered)
    sparse = without_views(sparse, held_out)
    if options.check_views and reflectance is not None:
        misfits_key = digest("misfits", key, sorted(options.hold_out), options.reflectance)
        misfits: InconsistentViews = folder.stage(
            "misfits",
            misfits_key,
            lambda: find_inconsistent_views(sparse, images, views, reflectance, site.brightness),
            InconsistentViews,
        )
        left_out |= {views.name[k]: str(misfits.reason[k]) for k in np.flatnonzero(misfits.left_out)}
        sparse = without_views(sparse, misfits.left_out)
    if chosen in left_out:
        raise InputError(f"region.reference {chosen!r} is left out: {left_out[chosen]}; or name another view")

    key = digest("region", key, site.region, options.region, sorted({*options.hold_out, *left_out}))
    place = folder.stage("region", key, lambda: _choose_place(site, sparse, images, views, options), _Place)
    region = Region(**{f.name: int(value) for f, value in zip(fields(Region), place.region, strict=True)})

    learned = (fingerprint(options.roma),) if options.matcher == "roma" else ()
    key = digest("dense", key, options.match_rounds, options.flow, options.densify, *learned)
    dense: DenseTracks = folder.stage(
        "dense",
        key,
        lambda: match_and_densify(
            sparse, images, views, int(place.reference), region, matcher, options, report_progress
        ),
        DenseTracks,
    )

    with folder.timed("initialise"):
        scene = initial_scene(site, sparse, images, views, int(place.reference), region, dense, reflectance)
    key = digest("adjust", key, options.reflectance, options.adjust, options.relight.slack)
    priors = enough(site.pose_priors, scene) if options.pose_priors else {}
    if priors:
        key = digest(key, prior_fingerprint(priors))
    estimator = Estimator(
        options=options.adjust,
        anchors=anchors_from(sparse),
        views=views,
        reflectance=reflectance,
        priors=priors,
        progress=report_progress,
    )
    adjustment, rounds = adjust_in_rounds(
        folder,
        key,
        scene,
        [image for image, there in zip(images, sparse.registered, strict=True) if there],
        estimator,
        replace(options.relight, rounds=0) if options.matcher == "flow" else options.relight,
        options.flow,
        options.densify,
        report_progress,
    )
    key = digest("held out", key, options.flow, options.matcher, options.relight)
    rough = views_in_frame_of(adjustment.scene, views) if priors else views
    aside = _resect_or_read(folder, key, adjustment.scene, rough, held, images, options)
    brought_in = {views.name[k]: how for k, how in sparse.how_brought_in().items()}
    return write_products(folder, adjustment, images, config, left_out, brought_in, aside, rounds, priors)


def _images_alone(site: Site) -> Site:
    """The site without what the sparse stage does not look at, so that it is not done again for that."""
    return replace(site, region=None, views=tuple(replace(view, pose_prior=None) for view in site.views))


def first_matcher(options: RunOptions) -> Matcher:
    """What finds the matches of the first map. Raises InputError where its weights or packages are missing."""
    return roma_matcher(options.roma) if options.matcher == "roma" else FlowMatcher(options.flow)


def choose_reflectance(name: str, brightness: str, body: str | None) -> Reflectance | None:
    """The reflectance model that `RunOptions.reflectance` means for a site's brightness and body; None for geometry
    alone."""
    if name == "none":
        return None
    if name != "auto":
        return starting_model(name, body)
    calibrated = brightness == "iof" and has_published("lunar-lambert", body)
    chosen = "lunar-lambert" if calibrated else "mcewen"
    log.info("reflectance: %s", chosen)
    return published(chosen, body)


def views_from(site: Site, sparse: SparseModel) -> Views:
    """All K views of the site with the poses of the sparse model, in the site's order."""
    count, sun_in_cam = len(site.views), site.sun_in_cam
    return Views(
        name=tuple(view.name for view in site.views),
        cameras=tuple(view.camera for view in site.views),
        body_from_cam=sparse.body_from_cam,
        sun=np.einsum("kij,kj->ki", sparse.body_from_cam.rotation, sun_in_cam),
        scale=np.ones(count),
        bias=np.zeros(count),
        sun_measured=sun_in_cam,
        sun_sigma=np.array([view.sun_sigma_rad for view in site.views]),
    )


def _choose_place(site: Site, sparse: SparseModel, images, views: Views, options: RunOptions) -> _Place:
    reference, region = choose_region(sparse, images, list(views.cameras), views.sun, site.region, options.region)
    return _Place(reference=reference, region=np.array(astuple(region)))


def match_and_densify(
    sparse: SparseModel,
    images: Sequence[Image],
    views: Views,
    reference: int,
    region: Region,
    matcher: Matcher,
    options: RunOptions,
    progress: Progress,
) -> DenseTracks:
    """Landmarks and their tracks: every registered view matched with the reference, as often as `match_rounds` says.

    Each round starts from the surface of the one before, so that what is left to match is small and undistorted.
    """
    cameras = list(views.cameras)
    padded = padded_region(region, MARGIN_PX, cameras[reference])
    depth = sparse_depth(sparse, reference, padded, cameras[reference])
    targets = [int(k) for k in np.flatnonzero(sparse.registered) if k != reference]
    dense = None
    for round_ in range(max(1, options.match_rounds)):
        matches = {}
        for done, target in enumerate(targets):
            progress(f"match {round_ + 1}", done, len(targets))
            request = request_match(
                list(images), cameras, views.body_from_cam, reference, target, region, padded, depth
            )
            matches[target] = matcher.match(request)
        progress(f"match {round_ + 1}", len(targets), len(targets))
        dense = densify(region, reference, matches, cameras, views.body_from_cam, options.densify)
        pose = views.body_from_cam[reference]
        depth = landmark_depth(dense.position, dense.pixel, pose, padded, cameras[reference])
    assert dense is not None
    return dense


def initial_scene(
    site: Site,
    sparse: SparseModel,
    images: Sequence[Image],
    views: Views,
    reference: int,
    region: Region,
    dense: DenseTracks,
    reflectance: Reflectance | None,
) -> Scene:
    """The scene at which the joint estimate starts: registered views only, first normals, albedos and scales."""
    kept = np.flatnonzero(sparse.registered)
    new_index = np.cumsum(sparse.registered) - 1
    registered, own = views[kept], int(new_index[reference])
    spacing = landmark_spacing_px(registered, dense.position, own)
    brightness, lit = sample_brightness(
        [images[k] for k in kept.tolist()], new_index[dense.view], dense.keypoint, spacing_px=spacing
    )
    # Planes through about the same ground at any stride: 32 px, but 3 x 3 landmarks at least.
    count = max(9, 32 // region.stride**2)
    normal = normals_from_neighbours(dense.position, registered.body_from_cam.translation, count)
    tracks = Tracks(
        start=dense.start,
        view=new_index[dense.view].astype(np.int32),
        keypoint=dense.keypoint,
        keypoint_sigma=dense.keypoint_sigma,
        brightness=brightness,
        lit=lit,
    )
    albedo = np.ones(len(normal))
    if reflectance is not None:
        free = site.brightness == "dn" or not reflectance.predicts_absolute_brightness
        albedo, scale, _ = initial_albedo(dense.position, normal, tracks, registered, reflectance, own, free)
        registered = replace(registered, scale=scale)
    return Scene(
        name=site.name,
        body=site.body,
        brightness=site.brightness,
        reflectance=reflectance,
        views=registered,
        landmarks=Landmarks(position=dense.position, normal=normal, albedo=albedo, pixel=dense.pixel),
        tracks=tracks,
        reference=own,
        region=region,
        surroundings=surroundings_of(sparse, reference, region, dense.position, dense.pixel, views.cameras[reference]),
    )


def anchors_from(sparse: SparseModel) -> TiePoints:
    """The sparse points of the whole images, with their views counted among the registered ones.

    Their keypoints' sigma is the mean reprojection error, a tenth of a pixel at least.
    """
    count = len(sparse.point_view)
    new_index = np.cumsum(sparse.registered) - 1
    return TiePoints(
        position=sparse.points,
        tracks=Tracks(
            start=sparse.point_start,
            view=new_index[sparse.point_view].astype(np.int32),
            keypoint=sparse.point_xy,
            keypoint_sigma=np.full(count, max(0.1, sparse.mean_reprojection_px)),
            brightness=np.zeros(count),
            lit=np.zeros(count, bool),
        ),
    )


def _resect_or_read(
    folder: RunFolder, key: str, scene: Scene, views: Views, held: np.ndarray, images, options: RunOptions
) -> Views | None:
    """The views (K',) held out, placed in the map's frame; None where there are none. Kept in held_out.json, too."""
    file = folder.path / held_out_file.NAME
    if not len(held):
        file.unlink(missing_ok=True)
        return None

    def make() -> Resected:
        return resect_views(scene, views, held, images, FlowMatcher(options.flow))

    found = held_out_views(views, folder.stage("held_out", key, make, Resected))
    held_out_file.write_held_out(file, found)
    return found
