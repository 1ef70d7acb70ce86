"""From one file to one view: the image upright and undistorted, with camera, Sun and pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from photoclinometry.ingest.cameras import camera_named, known_camera
from photoclinometry.ingest.detector import upright
from photoclinometry.ingest.facts import Facts, read_facts, time_of
from photoclinometry.ingest.geometry import (
    Geometry,
    geometry_from_kernels,
    geometry_from_label,
    geometry_from_sumfile,
    geometry_from_tables,
)
from photoclinometry.ingest.known_camera import KnownCamera
from photoclinometry.ingest.line_order import in_camera_order
from photoclinometry.ingest.optics import find_optics, without_camera
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.ingest.radiometry import calibrated, without_saturation
from photoclinometry.ingest.sumfiles import NamedSum, sumfile_of
from photoclinometry.ingest.undistort import undistorted
from photoclinometry.io.archives.archive import read_product
from photoclinometry.io.archives.product import Product
from photoclinometry.io.spice import Kernels
from photoclinometry.io.suns_csv import SunRow
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import ImageError, InputError
from photoclinometry.model.geometry import unit
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior

_WIDEST_DEG = 85.0
"""Largest angle between boresight and the direction of the body's centre; a larger one means mixed-up frames."""
_CODES_PER_SPACECRAFT = 1000
"""NAIF's rule: the instruments of spacecraft -64 are -64000 to -64999."""
SUNS_GIVEN = "table of Suns"
"""`Exposure.sources` of a Sun that --suns gives."""
_MAPS = ("IMAGE_MAP_PROJECTION", "MAPPING")
"""Blocks in the labels of map-projected images."""


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """A view made of one file."""

    path: Path
    data: Path
    """The file that holds the pixels; a label and its image are the same exposure."""
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
    """The sources of camera, Sun and pose, by these words."""
    sumfile: Path | None
    """Its SUMFILE, where there is one."""
    instrument: str
    """The camera's name, as far as it is known."""
    time: datetime | None
    """UTC, to a minute; None where it is not known, or where the Sun is of a table or a SUMFILE: all of these are of
    one solution."""


@dataclass(frozen=True)
class AuxiliaryData:
    """Data from other files than the images."""

    kernels: Kernels | None = None
    sumfiles: Sequence[NamedSum] = ()
    suns: Mapping[str, SunRow] | None = None
    """By image name."""


def read_exposure(path: Path, options: IngestOptions, auxiliary: AuxiliaryData) -> Exposure:
    """A file as a view. Raises InputError that lists everything that is missing, with the options that give it."""
    product = read_product(path, linear=options.linear)
    facts = read_facts(product)
    if facts.scanner:
        raise ImageError(
            f"{path}: is a line scanner's image ({facts.instrument or 'by its label'}), whose camera moves while it "
            "looks; give images of a frame camera"
        )
    if any(block.name in _MAPS for block in product.label.walk()):
        raise ImageError(f"{path}: is projected onto a map, which no camera sees; give the unprojected image")
    known = camera_named(options.camera) if options.camera else known_camera(facts)
    try:
        return _exposure(in_camera_order(product, known, options), facts, known, options, auxiliary)
    except InputError as error:
        if str(error).startswith(str(path)):
            raise
        raise InputError(f"{path}: {error}") from error


def _exposure(
    product: Product, facts: Facts, known: KnownCamera | None, options: IngestOptions, auxiliary: AuxiliaryData
) -> Exposure:
    sumfile = sumfile_of(product.path, facts, auxiliary.sumfiles)
    row = (auxiliary.suns or {}).get(product.path.name) or (auxiliary.suns or {}).get(product.data.name)
    optics = find_optics(product, facts, known, sumfile, options, auxiliary.kernels)
    missing, fault = [], None
    if optics is None:
        missing.append(_no_camera(facts, without_camera(product, facts, known, auxiliary.kernels)))
    try:
        geometry = _geometry(product, facts, known, sumfile, options, auxiliary.kernels)
    except InputError as error:
        geometry, fault = None, error
        missing.append(str(error))
        if row is None:
            missing.append("so the Sun's direction is unknown: correct that, or pass --sumfiles or --suns")
    else:
        if geometry is None and row is None:
            missing.append("the Sun's direction is unknown: pass --kernels, --sumfiles, or --suns")
    if missing:
        missing.extend(_without_match(options, sumfile, row))
    if missing or optics is None:
        raise InputError("; ".join(missing)) from fault
    detector = replace(optics.detector, distortion=None) if options.undistorted else optics.detector
    camera, cam_from_instrument, _ = upright(detector)
    if geometry is not None:
        geometry = geometry.turned(cam_from_instrument)
    distance = facts.sun_distance_km or (geometry.sun_distance_km if geometry else None)
    measured = without_saturation(product.image, known.saturation if known and facts.unit != "iof" else None)
    image, brightness = calibrated(measured, facts.unit, options.solar_flux, distance)
    sun, sigma, sun_source = _sun(row, geometry, options)
    prior = _prior(geometry, options)
    time = None
    if geometry is not None and row is None and sumfile is None:
        time = geometry.time or time_of(facts.start)
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
        sumfile=sumfile.path if sumfile else None,
        instrument=known.name if known else f"{facts.spacecraft or ''} {facts.instrument or ''}".strip().lower(),
        time=time,
    )


