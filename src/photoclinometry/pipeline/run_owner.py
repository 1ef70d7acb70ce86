"""What a run folder belongs to: one site, or one model. A folder never mixes results of two."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from photoclinometry.io.site import Site
from photoclinometry.io.site_images import image_digests, load_images
from photoclinometry.model.scene import Scene

SAME_SHARE = 0.5
"""Two sites are one if they have more than this share of the images of the smaller one in common: views may be added or
left out between runs, and another site has other images."""


@dataclass(frozen=True)
class Owner:
    """A site or a model, by what stays when it is moved, renamed or simulated again."""

    kind: str
    """ "site" or "model"."""
    name: str
    body: str | None
    place: str
    """Where it was found, for messages only."""
    images: tuple[str, ...]
    """Of a site, a digest of each image file; of a model, the names of its images."""

    def is_same(self, other: Owner) -> bool:
        """Whether both are one: of the same kind, not of two bodies, and with most images in common."""
        if self.kind != other.kind or (self.body and other.body and self.body.lower() != other.body.lower()):
            return False
        common = len(set(self.images) & set(other.images))
        return common > SAME_SHARE * min(len(set(self.images)), len(set(other.images)))

    def as_json(self) -> dict[str, Any]:
        """For run.json."""
        return {**vars(self), "images": list(self.images)}

    def __str__(self) -> str:
        body = "" if self.body is None else f"{self.body}, "
        return f"the {self.kind} {self.name!r} ({body}{len(self.images)} images, {self.place})"


def owner_of_site(site: Site) -> Owner:
    """The identity of a site. Raises ImageError for images that are missing or cannot be read."""
    if not all(view.image.exists() for view in site.views):
        load_images(site)  # raises ImageError, which lists all that are missing
    digests = tuple(digest.hex()[:20] for digest in image_digests(site))
    return Owner("site", site.name, site.body, str(Path(site.path).resolve()), digests)


def owner_of_model(source: Path, scene: Scene) -> Owner:
    """The identity of a text model, read from the folder `source`."""
    return Owner("model", scene.name, scene.body, str(Path(source).resolve()), scene.views.name)


def read_owner(content: Mapping[str, Any]) -> Owner | None:
    """What run.json says; None where it says nothing. Raises KeyError, TypeError and ValueError where it is damaged."""
    found = content.get("owner")
    if found is None:
        return None
    body = found["body"]
    return Owner(
        kind=str(found["kind"]),
        name=str(found["name"]),
        body=None if body is None else str(body),
        place=str(found["place"]),
        images=tuple(str(image) for image in found["images"]),
    )
