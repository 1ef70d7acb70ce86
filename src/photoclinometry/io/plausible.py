"""Whether the brightness of a site's images can be the quantity that `site.toml` names.

The radiance factor I/F of ground is bounded by physics: a white Lambert surface under the Sun at the zenith has 1. The
brightest known ground, Enceladus's ice near zero phase, has about 1.4 (Verbiscer et al. 2007, Science 315, 815).
Between views of the same ground it changes with phase by at most 0.05 magnitudes per degree (dark asteroids; Li et al.
2015, Asteroids IV, 129).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from photoclinometry.io.site import MIN_VIEWS, Site
from photoclinometry.model.errors import ImageError, SiteError
from photoclinometry.model.first_few import first_reasons
from photoclinometry.model.image import Image

BRIGHTEST_IOF = 1.5
"""I/F of the brightest known ground, 1.4, with an error of calibration."""
DARKEST_IOF = 1e-5
"""I/F of sunlit ground of normal albedo 0.02, dimmed by 0.05 magnitudes per degree over 150 degrees of phase, is
2e-5: images below hold another quantity."""
LEVEL_PERCENTILE = 90.0
"""The level of an image: sunlit ground, also where most of it lies in shadow; above it are single bright spots."""
STEEPEST_MAG_PER_DEG = 0.05
"""Dimming of the darkest ground with phase."""
OTHER_UNIT = 10.0
"""A view that differs from the typical one by this factor, beyond the effect of phase, is in another unit: slopes
facing the Sun or turned away from it, and incidence, cause factors of a few."""
PLATEAU_SHARE = 0.1
"""Least share of the valid pixels at the highest brightness that overexposure leaves there ..."""
PLATEAU_TOP = 0.01
"""... with at most this share above (hot pixels) ..."""
PLATEAU_STEP = 3.0
"""... and this many times as many as at the next lower brightness: coarsely counted ground thins out instead."""

_LISTED = 3
"""Views that an error names; the others are counted."""


def impossible_views(
    site: Site, images: Sequence[Image], empty: Mapping[str, str] = MappingProxyType({})
) -> dict[str, str]:
    """Views whose brightness cannot be that of sunlit ground, by name, with the reason; to be left out of the map.

    images: (K,) of the site's views, `valid` without sky. empty: those that are left out in any case, by name, with the
    reason; they are not among those returned. Raises SiteError where most views of a site that is called I/F have an
    impossible level, so that the key `brightness` is wrong, and ImageError where fewer than MIN_VIEWS views remain.
    """
    level = np.array([np.nan if image.name in empty else _level(image) for image in images])
    if site.brightness == "iof":
        _check_unit(site, level, images)
    found: dict[str, str] = {}
    odd = _in_other_units(site, level) if site.brightness == "iof" else {}
    for k, image in enumerate(images):
        if image.name in empty:
            continue
        reason = (
            _negative(image) or (site.brightness == "iof" and _beyond(level[k])) or odd.get(k) or overexposed(image)
        )
        if reason:
            found[image.name] = reason
    _check_enough(site, {**empty, **found})
    return found


def overexposed(image: Image) -> str | None:
    """Why an image is overexposed: many pixels at one highest brightness. None if they are not."""
    seen = image.brightness[image.valid]
    if not seen.size:
        return None
    top = np.quantile(seen, 1.0 - PLATEAU_TOP, method="lower")
    lower = seen[seen < top]
    at = np.count_nonzero(seen == top)
    if at < PLATEAU_SHARE * seen.size or not lower.size:
        return None
    if at < PLATEAU_STEP * np.count_nonzero(lower == lower.max()):
        return None
    return (
        f"its highest brightness, {top:g}, is that of {100 * at / seen.size:.0f} % of its pixels: it is overexposed; "
        "give a shorter exposure, or NaN where it is saturated"
    )


def _level(image: Image) -> float:
    """The brightness of an image's sunlit ground; NaN without a valid pixel."""
    seen = image.brightness[image.valid]
    return float(np.percentile(seen, LEVEL_PERCENTILE)) if seen.size else np.nan


