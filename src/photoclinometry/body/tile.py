"""One tile of a body: a run folder made by the stages of `phomo run`, from poses and a shape that are known."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from photoclinometry.body.coarse_shape import ClosedMesh
from photoclinometry.body.options import BodyOptions
from photoclinometry.body.plan import Plan, Tile
from photoclinometry.body.sparse import PoseCovariances
from photoclinometry.io.site import RegionRequest, Site
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.projection import projected_keypoints
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.model.sparse import SparseModel, normalised, of_views
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.choices import choose
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.posed_site import KnownViews, PosedSite
from photoclinometry.pipeline.products import RunResult
from photoclinometry.pipeline.run import map_posed
from photoclinometry.pipeline.run_folder import claimed_run
from photoclinometry.pipeline.run_owner import owner_of_site
from photoclinometry.pipeline.sparse_stages import Inputs, PosedImages, read_inputs
from photoclinometry.pipeline.stage import Keyed, Stage, Tools, digest, program_digest, say_found
from photoclinometry.surface.mesh_rays import MeshRays, depth_image, emission_image

log = logging.getLogger(__name__)

KNOWN_PX = 2.0
"""How well the body's sparse model knows where a view shows what [px]: first matches may be that far from epipolar
lines."""
STEPS = 100
"""Steps of the last estimate at most: of 60 tiles of 5 to 12 views 24 needed more than 30."""
TIE_STEP_PX = 8
"""Every so many pixels, down and across, a tile gives a tie point for the cameras that tiles share."""
MARGIN_DEG = 8.0
"""The coarse shape's slopes are wrong by so much [degrees]: ground is masked only beyond the plan's limit and this."""


@dataclass(frozen=True, kw_only=True)
class BodyModel:
    """What all tiles of a body share."""

    site: Site
    posed: PosedImages
    known: Keyed[PoseCovariances]
    shape: Keyed[ClosedMesh]
    plan: Keyed[Plan]
    options: BodyOptions

    @property
    def unit(self) -> str | None:
        """Of lengths in the body's frame; None where that is of the images alone."""
        return "m" if self.posed.frame == BODY_FIXED else None


def tile_folder(body: Path, number: int) -> Path:
    """The run folder of a tile."""
    return Path(body) / "tiles" / f"{number:04d}"


def tile_site(model: BodyModel, tile: Tile) -> Site:
    """The tile's views and its region. Without pose priors: the map is that of its images alone."""
    region = tile.region
    request = RegionRequest(
        reference=model.site.views[tile.reference].name,
        center_px=(region.col + region.width / 2, region.row + region.height / 2),
        size_px=(region.width, region.height),
    )
    views = tuple(replace(model.site.views[k], pose_prior=None) for k in tile.views)
    return replace(model.site, views=views, region=request)


@dataclass(frozen=True, kw_only=True)
class TiePoints:
    """Some landmarks of a tile with their keypoints (compressed rows), by which all tiles share their cameras."""

    landmark: np.ndarray
    """(m,) int: which of the tile's."""
    start: np.ndarray
    """(m + 1,) int64."""
    view: np.ndarray
    """(N,) int32, of all views of the body."""
    keypoint: np.ndarray
    """(N, 2) [px] where the tile's own poses see the landmarks."""


@dataclass(frozen=True, kw_only=True)
class TileMap:
    """What the body takes from a tile: its n landmarks, in a frame B of the tile's own or in the body's."""

    position: np.ndarray
    """(n, 3)."""
    normal: np.ndarray
    """(n, 3)."""
    albedo: np.ndarray
    """(n,)."""
    height_sigma: np.ndarray
    """(n,) along the normal [units of B]; like the other two infinite where the images do not determine it, and NaN
    where the map states none."""
    normal_sigma: np.ndarray
    """(n,) of the angle [rad]."""
    albedo_sigma: np.ndarray
    """(n,) as a share of the albedo."""
    views: np.ndarray
    """(n,) int: in how many images."""
    weight: np.ndarray
    """(n,) how much a landmark counts beside those of other tiles, but for its sigma: from 0 at the tile's edge to 1 in
    its middle, times the squared cosine of emission. Maps are worse at their edges, and where the reference sees the
    ground obliquely: errors of slopes grow from 5 degrees at 40 degrees of emission to 15 at 75, twice as fast as
    stated."""
    pixel: np.ndarray
    """(n, 2) row and column in the reference image."""
    ties: TiePoints
    gsd: float
    """[units of B]."""
    reflectance: Reflectance | None = None
    """As the tile's images have it."""
    distrust: tuple[str, ...] = ()
    """Why the tile is not to be trusted; empty where it is."""
    failure: str = ""
    """Why there is no map; n is 0 then."""


