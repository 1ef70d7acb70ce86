"""The owner of a folder of results: one site, model, map or body. A folder never mixes results of two."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SAME_SHARE = 0.5
"""Two sites are one if they have more than this share of the images of the smaller one in common: views may be added or
left out between runs, and another site has other images."""


@dataclass(frozen=True)
class Owner:
    """A site, model, map or body, identified by properties that stay when it is moved, renamed or simulated again."""

    kind: str
    """ "site", "model", "map" or "body"."""
    name: str
    body: str | None
    place: str
    """Where it was found, for messages only; empty where that is not known."""
    images: tuple[str, ...]
    """For a site, a digest of each image file; for a model, the names of its images; for a map, its views with their
    Suns; none for a body, which its name identifies."""

    def is_same(self, other: Owner) -> bool:
        """Whether both are one: of the same kind, not of two bodies, and with most images in common."""
        if self.kind != other.kind or (self.body and other.body and self.body.lower() != other.body.lower()):
            return False
        if not self.images and not other.images:
            return self.name == other.name
        common = len(set(self.images) & set(other.images))
        return common > SAME_SHARE * min(len(set(self.images)), len(set(other.images)))

    def as_json(self) -> dict[str, Any]:
        """For run.json and export.json."""
        return {**vars(self), "images": list(self.images)}

    def __str__(self) -> str:
        count = f"{len(self.images)} images" if self.images else ""
        known = ", ".join(part for part in (self.body, count, self.place) if part)
        return f"the {self.kind} {self.name!r}" + (f" ({known})" if known else "")


def read_owner(content: Mapping[str, Any]) -> Owner | None:
    """The owner that run.json or export.json states; None where it states none.

    Raises KeyError, TypeError and ValueError where it is damaged.
    """
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