def _geometry(
    product: Product,
    facts: Facts,
    known: KnownCamera | None,
    sumfile: NamedSum | None,
    options: IngestOptions,
    kernels: Kernels | None,
) -> Geometry | None:
    """Sun and pose from the first source that has them: SUMFILE, kernels, the cube's tables, the label."""
    if sumfile is not None:
        return geometry_from_sumfile(sumfile.summary)
    if kernels is not None:
        code = facts.frame_code or (known.code_with_filter(facts.filter) if known else None)
        body = options.body or facts.target
        if code is None:
            raise InputError("the label names no instrument, which SPICE needs: pass --camera")
        if body is None:
            raise InputError("the label names no target body, which SPICE needs: pass --body")
        spacecraft = known.spacecraft_code if known else -(abs(code) // _CODES_PER_SPACECRAFT)
        facts = replace(facts, clock=known.clock_of_kernel(facts.clock)) if known else facts
        return geometry_from_kernels(kernels, facts, spacecraft, code, body, known.delay_s if known else 0.0)
    return geometry_from_tables(product) or geometry_from_label(product, facts)


def _check_looks_at_body(prior: PosePrior) -> None:
    """Raises InputError if the body's centre is beside or behind the camera: frames are mixed up then."""
    center = prior.cam_from_body.translation
    angle = float(np.degrees(np.arctan2(np.hypot(center[0], center[1]), center[2])))
    if angle > _WIDEST_DEG:
        raise InputError(
            f"the camera would look {angle:.0f} degrees past the body's centre: its pose is in another frame than the "
            "camera is described in; pass other kernels, or --no-pose-priors and --suns"
        )


def _no_camera(facts: Facts, lacking: str) -> str:
    called = f"instrument {facts.instrument!r}" if facts.instrument else "the label names none"
    cause = f"{called}; {lacking}" if lacking else called
    return (
        f"its camera is not known ({cause}): pass --camera NAME, --pinhole FX FY CX CY, --sumfiles, "
        "or --kernels with its instrument kernel"
    )


def _without_match(options: IngestOptions, sumfile: NamedSum | None, row: SunRow | None) -> list[str]:
    """Tables and files that were given for images and do not name this one."""
    found = []
    if options.sumfiles and sumfile is None:
        found.append("no SUMFILE given has its name or time")
    if options.suns and row is None:
        found.append(f"no row of {options.suns} has its name, without folders, as image")
    return found


def _sun(row: SunRow | None, geometry: Geometry | None, options: IngestOptions) -> tuple[np.ndarray, float, str]:
    default = float(np.deg2rad(options.sun_sigma_deg))
    if row is not None:
        return row.sun, row.sigma_rad or default, SUNS_GIVEN
    assert geometry is not None
    return unit(geometry.sun), default, geometry.source


def _prior(geometry: Geometry | None, options: IngestOptions) -> PosePrior | None:
    if geometry is None or geometry.instrument_from_body is None or not options.pose_priors:
        return None
    pose = geometry.instrument_from_body
    distance = float(np.linalg.norm(pose.translation))
    turned, shifted = options.pose_common_sigma or (0.0, 0.0)
    return PosePrior(
        pose,
        geometry.pointing_sigma_rad or float(np.deg2rad(options.pointing_sigma_deg)),
        geometry.position_sigma_m or options.position_sigma * distance,
        float(np.deg2rad(turned)),
        float(shifted),
    )
