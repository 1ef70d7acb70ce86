"""The key `body` of `site.toml`, and `body_radius_m` for bodies that are not known here."""

from __future__ import annotations

import difflib

import numpy as np

from photoclinometry.io.rasters.globe import NAIF_NUMBER
from photoclinometry.io.table import Table
from photoclinometry.model.pose_prior import PosePrior

BODY, BODY_RADIUS = "body", "body_radius_m"
"""Keys in `site.toml`."""
MORE_BODIES = (
    *("67p", "annefrank", "apophis", "arrokoth", "bennu", "braille", "charon", "didymos", "dimorphos", "dinkinesh"),
    *("donaldjohanson", "pluto", "ryugu"),
)
"""Bodies of missions that PROJ's IAU_2015 has no reference system of, or not under this name."""


def is_known(body: str) -> bool:
    """Whether `site.toml` may name a body without its radius; case does not count."""
    return body.lower() in NAIF_NUMBER or body.lower() in MORE_BODIES


def read_body(table: Table) -> tuple[str | None, float | None]:
    """The body's name and its mean radius [m], None where the site does not give them. Raises SiteError."""
    body, radius = table.text(BODY, None), table.positive_number(BODY_RADIUS, None)
    if body is not None and radius is None and not is_known(body):
        known = sorted([*NAIF_NUMBER, *MORE_BODIES])
        near = difflib.get_close_matches(body.lower(), known, n=1)
        meant = f", did you mean {near[0]!r}?" if near else ""
        raise table.error(
            BODY,
            f"{body!r} is not known{meant} (known: {', '.join(known)}); for another body give its mean radius, too "
            "(body_radius_m), or leave the key out",
        )
    return body, radius


def check_outside(table: Table, radius_m: float | None, priors: dict[str, PosePrior]) -> None:
    """Raises SiteError where a pose prior puts a camera inside of a body of stated radius, as kilometres do."""
    if radius_m is None:
        return
    for name, prior in priors.items():
        distance = float(np.linalg.norm(prior.cam_from_body.translation))
        if distance < 0.5 * radius_m:
            raise table.error(
                BODY_RADIUS,
                f"is {radius_m:g} m, but cam_from_body of {name} is {distance:g} m from its centre, deep inside; "
                "give translation in metres, or correct the radius",
            )
