"""One file as a view: its image upright and undistorted, with camera, Sun and pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photoclinometry.ingest.cameras import KnownCamera, camera_named, code_for, detector_for, fitted, known_camera
from photoclinometry.ingest.detector import BORESIGHT_Z, Detector, turned_about, upright, windowed
from photoclinometry.ingest.facts import Facts, read_facts
from photoclinometry.ingest.geometry import (
    Geometry,
    geometry_from_kernels,
    geometry_from_label,
    geometry_from_sumfile,
    geometry_from_tables,
)
from photoclinometry.ingest.keywords import detector_from_keywords, keywords_of_label
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.ingest.radiometry import calibrated, without_saturation
from photoclinometry.ingest.sumfiles import NamedSum, detector_of_sumfile, sumfile_of
from photoclinometry.ingest.undistort import undistorted
from photoclinometry.io.archives.archive import read_product
from photoclinometry.io.archives.product import Product
from photoclinometry.io.spice import Kernels
from photoclinometry.io.suns_csv import SunRow
from photoclinometry.model.errors import ImageError, InputError
from photoclinometry.model.geometry import unit
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Camera, Image

_WIDEST_DEG = 85.0
"""No image is taken farther than this from the direction of the body's centre."""
_MAPS = ("IMAGE_MAP_PROJECTION", "MAPPING")
"""Blocks of labels whose images are maps."""


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """What one file gives."""

    path: Path
    data: Path
    """The file that holds the pixels; the same exposure may be named by its label and by its image."""
    image: Image
    camera: Camera
    sun: np.ndarray
    """(3,) unit vector from the body towards the Sun, in C."""
    sun_sigma_rad: float
    prior: PosePrior | None
    body: str | None
    brightness: str
    """"iof" or "dn"."""
    sources: dict[str, str]
    """Where camera, Sun and pose are from."""


@dataclass(frozen=True)
class Help:
    """What was read beside the images."""

    kernels: Kernels | None = None
    sumfiles: Sequence[NamedSum] = ()
    suns: Mapping[str, SunRow] | None = None


@dataclass(frozen=True)
class _Optics:
    detector: Detector
    source: str


def read_exposure(path: Path, options: IngestOptions, beside: Help) -> Exposure:
    """A file as a view. Raises InputError: all that is missing, and what to pass."""
    product = read_product(path)
    facts = read_facts(product)
    if facts.scanner:
        raise ImageError(
            f"{path}: is a line scanner's image ({facts.instrument or 'by its label'}), whose camera moves while it "
            "looks; give images of a frame camera"
        )
    if any(block.name in _MAPS for block in product.label.walk()):
        raise ImageError(
            f"{path}: is projected onto a map, where nothing is seen from one place; give the image itself"
        )
    known = camera_named(options.camera) if options.camera else known_camera(facts)
    try:
        return _exposure(_in_order(product, known, options), facts, known, options, beside)
    except InputError as error:
        if str(error).startswith(str(path)):
            raise
        raise InputError(f"{path}: {error}") from error


def _exposure(
    product: Product, facts: Facts, known: KnownCamera | None, options: IngestOptions, beside: Help
) -> Exposure:
    own_sum = sumfile_of(product.path, facts, beside.sumfiles)
    row = (beside.suns or {}).get(product.path.name) or (beside.suns or {}).get(product.data.name)
    optics = _optics(product, facts, known, own_sum, options, beside.kernels)
    missing = [] if optics else [_no_camera(facts)]
    try:
        geometry = _geometry(product, facts, known, own_sum, options, beside.kernels)
    except InputError as error:
        geometry = None
        missing.append(str(error))
    if geometry is None and row is None and len(missing) < 2:
        missing.append("nothing tells where the Sun stood: pass --kernels, --sumfiles, or --suns")
    if missing or optics is None:
        raise InputError("; ".join(missing))
    detector = replace(optics.detector, distortion=None) if options.undistorted else optics.detector
    camera, cam_from_instrument, _ = upright(detector)
    if geometry is not None:
        geometry = geometry.turned(cam_from_instrument)
    distance = facts.sun_distance_km or (geometry.sun_distance_km if geometry else None)
    measured = without_saturation(product.image, known.saturation if known and facts.unit != "iof" else None)
    image, brightness = calibrated(measured, facts.unit, options.solar_flux, distance)
    sun, sigma, sun_source = _sun(row, geometry, options)
    prior = _prior(geometry, options)
    if prior is not None:
        _check_looks_at_body(prior)
    return Exposure(
        path=product.path,
        data=product.data,
        image=undistorted(image, detector),
        camera=camera,
        sun=sun,
        sun_sigma_rad=sigma,
        prior=prior,
        body=(options.body or facts.target or "").lower() or None,
        brightness="dn" if options.uncalibrated else brightness,
        sources={
            "camera": optics.source,
            "sun": sun_source,
            "pose": geometry.source if geometry is not None and prior is not None else "none",
        },
    )


