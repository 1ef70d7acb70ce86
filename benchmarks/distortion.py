"""Distortion left in images: whether keypoints show it, and the errors of maps with it, and once it is calibrated.

    python benchmarks/distortion.py --out distortion --count 50     keypoints of sites drawn at random: alarms, misses
    python benchmarks/distortion.py --out distortion --count 0 --maps    maps of two sites, 0, 2, 10 px at the corners

Tables are written to OUT/keypoints.md and OUT/maps.md as they grow.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import tyro

import photoclinometry as pcm
from faults import SITES
from image_faults import distortion, read_images, write_spoiled
from outcomes import accuracy_cells
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.warning import collected_warnings
from photoclinometry.pipeline.calibrate import calibrate
from photoclinometry.pipeline.camera_check import CheckCameras
from photoclinometry.pipeline.folder.run_folder import open_run
from photoclinometry.pipeline.sparse_stages import SparseReconstruction, read_inputs
from photoclinometry.sfm import SfmOptions
from photoclinometry.simulate.site import simulate_site
from random_sites import drawn

KEYPOINTS_PX, MAPS_PX = (0.0, 2.0), (0.0, 2.0, 10.0)
"""Displacements of the corners."""
MAPPED = ("moderate", "few")


def main(out: Path, count: int = 50, maps: bool = False) -> None:
    """Look for distortion in keypoints, and map distorted images.

    Args:
        out: Folder for the tables and, meanwhile, sites and runs.
        count: Sites drawn at random whose keypoints are looked at, each as it is and distorted by 2 px.
        maps: Also map two sites as they are, distorted, and calibrated.
    """
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    lines = ["| site | corner [px] | found [px] | sigma [px] | |", "|---|---:|---:|---:|---|"]
    for i in range(count):
        site = _simulated(drawn(i), out / "site")
        for corner_px in KEYPOINTS_PX:
            lines.append(f"| {i} | {corner_px:g} | {_by_keypoints(_distorted(site, out, corner_px, i), out)} |")
            (out / "keypoints.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    lines = ["| site | corner [px] | | surface [GSD] | normals [deg] | PSNR [dB] |", "|---|---:|---|" + 3 * "---:|"]
    for name in MAPPED if maps else ():
        site = _simulated(SITES[name], out / "site")
        for corner_px in MAPS_PX:
            spoiled = _distorted(site, out, corner_px, 0)
            for how, file in (("as it is", spoiled), ("calibrated", calibrate(spoiled).site)):
                figures = _of_map(file, site.parent / "truth.h5", out)
                lines.append(f"| {name} | {corner_px:g} | {how} | {figures} |")
                (out / "maps.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for name in ("site", "spoiled", "run"):
        shutil.rmtree(out / name, ignore_errors=True)


def _simulated(options: pcm.SimulationOptions, folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    return simulate_site(options, folder)


def _distorted(site_file: Path, out: Path, corner_px: float, seed: int) -> Path:
    """The site.toml of the same site with distorted images."""
    site = read_site(site_file)
    images = read_images(site)
    if corner_px:
        images = distortion(images, np.random.default_rng(seed), corner_px)
    return write_spoiled(images, site, out / "spoiled")


def _by_keypoints(site_file: Path, out: Path) -> str:
    """Cells of what keypoints show of one camera's distortion."""
    shutil.rmtree(out / "run", ignore_errors=True)
    folder = open_run(out / "run")
    inputs = read_inputs(folder, read_site(site_file))
    try:
        sparse = folder.done(SparseReconstruction(inputs=inputs, options=SfmOptions(threads=1)))
    except ReconstructionError:
        return "– | – | no model"
    with collected_warnings() as warnings:
        found = folder.done(CheckCameras(inputs=inputs, sparse=sparse)).value
    if not len(found.shift_px):
        return "– | – | too few keypoints"
    (shift,), (sigma,) = found.shift_px, found.shift_sigma_px
    return f"{shift:.2f} | {sigma:.2f} | {'distorted' if warnings else ''}"


def _of_map(site_file: Path, truth: Path, out: Path) -> str:
    """Cells of a map's figures."""
    shutil.rmtree(out / "run", ignore_errors=True)
    return accuracy_cells(pcm.run(site_file, out / "run"), truth, site_file)


if __name__ == "__main__":
    tyro.cli(main)
