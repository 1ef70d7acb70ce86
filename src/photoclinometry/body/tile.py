"""One tile of a body: a run folder made by the stages of `phomo run`, from poses and a shape that are known."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.body.coarse_shape import ClosedMesh
from photoclinometry.body.options import BodyOptions
from photoclinometry.body.plan import Tile, TilePlan
from photoclinometry.body.sparse import PoseCovariances
from photoclinometry.body.tile_map import TileLandmarks, TileMap, TileTiePoints, tile_map
from photoclinometry.io.run_files import STAGES_FOLDER, TILES_FOLDER
from photoclinometry.io.site import RegionRequest, Site
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.model.sparse import SparseModel, normalised, of_views
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.choices import Choices, choose
from photoclinometry.pipeline.folder.run_folder import RunFolder, claimed_run
from photoclinometry.pipeline.folder.run_lock import check_lock
from photoclinometry.pipeline.folder.run_mark import remove
from photoclinometry.pipeline.folder.run_owner import owner_of_site
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, digest, program_digest, say_found
from photoclinometry.pipeline.model_choice import ChosenModel
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.posed_site import KnownViews, PosedSite
from photoclinometry.pipeline.products import RunResult
from photoclinometry.pipeline.run import map_posed
from photoclinometry.pipeline.sparse_stages import Inputs, PosedImages, read_inputs
from photoclinometry.pipeline.trust import NOT_LINEAR
from photoclinometry.surface.mesh_rays import MeshRays, depth_image, emission_image

log = logging.getLogger(__name__)

KNOWN_PX = 6.0
"""Largest error of projections by the body's sparse model [px]: first matches may be that far from epipolar lines. Rows
of images that few points join are off by 2 to 6; with 12 the maps are the same."""
MARGIN_DEG = 8.0
"""Error of the coarse shape's slopes [degrees]: ground is masked only beyond the plan's limit plus this."""


@dataclass(frozen=True, kw_only=True)
class BodyModel:
    """The inputs that all tiles of a body share."""

    site: Site
    posed: PosedImages
    known: Keyed[PoseCovariances]
    shape: Keyed[ClosedMesh]
    plan: Keyed[TilePlan]
    options: BodyOptions
    reflectance: Keyed[ChosenModel] | None = None
    """The reflectance model with which all tiles finish; None where it is given, or each tile is to choose."""

    @property
    def of_tiles(self) -> tuple[Any, ...]:
        """Inputs of a tile's map besides the tile; parts of `digest`."""
        return self.posed, self.known, self.shape, self.options.run, self.options.plan, self.reflectance

    @property
    def unit(self) -> str | None:
        """Of lengths in the body's frame; None where that is of the images alone."""
        return "m" if self.posed.frame == BODY_FIXED else None


def tile_folder(body: Path, number: int) -> Path:
    """The run folder of a tile."""
    return Path(body) / TILES_FOLDER / f"{number:04d}"


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
class MapTile(Stage[TileMap]):
    """One tile, mapped in a run folder of its own; finished stages of a stopped call are used again."""

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
        return digest(program_digest(), self.name, tile, *model.of_tiles)

    def make(self, tools: Tools) -> TileMap:
        tile = self.model.plan.value.tiles[self.number]
        try:
            found = map_tile(self.body.value, self.model, self.number, tools.progress)
        except ReconstructionError as error:
            warn(log, "tile-failed", "tile %d is not mapped: %s", self.number, error)
            return TileMap(landmarks=TileLandmarks.none(), ties=TileTiePoints.none(), gsd=tile.gsd, failure=str(error))
        except Exception as error:
            error.add_note(f"while tile {self.number} was mapped, in {tile_folder(self.body.value, self.number)}")
            raise
        distrust = tuple(why for why in found.distrust if why != NOT_LINEAR)
        for why in distrust:
            warn(log, "tile-untrusted", "tile %d is not to be trusted: %s", self.number, why)
        say_found(f"{len(found.scene.landmarks):,} landmarks")
        number = {view.name: k for k, view in enumerate(self.model.site.views)}
        return tile_map(found.scene, np.array([number[name] for name in found.scene.views.name]), distrust)


def map_tile(body: Path, model: BodyModel, number: int, progress: Progress = no_progress) -> RunResult:
    """Maps one tile into its folder, which may hold one of an earlier plan. Raises what `pipeline.run.run` raises."""
    tile = model.plan.value.tiles[number]
    site, options = tile_site(model, tile), tile_options(model.options)
    config = {"tile": number, "body": str(Path(body).resolve()), **asdict(options)}
    # Another plan gives this number to other ground, with other views; the body's own folder has been claimed already.
    with claimed_run(tile_folder(body, number), owner_of_site(site), progress, overwrite=True) as folder:
        return map_posed(folder, _posed_site(folder, site, model, tile, options), config)


def remove_tiles_from(body: Path, first: int) -> None:
    """Removes tiles from number `first` on, folders and results, which an earlier plan left in the body's folder.

    Raises RunFolderError where a process still maps one of them, or it cannot be removed.
    """
    for path in sorted((*(body / TILES_FOLDER).glob("*"), *(body / STAGES_FOLDER).glob("tile_*"))):
        number = path.stem.removeprefix("tile_")
        if not number.isdigit() or int(number) < first:
            continue
        if path.is_dir():
            check_lock(path)
        remove(path)


def _posed_site(folder: RunFolder, site: Site, model: BodyModel, tile: Tile, options: RunOptions) -> PosedSite:
    """The tile's views at the body's poses, in a frame of their own, with the known poses and shape."""
    inputs, sparse, rays = read_inputs(folder, site), _sparse(model, tile), _rays(model)
    return PosedSite(
        site=site,
        posed=PosedImages(inputs=_masked(inputs, model, tile, rays), sparse=sparse),
        choices=_choices(model, site, options),
        options=options,
        depth=_depth(model, tile, sparse, rays),
        known_views=_known(model, tile, sparse),
    )


def _choices(model: BodyModel, site: Site, options: RunOptions) -> Choices:
    """The choices for a tile, which finishes with the body's reflectance model where that is chosen."""
    found = choose(site, options)
    if model.reflectance is None:
        return found
    return replace(found, candidates=(), last_reflectance=model.reflectance.value.reflectance)


def tile_options(options: BodyOptions) -> RunOptions:
    """Options of a tile: matches may be as far from epipolar lines as the uncertainty of the poses."""
    run, densify = options.run, options.run.densify
    return replace(
        run,
        pose_priors=False,
        densify=replace(
            densify,
            min_views=min(densify.min_views or options.plan.min_views, options.plan.min_views),
            max_sampson_px2=max(densify.max_sampson_px2, KNOWN_PX**2),
        ),
    )


def _masked(inputs: Keyed[Inputs], model: BodyModel, tile: Tile, rays: MeshRays) -> Keyed[Inputs]:
    """The inputs without the pixels of the reference that see ground too obliquely to be mapped from there."""
    limit = model.options.plan.max_emission_deg + MARGIN_DEG
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
    """RMS distance between camera centres: a length that does not depend on the frame's axes."""
    return float(np.linalg.norm(poses.translation - poses.translation.mean(0)))
