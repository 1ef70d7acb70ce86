"""Where the Sun and the cameras stand over a map."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.geometry import angle_between
from photoclinometry.model.scene import Views


def sun_span_deg(views: Views) -> float:
    """The greatest angle between the Suns of two views [degrees]."""
    return float(np.degrees(angle_between(views.sun[:, None], views.sun[None])).max())
