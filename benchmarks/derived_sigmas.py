"""Whether sigmas of quantities of several landmarks hold: height differences, and mean heights of squares of ground.

    python benchmarks/derived_sigmas.py --out OUT

The six sites of `faults.py`, clean, are mapped and compared with their truth after the best similarity. A row per site:
the mean square of errors over their sigmas (1 if honest) of single heights, of differences between landmarks so many
pixels apart, and of means over squares of so many pixels. A quantity is as honest as the heights are where its number
is theirs. Then the same with errors of landmarks taken to be independent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tyro

import photoclinometry as pcm
from faults import SITES
from photoclinometry.model.geometry import align_similarity
from photoclinometry.model.scene import Scene
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.truth import truth_maps
from photoclinometry.simulate.truth_file import read_truth
from photoclinometry.surface.relief import local_frame

APART_PX = (1, 2, 4, 8, 16, 32)
SQUARES_PX = (4, 8, 16)
DRAWS = 400
"""Pairs and squares of each size."""
FULL = 0.9
"""Share of a square's cells that must have a landmark."""


def heights_off(scene: Scene, truth_file: Path) -> np.ndarray:
    """(J,) errors of heights after the best similarity; NaN where the truth has no ground."""
    maps = truth_maps(read_truth(truth_file), scene.views.name[scene.reference], scene.region)
    true, found = maps.position[scene.cells], scene.landmarks.position
    known = np.isfinite(true).all(1)
    off = np.full(found.shape, np.nan)
    off[known] = found[known] - align_similarity(true[known], found[known])(true[known])
    return off @ local_frame(scene).rotation[:, 2]


def squares_over_sigmas(scene: Scene, off: np.ndarray, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Mean squares of errors over their sigmas, as stated and with independent errors, in the order of the table."""
    up = local_frame(scene).rotation[:, 2]
    variance = np.einsum("a,jab,b->j", up, scene.uncertainty["position"], up)
    index = scene.grid(np.arange(len(off), dtype=float), fill=-1.0).astype(int)
    rows, cols = index.shape

    def over(landmarks: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
        error = float(weight @ off[landmarks]) ** 2
        stated = scene.sigma_of(landmarks, weight[:, None] * up)
        return error / stated**2, error / float(weight**2 @ variance[landmarks])

    known = np.isfinite(off)
    found = [(float(np.mean(off[known] ** 2 / variance[known])),) * 2]
    for apart in APART_PX:
        pairs = []
        for _ in range(DRAWS):
            down = (apart, 0) if rng.random() < 0.5 else (0, apart)
            at = rng.integers(rows - down[0]), rng.integers(cols - down[1])
            pair = np.array([index[at], index[at[0] + down[0], at[1] + down[1]]])
            if (pair >= 0).all() and known[pair].all():
                pairs.append(over(pair, np.array([1.0, -1.0])))
        found.append(tuple(np.mean(pairs, axis=0)))
    for side in SQUARES_PX:
        squares = []
        for _ in range(DRAWS):
            at = rng.integers(rows - side), rng.integers(cols - side)
            inside = index[at[0] : at[0] + side, at[1] : at[1] + side].ravel()
            inside = inside[inside >= 0]
            inside = inside[known[inside]]
            if len(inside) >= FULL * side**2:
                squares.append(over(inside, np.full(len(inside), 1.0 / len(inside))))
        found.append(tuple(np.mean(squares, axis=0)))
    return found


def main(out: Path) -> None:
    """Map the sites, and print the table.

    Args:
        out: Folder for sites and runs; finished ones are not made again.
    """
    heads = ["heights", *(f"{n} px apart" for n in APART_PX), *(f"squares of {n}" for n in SQUARES_PX)]
    print("| site | " + " | ".join(heads) + " |\n|---|" + "---:|" * len(heads))
    for name, options in SITES.items():
        site, run = out.resolve() / name / "site", out.resolve() / name / "run"
        if not (site / "truth.h5").exists():
            simulate_site(options, site)
        scene = pcm.run(site / "site.toml", run).scene
        found = squares_over_sigmas(scene, heights_off(scene, site / "truth.h5"), np.random.default_rng(0))
        for row, label in enumerate((name, f"{name}, independent")):
            print(f"| {label} | " + " | ".join(f"{both[row]:.2f}" for both in found) + " |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
