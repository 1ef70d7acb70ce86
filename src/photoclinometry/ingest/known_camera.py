"""A camera whose intrinsics are known beforehand: an entry of the table in `cameras.py`."""

from __future__ import annotations

from dataclasses import dataclass, field

from photoclinometry.ingest.detector import Detector, turned_about


@dataclass(frozen=True, kw_only=True)
class KnownCamera:
    """One camera. Detectors that depend on the filter are in `filters`."""

    name: str
    detector: Detector
    """The whole detector, in the order of the archive's files."""
    instruments: tuple[str, ...]
    """Its names in labels, in upper case."""
    spacecraft: tuple[str, ...]
    """Names of its spacecraft in labels, in upper case; if a label names a spacecraft, it must contain one of them."""
    spacecraft_code: int
    """NAIF identifier of the spacecraft."""
    code: int
    """NAIF identifier of the instrument."""
    source: str
    """Source of the figures."""
    filters: dict[str, Detector] = field(default_factory=dict)
    """Detectors by the filter's name in upper case."""
    filter_codes: dict[str, int] = field(default_factory=dict)
    """NAIF identifiers by filter, where filters have their own."""
    cube_lines_turned: bool = False
    """Whether ISIS's cubes hold the lines of the archive's files in reverse order."""
    display: tuple[tuple[bool, bool], ...] = ()
    """Display directions (lines up, samples left) of correct labels; other labels of this camera are in error."""
    delay_s: float = 0.0
    """Time from the label's clock count to the beginning of the exposure [s]."""
    clock_in_one_field: bool = False
    """Whether the clock kernel counts in one field what labels write with a point (NEAR)."""
    displayed: bool = False
    """Whether `detector` is that of the image as its label displays it, not of the file's order (OSIRIS)."""
    raw_lines: int | None = None
    """Lines of files with taller pixels over the same field of view (NEAR's raw images)."""
    saturation: float | None = None
    """Lowest raw DN that is saturated, for detectors with fewer bits than their files."""

    def with_filter(self, name: str | None) -> Detector:
        """The whole detector behind that filter, in the order of the archive's files."""
        return self.filters.get(filter_key(name), self.detector)

    def in_cube_order(self, name: str | None) -> Detector:
        """As `with_filter`, in the order of ISIS's cubes."""
        detector = self.with_filter(name)
        return turned_about(detector, lines=True, samples=False) if self.cube_lines_turned else detector

    def clock_of_kernel(self, clock: str | None) -> str | None:
        """A label's clock count in the form of the clock kernel: "126865998.830" of NEAR is 126865998830
        milliseconds."""
        return clock.replace(".", "") if clock is not None and self.clock_in_one_field else clock

    def code_with_filter(self, name: str | None) -> int:
        """NAIF identifier of the camera with that filter."""
        return self.filter_codes.get(filter_key(name), self.code)


def filter_key(name: str | None) -> str:
    """A filter's name as in the table of cameras: "NIR_F6" is "6"."""
    text = (name or "").strip().upper()
    return text[-1] if text[:-1].endswith("_F") or text[:-1] == "F" else text