def _check_unit(site: Site, level: np.ndarray, images: Sequence[Image]) -> None:
    """Raises SiteError where most views cannot be I/F."""
    known, bright = int(np.isfinite(level).sum()), np.flatnonzero(level > BRIGHTEST_IOF)
    dark = np.flatnonzero((level > 0) & (level < DARKEST_IOF))
    for wrong, than in ((bright, f"above {BRIGHTEST_IOF:g}, brighter than"), (dark, "dimmer than")):
        if 2 * len(wrong) <= known:
            continue
        listed = ", ".join(f"{site.views[k].name} {level[k]:.4g}" for k in wrong[:_LISTED])
        more = ", ..." if len(wrong) > _LISTED else ""
        counts = all(np.array_equal(images[k].brightness, np.round(images[k].brightness)) for k in wrong[:_LISTED])
        if len(dark) > len(bright):
            remedy = 'if this is radiance, convert it to I/F, or write brightness = "dn"'
        elif counts:
            remedy = 'they are whole numbers, as a detector counts: write brightness = "dn"'
        else:
            remedy = 'divide per cent by 100; write brightness = "dn" for radiance or counts'
        raise SiteError(
            f'{site.path}: brightness: is "iof", but {len(wrong)} of {known} images are {than} any sunlit ground '
            f"(level of the ground: {listed}{more}): {remedy}"
        )


def _negative(image: Image) -> str | None:
    seen = image.brightness[image.valid]
    middle = float(np.median(seen)) if seen.size else 0.0
    if middle >= 0.0:
        return None
    return (
        f"its brightness is negative (median {middle:.4g}), which no light is; add the offset that was taken away, or "
        "correct the sign of its integers (BZERO)"
    )


def _beyond(level: float) -> str | None:
    if level > BRIGHTEST_IOF:
        return f"its ground has I/F {level:.4g}, ground has {BRIGHTEST_IOF:g} at most; bring it to the others' unit"
    if 0 < level < DARKEST_IOF:
        return f"its ground has I/F {level:.2g}, which no sunlit ground has; bring it to the unit of the others"
    return None


def _in_other_units(site: Site, level: np.ndarray) -> dict[int, str]:
    """Views far brighter or dimmer than the typical one, beyond the effect of the phase angles."""
    phase_deg = np.degrees(np.arccos(np.clip(-site.sun_in_cam[:, 2], -1.0, 1.0)))
    good = level > 0
    if good.sum() < MIN_VIEWS:
        return {}
    typical, typical_deg = float(np.median(level[good])), float(np.median(phase_deg[good]))
    found = {}
    for k in np.flatnonzero(good):
        ratio = level[k] / typical
        # Dimming acts one way: a view at larger phase may be dimmer, at smaller phase brighter.
        turn = typical_deg - phase_deg[k] if ratio > 1 else phase_deg[k] - typical_deg
        explained = 10 ** (0.4 * STEEPEST_MAG_PER_DEG * max(turn, 0.0))
        factor = max(ratio, 1.0 / ratio)
        if factor > OTHER_UNIT * explained:
            found[int(k)] = (
                f"its ground is {factor:.3g} times as {'bright' if ratio > 1 else 'dim'} as that of the typical view "
                f"(I/F {level[k]:.4g} against {typical:.4g}), which no phase angle explains; bring it to the same unit"
            )
    return found


def _check_enough(site: Site, found: Mapping[str, str]) -> None:
    if not found or len(site.views) - len(found) >= MIN_VIEWS:
        return
    raise ImageError(
        f"{site.path}: {len(found)} of {len(site.views)} images cannot be used, {MIN_VIEWS} must remain: "
        f"{first_reasons(found, _LISTED)}"
    )
