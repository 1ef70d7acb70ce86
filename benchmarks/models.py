"""Whether the joint estimate converges with every reflectance model, calibrated and not.

    python benchmarks/models.py [side] [views]

A matched problem of each (`matched.py`); reflectance parameters held, and estimated where the model has any.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from matched import OPTIONS, matched_problem, rms_errors
from photoclinometry.adjust import adjust
from photoclinometry.model.reflectance import MODELS, starting_model


def main(side: int = 100, views: int = 29) -> None:
    for disk, model in MODELS.items():
        for brightness in ("iof", "dn"):
            for sigma in (0.0, 0.05) if model.parameters else (0.0,):
                chosen = starting_model(disk, "vesta")
                start, truth = matched_problem(side, views, reflectance=chosen, brightness=brightness)
                found = adjust(start, replace(OPTIONS, reflectance_sigma=sigma, uncertainty=False))
                print(
                    f"{disk:14} {brightness:4} {'estimated' if sigma else 'held':10} {found.message}; "
                    f"{len(found.log) - 1} steps, normals {rms_errors(found.scene, truth)['normal']:.3f} deg RMS"
                )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