@dataclass(frozen=True, kw_only=True)
class MapTile(Stage[TileMap]):
    """One tile, mapped in a run folder of its own; what a stopped call has finished there is used again."""

    name = "tile"
    result = TileMap
    number: int
    model: BodyModel
    body: Keyed[Path]
    """The body's folder."""

    @property
    def file_name(self) -> str:
        return f"tile_{self.number:04d}"

    @property
    def key(self) -> str:
        model, tile = self.model, self.model.plan.value.tiles[self.number]
        return digest(
            program_digest(), self.name, tile, model.posed, model.known, model.shape, model.options.run,
            model.options.plan,
        )  # fmt: skip

    def make(self, tools: Tools) -> TileMap:
        tile = self.model.plan.value.tiles[self.number]
        try:
            found = map_tile(self.body.value, self.model, self.number, tools.progress)
        except ReconstructionError as error:
            warn(log, "tile-failed", "tile %d is not mapped: %s", self.number, error)
            return _no_map(tile, str(error))
        for why in found.distrust:
            warn(log, "tile-untrusted", "tile %d is not to be trusted: %s", self.number, why)
        say_found(f"{len(found.scene.landmarks):,} landmarks")
        number = {view.name: k for k, view in enumerate(self.model.site.views)}
        return tile_map(found.scene, np.array([number[name] for name in found.scene.views.name]), found.distrust)


def tile_map(scene: Scene, number: np.ndarray, distrust: tuple[str, ...]) -> TileMap:
    """What the body takes from a tile's scene. number: (K,) what the scene's views are among all of the body."""
    landmarks, stated = scene.landmarks, scene.uncertainty
    row, col = landmarks.pixel.T
    edge = np.minimum(
        np.minimum(row - scene.region.row, scene.region.row + scene.region.height - 1 - row),
        np.minimum(col - scene.region.col, scene.region.col + scene.region.width - 1 - col),
    )
    towards = unit(scene.views.body_from_cam.translation[scene.reference] - landmarks.position)
    facing = np.maximum(np.sum(towards * landmarks.normal, -1), 0.0)
    unknown = np.full(len(landmarks), np.nan)
    along = np.einsum("ni,nij,nj->n", landmarks.normal, stated["position"], landmarks.normal) if stated else unknown
    normal = np.trace(stated["normal"], axis1=1, axis2=2) if "normal" in stated else unknown
    return TileMap(
        position=landmarks.position,
        normal=landmarks.normal,
        albedo=landmarks.albedo,
        height_sigma=_root(along),
        normal_sigma=_root(normal),
        albedo_sigma=stated["albedo"] / landmarks.albedo if "albedo" in stated else unknown,
        views=np.diff(scene.tracks.start),
        weight=np.clip(2.0 * (edge + 1) / min(scene.region.width, scene.region.height), 0.0, 1.0) * facing**2,
        pixel=landmarks.pixel,
        ties=_ties(scene, number),
        gsd=scene.gsd,
        reflectance=scene.reflectance,
        distrust=distrust,
    )


