"""The functions of `import photoclinometry`: each reads what it is given by path, calls the library, and returns.

Paths are strings or `Path`. Optional arguments go by keyword. Options are given as an object (`options=`), field by
field (`reflectance="mcewen"`), or both: single fields then replace those of the object.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from photoclinometry.adjust import Adjustment, AdjustOptions, Iteration
from photoclinometry.adjust import adjust as _adjust
from photoclinometry.evaluate.body_folder import evaluate_body, is_body
from photoclinometry.evaluate.evaluation import Evaluation, evaluate_map
from photoclinometry.io import run_files, scene_file
from photoclinometry.io import site as site_file
from photoclinometry.io.held_out import NAME as HELD_OUT_FILE
from photoclinometry.io.held_out import read_held_out
from photoclinometry.io.models.colmap import read_colmap
from photoclinometry.io.reference import Reference, read_reference, scene_as_reference
from photoclinometry.io.site import Site
from photoclinometry.model.errors import InputError
from photoclinometry.model.option_fields import changed
from photoclinometry.model.progress import Progress
from photoclinometry.model.reflectance import MODELS, Reflectance, starting_model
from photoclinometry.model.scene import Image, Scene, Views
from photoclinometry.output.export import ExportOptions, export_scene
from photoclinometry.output.figures.options import FigureOptions
from photoclinometry.photometry.render import render_reference, render_view
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
from photoclinometry.simulate.truth_file import read_truth
from photoclinometry.surface.relief import local_frame, sun_from_angles


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
        limits: Which of the views that see the place are chosen.
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
    candidates: bool = True,
    progress: Progress | None = None,
    **changes: Any,
) -> Plan:
    """Say what a map from given views would have, before images are taken, and what one more image would add.

    Args:
        site: A site.toml with pose priors, or a table of poses and Suns (.csv). Images are not opened.
        out: Folder for plan.json and pictures, new, empty or of an earlier plan; none by default.
        options: The place, what is assumed of the ground, and the candidates.
        candidates: Try candidates for one more image.
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
    found = plan_site(read_views(site), chosen, with_candidates=candidates, progress=progress)
    if out is not None:
        write_plan(Path(out), found)
    return found


def simulate(
    options: str | SimulationOptions,
    out: str | Path,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
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
    progress: Progress | None = None,
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
    path = Path(path)
    return scene_file.read_scene(path) if path.suffix in (".h5", ".hdf5") else run_files.read_run(path)


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
    scene: Scene,
    *,
    options: AdjustOptions | None = None,
    progress: Callable[[Iteration], None] | None = None,
    **changes: Any,
) -> Adjustment:
    """Estimate poses, Suns, exposures, positions, normals and albedos of a scene together.

    `run` does this itself. On a finished scene it is for other noise models, priors and losses.

    Args:
        scene: The start of the estimate, with its tracks.
        options: Noise, priors and losses.
        progress: Called after every step with its cost, damping and time.
        **changes: Fields of `AdjustOptions`, such as smooth_sigma_rad=0.1.

    Returns:
        The adjusted scene, whether and why the estimate stopped, and what it found the noise to be.

    Raises:
        InputError: An option is wrong.
        ReconstructionError: Too little is left to estimate anything from.
    """
    return _adjust(scene, changed(options or AdjustOptions(), changes), progress=progress)


def render(
    scene: Scene,
    *,
    view: str | None = None,
    sun: Sequence[float] | np.ndarray | None = None,
    sun_azimuth_deg: float | None = None,
    sun_elevation_deg: float | None = None,
    geometry: Literal["camera", "reference"] = "camera",
    cast_shadows: bool = False,
) -> Image:
    """Render a map as a camera sees it, under its own Sun or any other.

    Args:
        scene: The map.
        view: Name of the view whose camera, Sun, scale and bias to use. Default: the reference view.
        sun: Direction (3,) towards the Sun in the body-fixed frame, of any length.
        sun_azimuth_deg: Sun's azimuth, clockwise from up in the reference image, along the map's mean plane.
        sun_elevation_deg: Sun's elevation above the map's mean plane; goes with the azimuth.
        geometry: "camera" draws the view's whole image; "reference" the map's own grid of reference pixels.
        cast_shadows: Also darken what lies in the shadow of other ground of the map.

    Returns:
        Brightness in the unit of the scene's images; `valid` is where the map is.

    Raises:
        InputError: There is no such view, the Sun is not a direction, or the scene has no reflectance model.
    """
    index = view_index(scene, view)
    towards = _sun_direction(scene, sun, sun_azimuth_deg, sun_elevation_deg)
    draw = {"camera": render_view, "reference": render_reference}.get(geometry)
    if draw is None:
        raise InputError(f'geometry {geometry!r}: must be "camera" or "reference"')
    brightness, there = draw(scene, index, towards, cast_shadows=cast_shadows)
    return Image(scene.views.name[index], brightness.astype(np.float32), there)


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
    if isinstance(scene, (str, Path)) and is_body(Path(scene)):
        if cameras is not None or site is not None or isinstance(reference, Scene):
            raise InputError(f"{scene} holds a whole body: cameras, a site and the map of a place say nothing of it")
        return evaluate_body(Path(scene), truth=truth, reference=reference, unit=unit)
    if truth is not None and reference is not None:
        raise InputError("truth and reference are both given; compare with one at a time")
    if cameras is not None and reference is None:
        raise InputError("cameras align a map with another one: give the reference too")
    folder = _folder(scene)
    scene = _scene(scene)
    pictures, held_out = _images(scene, folder, site) if images else (None, None)
    return evaluate_map(
        scene,
        images=pictures,
        held_out=held_out,
        truth=None if truth is None else read_truth(Path(truth)),
        reference=None if reference is None else _reference(reference, cameras),
        unit=unit,
    )


