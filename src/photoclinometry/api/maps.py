"""Maps: the functions of `import photoclinometry` that read, make, judge and export them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from photoclinometry.adjust import Adjustment, AdjustOptions, Iteration
from photoclinometry.adjust import adjust as _adjust
from photoclinometry.api.given import given_folder, given_scene, scene_at
from photoclinometry.evaluate.body_folder import evaluate_body
from photoclinometry.evaluate.evaluation import Evaluation, evaluate_map
from photoclinometry.evaluate.model_ranking import ModelRanking, RankingOptions, rank_models
from photoclinometry.evaluate.same_site import read_truth_of
from photoclinometry.io import run_files, scene_file
from photoclinometry.io import site as site_file
from photoclinometry.io.held_out import read_held_out
from photoclinometry.io.models.colmap import read_colmap
from photoclinometry.io.reference import Reference, read_reference, scene_as_reference
from photoclinometry.io.site import Site
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.option_fields import changed
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.reflectance import MODELS, Reflectance, starting_model
from photoclinometry.model.scene import Scene, Views
from photoclinometry.output.export import ExportOptions, export_scene
from photoclinometry.pipeline.products import RunResult
from photoclinometry.pipeline.run import RunOptions
from photoclinometry.pipeline.run import run as _run
from photoclinometry.plan.options import PlanOptions
from photoclinometry.plan.products import check_folder, write_plan
from photoclinometry.plan.run import Plan, plan_site, read_views
from photoclinometry.registration import view_choice
from photoclinometry.registration.view_choice import ViewChoice, ViewLimits
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site


def read_site(path: str | Path) -> Site:
    """Read the description of a site; its images are not opened.

    Args:
        path: A site.toml.

    Returns:
        Views with their cameras and Sun directions, and the region to map.

    Raises:
        InputError: The file is missing, or something in it is wrong; the message names the view and the key.
    """
    return site_file.read_site(path)


def choose_views(
    site: str | Path,
    lon_deg: float,
    lat_deg: float,
    *,
    radii_m: tuple[float, ...] | None = None,
    out: str | Path | None = None,
    limits: ViewLimits | None = None,
    **changes: Any,
) -> ViewChoice:
    """Find which views of a site see a place of the body, and choose those for a map of it.

    Args:
        site: A site.toml with pose priors in the body-fixed frame, in metres.
        lon_deg: Longitude of the place, eastward.
        lat_deg: Planetocentric latitude of the place.
        radii_m: The body's radius, its equatorial and polar radius, or its three semi-axes. Default: the body's.
        out: A new site.toml of the chosen views, with the region about the place; none by default.
        limits: Limits for the choice among the views that see the place.
        **changes: Fields of `ViewLimits`, such as count=12.

    Returns:
        The views that see the place, with resolution and angles, and those chosen.

    Raises:
        InputError: There are no pose priors, no view sees the place, too few are within the limits, or `out` exists.
    """
    read = site_file.read_site(site)
    found = view_choice.choose_views(read, lon_deg, lat_deg, radii_m, changed(limits or ViewLimits(), changes))
    if out is not None:
        view_choice.write_chosen_site(Path(out), read, found)
    return found


def plan(
    site: str | Path,
    *,
    out: str | Path | None = None,
    options: PlanOptions | None = None,
    with_candidates: bool = True,
    progress: Progress = no_progress,
    **changes: Any,
) -> Plan:
    """Forecast the map from given views, before images are taken, and the gain by one more image.

    Args:
        site: A site.toml with pose priors, or a table of poses and Suns (.csv). Images are not opened.
        out: Folder for plan.json and pictures, new, empty or of an earlier plan; none by default.
        options: The place, what is assumed of the ground, and the candidates.
        with_candidates: Try candidates for one more image.
        progress: Called as progress(what, done, total); total is 0 where it is not known.
        **changes: Fields of `PlanOptions`, such as at=(240.0, -9.0), slope_deg=10.0.

    Returns:
        Sigmas of heights, normals and albedos (`sigmas`), light and resolution (`light`), and the candidates, best
        first (`gains`).

    Raises:
        InputError: There are no poses, too few views see the place, or they make no map of it.
    """
    if out is not None:
        check_folder(Path(out))
    chosen = changed(options or PlanOptions(), changes)
    found = plan_site(read_views(site), chosen, with_candidates=with_candidates, progress=progress)
    if out is not None:
        write_plan(Path(out), found)
    return found


def simulate(
    options: str | SimulationOptions,
    out: str | Path,
    *,
    overwrite: bool = False,
    progress: Progress = no_progress,
    **changes: Any,
) -> Path:
    """Simulate a site: images with shadows, optics and noise, site.toml, and truth.h5.

    Args:
        options: Name of a preset ("demo", "cornelia", "ahuna", "ikapati"; whole bodies: "topshape", "bilobed",
            "potato"), or all options.
        out: Folder for the site, new or empty. It appears whole or not at all.
        overwrite: Replace a site that was simulated there before.
        progress: Called as progress(what, done, total).
        **changes: Fields of `SimulationOptions`, such as views=6, seed=1.

    Returns:
        The path of site.toml, for `run`; truth.h5 lies beside it.

    Raises:
        InputError: An option is wrong, or the folder holds something else.
    """
    if isinstance(options, str):
        options = SimulationOptions(preset=options)
    return simulate_site(changed(options, changes), out, progress, overwrite)


def run(
    site: str | Path,
    out: str | Path,
    *,
    options: RunOptions | None = None,
    overwrite: bool = False,
    progress: Progress = no_progress,
    **changes: Any,
) -> RunResult:
    """Map a site: poses, dense landmarks, normals and albedo.

    A run that was stopped goes on where it was; changed options redo only what depends on them.

    Args:
        site: The site.toml, which names the images, the camera and a Sun direction per image.
        out: Folder for the run; new, empty, or that of an earlier run of the same site.
        options: How the map is made.
        overwrite: Remove what the folder holds of another site; without it, such a folder is refused.
        progress: Called as progress(what, done, total); total is 0 where it is not known.
        **changes: Fields of `RunOptions`, such as reflectance="mcewen".

    Returns:
        The map (`scene`), its figures, the views that were left out, all `warnings`, and whether it is `trusted`.

    Raises:
        InputError: The site or an option is wrong, or the folder belongs to another site or is in use.
        ReconstructionError: The images do not determine a map.
    """
    return _run(Path(site), Path(out), changed(options or RunOptions(), changes), progress, overwrite)


def read_scene(path: str | Path) -> Scene:
    """Read the map that a run has made.

    Args:
        path: A run folder, or a scene.h5.

    Returns:
        The scene: every value as it was written.

    Raises:
        InputError: There is no finished run, or the file is damaged or of another version.
    """
    return scene_at(Path(path))


def write_scene(path: str | Path, scene: Scene) -> None:
    """Write a scene as one HDF5 file, exact to the last bit.

    Args:
        path: The file, such as scene.h5; it appears whole or not at all.
        scene: What to write.

    Raises:
        InputError: The file cannot be written.
    """
    scene_file.write_scene(path, scene)


def adjust(
    scene: RunResult | Scene | str | Path,
    *,
    options: AdjustOptions | None = None,
    on_step: Callable[[Iteration], None] | None = None,
    **changes: Any,
) -> Adjustment:
    """Estimate poses, Suns, exposures, positions, normals and albedos of a scene together.

    `run` does this itself. On a finished scene it is for other noise models, priors and losses.

    Args:
        scene: The start of the estimate, with its tracks: the result of `run`, the folder of a finished run or its
            scene.h5, or a scene by itself.
        options: Noise, priors and losses.
        on_step: Called after every step with its cost, damping and time.
        **changes: Fields of `AdjustOptions`, such as smooth_sigma_rad=0.1.

    Returns:
        The adjusted scene, whether and why the estimate stopped, and what it found the noise to be.

    Raises:
        InputError: An option is wrong.
        ReconstructionError: Too little is left to estimate anything from.
    """
    return _adjust(given_scene(scene), changed(options or AdjustOptions(), changes), on_step=on_step)


def evaluate(
    scene: RunResult | Scene | str | Path,
    *,
    truth: str | Path | None = None,
    reference: Scene | str | Path | None = None,
    cameras: str | Path | None = None,
    unit: str = "m",
    site: str | Path | None = None,
    images: bool = True,
) -> Evaluation:
    """Measure a map: photometric error, PSNR and completeness, and how far it is from the truth or another map.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene by itself.
        truth: truth.h5 of a simulated site: compares surface, normals, albedos, poses, Suns and keypoints.
        reference: Another map of the place: a scene, the folder of another run or its scene.h5, a PLY file (mesh or
            points), or a GeoTIFF of heights (needs the extra `geo`). Of a whole body: a mesh (PLY, OBJ).
        cameras: COLMAP model folder with poses in the frame of the reference map. Its views, matched by name, give the
            first alignment; a scene brings its own. Without any, the map must be in the reference's frame.
        unit: Unit of length of the reference map, for the names of the figures.
        site: The site.toml with the images. Default: the one that the run recorded; a scene by itself has none.
        images: Read the images too, for PSNR and completeness.

    Returns:
        All figures by name, and the comparison that they are from; printed, they are tables.

    Raises:
        InputError: Files are missing or damaged, do not belong together, or both truth and reference are given.
    """
    if isinstance(scene, (str, Path)) and run_files.is_body(Path(scene)):
        if cameras is not None or site is not None or isinstance(reference, Scene):
            raise InputError(f"{scene} holds a whole body: cameras, a site and the map of a place say nothing of it")
        return evaluate_body(Path(scene), truth=truth, reference=reference, unit=unit)
    if truth is not None and reference is not None:
        raise InputError("truth and reference are both given; compare with one at a time")
    if cameras is not None and reference is None:
        raise InputError("cameras align a map with another one: give the reference too")
    folder = given_folder(scene)
    scene = given_scene(scene)
    pictures, held_out = _images(scene, folder, site) if images else (None, None)
    return evaluate_map(
        scene,
        images=pictures,
        held_out=held_out,
        truth=None if truth is None else read_truth_of(truth, scene),
        reference=None if reference is None else _reference(reference, cameras),
        unit=unit,
    )


def rank_reflectance(
    scene: RunResult | Scene | str | Path,
    *,
    options: RankingOptions | None = None,
    progress: Progress = no_progress,
    **changes: Any,
) -> ModelRanking:
    """Rank reflectance models by how well they predict images that they were not fitted to.

    Each model is fitted to most of the views, with normals and albedos of its own, and predicts the others.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        options: Which models, and how they are compared.
        progress: Called with the name of the task, how many models are done, and of how many.
        **changes: Fields of `RankingOptions`, such as models=("hapke", "lunar-lambert"), landmarks=500.

    Returns:
        The models, the best first, with their parameters, their errors by view, and every prediction.

    Raises:
        InputError: The map has no reflectance model (its brightness was not used), too few views or lit landmarks, or
            there is no such model.
    """
    return rank_models(given_scene(scene), changed(options or RankingOptions(), changes), progress)


def export(
    scene: RunResult | Scene | str | Path,
    out: str | Path,
    *,
    products: str | Sequence[str] = (),
    options: ExportOptions | None = None,
    overwrite: bool = False,
    **changes: Any,
) -> dict[str, str]:
    """Write a map for GIS, viewers and other reconstruction programs.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene by itself.
        out: Folder for the products; new, empty, or an earlier export of the map, which is replaced.
        products: What to write: "dtm", "albedo", "normals", "slope", "reflectance", "sigma" (GeoTIFF), "obj", "gltf",
            "ply", "colmap", "text-model", "sumfile", "csv". Default: all that the scene holds and its frame allows.
        options: The products, and what is known of the map's frame.
        overwrite: Replace an export of another map, too.
        **changes: Fields of `ExportOptions`, such as unit_m=1000.0.

    Returns:
        What each file in the folder is, by the file's name.

    Raises:
        InputError: The scene or its frame does not allow a product, or the folder holds something else.
    """
    if products:
        changes["products"] = (products,) if isinstance(products, str) else tuple(products)
    chosen = changed(options or ExportOptions(), changes)
    return export_scene(given_scene(scene), Path(out), chosen, overwrite=overwrite)["files"]


def reflectance_models() -> tuple[str, ...]:
    """Name the reflectance models.

    Returns:
        The names that `reflectance` and `RunOptions.reflectance` take.
    """
    return tuple(MODELS)


def reflectance(name: str, *, body: str | None = None) -> Reflectance:
    """Look up a reflectance model by name.

    Args:
        name: One of `reflectance_models()`.
        body: Body with published parameters of the model ("vesta", "ceres"). Models with neutral parameters start from
            these where nothing is published.

    Returns:
        The model. Called with the cosines of incidence and emission and the phase angle [rad], it gives I/F / albedo.

    Raises:
        InputError: There is no such model, or it has parameters without published or neutral values.
    """
    return starting_model(name, body)


def _images(scene: Scene, folder: Path | None, site: str | Path | None) -> tuple[list[Image] | None, Views | None]:
    """The images of a scene's views and of those that its run held out, and the latter; None without a site."""
    given = None if site is None else Path(site)
    if folder is None:
        return (None if given is None else run_files.run_images(given, scene.views.name)), None
    held_out = read_held_out(folder / run_files.HELD_OUT_FILE)
    names = scene.views.name + (held_out.name if held_out else ())
    return run_files.run_images(run_files.site_path(folder, given), names), held_out


def _reference(reference: Scene | str | Path, cameras: str | Path | None) -> Reference:
    """The map to compare with, and the poses to align with: those of a COLMAP model, or its own."""
    found = scene_as_reference(reference) if isinstance(reference, Scene) else read_reference(reference)
    if cameras is None:
        return found
    names, _, poses, _ = read_colmap(Path(cameras))
    return replace(found, names=names, body_from_cam=poses)
