"""The verdict on a map in words: sound, usable with care, or not to be trusted, with the reasons.

The report, `metrics.json`, the terminal and `phomo info` all state the verdict decided here. The reasons for distrust
come from `pipeline.trust` and `body.trust`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from photoclinometry.evaluate.illumination import sun_span_deg
from photoclinometry.evaluate.tables import digits, number
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.model.warning import Warned

SOUND, CARE, WRONG = "sound", "usable with care", "do not trust"
"""Verdicts."""

FEW_VIEWS = 5.0
"""Mean number of views per landmark below which normals and albedos rest on so few measurements that one bad view
shows. A normal and an albedo are three numbers, and each view gives one brightness."""
ROUGH_NORMAL_DEG, ROUGH_HEIGHT_GSD = 5.0, 0.5
"""Medians of stated sigmas beyond those of any sound simulated site: these have 1 to 2 degrees, and 0.1 GSD. Sound
simulated bodies have 3 to 4 degrees, and 0.1 to 0.2 GSD."""
LITTLE_LIGHT_DEG = 10.0
"""Greatest angle between two Suns below which brightness hardly distinguishes slope from albedo. Under Suns that are 10
degrees apart, ground of 5 degrees slope changes relative to level ground by 0.17 x 0.09 = 1.5 %, about the usual
residual of maps."""
UNCHECKED_RELIEF = 0.1
"""Standard deviation of relief over parallax beyond which a relief that is a fifth too low would pass as sound. Maps of
100 x 100 landmarks have 0.01 to 0.05."""
SPARSE_PERCENT = 80.0
"""Share of the lit region below which a map is full of holes."""
WORSE_BY_DB = 6.0
"""How much worse the PSNR of held-out views may be: twice the error."""
GUESSED_PERCENT = 5.0
"""Share of a body's surface without a map beyond which shape and volume rest on a guess. Sound simulated bodies have
0.2 to 1 per cent."""
POOR_DISK_PSNR_DB = 22.0
"""Mean PSNR of whole disks below which renderings differ from images by more than 8 % of the peak, twice as much as
those of sound simulated bodies, which have 27 to 30 dB."""


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """Whether a map is to be trusted, and what speaks against it."""

    warnings: tuple[Warned, ...] = ()
    """All warnings, including those of stages that were read back."""
    distrust: tuple[str, ...] = ()
    """Why the map is not to be trusted; empty where it is."""
    care: tuple[str, ...] = ()
    """Cautions about a map that is not wrong; empty for a sound one."""

    @property
    def verdict(self) -> str:
        """ "sound", "usable with care" (of a map that was warned of, too) or "do not trust"."""
        return WRONG if self.distrust else CARE if self.warnings or self.care else SOUND

    @property
    def trusted(self) -> bool:
        """Whether nothing says that the map is wrong as a whole."""
        return not self.distrust

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons for the verdict, except the warnings: one sentence each."""
        return (*self.distrust, *self.care)

    def as_json(self) -> dict[str, Any]:
        """What `metrics.json` begins with."""
        return {
            "verdict": self.verdict,
            "trusted": self.trusted,
            "not_trusted_because": list(self.distrust),
            "care": list(self.care),
            "warnings": [warned.as_row() for warned in self.warnings],
        }


class Judged:
    """Base of results that have a judgement: its parts by their own names."""

    judgement: Judgement

    @property
    def verdict(self) -> str:
        """ "sound", "usable with care" (of a map that was warned of, too) or "do not trust"."""
        return self.judgement.verdict

    @property
    def trusted(self) -> bool:
        """Whether nothing says that the map is wrong as a whole."""
        return self.judgement.trusted

    @property
    def warnings(self) -> tuple[Warned, ...]:
        """All warnings, including those of stages that were read back."""
        return self.judgement.warnings

    @property
    def distrust(self) -> tuple[str, ...]:
        """Why the map is not to be trusted; empty where it is."""
        return self.judgement.distrust

    @property
    def care(self) -> tuple[str, ...]:
        """Cautions about a map that is not wrong; empty for a sound one."""
        return self.judgement.care


