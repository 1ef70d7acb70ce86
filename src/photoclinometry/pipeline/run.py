"""A site in, a map out. `run` is the list of stages in DESIGN.md."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.evaluate.held_out import held_out_views
from photoclinometry.io.site import Site, read_site
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.scene import Views
from photoclinometry.pipeline.camera_check import CheckCameras
from photoclinometry.pipeline.checked_map import checked_map
from photoclinometry.pipeline.choices import Choices, check_enough_views, choose, choose_reflectance
from photoclinometry.pipeline.dense_stages import MatchDensely
from photoclinometry.pipeline.folder.run_folder import RunFolder, claimed_run
from photoclinometry.pipeline.folder.run_owner import owner_of_site
from photoclinometry.pipeline.folder.stage import Keyed
from photoclinometry.pipeline.map_stages import FinishedMap, PlaceHeldOutViews
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.posed_site import PosedSite
from photoclinometry.pipeline.products import RunResult, RunSummary, write_products
from photoclinometry.pipeline.sparse_stages import (
    ChooseRegion,
    PosedImages,
    SparseReconstruction,
    check_reference,
    choose_views,
    read_inputs,
)

__all__ = ["RunOptions", "RunResult", "choose_reflectance", "run"]


def run(
    site_file: Path,
    out: Path,
    options: RunOptions | None = None,
    progress: Progress = no_progress,
    overwrite: bool = False,
) -> RunResult:
    """Maps a site: from `site.toml` and images to everything in the run folder `out`.

    A folder that holds part of the same run is continued. overwrite: results of another site in it are removed first.
    Raises InputError (what was given is wrong, or the folder belongs to another site or is in use) and
    ReconstructionError (the images do not determine a map).
    """
    options = options or RunOptions()
    site = read_site(site_file)
    choices = choose(site, options)
    with claimed_run(out, owner_of_site(site), progress, overwrite=overwrite) as folder:
        config = {"site": str(Path(site_file).resolve()), **asdict(options)}
        folder.log_config(config)
        return _map(folder, site, choices, options, config)


def _map(folder: RunFolder, site: Site, choices: Choices, options: RunOptions, config: dict[str, Any]) -> RunResult:
    """All stages, and their products."""
    inputs = read_inputs(folder, site)
    check_reference(site, inputs.value.unusable)
    usable = np.array([image.name not in inputs.value.unusable for image in inputs.value.images])
    check_enough_views(site, usable & ~choices.held_out, options.densify, ReconstructionError)
    sparse = folder.result_of(SparseReconstruction(inputs=inputs, options=options.sfm))
    folder.result_of(CheckCameras(inputs=inputs, sparse=sparse))
    posed = PosedImages(inputs=inputs, sparse=sparse)
    return map_posed(folder, PosedSite(site=site, posed=posed, choices=choices, options=options), config)


def map_posed(folder: RunFolder, posed_site: PosedSite, config: dict[str, Any]) -> RunResult:
    """The stages after the sparse one, and their products. config: the options that shaped the map, for its report."""
    site, posed, choices, options = posed_site.site, posed_site.posed, posed_site.choices, posed_site.options
    checked_with = choices.reflectance if options.check_views else None
    chosen = choose_views(folder, posed, choices.held_out, checked_with)
    check_reference(site, chosen.left_out)
    used = chosen.used
    dense = MatchDensely(
        posed=used,
        place=folder.result_of(ChooseRegion(posed=used, request=site.region, options=options.region)),
        matcher=choices.matcher,
        passes=options.matching_passes,
        densify=options.densify,
        depth=posed_site.depth,
    )
    found = checked_map(folder, posed_site, chosen, dense)
    brought_in = posed.sparse.value.how_brought_in()
    summary = RunSummary(
        adjustment=found.finished.value.adjustment,
        images=posed.inputs.value.images,
        config=config,
        left_out=chosen.left_out | dict(found.left_out),
        brought_in={posed.views.name[k]: how for k, how in brought_in.items()},
        held_out=_held_out_views(folder, found.finished, posed, choices),
        iterations=found.iterations,
        pose_priors=found.pose_priors,
        control=choices.control,
        altimetry=choices.altimetry is not None,
        relief=found.relief,
        psf_sigma_px=found.finished.value.psf_sigma_px,
        response=found.response,
    )
    return write_products(folder, summary)


def _held_out_views(
    folder: RunFolder, finished: Keyed[FinishedMap], posed: PosedImages, choices: Choices
) -> Views | None:
    """The views held out, placed in the map's frame; None where there are none."""
    registered = np.flatnonzero(choices.held_out & posed.sparse.value.registered)
    if not len(registered):
        return None
    stage = PlaceHeldOutViews(finished=finished, posed=posed, held_out=registered, matcher=choices.relit_matcher)
    return held_out_views(posed.views, folder.result_of(stage).value)
