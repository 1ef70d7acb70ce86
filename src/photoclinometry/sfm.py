"""Sparse structure from motion: images and intrinsics -> poses and sparse points, from nothing.

The one file (besides `io/colmap.py`) that knows pycolmap. SIFT keypoints are matched between all pairs of
images, verified by two-view geometry and mapped with the intrinsics held fixed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from photoclinometry.errors import InputError, ReconstructionError
from photoclinometry.geometry import Rigid
from photoclinometry.keypoints import sift_keypoints, stretch_for_features
from photoclinometry.scene import Camera, Image
from photoclinometry.sparse import SparseModel, connected_groups, normalised

log = logging.getLogger(__name__)

PAIRS_AT_ONCE = 60
"""Pairs matched between two reports of progress; fewer cost time, as search indices are built anew."""

Progress = Callable[[str, int, int], None]
"""Called as progress(stage, done, total)."""


@dataclass(frozen=True, kw_only=True)
class SfmOptions:
    """Sparse structure from motion."""

    max_features: int = 5000
    """SIFT keypoints per image, the strongest contrast first."""
    mapper: Literal["incremental", "global"] = "incremental"
    """How poses are found: view after view, or all at once."""
    max_ratio: float = 0.8
    """Lowe's ratio test: the best descriptor is nearer than this times the second best."""
    max_epipolar_px: float = 2.0
    """A pair's matches agree with its two-view geometry within this [px]."""
    max_reprojection_px: float = 1.5
    """Observations of sparse points farther from their projection are dropped [px]."""
    min_triangulation_deg: float = 1.0
    """Points whose rays meet at a smaller angle are dropped."""
    min_pair_matches: int = 20
    """Pairs with fewer verified matches count as not overlapping."""
    seed: int = 0
    """Seed of RANSAC and of the mapper."""
    threads: int = -1
    """-1: all cores. 1 repeats a model bit by bit; several add up in any order, and what is weakly determined may then
    end elsewhere within its uncertainty."""


def reconstruct_sparse(
    images: list[Image],
    cameras: list[Camera],
    work_dir: Path,
    options: SfmOptions | None = None,
    progress: Progress | None = None,
) -> SparseModel:
    """Poses and sparse points of the views, from their images alone; intrinsics are known and held fixed.

    images, cameras: one per view. work_dir receives 8-bit copies and COLMAP's database (overwritten).
    Views that do not register are logged by name and False in `registered`; `reason` says why.
    Raises InputError for fewer than 3 images, ReconstructionError where fewer than 3 views register.
    """
    options = options or SfmOptions()
    if len(images) < 3:
        raise InputError(f"{len(images)} images given; a reconstruction needs at least 3 views")
    work_dir = Path(work_dir)
    work_dir.mkdir(parents=True, exist_ok=True)
    with _quiet_pycolmap(options.seed):
        _extract(images, cameras, work_dir, options, progress)
        inliers = _match(len(images), work_dir, options, progress)
        models = _map(cameras, work_dir, options, progress)
    names = [image.name for image in images]
    best = max(models, key=_size, default=None)
    if best is None or best.num_reg_images() < 3:
        raise ReconstructionError(_explain_failure(names, inliers, best, options))
    sparse = normalised(_from_colmap(best, len(images)), cameras)
    log.info(
        "%d of %d views registered, %d points, %.3f px mean reprojection error",
        sparse.registered.sum(), len(names), len(sparse.points), sparse.mean_reprojection_px,
    )  # fmt: skip
    reason = _reasons(names, sparse.registered, [_views_of(model) for model in models], inliers, options)
    for view in np.flatnonzero(~sparse.registered):
        log.warning("%s is left out: %s", names[view], reason[view])
    return replace(sparse, reason=reason)


@contextmanager
def _quiet_pycolmap(seed: int) -> Iterator[None]:
    """Seeded, and silent but for errors: what matters is said by this package's own log."""
    import pycolmap

    before = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)
    pycolmap.set_random_seed(seed)
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = before


def _image_file(view: int) -> str:
    return f"{view:05d}.png"