def export(
    scene: Scene,
    out: str | Path,
    *,
    products: str | Sequence[str] = (),
    options: ExportOptions | None = None,
    **changes: Any,
) -> dict[str, str]:
    """Write a map for GIS, viewers and other reconstruction programs.

    Args:
        scene: The map.
        out: Folder for the products; new, empty, or an earlier export, which is replaced.
        products: What to write: "dtm", "albedo", "normals", "slope", "reflectance", "sigma" (GeoTIFF), "obj", "gltf",
            "ply", "colmap", "text-model", "sumfile", "csv". Default: all that the scene holds and its frame allows.
        options: The products, and what is known of the map's frame.
        **changes: Fields of `ExportOptions`, such as unit_m=1000.0.

    Returns:
        What each file in the folder is, by the file's name.

    Raises:
        InputError: The scene or its frame does not allow a product, or the folder holds something else.
    """
    if products:
        changes["products"] = (products,) if isinstance(products, str) else tuple(products)
    return export_scene(scene, Path(out), changed(options or ExportOptions(), changes))["files"]


def plot(
    scene: RunResult | Scene | str | Path,
    layer: str,
    *,
    ax: Any = None,
    view: str | None = None,
    clim: tuple[float, float] | None = None,
    marks: bool = True,
) -> Any:
    """Draw a layer of a map on matplotlib's axes, with colour bar, scale bar and arrows.

    The axes count pixels of the reference image. Places without a landmark stay blank.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        layer: "albedo", "relief" (shaded), "height", "slope", "normals", "height-sigma", "normal-sigma",
            "albedo-sigma", "views" or "residual".
        ax: The axes to draw on. Default: those of a new figure of matplotlib.pyplot.
        view: Name of the view whose Sun an arrow shows, and which lights the relief of "relief" and "height". Default:
            no arrow, and light from the upper left.
        clim: Ends of the colour scale, in the layer's unit. Default: by percentiles.
        marks: Draw the scale bar, and the arrows to the north (in the body-fixed frame) and to the Sun.

    Returns:
        The axes.

    Raises:
        InputError: There is no such layer or view, or the scene does not hold what the layer shows.
    """
    from photoclinometry.output.figures.maps import plot_layer

    scene = _scene(scene)
    index = None if view is None else view_index(scene, view)
    return plot_layer(ax or _new_axes(), scene, layer, view=index, clim=clim, marks=marks)


def plot_profile(
    scene: RunResult | Scene | str | Path,
    start: tuple[float, float],
    end: tuple[float, float],
    *,
    layer: str = "height",
    ax: Any = None,
) -> Any:
    """Draw a layer along a line of a map, with a band of one standard deviation.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        start: One end (x, y) in pixels of the reference image, as the axes of `plot` count them.
        end: The other end.
        layer: As of `plot`, but for "normals".
        ax: The axes to draw on. Default: those of a new figure of matplotlib.pyplot.

    Returns:
        The axes: distances along the map's mean plane in metres, or in GSD, and values in the layer's unit.

    Raises:
        InputError: There is no such layer, the ends are one place, or the line misses the map.
    """
    from photoclinometry.output.figures import profile

    return profile.plot_profile(ax or _new_axes(), _scene(scene), start, end, name=layer)


def plot_residuals(
    scene: RunResult | Scene | str | Path,
    *,
    view: str | None = None,
    kind: Literal["brightness", "keypoint"] = "brightness",
    ax: Any = None,
) -> Any:
    """Draw how far measurements are from what a map predicts: of all views, or of one view as a map.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        view: Name of the view to draw as a map. Default: all views beside each other; boxes hold the middle half of
            their residuals, lines end at the 5th and the 95th percentile.
        kind: "brightness", predicted minus measured in per cent of the view's mean, or "keypoint", distances in pixels.
        ax: The axes to draw on. Default: those of a new figure of matplotlib.pyplot.

    Returns:
        The axes.

    Raises:
        InputError: There is no such view or kind, or the scene has no reflectance model to predict brightness with.
    """
    from photoclinometry.output.figures import residuals

    scene = _scene(scene)
    index = None if view is None else view_index(scene, view)
    return residuals.plot_residuals(ax or _new_axes(), scene, view=index, kind=kind)


