"""The joint estimate alone: it improves a text model that another program has matched and triangulated."""

from __future__ import annotations

import logging
import math
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from photoclinometry.adjust import Adjustment, AdjustOptions
from photoclinometry.io.models.text_model import TextModel, model_fingerprint, read_text_model, write_text_model
from photoclinometry.io.run_files import MODEL_FOLDER
from photoclinometry.io.site import DEFAULT_SUN_SIGMA_RAD
from photoclinometry.model.errors import InputError
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.reflectance import MODELS, ModelChoice, Reflectance, has_published
from photoclinometry.model.scene import Scene
from photoclinometry.model.tiny import TINY
from photoclinometry.photometry.predict import observation_brightness
from photoclinometry.pipeline.choices import choose_reflectance
from photoclinometry.pipeline.folder.run_folder import claimed_run
from photoclinometry.pipeline.folder.run_owner import owner_of_model
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, digest
from photoclinometry.pipeline.joint_estimate import EstimateSettings, JointEstimate
from photoclinometry.pipeline.products import RunResult, RunSummary, write_products

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class RefineOptions(Ranged):
    """Properties of a model that its files do not state, and options of the estimate."""

    reflectance: ModelChoice = "auto"
    """Reflectance model. auto: lunar-lambert where brightness is I/F and the body has published coefficients, else
    mcewen. none: geometry alone."""
    body: str | None = None
    """Body with published coefficients of the reflectance models: vesta or ceres."""
    phase_weighting: Annotated[tuple[float, float] | None, Range()] = None
    """w0 and w1 [1/rad] of the disk function, in place of the published ones."""
    phase_coefficients: Annotated[tuple[float, ...] | None, Range()] = None
    """c_0, c_1 [1/rad], c_2 [1/rad^2], ... of the phase function, in place of the published ones."""
    albedo_unit: Annotated[float | None, Range(above=0)] = None
    """Unit of the model's albedos: they are multiplied by it to become normal albedos, and divided by it again in the
    refined model. The authors' are in units of c_0 (Vesta 0.301, Ceres 0.0746). Left out: c_0 of the phase coefficients
    given, else 1."""
    brightness: Literal["auto", "iof", "dn"] = "auto"
    """What INTENSITY is: radiance factor I/F, or linear uncalibrated numbers. auto: I/F if the reflectance model has a
    phase function (auto: if the body is named), else uncalibrated."""
    reference: str | None = None
    """Name of the image whose pose is held and whose pixels maps are drawn on. Left out: the model's first."""
    sun_sigma_deg: Annotated[float, Range(above=0, most=180)] = math.degrees(DEFAULT_SUN_SIGMA_RAD)
    """Standard deviation of the Sun directions about each axis [degrees]."""
    shadow_threshold: Annotated[float, Range(least=0)] = 0.0
    """Brightness below this is shadow and not used (the authors: 0.025 at Vesta, 0.0025 at Ceres)."""
    min_observations: Annotated[int, Range(least=1, most=1_000_000)] = 6
    """Landmarks with fewer lit observations are left out (with fewer keypoints, of geometry alone)."""
    min_view_observations: Annotated[int, Range(least=1, most=2**31 - 1)] = 100
    """Images with fewer are left out."""
    adjust: AdjustOptions = field(
        default_factory=lambda: AdjustOptions(keypoint_correlation_px=1.0, reflectance_sigma=0.0)
    )
    """As of `phomo run`, but keypoints are assumed to have independent errors and the reflectance is held, as in the
    authors' estimates."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """The model from which the estimate starts."""

    source: Path
    """The model's folder."""
    model: TextModel
    """Views and landmarks with enough observations, with normal albedos."""
    albedo_unit: float
    left_out: tuple[str, ...]
    """Names of images with too few observations."""


@dataclass(frozen=True, kw_only=True)
class RefineModel(Stage[Adjustment]):
    """The joint estimate of a model."""

    name = "refine"
    result = Adjustment
    start: Keyed[Scene]
    options: AdjustOptions

    def make(self, tools: Tools) -> Adjustment:
        return JointEstimate(options=self.options)(self.start.value, EstimateSettings(), tools.progress)


def read_start(folder: Path, options: RefineOptions | None = None) -> Start:
    """The model in `folder`, completed by the options.

    Raises InputError for models that are damaged or cannot be explained: nothing lit, albedos in another unit.
    """
    options = options or RefineOptions()
    reflectance, brightness, unit = photometry(options)
    model = read_text_model(
        folder,
        brightness=brightness,
        reflectance=reflectance,
        body=options.body,
        reference=options.reference,
        sun_sigma_rad=math.radians(options.sun_sigma_deg),
        shadow_threshold=options.shadow_threshold,
    )
    views, landmarks = _well_observed(model.scene, options)
    left_out = tuple(name for name, kept in zip(model.scene.views.name, views, strict=True) if not kept)
    model = _keep(folder, model, views, landmarks)
    model = replace(model, scene=_with_albedo(model.scene, unit))
    if reflectance is not None:
        _check_albedo(folder, model.scene, unit)
    return Start(source=Path(folder), model=model, albedo_unit=unit, left_out=left_out)


