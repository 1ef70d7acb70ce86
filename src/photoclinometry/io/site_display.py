"""Display of a site: one line at the prompt, a table and one of its images in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from photoclinometry.io.images import read_image
from photoclinometry.model.display import BRIGHTNESS_UNITS, card, named, thumbnail
from photoclinometry.model.gamma import LINEAR

if TYPE_CHECKING:
    from photoclinometry.io.site import Site, SiteView


def site_line(site: Site) -> str:
    """The site in one line."""
    about = site_table(site)
    parts = [f"{about['views']} views", about["brightness"], f"region {about['region']}"]
    priors = [f"{about['pose priors']} pose priors"] if site.pose_priors else []
    return f"<Site {named(site.name, site.body)}: {'; '.join([*parts, *priors, about['file']])}>"


def site_card(site: Site) -> str:
    """The site as HTML, with the image of its reference view, or of its first where that is not chosen yet."""
    title = f"Site {named(site.name, site.body)}"
    return card(title, site_table(site), lambda: site_picture(site), shown_view(site).name)


def site_table(site: Site) -> dict[str, str]:
    """Properties of the site, in words and numbers."""
    cameras = dict.fromkeys(view.camera for view in site.views)
    return {
        "views": f"{len(site.views)}",
        "cameras": ", ".join(f"{c.model} {c.width} x {c.height} px, {c.focal_px[0]:.5g} px focal" for c in cameras),
        "brightness": BRIGHTNESS_UNITS.get(site.brightness, site.brightness),
        "region": _region(site),
        "pose priors": f"{len(site.pose_priors)}",
        "file": str(site.path),
    }


def site_picture(site: Site) -> np.ndarray:
    """Grey values (h, w) of one image, NaN where its pixels are not valid. Raises ImageError."""
    view = shown_view(site)
    image = read_image(view.image, linear=site.linear or view.gamma != LINEAR)
    return thumbnail(np.where(image.valid, image.brightness, np.nan))


def shown_view(site: Site) -> SiteView:
    """The reference view, or the first where that is not chosen yet."""
    reference = site.region.reference if site.region else None
    return next((view for view in site.views if view.name == reference), site.views[0])


def _region(site: Site) -> str:
    """The region that the site asks for."""
    region = site.region
    if region is None:
        return "chosen automatically"
    size = "of automatic size" if region.size_px is None else f"{region.size_px[0]} x {region.size_px[1]} px"
    return f"{size} in {region.reference or 'an image chosen automatically'}"
