"""Images that are not linear in radiance: whether brightness shows it, and the errors of maps before and after.

    python benchmarks/response.py --out response              six sites, four exponents each
    python benchmarks/response.py --out response --count 50   and linear images of sites drawn at random: false alarms

Each image is encoded by V ~ L^(1 / gamma). The map of such images is made as they are, and again of the site that
`phomo calibrate --response` writes. Tables are written to OUT/maps.md and OUT/random.md as they grow.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tyro

import photoclinometry as pcm
from faults import SITES
from image_faults import gamma, read_images, write_spoiled
from outcomes import accuracy_cells
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.pipeline.calibrate import CalibrationOptions, calibrate
from photoclinometry.pipeline.products import RunResult
from photoclinometry.pipeline.response_check import CODE
from photoclinometry.simulate.site import simulate_site
from random_sites import drawn

EXPONENTS = (1.0, 0.7, 1.5, 2.2)


def main(out: Path, count: int = 0, maps: bool = True) -> None:
    """Map encoded images.

    Args:
        out: Folder for the tables and, meanwhile, sites and runs.
        count: Sites drawn at random whose linear images are mapped.
        maps: Map six sites of encoded images.
    """
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    lines = ["| site | gamma | stated | surface [GSD] | normals [deg] | PSNR [dB] | warnings |", "|---" * 7 + "|"]
    for name in SITES if maps else ():
        shutil.rmtree(out / "site", ignore_errors=True)
        site = simulate_site(SITES[name], out / "site")
        for exponent in EXPONENTS:
            for row in _rows(_encoded(site, out, exponent), site.parent / "truth.h5", out):
                lines.append(f"| {name} | {exponent:g} | {row} |")
                print(lines[-1], flush=True)
                (out / "maps.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    lines = ["| site | warnings |", "|---|---|"]
    for i in range(count):
        shutil.rmtree(out / "site", ignore_errors=True)
        site = simulate_site(drawn(i), out / "site")
        try:
            lines.append(f"| {i} | {_codes(pcm.run(site, out / 'run', overwrite=True))} |")
        except ReconstructionError:
            lines.append(f"| {i} | no map |")
        (out / "random.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for name in ("site", "spoiled", "run"):
        shutil.rmtree(out / name, ignore_errors=True)


def _encoded(site_file: Path, out: Path, exponent: float) -> Path:
    """The site.toml of the same site with encoded images."""
    site = read_site(site_file)
    encoded = gamma(read_images(site), np.random.default_rng(0), exponent)
    return write_spoiled(encoded, site, out / "spoiled")


def _rows(site_file: Path, truth: Path, out: Path) -> Sequence[str]:
    """Cells of both maps of a site: as it is, and calibrated where its map is warned of."""
    rows = []
    while True:
        result = pcm.run(site_file, out / "run", overwrite=True)
        rows.append(
            f"{read_site(site_file).views[0].gamma:.2f} | {accuracy_cells(result, truth, site_file)} | {_codes(result)}"
        )
        if CODE not in _codes(result) or len(rows) == 2:
            return rows
        site_file = calibrate(site_file, options=CalibrationOptions(response=True)).site


def _codes(result: RunResult) -> str:
    return " ".join(sorted({warned.code for warned in result.warnings}))


if __name__ == "__main__":
    tyro.cli(main)
