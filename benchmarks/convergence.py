"""Does the joint estimate reach the same minimum from wherever it starts?

Random sites (30 x 30 landmarks; five reflectance models, calibrated or not) are mapped from random starts: positions
off by 0.2 to 1 ground sample, normals from plane fits to those, poses turned by 1e-3 rad and shifted by a ground
sample, and one keypoint in ten wrong by up to 30 px. The best cost known is the lowest of this start and of the truth,
followed down until nothing changes. Says for each site by how much the default options end above it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matched import OPTIONS, Noise, matched_problem
from photoclinometry.adjust import Adjustment, SolverOptions, adjust
from photoclinometry.model.reflectance import published
from photoclinometry.model.scene import Scene

MODELS = ("lunar-lambert", "minnaert", "akimov+", "mcewen", "akimov")
DEFAULT = replace(
    OPTIONS, keypoint_sigma_px=0.3, keypoint_loss=3.0, brightness_loss=3.0, max_reweightings=4, uncertainty=False
)
TIGHT = replace(
    DEFAULT, solver=SolverOptions(max_steps=150, relative_decrease=1e-7, absolute_decrease=0.1, settled=0.0)
)


def random_start(seed: int, fewest: int = 10, side: int = 30) -> tuple[Scene, Scene]:
    """A random start, and the truth with the same measurements; of `fewest` to 29 views."""
    rng = np.random.default_rng(1000 + seed)
    start, truth = matched_problem(
        side,
        int(rng.integers(fewest, 30)),
        seed=seed,
        reflectance=published(MODELS[seed % len(MODELS)], "vesta"),
        brightness="iof" if seed % 2 else "dn",
        noise=Noise(start_position=rng.uniform(0.2, 1.0), start_rotation_rad=1e-3, start_center=1.0),
    )
    keypoint = start.tracks.keypoint.copy()
    wrong = rng.uniform(size=len(keypoint)) < 0.1
    keypoint[wrong] += rng.uniform(-30.0, 30.0, (int(wrong.sum()), 2))
    tracks = replace(start.tracks, keypoint=keypoint)
    return replace(start, tracks=tracks), replace(truth, tracks=tracks)


def final_cost(found: Adjustment) -> float:
    """Of the last step taken."""
    return next(step.total for step in reversed(found.log) if step.accepted)


def main(sites: int = 50, fewest: int = 10) -> None:
    """Prints a line for each site, then how many end within 1e-4 of the best cost known."""
    within = 0
    for seed in range(sites):
        start, truth = random_start(seed, fewest)
        found = adjust(start, DEFAULT)
        best = min(final_cost(found), *(final_cost(adjust(scene, TIGHT)) for scene in (start, truth)))
        above = final_cost(found) / best - 1.0
        within += above <= 1e-4
        model = start.reflectance.name if start.reflectance else "none"
        steps = sum(step.cg_iterations > 0 for step in found.log)
        print(
            f"{seed:3d} {model:13s} {start.brightness} {len(start.views):2d} views: {above:.1e} above, {steps} steps, "
            f"{found.message}",
            flush=True,
        )
    print(f"{within} of {sites} within 1e-4 of the best cost known")


if __name__ == "__main__":
    import sys

    main(*map(int, sys.argv[1:]))