def _extract(
    images: list[Image], cameras: list[Camera], work_dir: Path, options: SfmOptions, progress: Progress | None
) -> None:
    """A new database with the keypoints of every view; one COLMAP camera per distinct set of intrinsics."""
    import cv2
    import pycolmap

    pictures = work_dir / "images"
    pictures.mkdir(exist_ok=True)
    database_path = work_dir / "database.db"
    database_path.unlink(missing_ok=True)
    with pycolmap.Database.open(database_path) as database:
        view_cameras = _write_cameras(database, cameras)
        for view, image in enumerate(images):
            picture = stretch_for_features(image)
            if not cv2.imwrite(str(pictures / _image_file(view)), picture):
                raise OSError(f"{pictures}: cannot write the pictures for feature detection")
            keypoints, descriptors = sift_keypoints(picture, image.valid, options.max_features)
            image_id = _write_view(database, view, view_cameras[view])
            database.write_keypoints(image_id, keypoints)
            kind = pycolmap.FeatureExtractorType.SIFT
            database.write_descriptors(image_id, pycolmap.FeatureDescriptors(kind, descriptors))
            if progress:
                progress("features", view + 1, len(images))


def _write_cameras(database: Any, cameras: list[Camera]) -> list[Any]:
    """Each view's COLMAP camera, with its trivial rig."""
    import pycolmap

    made = {}
    for camera in dict.fromkeys(cameras):
        c = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=list(camera.params))
        c.has_prior_focal_length = True
        c.camera_id = database.write_camera(c)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(c.sensor_id)
        rig.rig_id = database.write_rig(rig)
        made[camera] = (c, rig)
    return [made[camera] for camera in cameras]


def _write_view(database: Any, view: int, camera_and_rig: tuple[Any, Any]) -> int:
    """The new image's id; the image is a frame of its own."""
    import pycolmap

    camera, rig = camera_and_rig
    image = pycolmap.Image(name=_image_file(view), camera_id=camera.camera_id)
    image.image_id = database.write_image(image)
    frame = pycolmap.Frame()
    frame.rig_id = rig.rig_id
    frame.add_data_id(image.data_id)
    database.write_frame(frame)
    return image.image_id


