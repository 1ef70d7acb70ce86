"""The facts about an exposure in its label, under the same names for all formats."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from photoclinometry.ingest.radiometry import AU_KM
from photoclinometry.io.archives.product import Product
from photoclinometry.io.archives.pvl import Block, Quantity

_LARGEST_AU = 1000.0
"""Of distances without a unit, those below are in astronomical units, those above in kilometres."""
_FARTHEST_KM = 1e12
"""Larger distances are damage: 6,700 astronomical units."""
_SECONDS = {
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "microsec"), 1e-6),
}
"""Units of durations in labels, in seconds."""
_KILOMETRES = {
    **dict.fromkeys(("km", "kilometer", "kilometers", "kilometre", "kilometres"), 1.0),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1e-3),
    **dict.fromkeys(("au", "ua", "astronomical unit", "astronomical units"), AU_KM),
}
"""Units of distances in labels, in kilometres."""
_MISSING = ("N/A", "NULL", "UNK", "NONE", "")
_OCAMS = {"0": "MapCam", "1": "SamCam", "2": "PolyCam"}
"""OSIRIS-REx's cameras by their number in labels and headers, which name only the suite (ISIS, ocams2isis)."""
_CAMERA_NUMBERS = ("CAMERAID", "CAMERA_ID")
"""Keys of that number, in FITS headers and in PDS4 labels."""
_MILLISECOND_HEADERS = ("NEAR-010", "CAMERAID")
"""Keywords of the FITS headers that count exposures in milliseconds: NEAR's, OCAMS's (ISIS, OsirisRexOcamsCamera)."""


@dataclass(frozen=True, kw_only=True)
class Facts:
    """One exposure; None where the label has no value."""

    spacecraft: str | None = None
    instrument: str | None = None
    filter: str | None = None
    target: str | None = None
    """In lower case and without its number: "ceres"."""
    start: str | None = None
    """UTC of the exposure's beginning."""
    exposure_s: float | None = None
    clock: str | None = None
    """The spacecraft clock at the beginning, as written."""
    unit: str | None = None
    """Unit of the pixels: "iof", "radiance" or "dn"."""
    sun_distance_km: float | None = None
    frame_code: int | None = None
    """NAIF identifier of the instrument (ISIS)."""
    scanner: bool = False
    """Whether the camera is a line scanner."""


_KEYS = {
    "spacecraft": (
        "SPACECRAFTNAME",
        "INSTRUMENT_HOST_NAME",
        "SPACECRAFT_NAME",
        "INSTRUMENT_HOST_ID",
        "SPCECRFT",
        "HOSTNAME",
    ),
    "instrument": ("INSTRUMENTID", "INSTRUMENT_ID", "NAIFNAME", "INSTRUME", "NEAR-005"),
    "filter": ("FILTERNAME", "FILTER_NUMBER", "FILTER_NAME", "FILTERNUMBER", "FILTNAME", "FILTER", "NEAR-009"),
    "target": ("TARGETNAME", "TARGET_NAME", "TARGET", "OBJECT", "NEAR-047"),
    "start": ("STARTTIME", "START_TIME", "START_DATE_TIME", "DATE-BEG", "DATE-OBS", "DATE_OBS", "OBS_DATE"),
    "exposure": ("EXPOSUREDURATION", "EXPOSURE_DURATION", "EXPTIME", "EXPOSURE", "XPOSURE", "NEAR-010"),
    "clock": (
        "SPACECRAFTCLOCKSTARTCOUNT",
        "SPACECRAFT_CLOCK_START_COUNT",
        "SPACECRAFT_CLOCK_START",
        "SCLK_STR",
        "TI_0",
    ),
    "sun_distance": ("SOLARDISTANCE", "SPACECRAFT_SOLAR_DISTANCE", "SOLAR_DISTANCE", "SUN_DIST", "S_DISTHS"),
}
_SCANS = ("LINE_EXPOSURE_DURATION", "LINEEXPOSUREDURATION", "LINE_SAMPLING_INTERVAL")
_SCANNERS = ("HRSC", "LROC", "NACL", "NACR", "TC1", "TC2", "CTX", "HIRISE", "MOC")


