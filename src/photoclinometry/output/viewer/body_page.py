"""A finished body as its page shows it, from what its folder and its site hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.meshes.shape_ply import read_shape_ply
from photoclinometry.io.models.colmap import read_colmap
from photoclinometry.io.run_files import BODY_FILE, METRICS_FILE, POSES_FOLDER, read_metrics
from photoclinometry.io.site import Site
from photoclinometry.io.site_views import views_at
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Views
from photoclinometry.output.viewer.body_content import ViewedBody

REMAKE = "run `phomo body` on the folder again, which makes its report"


def read_viewed_body(folder: Path, site: Site) -> ViewedBody:
    """A finished body. site: of its images.

    Raises InputError for files that are missing, damaged, or of another site.
    """
    shape, document = read_shape_ply(folder / BODY_FILE), read_metrics(folder)
    gsd = document.get("metrics", {}).get("gsd")
    if not isinstance(gsd, (int, float)):
        raise RunFolderError(f"{folder / METRICS_FILE}: names no ground sample distance; {REMAKE}")
    return ViewedBody(
        name=site.name,
        body=site.body,
        shape=shape,
        views=_views(folder, site, document),
        reflectance=reflectance_of(folder, document),
        gsd=float(gsd),
        brightness=site.brightness,
        body_fixed=not shape.from_images_alone,
        pose_priors=site.pose_priors,
    )


def _views(folder: Path, site: Site, document: dict[str, Any]) -> Views:
    """The views that have a pose, in the site's order, with the brightness of their images over that of renderings."""
    names, _, poses, _ = read_colmap(folder / POSES_FOLDER)
    row = {name: k for k, name in enumerate(names)}
    used = [k for k, view in enumerate(site.views) if view.name in row]
    if len(used) < len(names):
        raise RunFolderError(f"{site.path}: lacks views that {folder} was made of; it is another site; {REMAKE}")
    chosen = replace(site, views=tuple(site.views[k] for k in used))
    rows = [row[view.name] for view in chosen.views]
    views = views_at(chosen, Rigid(poses.rotation[rows], poses.translation[rows]))
    return views if site.brightness == "iof" else replace(views, scale=_gains(folder, views, document))


def _gains(folder: Path, views: Views, document: dict[str, Any]) -> np.ndarray:
    """(K,) as the body's metrics.json has them of uncalibrated images; 1 where no rendering was made."""
    kept = {each.get("name"): each for each in document.get("views", ()) if "gain" in each}
    if not set(views.name) <= set(kept):
        raise RunFolderError(f"{folder / METRICS_FILE}: names no brightness of its images; {REMAKE}")
    gains = [kept[name]["gain"] for name in views.name]
    return np.array([1.0 if gain is None else gain for gain in gains], float)


def reflectance_of(folder: Path, document: dict[str, Any]) -> Reflectance | None:
    """The reflectance model with which the body was rendered, from `document`, its metrics.json; None of geometry
    alone.

    Raises RunFolderError where it does not state the model, and InputError for a model that does not exist.
    """
    try:
        stated = document["reflectance"]
        if stated is None:
            return None
        name, values = str(stated["name"]), tuple(map(float, stated["parameters"].values()))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RunFolderError(f"{folder / METRICS_FILE}: names no reflectance model; {REMAKE}") from error
    return Reflectance(name, values)