def _match(count: int, work_dir: Path, options: SfmOptions, progress: Progress | None) -> np.ndarray:
    """(K, K) verified matches between all pairs of views.

    Plain, not guided, matching: matches found again along epipolar lines made the poses worse (0.034
    against 0.026 degrees on Vesta) and took nine times as long.
    """
    import pycolmap

    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    matching.num_threads = options.threads
    matching.sift.max_ratio = options.max_ratio
    verification = pycolmap.TwoViewGeometryOptions()
    verification.min_num_inliers = options.min_pair_matches
    verification.detect_watermark = False
    verification.ransac.max_error = options.max_epipolar_px
    verification.ransac.random_seed = options.seed
    database, pairs_file = work_dir / "database.db", work_dir / "pairs.txt"
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = str(pairs_file)
    pairs = [(a, b) for a in range(count) for b in range(a)]
    for done in range(0, len(pairs), PAIRS_AT_ONCE):
        block = pairs[done : done + PAIRS_AT_ONCE]
        pairs_file.write_text("".join(f"{_image_file(a)} {_image_file(b)}\n" for a, b in block))
        pycolmap.match_image_pairs(database, matching, pairing, verification, pycolmap.Device.cpu)
        if progress:
            progress("matches", done + len(block), len(pairs))
    inliers = np.zeros((count, count), int)
    for (a, b), number in _verified_pairs(database):
        inliers[a, b] = inliers[b, a] = number
    log.info("%d of %d pairs overlap", np.count_nonzero(inliers) // 2, len(pairs))
    return inliers


def _verified_pairs(database_path: Path) -> list[tuple[tuple[int, int], int]]:
    import pycolmap

    with pycolmap.Database.open(database_path) as database:
        view = {image.image_id: int(Path(image.name).stem) for image in database.read_all_images()}
        pair_ids, numbers = database.read_two_view_geometry_num_inliers()
        pairs = [pycolmap.pair_id_to_image_pair(pair) for pair in pair_ids]
    return [((view[a], view[b]), int(number)) for (a, b), number in zip(pairs, numbers, strict=True)]


def _map(cameras: list[Camera], work_dir: Path, options: SfmOptions, progress: Progress | None) -> list[Any]:
    """The reconstructions found (one for each set of views that hang together)."""
    import pycolmap

    out = work_dir / "mapping"
    out.mkdir(exist_ok=True)
    database, images = work_dir / "database.db", work_dir / "images"
    if options.mapper == "global":
        models = pycolmap.global_mapping(database, images, out, _global_options(cameras, options))
    else:
        mapped = 0

        def one_more() -> None:
            nonlocal mapped
            mapped += 1
            if progress:
                progress("mapping", min(mapped, len(cameras)), len(cameras))

        models = pycolmap.incremental_mapping(
            database, images, out, _incremental_options(cameras, options), next_image_callback=one_more
        )
    for model in models.values():
        _adjust_robustly(model, options)
    return list(models.values())


def _adjust_robustly(model: Any, options: SfmOptions) -> None:
    """A last bundle adjustment with a loss that matches the keypoints' precision (0.3 px): shadow edges move
    and make heavy tails. It took a quarter off the rotation errors of simulated sites."""
    import pycolmap

    adjustment = pycolmap.BundleAdjustmentOptions()
    adjustment.refine_focal_length = False
    adjustment.refine_principal_point = False
    adjustment.refine_extra_params = False
    adjustment.refine_sensor_from_rig = False
    adjustment.ceres.use_gpu = False
    adjustment.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    adjustment.ceres.loss_function_scale = 0.3
    adjustment.ceres.solver_options.num_threads = options.threads
    adjustment.ceres.solver_options.max_num_iterations = 50
    adjustment.ceres.solver_options.function_tolerance = 1e-8
    adjustment.print_summary = False
    # Not pycolmap.bundle_adjustment: that prints whatever the log level.
    problem = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        problem.add_image(image_id)
    problem.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(adjustment, problem, model).solve()
    model.update_point_3d_errors()


def _angle_of_pixels(cameras: list[Camera], pixels: float) -> float:
    """Degrees that `pixels` subtend: COLMAP's gates of 1-2 degrees are hundreds of pixels of such cameras."""
    return float(np.degrees(pixels / min(min(camera.focal_px) for camera in cameras)))


def _max_focal_ratio(cameras: list[Camera]) -> float:
    """Above every camera's focal length / width; COLMAP drops longer lenses (> 10) without a word."""
    return 10.0 + 2.0 * max(max(camera.focal_px) / min(camera.width, camera.height) for camera in cameras)


def _tune_triangulation(triangulation: Any, cameras: list[Camera], options: SfmOptions) -> None:
    gate = _angle_of_pixels(cameras, 2 * options.max_reprojection_px)
    triangulation.create_max_angle_error = gate
    triangulation.continue_max_angle_error = gate
    triangulation.re_max_angle_error = gate
    triangulation.merge_max_reproj_error = options.max_reprojection_px
    triangulation.complete_max_reproj_error = options.max_reprojection_px
    triangulation.min_angle = options.min_triangulation_deg
    triangulation.max_focal_length_ratio = _max_focal_ratio(cameras)
    triangulation.random_seed = options.seed


def _incremental_options(cameras: list[Camera], options: SfmOptions) -> Any:
    import pycolmap

    pipeline = pycolmap.IncrementalPipelineOptions()
    pipeline.min_num_matches = options.min_pair_matches
    pipeline.min_model_size = 3
    pipeline.max_num_models = 10
    pipeline.random_seed = options.seed
    pipeline.num_threads = options.threads
    pipeline.extract_colors = False
    # Fewer and looser bundle adjustments on the way: a third of the time for the same poses.
    pipeline.ba_global_frames_ratio = 1.4
    pipeline.ba_global_points_ratio = 1.4
    pipeline.ba_global_max_refinements = 2
    pipeline.ba_local_max_refinements = 1
    pipeline.ba_local_function_tolerance = 1e-6
    pipeline.ba_global_function_tolerance = 1e-6
    pipeline.max_focal_length_ratio = _max_focal_ratio(cameras)
    pipeline.ba_refine_focal_length = False
    pipeline.ba_refine_principal_point = False
    pipeline.ba_refine_extra_params = False
    pipeline.ba_refine_sensor_from_rig = False
    pipeline.mapper.abs_pose_refine_focal_length = False
    pipeline.mapper.abs_pose_refine_extra_params = False
    pipeline.mapper.init_min_tri_angle = 4.0
    pipeline.mapper.init_min_num_inliers = 50
    pipeline.mapper.init_max_error = options.max_epipolar_px
    pipeline.mapper.abs_pose_max_error = 3 * options.max_reprojection_px
    pipeline.mapper.abs_pose_min_num_inliers = options.min_pair_matches
    pipeline.mapper.ba_local_min_tri_angle = options.min_triangulation_deg
    pipeline.mapper.filter_max_reproj_error = options.max_reprojection_px
    pipeline.mapper.filter_min_tri_angle = options.min_triangulation_deg
    pipeline.mapper.random_seed = options.seed
    _tune_triangulation(pipeline.triangulation, cameras, options)
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
    _tune_triangulation(mapper.retriangulation, cameras, options)
    return pipeline


def _size(model: Any) -> tuple[int, int]:
    return model.num_reg_images(), model.num_points3D()


def _views_of(model: Any) -> list[int]:
    return sorted(int(Path(model.images[i].name).stem) for i in model.reg_image_ids())


def _from_colmap(model: Any, count: int) -> SparseModel:
    rotation, translation = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    registered, view_of = np.zeros(count, bool), {}
    for image_id in model.reg_image_ids():
        image = model.images[image_id]
        view_of[image_id] = view = int(Path(image.name).stem)
        body_from_cam = image.cam_from_world().inverse()
        rotation[view], translation[view] = body_from_cam.rotation.matrix(), body_from_cam.translation
        registered[view] = True
    points = [model.points3D[i] for i in sorted(model.point3D_ids())]
    elements = [point.track.elements for point in points]
    observed = [(e.image_id, e.point2D_idx) for track in elements for e in track]
    return SparseModel(
        registered=registered,
        body_from_cam=Rigid(rotation, translation),
        points=np.array([point.xyz for point in points]).reshape(-1, 3),
        point_start=np.concatenate([[0], np.cumsum([len(track) for track in elements])]).astype(np.int64),
        point_view=np.array([view_of[i] for i, _ in observed], np.int32),
        point_xy=np.array([model.images[i].points2D[n].xy for i, n in observed]).reshape(-1, 2),
        mean_reprojection_px=float(model.compute_mean_reprojection_error()),
    )


def _explain_failure(names: list[str], inliers: np.ndarray, best: Any, options: SfmOptions) -> str:
    registered = best.num_reg_images() if best is not None else 0
    pairs = np.count_nonzero(inliers >= options.min_pair_matches) // 2
    other = "global" if options.mapper == "incremental" else "incremental"
    message = (
        f"{registered} of {len(names)} views registered, at least 3 are needed "
        f"({pairs} of {len(names) * (len(names) - 1) // 2} pairs of images matched, "
        f"{int(inliers.max())} matches in the best)."
    )
    groups = [group for group in connected_groups(inliers, options.min_pair_matches) if len(group) > 1]
    if len(groups) > 1:
        message += " The views fall apart into places that share nothing: " + _listing(names, groups) + "."
    return message + (
        " Use images that overlap more and whose light differs less (Sun within about 30 degrees), views 3 "
        f"to 30 degrees apart, more features (now {options.max_features}), or the {other} mapper."
    )


def _listing(names: list[str], groups: list[list[int]]) -> str:
    return "; ".join("[" + ", ".join(names[view] for view in group) + "]" for group in groups)


def _reasons(
    names: list[str], registered: np.ndarray, places: list[list[int]], inliers: np.ndarray, options: SfmOptions
) -> np.ndarray:
    """(K,) str: why views are not registered. places: the views of each model that was found."""
    reason = np.full(len(names), "", object)
    for view in np.flatnonzero(~registered):
        partners = np.count_nonzero(inliers[view][registered] >= options.min_pair_matches)
        said = f"not registered, it matched {partners} of the {registered.sum()} registered views"
        place = next((p for p in places if view in p and not registered[p].any()), None)
        if place is not None:
            others = ", ".join(names[k] for k in place if k != view)
            said += f"; it shows another place, with {others}: that of more views is mapped, the other is a site apart"
        reason[view] = said
    return reason.astype(str)