def read_facts(product: Product) -> Facts:
    """The facts in a product's label; all None for a plain image."""
    label = product.label
    found = {fact: _first(label, keys) for fact, keys in _KEYS.items()}
    instrument = _text(found["instrument"])
    if product.kind == "PDS4":
        found["spacecraft"], instrument = _pds4_component(label, *_PDS4_HOSTS), _pds4_component(label, "INSTRUMENT")
        target = label_block(label, "TARGET_IDENTIFICATION")
        found["target"] = target.get("NAME") if target else None
    instrument = _ocams_camera(label, _text(found["spacecraft"]), instrument) or instrument
    kernels = label.block("ISISCUBE", "KERNELS")
    code = kernels.get("NAIFFRAMECODE", kernels.get("NAIFIKCODE")) if kernels else None
    return Facts(
        spacecraft=_text(found["spacecraft"]),
        instrument=instrument,
        filter=_text(found["filter"]),
        target=_body(_text(found["target"])),
        start=_utc(_text(found["start"])),
        exposure_s=_seconds(found["exposure"], product),
        clock=_clock(found["clock"]),
        unit=_unit(product),
        sun_distance_km=_distance_km(found["sun_distance"]),
        frame_code=code if isinstance(code, int) else None,
        scanner=any(label.find(key) is not None for key in _SCANS) or (instrument or "").upper() in _SCANNERS,
    )


def _ocams_camera(label: Block, spacecraft: str | None, instrument: str | None) -> str | None:
    """The camera that the number in a label of OSIRIS-REx's camera suite stands for; None for other labels."""
    ours = any(name in (spacecraft or "").upper() for name in ("OREX", "OSIRIS-REX"))
    if not ours or (instrument or "OCAMS").upper() != "OCAMS":
        return None
    return _OCAMS.get(_text(_first(label, _CAMERA_NUMBERS)) or "")


def label_block(label: Block, name: str) -> Block | None:
    """The first block of that name anywhere in a label."""
    return next((block for block in label.walk() if block.name == name), None)


def _first(label: Block, keys: tuple[str, ...]) -> Any:
    for key in keys:
        value = label.find(key)
        if value is not None and str(value).strip().upper() not in _MISSING:
            return value
    return None


def _text(value: Any) -> str | None:
    if isinstance(value, tuple) and not isinstance(value, Quantity):
        value = value[0] if value else None
    if isinstance(value, Quantity):
        value = int(value.value) if value.value == int(value.value) else value.value
    value = getattr(value, "text", value)
    return None if value is None else str(value).strip() or None


def _clock(value: Any) -> str | None:
    """The clock's count; None for hexadecimal ones (Hayabusa2's early headers), which SPICE does not read."""
    text = _text(value)
    return None if text is None or text.lower().startswith("0x") else text


def _body(name: str | None) -> str | None:
    """The name without number and brackets, as in "1 CERES", "(433) Eros", "101955 BENNU (1999 RQ36)"."""
    if name is None:
        return None
    bare = re.sub(r"\([^)]*\)|^\s*\d+\s+", "", name).strip().lower()
    return bare or name.lower()


def _utc(text: str | None) -> str | None:
    return text.removesuffix("Z") if text else None


def _seconds(value: Any, product: Product) -> float | None:
    if isinstance(value, Quantity):
        factor = _SECONDS.get(value.unit)
        return value.value * factor if factor else None
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    # PDS3's dictionary has milliseconds for EXPOSURE_DURATION, FITS and ISIS have seconds, but for some headers.
    in_ms = product.kind == "PDS3" or any(product.label.find(key) is not None for key in _MILLISECOND_HEADERS)
    by_format = float(value) * (1e-3 if in_ms else 1.0)
    between = _seconds_between(_text(product.label.find("START_TIME")), _text(product.label.find("STOP_TIME")))
    # Labels of Rosetta's NavCam give seconds nevertheless, as start and stop times show.
    return by_format if between is None or abs(by_format - between) <= abs(value - between) else float(value)


