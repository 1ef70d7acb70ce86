"""Poses and points from matches, by COLMAP's mappers and bundle adjustment."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.progress import Progress
from photoclinometry.model.sparse import SparseModel
from photoclinometry.photometry.relief_shading import ReliefShading
from photoclinometry.sfm.adjustment import RobustAdjustment
from photoclinometry.sfm.database import DATABASE, first_pairs, padded_size, padding_px
from photoclinometry.sfm.options import SfmOptions
from photoclinometry.sfm.reversal import UNDETERMINED_RATIO, Oriented, resolve_depth_reversal

GROWTH = 1.4
"""Global bundle adjustments are repeated when the model has grown by this factor. With one local and two global
refinements at LOOSE_TOLERANCE this takes a third of COLMAP's default time for the same poses."""

LOOSE_TOLERANCE = 1e-6
"""Relative decrease of cost that ends a bundle adjustment on the way: the last one is stricter."""

FIRST_PAIR_DEG, FIRST_PAIR_MATCHES = 4.0, 50
"""Least angle between the rays of the first pair of views, a quarter of COLMAP's default, since spacecraft see a place
from similar directions; and its fewest verified matches."""

TRIALS = 6
"""Largest number of times that views are mapped. On a site of low relief with a field of view of 1.7 degrees one seed
of four ended in a mixture of right and reversed views, on one of 0.7 degrees six of eight."""

MORE_TRIALS, FEW_VIEWS = 18, 30
"""The same where there are at most FEW_VIEWS views, a Sun is known, and shading confirms no model yet. Further trials
begin with the pairs of most matches, one after the other: seeds alone may end in the same mixture each time."""

MODELS = 10
"""Largest number of models that are tried, each of views that are connected with each other."""


