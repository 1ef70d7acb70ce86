"""Whether the joint estimate converges with every reflectance model, calibrated and not.

    python benchmarks/models.py [side] [views]

A matched problem of each (`matched.py`); reflectance parameters held, and estimated where the model has any.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from matched import OPTIONS, matched_problem, rms_errors
from photoclinometry.adjust import adjust
from photoclinometry.model.reflectance import DISK_FUNCTIONS, HAS_PHASE_FUNCTION, published


def main(side: int = 100, views: int = 29) -> None:
    for disk in DISK_FUNCTIONS:
        for brightness in ("iof", "dn"):
            for sigma in (0.0, 0.05) if disk in HAS_PHASE_FUNCTION else (0.0,):
                start, truth = matched_problem(side, views, reflectance=published(disk, "vesta"), brightness=brightness)
                found = adjust(start, replace(OPTIONS, reflectance_sigma=sigma, uncertainty=False))
                print(
                    f"{disk:14} {brightness:4} {'estimated' if sigma else 'held':10} {found.message}; "
                    f"{len(found.log) - 1} steps, normals {rms_errors(found.scene, truth)['normal']:.3f} deg RMS"
                )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