def figure(
    scene: RunResult | Scene | str | Path, out: str | Path, *, options: FigureOptions | None = None, **changes: Any
) -> Path:
    """Write a figure for publication: lettered maps and a profile, at the width of a journal's columns.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        out: The file; .pdf, .svg or .png. Text of PDF and SVG files is text, in fonts that lie in the file.
        options: Layers, profile, size and resolution.
        **changes: Fields of `FigureOptions`, such as layers=("albedo", "height"), dpi=600.

    Returns:
        The path of the file.

    Raises:
        InputError: An option is wrong, the scene lacks a layer, the figure does not fit a page, or `out` cannot be
            written.
    """
    from photoclinometry.output.figures.journal import write_figure

    scene, chosen = _scene(scene), changed(options or FigureOptions(), changes)
    write_figure(Path(out), scene, chosen, None if chosen.view is None else view_index(scene, chosen.view))
    return Path(out)


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


def view_index(scene: Scene, name: str | None) -> int:
    """Index of a view by its name, its file name, or its file name without suffix; None is the reference.

    Raises InputError that names the nearest.
    """
    if name is None:
        return scene.reference
    names = scene.views.name
    for candidates in (names, [Path(n).name for n in names], [Path(n).stem for n in names]):
        if list(candidates).count(name) == 1:
            return list(candidates).index(name)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.0)
    raise InputError(f"no view {name!r} in scene {scene.name!r}; nearest: {', '.join(near)}")


def _sun_direction(
    scene: Scene, sun: Sequence[float] | np.ndarray | None, azimuth_deg: float | None, elevation_deg: float | None
) -> np.ndarray | None:
    """The Sun asked for as a vector (3,) in B; None for the view's own. Raises InputError."""
    if (azimuth_deg is None) != (elevation_deg is None):
        raise InputError("the Sun's azimuth and elevation go together: give both or none")
    if sun is not None and azimuth_deg is not None:
        raise InputError("the Sun is given twice: give its direction, or azimuth and elevation")
    if sun is not None:
        direction = np.asarray(sun, float)
        if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
            raise InputError(f"Sun {direction.tolist()} is not a direction; give three numbers, not all zero")
        return direction
    if azimuth_deg is None or elevation_deg is None:
        return None
    if not np.isfinite(azimuth_deg):
        raise InputError(f"Sun's azimuth {azimuth_deg} degrees: must be a finite number")
    if not 0.0 < elevation_deg <= 90.0:
        raise InputError(f"Sun's elevation {elevation_deg} degrees: must be above 0 and at most 90 for light to fall")
    return sun_from_angles(local_frame(scene), np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg))


def _scene(scene: RunResult | Scene | str | Path) -> Scene:
    """The map of a result, of a run folder, or of a scene.h5; a scene itself. Raises InputError."""
    if isinstance(scene, RunResult):
        return scene.scene
    return scene if isinstance(scene, Scene) else read_scene(scene)


def _new_axes() -> Any:
    """Axes of a new figure, which a notebook and `matplotlib.pyplot.show` show."""
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained")[1]


def _folder(scene: RunResult | Scene | str | Path) -> Path | None:
    """The run folder of a map; None of a scene by itself."""
    if isinstance(scene, Scene):
        return None
    path = scene.folder if isinstance(scene, RunResult) else Path(scene)
    return path.parent if path.is_file() else path


def _images(scene: Scene, folder: Path | None, site: str | Path | None) -> tuple[list[Image] | None, Views | None]:
    """The images of a scene's views and of those that its run held out, and the latter; None without a site."""
    given = None if site is None else Path(site)
    if folder is None:
        return (None if given is None else run_files.run_images(given, scene.views.name)), None
    held_out = read_held_out(folder / HELD_OUT_FILE)
    names = scene.views.name + (held_out.name if held_out else ())
    return run_files.run_images(run_files.site_path(folder, given), names), held_out


def _reference(reference: Scene | str | Path, cameras: str | Path | None) -> Reference:
    """The map to compare with, and the poses to align with: those of a COLMAP model, or its own."""
    found = scene_as_reference(reference) if isinstance(reference, Scene) else read_reference(reference)
    if cameras is None:
        return found
    names, _, poses, _ = read_colmap(Path(cameras))
    return replace(found, names=names, body_from_cam=poses)
