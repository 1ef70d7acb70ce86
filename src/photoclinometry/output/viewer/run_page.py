"""The viewer's page of the folder of a run or a body."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from photoclinometry.io.run_files import REPORT_FOLDER, is_body, is_map, read_run, run_images, site_path
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.output.viewer.body_page import read_viewed_body
from photoclinometry.output.viewer.page import NAME, write_body_viewer, write_viewer

log = logging.getLogger(__name__)


def run_page(run: Path) -> Path:
    """The path of the page of a finished run or body: that of its report, or one that is written there now.

    Raises RunFolderError where there is no finished run, or the page cannot be written, and InputError where the site
    of a body is not there any more.
    """
    path = run / REPORT_FOLDER / NAME
    if (is_map(run) or is_body(run)) and path.is_file():
        return path
    if is_body(run):
        body = read_viewed_body(run, read_site(site_path(run)))
        images, _ = _of_site(run, body.views.name)
        return write_body_viewer(path, body, images)
    scene = read_run(run)
    return write_viewer(path, scene, *_of_site(run, scene.views.name))


def _of_site(run: Path, names: Sequence[str]) -> tuple[list[Image], dict[str, PosePrior]]:
    """The images of these views and the pose priors of the site; none, with the reason in the log, where they are not
    there any more."""
    try:
        site = site_path(run)
        return run_images(site, names), read_site(site).pose_priors
    except InputError as error:
        log.info("the page holds no images: %s", error)
        return [], {}