def _in_order(product: Product, known: KnownCamera | None, options: IngestOptions) -> Product:
    """The product with its lines as the camera's files have them; for cameras that are not known, first line on top.

    Where nothing is known of a camera's labels, its files are taken as the table has them, unless --lines is up.

    Raises ImageError where a label contradicts what all files of the camera have.
    """
    if product.kind == "ISIS":
        return product
    said = (product.lines_up, product.samples_left)
    if known is None:
        if product.samples_left:
            raise ImageError(f"{product.path}: its samples run from right to left; mirror it first")
        turn = product.lines_up if options.lines_up is None else options.lines_up
        return _turned(product) if turn else product
    if not known.display:
        return _turned(product) if options.lines_up else product
    if options.lines_up is not None:
        return product if options.lines_up == known.display[0][0] else _turned(product)
    if None not in said and said not in known.display:
        raise ImageError(
            f"{product.path}: the label has the first line {'at the bottom' if said[0] else 'on top'} and the first "
            f"sample {'right' if said[1] else 'left'}, unlike all files of {known.name}; if the lines run the usual "
            f"way all the same, pass --lines {'up' if known.display[0][0] else 'down'}"
        )
    return product


def _turned(product: Product) -> Product:
    image = product.image
    return replace(product, image=Image(image.name, image.brightness[::-1], image.valid[::-1]))


def _optics(
    product: Product,
    facts: Facts,
    known: KnownCamera | None,
    own_sum: NamedSum | None,
    options: IngestOptions,
    kernels: Kernels | None,
) -> _Optics | None:
    """The detector of the image, as its lines and samples now run."""
    height, width = product.image.brightness.shape
    if options.pinhole is not None:
        return _Optics(_given_pinhole(options.pinhole, known, facts, (width, height)), "--pinhole")
    if own_sum is not None:
        detector = detector_of_sumfile(own_sum)
        if detector.mirrored and options.lines_up is None:
            raise InputError(
                f"{own_sum.path.name} counts lines upwards (K-MATRIX), and whether the image does is not known: pass "
                "--lines down if the file has its lines as the SUMFILE counts them, --lines up if the other way round"
            )
        return _Optics(fitted(detector, width, height), f"SUMFILE {own_sum.path.name}")
    whole = _whole_detector(product, facts, known, kernels)
    if whole is None:
        return None
    if product.window is not None:
        return replace(whole, detector=windowed(whole.detector, product.window, width, height))
    return replace(whole, detector=fitted(whole.detector, width, height, known.raw_lines if known else None))


def _whole_detector(
    product: Product, facts: Facts, known: KnownCamera | None, kernels: Kernels | None
) -> _Optics | None:
    """By the cube's keywords, the loaded kernels, or the table."""
    size = (known.detector.width, known.detector.height) if known else product.image.brightness.shape[::-1]
    code = facts.frame_code or (code_for(known, facts.filter) if known else None)
    lines_turned = known is not None and known.cube_lines_turned
    if product.kind == "ISIS" and code is not None:
        found = detector_from_keywords(keywords_of_label(product.label), code, facts.filter, size)
        if found is not None:
            return _Optics(found, "ISIS keywords")
    # Addenda describe detectors in ISIS's frames, with the boresight along z; not so, the table is the better guide.
    if kernels is not None and code is not None and (known is None or known.detector.frame == BORESIGHT_Z):
        found = detector_from_keywords(kernels.keyword, code, facts.filter, size)
        if found is not None:
            turn = lines_turned and product.kind != "ISIS"
            return _Optics(turned_about(found, lines=True, samples=False) if turn else found, "instrument kernel")
    if known is None:
        return None
    detector = detector_for(known, facts.filter)
    turn = lines_turned and product.kind == "ISIS"
    return _Optics(
        turned_about(detector, lines=True, samples=False) if turn else detector,
        f"table of cameras ({known.name}): {known.source}",
    )