def _seconds_between(start: str | None, stop: str | None) -> float | None:
    begin, end = time_of(start), time_of(stop)
    return (end - begin).total_seconds() if begin and end else None


def time_of(text: str | None) -> datetime | None:
    """ISO 8601, by date or day of year, or SPC's "2019 MAR 14 19:01:23.961"; None for anything else."""
    if text is None:
        return None
    clean = re.sub(r"(\.\d{6})\d+", r"\1", text.strip().removesuffix("Z"))
    for form in ("%Y-%m-%dT%H:%M:%S", "%Y-%jT%H:%M:%S", "%Y %b %d %H:%M:%S"):
        for fraction in (".%f", ""):
            try:
                return datetime.strptime(clean, form + fraction)
            except ValueError:
                continue
    return None


def _distance_km(value: Any) -> float | None:
    """A distance by its unit; without one, in km or astronomical units by its size. None for an unknown unit."""
    if isinstance(value, Quantity):
        distance = value.value * _KILOMETRES.get(value.unit, 0.0)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        distance = float(value) * (AU_KM if value < _LARGEST_AU else 1.0)
    else:
        return None
    return distance if 0 < distance < _FARTHEST_KM else None


_NEAR_UNITS = {"0": "dn", "1": "radiance", "2": "iof"}
"""By the keyword NEAR-013, calibration; BUNIT is often wrong in these files."""


def _unit(product: Product) -> str | None:
    label = product.label
    near = label.find("NEAR-013")
    if near is not None:
        return _NEAR_UNITS.get(str(near).strip())
    return _unit_of_words(label) or _unit_of_name(product)


def _unit_of_name(product: Product) -> str | None:
    """The unit of OCAMS's and ONC's files, which only their names give.

    PNG files are excluded: their integers are stretched.
    """
    name = product.path.name.lower()
    calibrated = "_iof" in name or (name.startswith("hyb2_onc_") and "_l2d" in name)
    return "iof" if product.kind in ("ISIS", "FITS", "PDS4") and calibrated else None


def _unit_of_words(label: Block) -> str | None:
    text = " ".join(
        str(label.find(key) or "")
        for key in (
            "RADIOMETRICTYPE",
            "BUNIT",
            "UNIT",
            "UNITS",
            "PROCESSING_HISTORY_TEXT",
            "SAMPLE_BIT_UNIT",
            "IMAGE_VALUE_TYPE",
            "SOURCEPRODUCTID",
            "DATA_SET_ID",
        )
    ).upper()
    words = set(re.split(r"[^A-Z0-9/]+", text)) | set(re.split(r"[^A-Z0-9]+", text))
    if words & {"IOF", "I/F", "REFLECTANCE", "REFL"} or "IOFL2" in text:
        return "iof"
    if words & {"RADIANCE", "SR", "STR"} or "W/" in text:
        return "radiance"
    return "dn" if words & {"DN", "DU", "RAW_INSTRUMENT_COUNT", "EDR", "COUNTS", "ADU"} else None


_PDS4_HOSTS = ("HOST", "SPACECRAFT")
"""Types of the component that carries the instrument; labels until 2019 have the second."""


def _pds4_component(label: Block, *kinds: str) -> str | None:
    """The name of the observing system's component of one of some types."""
    for block in label.walk():
        kind = str(block.get("TYPE")).upper()
        if block.name == "OBSERVING_SYSTEM_COMPONENT" and any(k in kind for k in kinds):
            return _text(block.get("NAME"))
    return None
