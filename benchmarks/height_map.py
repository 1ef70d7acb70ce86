"""Errors of an exported height map, compared with those of the landmarks from which it is made.

    python benchmarks/height_map.py RUN SITE       # a finished run, and the folder of its simulated site

The map is put on a place of Vesta, exported as GeoTIFF, and read again; distances are those to the true surface [m].
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.io.rasters.geotiff import read_dtm_mesh
from photoclinometry.io.rasters.globe import find_globe
from photoclinometry.io.run_files import read_run
from photoclinometry.model.geometry import Similarity, align_similarity, unit
from photoclinometry.output.export import ExportOptions
from photoclinometry.output.export.frame import Framed
from photoclinometry.output.export.maps import write_maps
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.simulate.truth import nearest_surface
from photoclinometry.simulate.truth_file import read_truth

UP = unit(np.array([0.95, 0.27, -0.16]))
"""Of the place, body-fixed: 16 degrees east, 9 south."""


def main(run: Path, site: Path) -> None:
    scene, truth = read_run(run), read_truth(site / "truth.h5")
    aligned = evaluate_against_truth(scene, truth).aligned.landmarks.position
    globe = find_globe("vesta")
    east = unit(np.cross([0.0, 0.0, 1.0], UP))
    here = Similarity(1.0, np.stack([east, np.cross(UP, east), UP], axis=1), globe.radii_m[0] * UP)
    body_from_scene = here @ align_similarity(scene.landmarks.position, aligned)
    framed = Framed(scene=transform_scene(body_from_scene, replace(scene, uncertainty={})), globe=globe, metric=True)
    print(f"landmarks: {_mean(truth, aligned):.2f} m")
    for projection in ("equirectangular", "orthographic"):
        with tempfile.TemporaryDirectory() as folder:
            write_maps(Path(folder), framed, ["dtm"], ExportOptions(projection=projection))
            position = here.inverse()(read_dtm_mesh(Path(folder) / "dtm.tif").position)
        print(f"dtm.tif, {projection}: {_mean(truth, position):.2f} m")


def _mean(truth, points: np.ndarray) -> float:
    return float(np.mean(np.abs(nearest_surface(truth.surface, points)[0])))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