def refine(
    start: Start,
    out: Path,
    options: RefineOptions | None = None,
    progress: Progress = no_progress,
    overwrite: bool = False,
) -> RunResult:
    """The joint estimate of a model, as a run folder with the refined model in `out`/model.

    There are no images, and hence no renderings beside them in the report. Results of the same estimate in the folder
    are used again. overwrite: results of another model in the folder are removed first. Raises InputError and
    ReconstructionError.
    """
    options = options or RefineOptions()
    owner = owner_of_model(start.source, start.model.scene)
    with claimed_run(out, owner, progress, overwrite=overwrite) as folder:
        config = {"model": str(start.source.resolve()), **asdict(options)}
        folder.log_config(config)
        scene = Keyed(start.model.scene, digest(model_fingerprint(start.source), options))
        adjustment = folder.result_of(RefineModel(start=scene, options=options.adjust)).value
        folder.reopen()
        with folder.timed("model"):
            write_text_model(
                folder.path / MODEL_FOLDER,
                _with_albedo(adjustment.scene, 1.0 / start.albedo_unit),
                image_id=start.model.image_id,
                point_id=start.model.point_id,
            )
        left_out = dict.fromkeys(start.left_out, "too few lit observations")
        return write_products(folder, RunSummary(adjustment=adjustment, config=config, left_out=left_out))


def photometry(options: RefineOptions) -> tuple[Reflectance | None, str, float]:
    """The reflectance, the kind of brightness ("iof" or "dn"), and the albedos' unit. Raises InputError."""
    brightness = options.brightness
    if brightness == "auto":
        named = options.reflectance == "auto" and has_published("lunar-lambert", options.body)
        model = MODELS.get(options.reflectance)
        brightness = "iof" if named or (model and model.predicts_absolute_brightness) else "dn"
    unit = 1.0 if options.albedo_unit is None else options.albedo_unit
    given = options.phase_weighting is not None or options.phase_coefficients is not None
    if not given:
        return choose_reflectance(options.reflectance, options.body), brightness, unit
    polynomial = {name for name, model in MODELS.items() if model.open_ended}
    if options.reflectance not in polynomial:
        known = ", ".join(sorted(polynomial))
        raise InputError(f"reflectance {options.reflectance} has no coefficients to be given; choose one of {known}")
    if options.phase_weighting is None or not options.phase_coefficients or options.phase_coefficients[0] <= 0:
        raise InputError("give both --phase-weighting and --phase-coefficients, of which the first, c_0, is positive")
    first, *others = options.phase_coefficients
    reflectance = Reflectance(options.reflectance, (*options.phase_weighting, *(c / first for c in others)))
    return reflectance, brightness, first if options.albedo_unit is None else unit


def _well_observed(scene: Scene, options: RefineOptions) -> tuple[np.ndarray, np.ndarray]:
    """(K,) and (J,) bool: views with enough observations, lit unless geometry is all, and landmarks with enough of
    them in those views."""
    tracks = scene.tracks
    useful = tracks.lit if scene.reflectance is not None else np.ones(len(tracks), bool)
    in_view = np.bincount(tracks.view[useful], minlength=len(scene.views))
    views = in_view >= max(1, options.min_view_observations)
    useful = useful & views[tracks.view]
    of_landmark = np.bincount(tracks.landmark[useful], minlength=len(scene.landmarks))
    return views, of_landmark >= options.min_observations


def _keep(folder: Path, model: TextModel, views: np.ndarray, landmarks: np.ndarray) -> TextModel:
    """The model with only some views (K,) and landmarks (J,). Raises InputError where the reference or all is lost."""
    scene, tracks = model.scene, model.scene.tracks
    if not views[scene.reference]:
        name = scene.views.name[scene.reference]
        raise InputError(
            f"{folder}: the reference image {name} has too few lit observations; choose another --reference, or lower "
            "--shadow-threshold or --min-view-observations"
        )
    if not landmarks.any():
        raise InputError(
            f"{folder}: no landmark has enough lit observations; lower --shadow-threshold or --min-observations"
        )
    if not landmarks.all() or not views.all():
        log.info("left out: %d landmarks and %d images with few observations", np.sum(~landmarks), np.sum(~views))
    used = np.flatnonzero(views)
    scene = replace(
        scene,
        views=scene.views[used],
        landmarks=scene.landmarks[landmarks],
        tracks=tracks.of_landmarks(np.flatnonzero(landmarks))[0].of_views(used),
        reference=int(np.sum(views[: scene.reference])),
    )
    return TextModel(scene=scene, image_id=model.image_id[views], point_id=model.point_id[landmarks])


def _with_albedo(scene: Scene, factor: float) -> Scene:
    return replace(scene, landmarks=replace(scene.landmarks, albedo=scene.landmarks.albedo * factor))


def _check_albedo(folder: Path, scene: Scene, unit: float) -> None:
    """Raises InputError where the albedos predict less than half of the reference image's brightness, or over twice."""
    tracks = scene.tracks
    there = tracks.lit & (tracks.view == scene.reference)
    predicted, measured = observation_brightness(scene)[there], tracks.brightness[there]
    bias = scene.views.bias[scene.reference]
    ratio = float(np.median(measured - bias) / max(np.median(predicted - bias), TINY))
    if not 0.5 < ratio < 2.0:
        name = scene.views.name[scene.reference]
        raise InputError(
            f"{folder}: the brightness of {name} is {ratio:.3g} times what the model's albedos predict; give their "
            f"unit, --albedo-unit {ratio * unit:.3g} or so (of the authors' models, c_0 of the phase function)"
        )
