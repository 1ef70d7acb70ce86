"""Matching of views by their keypoints' descriptors, and verification by two-view geometry."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.progress import Progress
from photoclinometry.sfm.database import (
    DATABASE,
    image_file,
    padding_px,
    read_keypoints,
    to_colmap,
    verified_numbers,
    write_matches,
    write_verified_matches,
)
from photoclinometry.sfm.guided_matching import described, guided_matches
from photoclinometry.sfm.options import SfmOptions

PAIRS_AT_ONCE = 60
"""Pairs matched between two reports of progress: fewer cost time, since search indices are built anew each time."""


def match_views(
    count: int,
    pairs: list[tuple[int, int]],
    work_dir: Path,
    options: SfmOptions,
    stage: str,
    progress: Progress,
) -> np.ndarray:
    """(K, K) numbers of verified matches between views, of these pairs and of those matched before.

    stage: name for progress reports. COLMAP's own guided matching is not used: searching again along epipolar lines
    made the poses worse (0.034 against 0.026 degrees on images of Vesta) and took nine times as long.
    """
    import pycolmap

    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    matching.num_threads = options.threads
    matching.sift.max_ratio = options.max_ratio
    verification = _verification(options)
    database, pairs_file = work_dir / DATABASE, work_dir / "pairs.txt"
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = str(pairs_file)
    for done in range(0, len(pairs), PAIRS_AT_ONCE):
        block = pairs[done : done + PAIRS_AT_ONCE]
        pairs_file.write_text("".join(f"{image_file(a)} {image_file(b)}\n" for a, b in block))
        pycolmap.match_image_pairs(database, matching, pairing, verification, pycolmap.Device.cpu)
        progress(stage, done + len(block), len(pairs))
    return verified_numbers(count, work_dir)


def _verification(options: SfmOptions) -> Any:
    import pycolmap

    verification = pycolmap.TwoViewGeometryOptions()
    verification.min_num_inliers = options.min_pair_matches
    verification.detect_watermark = False
    verification.ransac.max_error = options.max_epipolar_px
    verification.ransac.random_seed = options.seed
    return verification


def match_guided(
    cameras: list[Camera],
    pairs: list[tuple[int, int]],
    work_dir: Path,
    options: SfmOptions,
    stage: str,
    progress: Progress,
) -> np.ndarray:
    """(K, K) numbers of verified matches between views, after pairs were matched as of `guided_matches`.

    Matches that two-view geometry verifies replace the earlier ones of these pairs; pairs without enough stay as they
    are. stage: name for progress reports.
    """
    import pycolmap

    count = len(cameras)
    views = read_keypoints(cameras, work_dir)
    verification = _verification(options)
    found = {}
    for done, (a, b) in enumerate(pairs, start=1):
        one, other = described(*views[a]), described(*views[b])
        index = guided_matches(one, other, math.sqrt(cameras[b].width * cameras[b].height))
        if len(index) >= options.min_pair_matches:
            geometry = pycolmap.estimate_calibrated_two_view_geometry(
                to_colmap(cameras[a]), one.xy + padding_px(cameras[a]),
                to_colmap(cameras[b]), other.xy + padding_px(cameras[b]),
                index.astype(np.uint32), verification,
            )  # fmt: skip
            verified = np.asarray(geometry.inlier_matches).reshape(-1, 2)
            if len(verified) >= options.min_pair_matches:
                found[a, b] = verified.astype(int)
        progress(stage, done, len(pairs))
    write_matches(work_dir, found)
    write_verified_matches(work_dir, found)
    return verified_numbers(count, work_dir)
