"""All images of a body in, one closed surface out. `map_body` is the list of stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from photoclinometry.body.cameras import ShareCameras
from photoclinometry.body.cluster import on_cluster
from photoclinometry.body.coarse_shape import CoarseShape
from photoclinometry.body.finished_surface import FinishedSurface
from photoclinometry.body.merge import MergeTiles
from photoclinometry.body.model_choice import ChooseBodyModel, chooses_reflectance
from photoclinometry.body.options import BodyOptions
from photoclinometry.body.placement import PlaceLeftOut
from photoclinometry.body.plan import PlanTiles
from photoclinometry.body.products import BodyParts, BodyResult, write_body_products
from photoclinometry.body.renderings import CompareRenderings
from photoclinometry.body.sparse import BodySparse, PoseUncertainty
from photoclinometry.body.tile import BodyModel, MapTile, remove_tiles_from
from photoclinometry.body.tile_map import TileMap
from photoclinometry.body.workers import in_processes
from photoclinometry.io.site import Site, read_site
from photoclinometry.io.site_images import input_fingerprint
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.owner import Owner
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.scene import BODY_FIXED, SHARED
from photoclinometry.pipeline.camera_check import CheckCameras
from photoclinometry.pipeline.folder.run_folder import RunFolder, claimed_run, joined_run
from photoclinometry.pipeline.folder.run_owner import owner_of_site
from photoclinometry.pipeline.folder.stage import Keyed
from photoclinometry.pipeline.sparse_stages import Inputs, PosedImages, read_inputs, without_priors
from photoclinometry.registration.georeference import MIN_PRIORS

if TYPE_CHECKING:
    from distributed import Client

PLANNED = ("body_sparse", "pose_covariances", "coarse_shape", "plan")
"""Stages that the coordinating process makes and tasks read back."""
BEFORE_TILES = (*PLANNED, "reflectance")
"""Stages that tasks of single tiles read back."""


def owner_of_body(site: Site) -> Owner:
    """The identity of a body's folder: that of its site, but no folder of `phomo run`."""
    return replace(owner_of_site(site), kind="body")


def plan_body(
    site_file: Path, out: Path, options: BodyOptions, progress: Progress = no_progress, *, overwrite: bool = False
) -> BodyModel:
    """Sparse model, coarse shape and plan: all stages before the tiles.

    Raises InputError (what was given is wrong, or the folder belongs to another site or is in use) and
    ReconstructionError (the images do not determine a shape).
    """
    site = read_site(site_file)
    with claimed_run(out, owner_of_body(site), progress, overwrite=overwrite) as folder:
        return _prepared(folder, site_file, site, options)


def tiles_to_map(
    site_file: Path, out: Path, options: BodyOptions, progress: Progress = no_progress, *, overwrite: bool = False
) -> list[int]:
    """Numbers of the tiles of a body's plan that the folder does not hold yet.

    The plan is made and the reflectance model chosen, if need be. Raises as `plan_body`.
    """
    site, out = read_site(site_file), out.resolve()
    with claimed_run(out, owner_of_body(site), progress, overwrite=overwrite) as folder:
        model = _prepared(folder, site_file, site, options)
        _have_model_chosen(folder, model, partial(in_processes, 1), site_file)
        return _missing(folder, _tile_stages(folder, model))


def map_body(
    site_file: Path,
    out: Path,
    options: BodyOptions,
    progress: Progress = no_progress,
    *,
    workers: int = 1,
    scheduler: str | Client | None = None,
    overwrite: bool = False,
) -> BodyResult:
    """Maps a body: from `site.toml` and images to one closed surface in the folder `out`.

    A folder that holds part of the same map is continued. workers: processes of this machine that map tiles, unless a
    Dask scheduler is given, by its address or by a client: its workers then map them. overwrite: results of another
    site in the folder are removed first. Raises as `plan_body` and `on_cluster`, and ReconstructionError where no tile
    is mapped.
    """
    site, out = read_site(site_file), out.resolve()
    run_tasks = partial(in_processes, workers) if scheduler is None else partial(on_cluster, scheduler)
    with claimed_run(out, owner_of_body(site), progress, overwrite=overwrite) as folder:
        model = _prepared(folder, site_file, site, options)
        _have_model_chosen(folder, model, run_tasks, site_file)
        stages = _tile_stages(folder, model)
        run_tasks(map_one_tile, [(site_file.resolve(), out, options, n) for n in _missing(folder, stages)], progress)
        tiles = tuple(folder.result_of(stage) for stage in stages)
        _check_tiles(tiles)
        remove_tiles_from(folder.path, len(tiles))  # those of an earlier plan
        posed, priors = model.posed, _priors(site, options)
        cameras = folder.result_of(ShareCameras(tiles=tiles, posed=posed, priors=priors))
        merged = folder.result_of(MergeTiles(tiles=tiles, cameras=cameras, posed=posed, shape=model.shape))
        surface = FinishedSurface(merged=merged, tiles=tiles)
        placed = folder.result_of(PlaceLeftOut(posed=posed, cameras=cameras, surface=surface, priors=priors))
        renderings = folder.result_of(CompareRenderings(posed=posed, placed=placed, surface=surface))
        made = BodyParts(
            tiles=tiles,
            cameras=cameras.value,
            surface=merged.value,
            placed=placed.value,
            renderings=renderings.value,
        )
        return write_body_products(folder, model, made, _config(site_file, options))


