"""The detector of an image, from the best source there is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.ingest.detector import BORESIGHT_Z, Detector, fitted, turned_about, windowed
from photoclinometry.ingest.facts import Facts
from photoclinometry.ingest.keywords import detector_from_keywords, keywords_of_label, lacking_keywords
from photoclinometry.ingest.known_camera import KnownCamera
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.ingest.sumfiles import NamedSum, detector_of_sumfile
from photoclinometry.io.archives.product import Product
from photoclinometry.io.spice import Kernels
from photoclinometry.model.errors import InputError


@dataclass(frozen=True)
class Optics:
    """A detector, and the source it is from."""

    detector: Detector
    source: str


def find_optics(
    product: Product,
    facts: Facts,
    known: KnownCamera | None,
    sumfile: NamedSum | None,
    options: IngestOptions,
    kernels: Kernels | None,
) -> Optics | None:
    """The detector of the image, in the order of `product`; None if no source gives it. Raises InputError."""
    height, width = product.image.brightness.shape
    if options.pinhole is not None:
        return Optics(_given_pinhole(options.pinhole, known, facts, (width, height)), "--pinhole")
    if sumfile is not None:
        detector = detector_of_sumfile(sumfile)
        if detector.mirrored and options.lines_up is None:
            raise InputError(
                f"{sumfile.path.name} counts lines upwards (K-MATRIX), and the image's order of lines is unknown: pass "
                "--lines down if the image has the SUMFILE's order, --lines up if it has the reverse"
            )
        return Optics(fitted(detector, width, height), f"SUMFILE {sumfile.path.name}")
    whole = _whole_detector(product, facts, known, kernels, options)
    if whole is None:
        return None
    raw_lines = known.raw_lines if known else None
    if product.window is None:
        return replace(whole, detector=fitted(whole.detector, width, height, raw_lines))
    parent = whole.detector
    if product.window.parent is not None:
        parent = fitted(parent, *product.window.parent, raw_lines)
    return replace(whole, detector=windowed(parent, product.window, width, height))


def _check_binning(product: Product) -> None:
    """Raises InputError for cubes of MESSENGER's MDIS whose place on the detector depends on filter or binning."""
    instrument = product.label.block("ISISCUBE", "INSTRUMENT")
    if instrument is None or not str(instrument.get("INSTRUMENTID")).upper().startswith("MDIS"):
        return
    if str(instrument.get("INSTRUMENTID")).upper() == "MDIS-WAC":
        raise InputError("each filter of MDIS-WAC is a camera of its own, which is not supported: pass --pinhole")
    for name in ("FPUBINNINGMODE", "PIXELBINNINGMODE"):
        if instrument.get(name) not in (None, 0):
            raise InputError(
                f"{name} is {instrument.get(name)}: binned images of MDIS are not supported: pass --pinhole"
            )


def without_camera(product: Product, facts: Facts, known: KnownCamera | None, kernels: Kernels | None) -> str:
    """The reason why no source gives the camera of an image: the keywords that each lacks."""
    code = _instrument(facts, known)
    if code is None:
        return "the label has no NaifFrameCode of ISIS" if product.kind == "ISIS" else ""
    held = {"the cube": keywords_of_label(product.label)} if product.kind == "ISIS" else {}
    if kernels is not None:
        held["the kernels"] = kernels.keywords_of(code)
    return "; ".join(
        f"{place} {'lack' if place.endswith('s') else 'lacks'} {', '.join(lacking_keywords(keywords, code))}"
        for place, keywords in held.items()
    )


def _instrument(facts: Facts, known: KnownCamera | None) -> int | None:
    """NAIF's identifier of the instrument, or of its filter."""
    return facts.frame_code or (known.code_with_filter(facts.filter) if known else None)


def _whole_detector(
    product: Product, facts: Facts, known: KnownCamera | None, kernels: Kernels | None, options: IngestOptions
) -> Optics | None:
    """The whole detector by the cube's keywords, the loaded kernels, or the table of cameras, in this order."""
    _check_binning(product)
    height, width = product.image.brightness.shape
    parent = (product.window and product.window.parent) or (width, height)
    size = (known.detector.width, known.detector.height) if known else parent
    code = _instrument(facts, known)
    lines_turned = known is not None and known.cube_lines_turned
    in_cube = known.in_cube_order(facts.filter) if known else None
    if product.kind == "ISIS" and code is not None:
        held = keywords_of_label(product.label)
        found = detector_from_keywords(held, code, facts.filter, size, in_cube, undistorted=options.undistorted)
        if found is not None:
            return Optics(found, "ISIS keywords")
    # Addenda assume ISIS's frames, with the boresight along z. For other frames the table is more reliable.
    if kernels is not None and code is not None and (known is None or known.detector.frame == BORESIGHT_Z):
        held = kernels.keywords_of(code)
        try:
            found = detector_from_keywords(held, code, facts.filter, size, in_cube, undistorted=options.undistorted)
        except InputError as error:
            named = ", ".join(file.name for file in kernels.files if file.suffix.lower() == ".ti") or "the kernels"
            raise InputError(f"{error} (in {named})") from error
        if found is not None:
            turn = lines_turned and product.kind != "ISIS"
            return Optics(turned_about(found, lines=True, samples=False) if turn else found, "instrument kernel")
    if known is None:
        return None
    return Optics(
        known.in_cube_order(facts.filter) if product.kind == "ISIS" else known.with_filter(facts.filter),
        f"table of cameras ({known.name}): {known.source}",
    )


def _given_pinhole(
    pinhole: tuple[float, float, float, float], known: KnownCamera | None, facts: Facts, size: tuple[int, int]
) -> Detector:
    """The camera of --pinhole. If the camera is in the table, its axes and frame are taken from there."""
    fx, fy, cx, cy = pinhole
    if min(fx, fy) <= 0 or not np.isfinite(pinhole).all():
        raise InputError(f"--pinhole {pinhole}: expected fx fy cx cy [px], positive focal lengths first")
    plain = Detector(
        width=size[0], height=size[1], focal_mm=1.0, pitch_mm=(1.0 / fx, 1.0 / fy), center=(cx, cy), distortion=None
    )
    if known is None:
        return plain
    detector = known.with_filter(facts.filter)
    return replace(plain, axes=detector.axes, frame=detector.frame)
