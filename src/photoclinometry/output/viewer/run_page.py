"""The viewer's page of the folder of a run or a body."""

from __future__ import annotations

import logging
from pathlib import Path

from photoclinometry.evaluate.body_folder import is_body
from photoclinometry.io.run_files import read_run, run_images, site_path
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Image, Scene
from photoclinometry.output.viewer.page import NAME, write_viewer

log = logging.getLogger(__name__)


def run_page(run: Path) -> Path:
    """The path of the page of a finished run or body: that of its report, or of a run one that is written there now.

    Raises RunFolderError where there is no finished run, or the page cannot be written.
    """
    path = run / "report" / NAME
    if ((run / "scene.h5").is_file() or is_body(run)) and path.is_file():
        return path
    if is_body(run):
        raise RunFolderError(f"{path}: is not there; run `phomo body` on the folder again, which makes its report")
    scene = read_run(run)
    return write_viewer(path, scene, *_of_site(run, scene))


def _of_site(run: Path, scene: Scene) -> tuple[list[Image], dict[str, PosePrior]]:
    """The images of the run's views and their pose priors; none, with the reason in the log, where they are not there
    any more."""
    try:
        site = site_path(run)
        return run_images(site, scene.views.name), read_site(site).pose_priors
    except InputError as error:
        log.info("the page holds no images: %s", error)
        return [], {}
