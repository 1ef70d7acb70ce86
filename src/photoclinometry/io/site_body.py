"""The key `body` of `site.toml`, and `body_radius_m` for bodies that are not known (`model/bodies.py`)."""

from __future__ import annotations

import difflib

import numpy as np

from photoclinometry.io.table import Table
from photoclinometry.model.bodies import BODIES, is_known
from photoclinometry.model.pose_prior import PosePrior

BODY, BODY_RADIUS = "body", "body_radius_m"
"""Keys in `site.toml`."""


def read_body(table: Table) -> tuple[str | None, float | None]:
    """The body's name and its mean radius [m], None where the site does not give them. Raises SiteError."""
    body, radius = table.text(BODY, None), table.positive_number(BODY_RADIUS, None)
    if body is not None and radius is None and not is_known(body):
        known = [each.name for each in BODIES]
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