def why_with_care(scene: Scene, metrics: Mapping[str, Any]) -> list[str]:
    """Reasons why the map of a place that is not wrong is less than sound: one sentence each; none for a sound map.
    metrics: as in `metrics.json`."""
    suns = sun_span_deg(scene.views)
    found = _few_views(len(scene.tracks) / max(1, len(scene.landmarks)))
    if scene.reflectance is not None and suns < LITTLE_LIGHT_DEG:
        found.append(f"the light hardly changes: Suns are at most {suns:.1f}° apart, so that albedo may contain slope")
    if not scene.uncertainty:
        found.append("no uncertainties were computed")
    found += _rough_normals(metrics)
    if scene.frame != BODY_FIXED:
        found += _rough_heights(metrics)
    unsure = metrics.get("relief_over_parallax_sigma", 0.0)
    if unsure > UNCHECKED_RELIEF:
        found.append(f"parallax checks the relief to {100.0 * unsure:.0f} % only: it may be too high or too low")
    if metrics.get("completeness_percent", 100.0) < SPARSE_PERCENT:
        found.append(f"{100.0 - metrics['completeness_percent']:.0f} % of the lit region are not mapped")
    quality, held_out = metrics.get("psnr_mean_db"), metrics.get("psnr_held_out_mean_db")
    if quality is not None and held_out is not None and held_out < quality - WORSE_BY_DB:
        found.append(f"held-out views are predicted {quality - held_out:.1f} dB worse than those that were used")
    return found


def why_body_with_care(
    metrics: Mapping[str, Any], tiles: Sequence[Mapping[str, Any]], views_per_vertex: float | None
) -> list[str]:
    """As `why_with_care`, of a whole body. tiles: a row for each, with "used"; views_per_vertex: images that measure a
    vertex, in the mean over those that were mapped; None where that is not known."""
    found = [] if views_per_vertex is None else _few_views(views_per_vertex)
    left_out = metrics["images"] - metrics["images_registered"] - metrics["images_placed_by_surface"]
    if left_out:
        found.append(f"left out, since they have no pose: {number(left_out)} of {number(metrics['images'])} images")
    without = [str(n) for n, row in enumerate(tiles) if not row["used"]]
    if without:
        found.append(f"{len(without)} of {len(tiles)} tiles have no map: {', '.join(without)}")
    if metrics["tiles_untrusted"]:
        count = f"{number(metrics['tiles_untrusted'])} of {number(metrics['tiles'])}"
        found.append(f"{count} tiles are not to be trusted, and count only where there is no other")
    guessed = 100.0 - metrics["mapped_percent"]
    if guessed > GUESSED_PERCENT:
        found.append(f"{guessed:.0f} % of the surface were never mapped: shape and volume rest on a guess there")
    found += _rough_normals(metrics) + _rough_heights(metrics)
    quality = metrics.get("psnr_mean_db")
    if quality is not None and quality < POOR_DISK_PSNR_DB:
        found.append(f"renderings differ from the images: mean PSNR {quality:.1f} dB")
    return found


def _few_views(per_landmark: float) -> list[str]:
    """A caution where few views measure a landmark, in the mean."""
    if per_landmark >= FEW_VIEWS:
        return []
    return [f"few views: {per_landmark:.1f} measure a landmark, {FEW_VIEWS:.0f} or more are good"]


def _rough_normals(metrics: Mapping[str, Any]) -> list[str]:
    sigma = metrics.get("normal_sigma_median_deg", 0.0)
    return [f"normals are uncertain: {digits(sigma)}° in the median"] if sigma > ROUGH_NORMAL_DEG else []


def _rough_heights(metrics: Mapping[str, Any]) -> list[str]:
    sigma = metrics.get("height_sigma_median_gsd", 0.0)
    return [f"heights are uncertain: {digits(sigma)} GSD in the median"] if sigma > ROUGH_HEIGHT_GSD else []