def _ties(scene: Scene, number: np.ndarray) -> TiePoints:
    chosen = np.flatnonzero((scene.landmarks.pixel % TIE_STEP_PX == TIE_STEP_PX // 2).all(-1))
    tracks, picked = scene.tracks.of_landmarks(chosen)
    keypoint = projected_keypoints(scene)[picked]
    return TiePoints(landmark=chosen, start=tracks.start, view=number[tracks.view].astype(np.int32), keypoint=keypoint)


def _no_map(tile: Tile, failure: str) -> TileMap:
    none = np.empty(0)
    return TileMap(
        position=np.empty((0, 3)),
        normal=np.empty((0, 3)),
        albedo=none,
        height_sigma=none,
        normal_sigma=none,
        albedo_sigma=none,
        views=np.empty(0, int),
        weight=none,
        pixel=np.empty((0, 2), np.int32),
        ties=TiePoints(
            landmark=np.empty(0, int),
            start=np.zeros(1, np.int64),
            view=np.empty(0, np.int32),
            keypoint=np.empty((0, 2)),
        ),
        gsd=tile.gsd,
        failure=failure,
    )


def _root(variance: np.ndarray) -> np.ndarray:
    """Square roots; NaN of what is not known, or negative by rounding."""
    return np.sqrt(np.where(variance >= 0, variance, np.nan))


def map_tile(body: Path, model: BodyModel, number: int, progress: Progress = no_progress) -> RunResult:
    """Maps one tile into its folder. Raises what `pipeline.run.run` raises."""
    tile = model.plan.value.tiles[number]
    site, options = tile_site(model, tile), tile_options(model.options)
    config = {"tile": number, "body": str(Path(body).resolve()), **asdict(options)}
    with claimed_run(tile_folder(body, number), owner_of_site(site), progress) as folder:
        folder.write_config(config)
        inputs, sparse, rays = read_inputs(folder, site), _sparse(model, tile), _rays(model)
        ready = PosedSite(
            site=site,
            posed=PosedImages(inputs=_masked(inputs, model, tile, rays), sparse=sparse),
            choices=choose(site, options),
            options=options,
            depth=_depth(model, tile, sparse, rays),
            known_views=_known(model, tile, sparse),
        )
        return map_posed(folder, ready, config)


def tile_options(options: BodyOptions) -> RunOptions:
    """How a tile is mapped: matches may be as far from epipolar lines as poses are uncertain, and the estimate takes
    the steps that slow motions of few views need."""
    run, densify, solver = options.run, options.run.densify, options.run.adjust.solver
    return replace(
        run,
        pose_priors=False,
        densify=replace(
            densify,
            min_views=min(densify.min_views, options.plan.min_views),
            max_sampson_px2=max(densify.max_sampson_px2, KNOWN_PX**2),
        ),
        adjust=replace(run.adjust, solver=replace(solver, max_steps=max(solver.max_steps, STEPS))),
    )


def _masked(inputs: Keyed[Inputs], model: BodyModel, tile: Tile, rays: MeshRays) -> Keyed[Inputs]:
    """The inputs without the pixels of the reference that see ground too obliquely to be mapped from there."""
    limit = model.options.plan.max_emission + MARGIN_DEG
    k, index = tile.reference, int(np.flatnonzero(tile.views == tile.reference)[0])
    pose = model.posed.sparse.value.body_from_cam[k]
    oblique = emission_image(rays, model.site.views[k].camera, pose) > np.radians(limit)
    images = list(inputs.value.images)
    images[index] = replace(images[index], valid=images[index].valid & ~oblique)
    return Keyed(replace(inputs.value, images=images), digest(inputs, model.shape, model.posed.sparse, k, limit))


def _rays(model: BodyModel) -> MeshRays:
    shape = model.shape.value
    return MeshRays(shape.vertices, shape.faces, shape.spacing)


def _sparse(model: BodyModel, tile: Tile) -> Keyed[SparseModel]:
    """The sparse model of the tile's views alone, in the frame of a site's model."""
    whole = model.posed.sparse
    own = normalised(of_views(whole.value, tile.views), [model.site.views[k].camera for k in tile.views])
    return Keyed(own, digest(whole, tile.views))


def _depth(model: BodyModel, tile: Tile, sparse: Keyed[SparseModel], rays: MeshRays) -> Keyed[np.ndarray]:
    """The coarse shape as the tile's reference sees it, in the unit of the tile's sparse model."""
    k, whole = tile.reference, model.posed.sparse.value.body_from_cam
    depth = depth_image(rays, model.site.views[k].camera, whole[k])
    return Keyed(_scale(model, tile, sparse) * depth, digest(model.shape, model.posed.sparse, tile.views, k))


def _known(model: BodyModel, tile: Tile, sparse: Keyed[SparseModel]) -> KnownViews:
    """The body's poses with their uncertainties, about that of the reference, in the frame of the tile's model."""
    length = np.repeat([1.0, _scale(model, tile, sparse)], 3)
    own = model.known.value.covariance[tile.views] * np.outer(length, length)
    return KnownViews(
        name=tuple(model.site.views[k].name for k in tile.views),
        body_from_cam=sparse.value.body_from_cam,
        covariance=2.0 * own,  # the reference, which the frame holds, is about as uncertain
    )


def _scale(model: BodyModel, tile: Tile, sparse: Keyed[SparseModel]) -> float:
    """Units of the body's frame times this are units of the tile's model."""
    return _spread(sparse.value.body_from_cam) / _spread(model.posed.sparse.value.body_from_cam[tile.views])


def _spread(poses: Rigid) -> float:
    """How far apart camera centres are, RMS: a length that no frame's axes change."""
    return float(np.linalg.norm(poses.translation - poses.translation.mean(0)))
