"""Steps of a map where a view ends: none should be seen, whatever is wrong with the brightness of images.

    python benchmarks/seams.py --out seams

Cameras point so badly that the borders of views lie all over the region. The site is mapped as it is, and with faults
of brightness. A step is the change of the error from one landmark to its neighbour in a row or column. The table has
the root mean square of steps across ends of views, that of all others, and their ratio: a seam would make it large.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tyro

import photoclinometry as pcm
from faults import region_of
from image_faults import FAULTS, read_images, write_spoiled
from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.io.site import read_site
from photoclinometry.model.scene import Scene
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.truth import truth_maps
from photoclinometry.simulate.truth_file import read_truth

SITE = {"views": 14, "image_size": 256, "region_size": 112, "pointing_jitter_px": 60.0, "lighting": "moderate"}
MARGIN_PX = 16.0
"""A view ends between two landmarks where it sees one and not the other, which is this near to its image's border, or
beyond: more than half of any window of the matching."""
BESIDE = 4
"""Landmarks on each side whose mean errors make a step, besides those of the nearest two."""


def main(out: Path, seeds: int = 2, faults: tuple[str, ...] = ("none", "vignetting", "gradient", "flat-field")) -> None:
    """Map sites, and table the steps.

    Args:
        out: Folder for sites, runs and the table.
        seeds: Sites.
        faults: Of `image_faults.FAULTS`; "none" for images as they are.
    """
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    lines = ["| site | fault | ends of views [pairs] | heights | heights, means of 4 | normals | normals, means of 4 |",
             "|---" * 7 + "|"]  # fmt: skip
    for seed in range(seeds):
        options = SimulationOptions(preset="demo", seed=300 + seed, **SITE)
        file = simulate_site(options, out / f"site-{seed}", overwrite=True)
        clean, region = read_site(file), None
        for fault in faults:
            given = file
            if fault != "none":
                spoiled = FAULTS[fault](read_images(clean), np.random.default_rng(seed))
                given = write_spoiled(spoiled, clean, out / f"site-{seed}-{fault}", region)
            scene = pcm.run(given, out / f"run-{seed}-{fault}", overwrite=True).scene
            region = region or region_of(scene)
            lines.append(f"| {seed} | {fault} | {_row(scene, file)} |")
            print(lines[-1], flush=True)
            (out / "table.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _row(scene: Scene, site: Path) -> str:
    truth = read_truth(site.with_name("truth.h5"))
    true = truth_maps(truth, scene.views.name[scene.reference], scene.region)
    found = evaluate_against_truth(scene, truth)
    height = scene.grid(found.errors["position_error_along_normal_m"] / found.aligned.gsd)[..., None]
    true_normal = np.where(true.hit[..., None], true.normal_mean, np.nan)
    normal = np.degrees(scene.grid(found.aligned.landmarks.normal) - true_normal)
    ends = [_ends(scene, axis) for axis in (0, 1)]
    cells = [str(int(sum(each.sum() for each in ends)))]
    for error in (height, normal):
        for beside in (1, BESIDE):
            steps = [_steps(error, axis, beside) for axis in (0, 1)]
            at = np.concatenate([step[end] for step, end in zip(steps, ends, strict=True)])
            other = np.concatenate([step[~end] for step, end in zip(steps, ends, strict=True)])
            cells.append(f"{_rms(at):.4f} / {_rms(other):.4f} = {_rms(at) / _rms(other):.2f}")
    return " | ".join(cells)


def _ends(scene: Scene, axis: int) -> np.ndarray:
    """Cells between which a view ends: a cell of the map's grid and the next along an axis."""
    ends = np.zeros(scene.region.grid_shape, bool).swapaxes(0, axis)[1:]
    for k, camera in enumerate(scene.views.cameras):
        observed = np.zeros(len(scene.landmarks), bool)
        observed[scene.tracks.landmark[scene.tracks.view == k]] = True
        pixel = scene.grid(scene.views.project(k, scene.landmarks.position))
        inside = np.minimum(pixel, np.array([camera.width, camera.height]) - pixel).min(-1).swapaxes(0, axis)
        seen = scene.grid(observed, 0).astype(bool).swapaxes(0, axis)
        out = ~seen & (inside < MARGIN_PX)
        ends |= (seen[:-1] & out[1:]) | (out[:-1] & seen[1:])
    return ends.swapaxes(0, axis)


def _steps(error: np.ndarray, axis: int, beside: int) -> np.ndarray:
    """Lengths of the difference between the mean errors of cells on both sides of every border between two cells."""
    error = error.swapaxes(0, axis)
    padded = np.pad(error, ((beside - 1, beside - 1), (0, 0), (0, 0)), constant_values=np.nan)
    count = len(error) - 1
    before = np.mean([padded[n : n + count] for n in range(beside)], axis=0)
    after = np.mean([padded[n : n + count] for n in range(beside, 2 * beside)], axis=0)
    return np.linalg.norm(after - before, axis=-1).swapaxes(0, axis)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


if __name__ == "__main__":
    tyro.cli(main)
