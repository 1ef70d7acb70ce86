"""Whether the keypoints show distortion that the cameras of the site lack."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.sparse import SparseModel
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.sparse_stages import Inputs
from photoclinometry.sfm.self_calibration import estimate_lenses

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Displacements:
    """How far distortion displaces keypoints, by camera (C,); (0,) where there are too few keypoints to determine
    it."""

    shift_px: np.ndarray
    """Largest displacement."""
    shift_sigma_px: np.ndarray
    """Its standard deviation."""


@dataclass(frozen=True, kw_only=True)
class CheckCameras(Stage[Displacements]):
    """Looks for distortion beyond that of the site's cameras, and warns of it."""

    name = "distortion"
    result = Displacements
    inputs: Keyed[Inputs]
    sparse: Keyed[SparseModel]

    def make(self, tools: Tools) -> Displacements:
        site = self.inputs.value.site
        cameras, of_view = site.cameras
        found = estimate_lenses(self.sparse.value, [camera.camera for camera in cameras], of_view)
        for number, estimate in enumerate(found):
            if estimate.is_clear:
                views = np.flatnonzero(of_view == number)
                warn(
                    log, "camera-distorted",
                    "the images of the camera of %s and %d more have distortion that site.toml does not state: it "
                    "displaces keypoints by up to %.1f +- %.1f px. `phomo calibrate %s` writes a site that states it",
                    site.views[views[0]].name, len(views) - 1, estimate.shift_px, estimate.shift_sigma_px, site.path,
                )  # fmt: skip
        if found:
            most = max(found, key=lambda estimate: estimate.shift_px / estimate.shift_sigma_px)
            say_found(f"displaced by up to {most.shift_px:.2f} +- {most.shift_sigma_px:.2f} px")
        return Displacements(
            shift_px=np.array([estimate.shift_px for estimate in found]),
            shift_sigma_px=np.array([estimate.shift_sigma_px for estimate in found]),
        )
