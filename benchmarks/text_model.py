"""Time and memory of writing and reading a text model of the size of the paper's.

    python benchmarks/text_model.py [--landmarks 160000] [--views 29] [--observations 23]

The model is generated: only its size and the length of its numbers matter (17 digits, as estimates have). Each step is
a process of its own, so that its peak memory is its own. Lower is better; reading should take less than 30 s and 3 GB.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views


def generated_scene(landmarks: int, views: int, observations: int) -> Scene:
    """Landmarks on a square, each with keypoints and brightness of any value in some of the views."""
    rng = np.random.default_rng(0)
    side = int(np.ceil(np.sqrt(landmarks)))
    pixel = np.stack(np.divmod(np.arange(landmarks), side), -1).astype(np.int32)
    camera = Camera("PINHOLE", side, side, (10 * side, 10 * side, side / 2, side / 2))
    start = np.arange(landmarks + 1, dtype=np.int64) * observations
    view = np.argsort(rng.random((landmarks, views)), axis=1)[:, :observations]
    count = landmarks * observations
    ones = np.ones(views)
    return Scene(
        name="generated",
        body=None,
        brightness="iof",
        reflectance=None,
        views=Views(
            name=tuple(f"img{k:03d}.png" for k in range(views)),
            cameras=(camera,) * views,
            body_from_cam=Rigid(np.tile(np.eye(3), (views, 1, 1)), np.tile([0.0, 0.0, -10.0 * side], (views, 1))),
            sun=unit(rng.normal(size=(views, 3))),
            scale=ones,
            bias=0 * ones,
            sun_measured=unit(rng.normal(size=(views, 3))),
            sun_sigma=1e-3 * ones,
            sun_common_sigma=0 * ones,
            arc=np.zeros(views, int),
            dark_level=0 * ones,
        ),
        landmarks=Landmarks(
            position=np.column_stack([pixel[:, ::-1] - side / 2, rng.normal(size=landmarks)]),
            normal=unit(rng.normal(size=(landmarks, 3))),
            albedo=rng.uniform(0.2, 0.4, landmarks),
            pixel=pixel,
        ),
        tracks=Tracks(
            start=start,
            view=np.sort(view, axis=1).ravel().astype(np.int32),
            keypoint=rng.uniform(0, side, (count, 2)),
            keypoint_sigma=np.ones(count),
            brightness=rng.uniform(0.01, 0.2, count),
            lit=np.ones(count, bool),
        ),
        reference=0,
        region=Region.of_image(side, side),
    )


def step(what: str, folder: Path, size: tuple[int, int, int]) -> None:
    """Writes or reads the model in `folder`, and prints what that took."""
    from photoclinometry.io.models.text_model import read_text_model, write_text_model

    scene = generated_scene(*size) if what == "write" else None
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wall, cpu = time.perf_counter(), time.process_time()
    if scene is not None:
        write_text_model(folder, scene)
    else:
        assert len(read_text_model(folder).scene.tracks) == size[0] * size[2]
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{what}: {wall:.1f} s, {cpu:.1f} CPU s, peak {peak / 2**20:.2f} GB ({before / 2**20:.2f} before)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("landmarks", 160_000), ("views", 29), ("observations", 23)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--step", choices=("write", "read"), help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    size = (options.landmarks, options.views, options.observations)
    if options.step:
        step(options.step, options.folder, size)
        return
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "model"
        given = [f"--{name}={value}" for name, value in zip(("landmarks", "views", "observations"), size, strict=True)]
        for what in ("write", "read"):
            subprocess.run([sys.executable, __file__, *given, f"--step={what}", f"--folder={model}"], check=True)
        megabytes = sum(file.stat().st_size for file in model.iterdir()) / 1e6
    print(f"{size[0]} landmarks, {size[0] * size[2]} observations in {size[1]} views, {megabytes:.0f} MB")


if __name__ == "__main__":
    main()