def map_one_tile(site_file: Path, out: Path, options: BodyOptions, number: int) -> None:
    """Maps one tile of a body whose plan is made and whose reflectance model is chosen; may run on any machine that
    sees the folder.

    Raises RunFolderError where these are not made, or with other options, and InputError where there is no such tile.
    """
    folder, model = _joined(site_file, out, options, BEFORE_TILES)
    count = len(model.plan.value.tiles)
    if not 0 <= number < count:
        raise InputError(f"there is no tile {number}: the plan has {count}, from 0 to {count - 1}")
    folder.result_of(_tile_stages(folder, model)[number])


def choose_model(site_file: Path, out: Path, options: BodyOptions) -> None:
    """Chooses the reflectance model of a body whose plan is made, as `map_one_tile` maps a tile. Raises as that."""
    folder, model = _joined(site_file, out, options, PLANNED)
    folder.result_of(_model_choice(folder, model))


def _joined(
    site_file: Path, out: Path, options: BodyOptions, finished_by_others: tuple[str, ...]
) -> tuple[RunFolder, BodyModel]:
    """The folder of a body and its plan, as a task finds them."""
    site = read_site(site_file)
    folder = joined_run(out, owner_of_body(site))
    folder.finished_by_others = finished_by_others
    alone = without_priors(site)
    known = Keyed(Inputs(site=alone, images=[]), input_fingerprint(alone))
    return folder, _model(folder, site, known, options)


def _have_model_chosen(folder: RunFolder, model: BodyModel, run_tasks: Callable[..., None], site_file: Path) -> None:
    """Lets a task choose the reflectance model, if the images are to decide and have not yet."""
    if chooses_reflectance(model) and not folder.holds(_model_choice(folder, model)):
        run_tasks(choose_model, [(site_file.resolve(), folder.path, model.options)], folder.progress)


def _model_choice(folder: RunFolder, model: BodyModel) -> ChooseBodyModel:
    return ChooseBodyModel(model=model, body=_body(folder))


def _body(folder: RunFolder) -> Keyed[Path]:
    return Keyed(folder.path, "body")


def _tile_stages(folder: RunFolder, model: BodyModel) -> list[MapTile]:
    """The stages that map the tiles of a plan, all with one reflectance model."""
    body = _body(folder)
    if chooses_reflectance(model):
        model = replace(model, reflectance=folder.result_of(_model_choice(folder, model)))
    return [MapTile(number=n, model=model, body=body) for n in range(len(model.plan.value.tiles))]


def _missing(folder: RunFolder, stages: Sequence[MapTile]) -> list[int]:
    """Numbers of the tiles that the folder does not hold."""
    return [stage.number for stage in stages if not folder.holds(stage)]


def _prepared(folder: RunFolder, site_file: Path, site: Site, options: BodyOptions) -> BodyModel:
    folder.log_config(_config(site_file, options))
    model = _model(folder, site, read_inputs(folder, site), options)
    folder.result_of(CheckCameras(inputs=model.posed.inputs, sparse=model.posed.sparse))
    return model


def _config(site_file: Path, options: BodyOptions) -> dict[str, Any]:
    return {"site": str(Path(site_file).resolve()), **asdict(options)}


def _model(folder: RunFolder, site: Site, inputs: Keyed[Inputs], options: BodyOptions) -> BodyModel:
    """Sparse model, coarse shape and plan."""
    priors = _priors(site, options)
    sparse = folder.result_of(BodySparse(inputs=inputs, priors=priors, options=options.sfm))
    frame = BODY_FIXED if len(priors) >= MIN_PRIORS else SHARED
    posed = PosedImages(inputs=inputs, sparse=sparse, frame=frame)
    known = folder.result_of(PoseUncertainty(posed=posed, priors=priors))
    shape = folder.result_of(CoarseShape(sparse=sparse))
    plan = folder.result_of(PlanTiles(posed=posed, shape=shape, options=options.plan))
    return BodyModel(site=site, posed=posed, known=known, shape=shape, plan=plan, options=options)


def _priors(site: Site, options: BodyOptions) -> dict[str, PosePrior]:
    """By name of view, without their common errors. These move a body as a whole, which tiles do not detect; a tile
    would treat them as independent errors of each view."""
    if not options.run.pose_priors:
        return {}
    alone = {"common_rotation_sigma_rad": 0.0, "common_translation_sigma": 0.0}
    return {name: replace(prior, **alone) for name, prior in site.pose_priors.items()}


def _check_tiles(tiles: Sequence[Keyed[TileMap]]) -> None:
    failures = [f"tile {n}: {tile.value.failure}" for n, tile in enumerate(tiles) if tile.value.failure]
    if len(failures) == len(tiles):
        raise ReconstructionError(f"no tile could be mapped; {failures[0]}")
