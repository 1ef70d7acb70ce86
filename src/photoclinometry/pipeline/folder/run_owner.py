"""What a run folder belongs to: one site, or one model."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.io.site import Site
from photoclinometry.io.site_images import image_digests, load_images
from photoclinometry.model.owner import Owner
from photoclinometry.model.scene import Scene


def owner_of_site(site: Site) -> Owner:
    """The identity of a site. Raises ImageError for images that are missing or cannot be read."""
    if not all(view.image.exists() for view in site.views):
        load_images(site)  # raises ImageError, which lists all that are missing
    digests = tuple(digest.hex()[:20] for digest in image_digests(site))
    return Owner("site", site.name, site.body, str(Path(site.path).resolve()), digests)


def owner_of_model(source: Path, scene: Scene) -> Owner:
    """The identity of a text model, read from the folder `source`."""
    return Owner("model", scene.name, scene.body, str(Path(source).resolve()), scene.views.name)