def _given_pinhole(
    pinhole: tuple[float, float, float, float], known: KnownCamera | None, facts: Facts, size: tuple[int, int]
) -> Detector:
    """The camera given by hand; if the camera is known, its axes tell how poses in its frame are meant."""
    fx, fy, cx, cy = pinhole
    if min(fx, fy) <= 0 or not np.isfinite(pinhole).all():
        raise InputError(f"--pinhole {pinhole}: expected fx fy cx cy [px], positive focal lengths first")
    plain = Detector(
        width=size[0], height=size[1], focal_mm=1.0, pitch_mm=(1.0 / fx, 1.0 / fy), center=(cx, cy), distortion=None
    )
    if known is None:
        return plain
    detector = detector_for(known, facts.filter)
    return replace(plain, axes=detector.axes, frame=detector.frame)


def _geometry(
    product: Product,
    facts: Facts,
    known: KnownCamera | None,
    own_sum: NamedSum | None,
    options: IngestOptions,
    kernels: Kernels | None,
) -> Geometry | None:
    """From the best source there is: SUMFILE, kernels, the cube's tables, the label. Raises InputError."""
    if own_sum is not None:
        return geometry_from_sumfile(own_sum.summary)
    if kernels is not None:
        code = facts.frame_code or (code_for(known, facts.filter) if known else None)
        body = options.body or facts.target
        if code is None:
            raise InputError("which instrument it is the label does not say, so SPICE cannot be asked: pass --camera")
        if body is None:
            raise InputError("which body it shows the label does not say, so SPICE cannot be asked: pass --body")
        spacecraft = known.spacecraft_code if known else -(abs(code) // 1000)
        return geometry_from_kernels(kernels, facts, spacecraft, code, body, known.delay_s if known else 0.0)
    return geometry_from_tables(product) or geometry_from_label(product, facts)


def _check_looks_at_body(prior: PosePrior) -> None:
    """Raises InputError where the body would be beside or behind the camera: frames are mixed up then."""
    center = prior.cam_from_body.translation
    angle = float(np.degrees(np.arctan2(np.hypot(center[0], center[1]), center[2])))
    if angle > _WIDEST_DEG:
        raise InputError(
            f"the camera would look {angle:.0f} degrees past the body's centre: its pose is in another frame than the "
            "camera is described in; pass other kernels, or --no-pose-priors and --suns"
        )


def _no_camera(facts: Facts) -> str:
    called = f"instrument {facts.instrument!r}" if facts.instrument else "the label names none"
    return (
        f"its camera is not known ({called}): pass --camera NAME, --pinhole FX FY CX CY, --sumfiles, "
        "or --kernels with its instrument kernel"
    )


def _sun(row: SunRow | None, geometry: Geometry | None, options: IngestOptions) -> tuple[np.ndarray, float, str]:
    usual = float(np.deg2rad(options.sun_sigma_deg))
    if row is not None:
        return row.sun, row.sigma_rad or usual, "table of Suns"
    assert geometry is not None
    return unit(geometry.sun), usual, geometry.source


def _prior(geometry: Geometry | None, options: IngestOptions) -> PosePrior | None:
    if geometry is None or geometry.instrument_from_body is None or not options.pose_priors:
        return None
    pose = geometry.instrument_from_body
    distance = float(np.linalg.norm(pose.translation))
    return PosePrior(
        pose,
        geometry.pointing_sigma_rad or float(np.deg2rad(options.pointing_sigma_deg)),
        geometry.position_sigma_m or options.position_sigma * distance,
    )