@contextmanager
def _signals_deferred() -> Iterator[None]:
    """Ctrl-C and SIGTERM that come in the block have their effect after it, by the handlers that stood before.

    While it is imported, pycolmap takes every exception for a failure of its own. It also handles SIGTERM itself, and
    would then write its stack.
    """
    numbers, came = (signal.SIGINT, signal.SIGTERM), []
    if threading.current_thread() is not threading.main_thread() or None in map(signal.getsignal, numbers):
        yield
        return
    before = {number: signal.signal(number, lambda number, _: came.append(number)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


@contextmanager
def quiet_pycolmap(seed: int) -> Iterator[None]:
    """COLMAP seeded, and silent: it raises its errors, and this package writes the log itself."""
    with _signals_deferred():
        import pycolmap

    before = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    pycolmap.set_random_seed(seed)
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = before


def map_views(
    cameras: list[Camera],
    work_dir: Path,
    options: SfmOptions,
    progress: Progress,
    shading_of: Callable[[SparseModel], ReliefShading] | None = None,
    *,
    all_trials: bool = False,
) -> list[Oriented]:
    """The reconstructions found, one for each connected set of views, the largest first.

    Where views of the largest may be reversed (`Oriented.is_doubtful`), the views are mapped again with another seed,
    which begins with other views. This ends when the best is found twice and, if any Sun is known, is confirmed by
    shading; or after TRIALS; or after MORE_TRIALS for few views without such a confirmation. A first seed that maps
    nothing ends it.
    shading_of: the shading of a model compared with the images; None where no Sun is known. all_trials: map TRIALS
    times in any case.
    """
    best: list[Oriented] = []
    for trial in range(MORE_TRIALS):
        seeded = replace(options, seed=options.seed + trial)
        rank = trial - TRIALS if trial >= TRIALS else None
        found = _mapped(cameras, work_dir, seeded, progress, shading_of, rank)
        found_again = bool(best and found) and _alike(best[0], found[0])
        best = max((best, found), key=_quality)
        shown = bool(best) and (best[0].is_shown or best[0].shading is None)
        if not all_trials and (not best or (found_again and shown) or not best[0].is_doubtful):
            break
        wanting = bool(best) and best[0].is_doubtful and not shown
        if trial + 1 >= TRIALS and not (wanting and len(cameras) <= FEW_VIEWS):
            break
    return best


def _mapped(
    cameras: list[Camera],
    work_dir: Path,
    options: SfmOptions,
    progress: Progress,
    shading_of: Callable[[SparseModel], ReliefShading] | None,
    rank: int | None,
) -> list[Oriented]:
    """The reconstructions found with one seed, the largest first.

    rank: of the pair of views to begin with, by its number of matches; None for COLMAP's own choice.
    """
    import pycolmap

    pycolmap.set_random_seed(options.seed)
    out = work_dir / "mapping"
    out.mkdir(exist_ok=True)
    database, images = work_dir / DATABASE, work_dir / "images"
    if options.mapper == "global":
        models = pycolmap.global_mapping(database, images, out, _global_options(cameras, options))
    else:
        mapped = 0
        pair = None if rank is None else next(iter(first_pairs(len(cameras), work_dir)[rank:]), None)

        def more(views: int) -> None:
            nonlocal mapped
            mapped += views
            progress("mapping", min(mapped, len(cameras)), len(cameras))

        models = pycolmap.incremental_mapping(
            database,
            images,
            out,
            _incremental_options(cameras, options, pair),
            initial_image_pair_callback=lambda: more(2),
            next_image_callback=lambda: more(1),
        )
    progress("mapping", len(cameras), len(cameras))  # views that match nothing are not counted above
    adjustment = RobustAdjustment(options.threads)
    by_images = None if shading_of is None else lambda model: shading_of(from_colmap(model, cameras))
    found = [resolve_depth_reversal(model, adjustment, by_images) for model in models.values() if model.num_points3D()]
    return sorted(found, key=lambda each: size(each.model), reverse=True)


def _quality(found: list[Oriented]) -> tuple[int, bool, float]:
    """Order of reconstructions: number of views in the largest, then whether shading confirms it, then the smallness of
    its reprojection error."""
    return (found[0].model.num_reg_images(), found[0].is_shown, -found[0].error_px) if found else (0, False, 0.0)


def _alike(one: Oriented, other: Oriented) -> bool:
    views = [each.model.num_reg_images() for each in (one, other)]
    errors = [each.error_px for each in (one, other)]
    return views[0] == views[1] and max(errors) < UNDETERMINED_RATIO * min(errors)


def _angle_of_pixels(cameras: list[Camera], pixels: float) -> float:
    """Angle [degrees] of a number of pixels. COLMAP's limits of 1-2 degrees are hundreds of pixels of long lenses."""
    return float(np.degrees(pixels / min(min(camera.focal_px) for camera in cameras)))


def _max_focal_ratio(cameras: list[Camera]) -> float:
    """A limit above every camera's focal length / width. COLMAP silently drops views beyond it."""
    return 2.0 * max(max(camera.focal_px) / min(camera.width, camera.height) for camera in cameras)


def _min_focal_ratio(cameras: list[Camera]) -> float:
    """A limit below every camera's focal length / width of its padded picture, which falls with the padding."""
    return 0.5 * min(min(camera.focal_px) / max(padded_size(camera)) for camera in cameras)


def tune_triangulation(triangulation: Any, cameras: list[Camera], options: SfmOptions) -> None:
    gate = _angle_of_pixels(cameras, 2 * options.max_reprojection_px)
    triangulation.create_max_angle_error = gate
    triangulation.continue_max_angle_error = gate
    triangulation.re_max_angle_error = gate
    triangulation.merge_max_reproj_error = options.max_reprojection_px
    triangulation.complete_max_reproj_error = options.max_reprojection_px
    triangulation.min_angle = options.min_triangulation_deg
    triangulation.max_focal_length_ratio = _max_focal_ratio(cameras)
    triangulation.min_focal_length_ratio = _min_focal_ratio(cameras)
    triangulation.random_seed = options.seed


def _incremental_options(cameras: list[Camera], options: SfmOptions, pair: tuple[int, int] | None) -> Any:
    import pycolmap

    pipeline = pycolmap.IncrementalPipelineOptions()
    pipeline.min_num_matches = options.min_pair_matches
    pipeline.min_model_size = 3
    pipeline.max_num_models = MODELS
    pipeline.random_seed = options.seed
    pipeline.num_threads = options.threads
    pipeline.extract_colors = False
    pipeline.ba_global_frames_ratio = GROWTH
    pipeline.ba_global_points_ratio = GROWTH
    pipeline.ba_global_max_refinements = 2
    pipeline.ba_local_max_refinements = 1
    pipeline.ba_local_function_tolerance = LOOSE_TOLERANCE
    pipeline.ba_global_function_tolerance = LOOSE_TOLERANCE
    pipeline.max_focal_length_ratio = _max_focal_ratio(cameras)
    pipeline.min_focal_length_ratio = _min_focal_ratio(cameras)
    pipeline.ba_refine_focal_length = False
    pipeline.ba_refine_principal_point = False
    pipeline.ba_refine_extra_params = False
    pipeline.ba_refine_sensor_from_rig = False
    pipeline.mapper.abs_pose_refine_focal_length = False
    pipeline.mapper.abs_pose_refine_extra_params = False
    pipeline.mapper.init_min_tri_angle = FIRST_PAIR_DEG
    pipeline.mapper.init_min_num_inliers = FIRST_PAIR_MATCHES
    pipeline.mapper.init_max_error = options.max_epipolar_px
    pipeline.mapper.abs_pose_max_error = 3 * options.max_reprojection_px
    pipeline.mapper.abs_pose_min_num_inliers = options.min_pair_matches
    pipeline.mapper.ba_local_min_tri_angle = options.min_triangulation_deg
    pipeline.mapper.filter_max_reproj_error = options.max_reprojection_px
    pipeline.mapper.filter_min_tri_angle = options.min_triangulation_deg
    pipeline.mapper.random_seed = options.seed
    tune_triangulation(pipeline.triangulation, cameras, options)
    if pair is not None:
        pipeline.init_image_id1, pipeline.init_image_id2 = pair
    return pipeline


def _global_options(cameras: list[Camera], options: SfmOptions) -> Any:
    import pycolmap

    pipeline = pycolmap.GlobalPipelineOptions()
    pipeline.min_num_matches = options.min_pair_matches
    pipeline.random_seed = options.seed
    pipeline.num_threads = options.threads
    mapper = pipeline.mapper
    mapper.global_positioning.use_gpu = False
    mapper.bundle_adjustment.ceres.use_gpu = False
    mapper.random_seed = options.seed
    mapper.refine_sensor_from_rig = False
    mapper.bundle_adjustment.refine_focal_length = False
    mapper.bundle_adjustment.refine_principal_point = False
    mapper.bundle_adjustment.refine_extra_params = False
    mapper.min_tri_angle_deg = options.min_triangulation_deg
    mapper.max_angular_reproj_error_deg = _angle_of_pixels(cameras, 2 * options.max_reprojection_px)
    tune_triangulation(mapper.retriangulation, cameras, options)
    return pipeline


def size(model: Any) -> tuple[int, int]:
    """Numbers of registered views and of points."""
    return model.num_reg_images(), model.num_points3D()


def from_colmap(model: Any, cameras: Sequence[Camera]) -> SparseModel:
    """A pycolmap reconstruction of the views that have these cameras, in its own frame, with pixels of their images.

    Where a track has several keypoints of one image, such as a corner found twice, the one nearest to the point counts.
    """
    count = len(cameras)
    rotation, translation = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    registered, view_of = np.zeros(count, bool), {}
    for image_id in model.reg_image_ids():
        image = model.images[image_id]
        view_of[image_id] = view = int(Path(image.name).stem)
        body_from_cam = image.cam_from_world().inverse()
        rotation[view], translation[view] = body_from_cam.rotation.matrix(), body_from_cam.translation
        registered[view] = True
    tracks = [(model.points3D[i], _one_per_image(model, model.points3D[i])) for i in sorted(model.point3D_ids())]
    tracks = [(point, track) for point, track in tracks if len(track) >= 2]
    points, elements = [point for point, _ in tracks], [track for _, track in tracks]
    observed = [(e.image_id, e.point2D_idx) for track in elements for e in track]
    point_view = np.array([view_of[i] for i, _ in observed], np.int32)
    padded_xy = np.array([model.images[i].points2D[n].xy for i, n in observed]).reshape(-1, 2)
    padding = np.array([padding_px(camera) for camera in cameras])
    return SparseModel(
        registered=registered,
        body_from_cam=Rigid(rotation, translation),
        points=np.array([point.xyz for point in points]).reshape(-1, 3),
        point_start=row_starts(np.array([len(track) for track in elements], int)),
        point_view=point_view,
        point_xy=padded_xy - padding[point_view],
        mean_reprojection_px=float(model.compute_mean_reprojection_error()),
    )


def _one_per_image(model: Any, point: Any) -> list[Any]:
    """The elements of a point's track; among several in one image, the one nearest to the point."""
    track = point.track.elements
    if len({element.image_id for element in track}) == len(track):
        return list(track)
    nearest: dict[int, tuple[float, Any]] = {}
    for element in track:
        image = model.images[element.image_id]
        off = float(np.linalg.norm(image.project_point(point.xyz) - image.points2D[element.point2D_idx].xy))
        if element.image_id not in nearest or off < nearest[element.image_id][0]:
            nearest[element.image_id] = off, element
    return [element for _, element in nearest.values()]
