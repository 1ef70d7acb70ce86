"""The views of a site at given poses, under the Suns that the site states."""

from __future__ import annotations

import numpy as np

from photoclinometry.io.site import Site
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.scene import Views


def views_at(site: Site, body_from_cam: Rigid) -> Views:
    """All K views in the site's order, at poses (K,), with the brightness of their images as it is."""
    count, sun_in_cam = len(site.views), site.sun_in_cam
    own, common = site.sun_sigmas
    return Views(
        name=tuple(view.name for view in site.views),
        cameras=tuple(view.camera for view in site.views),
        body_from_cam=body_from_cam,
        sun=np.einsum("kij,kj->ki", body_from_cam.rotation, sun_in_cam),
        scale=np.ones(count),
        bias=np.zeros(count),
        dark_level=np.zeros(count),
        sun_measured=sun_in_cam,
        sun_sigma=own,
        sun_common_sigma=common,
        arc=site.arcs,
    )
