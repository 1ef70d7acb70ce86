"""Every reader is given spoilt files: each is read correctly or refused by name, soon, and without a crash.

    python benchmarks/fuzz_readers.py [--files 100000] [--data FOLDER] [--only NAME ...] [--seed 0] [--workers 1]

--data: a folder of real samples beside those made here. --keep FOLDER writes the files of each fault there; --trial N
with one --only NAME reads that file alone, with its traceback. Ends with exit code 1 where there was a fault.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import fuzz_samples as made
from fuzz_samples import Reader, samples
from fuzz_workers import BATCH, Job, Tally, run_jobs, spoilt_files, try_file, write_files
from photoclinometry.io.archives.archive import read_product
from photoclinometry.io.archives.pvl import parse_pvl
from photoclinometry.io.control_points_csv import read_control_points
from photoclinometry.io.ground import read_ground
from photoclinometry.io.held_out import read_held_out
from photoclinometry.io.images import read_image, read_mask
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.io.models.colmap import read_colmap
from photoclinometry.io.models.sumfile import read_sumfile
from photoclinometry.io.models.text_model import read_text_model
from photoclinometry.io.scene_file import read_scene
from photoclinometry.io.similarity import read_similarity
from photoclinometry.io.site import read_site
from photoclinometry.io.spice import Kernels
from photoclinometry.io.suns_csv import SunRow, read_suns
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.image import Image
from photoclinometry.model.scene import Scene

LARGEST_PX = 10_000
"""Masks of larger images are not made: a site may well announce them [px]."""


def _sound(holds: Any, what: str) -> None:
    if not holds:
        raise AssertionError(f"accepted, but {what}")


def _image(image: Image) -> None:
    _sound(image.brightness.shape == image.valid.shape and image.valid.dtype == bool, "without a mask")
    _sound(np.isfinite(image.brightness).all(), "brightness is not finite")


def _mask(mask: np.ndarray) -> None:
    _sound(mask.ndim == 2 and mask.dtype == bool, "not a mask")


def read_product_wholly(path: Path) -> None:
    """A product, and the facts in its label."""
    from photoclinometry.ingest.facts import read_facts

    product = read_product(path)
    _image(product.image)
    read_facts(product)


def read_view(path: Path) -> None:
    """A product as a view."""
    from photoclinometry.ingest.exposure import AuxiliaryData, read_exposure
    from photoclinometry.ingest.options import IngestOptions

    suns = {path.name: SunRow(np.array([0.6, 0.0, -0.8]), None)}
    exposure = read_exposure(path, IngestOptions(pinhole=(500.0, 500.0, 30.0, 20.0)), AuxiliaryData(suns=suns))
    _image(exposure.image)
    _sound(np.isfinite(exposure.sun).all(), "the Sun is not finite")


def read_mesh(path: Path) -> None:
    """A PLY file, with its faces in range."""
    from photoclinometry.io.meshes.ply import read_ply

    ply = read_ply(path)
    _sound(np.isfinite(ply.position).all(), "vertices are not finite")
    _sound(ply.faces is None or not len(ply.faces) or ply.faces.max() < len(ply.position), "faces out of range")


def read_body_ply(path: Path) -> None:
    """A shape model, with its faces in range and standard deviations that can be."""
    from photoclinometry.io.meshes.shape_ply import read_shape_ply

    shape = read_shape_ply(path)
    _sound(np.isfinite(shape.vertices).all(), "vertices are not finite")
    _sound(shape.faces.min() >= 0 and shape.faces.max() < len(shape.vertices), "faces out of range")
    _sound(not any((sigma < 0).any() for sigma in shape.sigma.values()), "standard deviations are negative")


def read_icq_model(path: Path) -> None:
    """Gaskell's vertices."""
    from photoclinometry.io.models.icq import read_icq

    _sound(np.isfinite(read_icq(path)).all(), "vertices are not finite")


def read_truth_file(path: Path) -> None:
    """The truth of a simulated site."""
    from photoclinometry.simulate.truth_file import read_truth

    read_truth(path)


def read_body_truth_file(path: Path) -> None:
    """The truth of a simulated body."""
    from photoclinometry.simulate.bodies.truth import read_body_truth

    read_body_truth(path)


def read_stage(path: Path) -> None:
    """A stage's record: damage is warned of, and nothing is raised."""
    from photoclinometry.pipeline.folder.records import read_record

    read_record(path, "key", Scene)


def read_plan_table(path: Path) -> None:
    """A table of poses and Suns, with numbers that can be planned with."""
    from photoclinometry.plan.table import read_table

    for view in read_table(path).views:
        assert view.pose_prior is not None
        pose = view.pose_prior.cam_from_body
        _sound(np.isfinite(pose.rotation).all() and np.isfinite(pose.translation).all(), "a pose is not finite")
        _sound(np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-9), "an attitude is no rotation")
        _sound(abs(np.linalg.norm(view.sun) - 1.0) < 1e-9, "the Sun is not a unit vector")
        _sound(min(view.camera.width, view.camera.height) >= 1, "an image has no pixels")
        _sound(
            all(sigma > 0 for sigma in (view.sun_sigma_rad, view.pose_prior.translation_sigma)),
            "a sigma is not positive",
        )


def read_config_file(run: Path) -> None:
    """The options of a run, and the site that they name."""
    from photoclinometry.io.run_files import read_config, site_path

    _sound(isinstance(read_config(run), dict), "not a table")
    with suppress(RunFolderError):  # it is not there
        site_path(run)


def read_metrics_file(run: Path) -> None:
    """The figures and warnings of a run, as `phomo info` shows them."""
    from photoclinometry.cli.info import figure_rows
    from photoclinometry.io.run_files import read_metrics

    content = read_metrics(run)
    figure_rows(content)
    _sound(all(isinstance(row["words"], str) for row in content.get("warnings", [])), "a warning is no text")


def read_mark_file(run: Path) -> None:
    """The mark of a run folder: its format, and which site it belongs to."""
    from photoclinometry.pipeline.folder.run_mark import check_format, owner_of_folder

    check_format(run)
    owner_of_folder(run)


def read_lock_file(run: Path) -> None:
    """The lock of a run folder, of a process that has ended. A damaged one counts as just being written."""
    from photoclinometry.pipeline.folder.run_lock import check_lock

    check_lock(run)


def read_manifest_file(path: Path) -> None:
    """The list of files of an export. A damaged one is that of no export, so that nothing may be replaced."""
    from photoclinometry.output.export.folder import check_folder

    check_folder(path.parent, made.owner(), overwrite=True)


def read_study_record(folder: Path) -> None:
    """The record of a study's cell. Damage is warned of, and nothing is raised; here that counts as refused."""
    from photoclinometry.study.record import ARRAYS, read_record

    record = read_record(folder, made.study_cell(), "key")
    if record is None:
        raise InputError(f"{folder}: the cell is measured again")
    _sound(all(isinstance(value, float | int) for value in record.metrics.values()), "a figure is no number")
    _sound(set(ARRAYS) <= set(record.arrays), "arrays are missing")


def read_masked_site(path: Path) -> None:
    """A site, and where its images are used."""
    for view in read_site(path).views:
        shape = (view.camera.height, view.camera.width)
        if max(shape) <= LARGEST_PX:
            _mask(view.masking.usable(shape))


def read_model(path: Path) -> None:
    """A COLMAP model."""
    _, _, poses, points = read_colmap(path)
    _sound(np.isfinite(poses.rotation).all() and points.shape[1:] == (3,), "poses are not finite")


def read_kernel(path: Path) -> None:
    """A kernel, with questions, in a process of SPICE that is kept for the next one.

    Where that process breaks down, an earlier kernel may have harmed it, so that a new one is given this kernel alone.
    """
    if SPICE.count == KERNELS_EACH:
        SPICE.end()
    try:
        SPICE.read(path)
    except InputError as error:
        if "SPICE broke down" not in str(error):
            raise
        SPICE.end()
        SPICE.read(path)


class _Spice:
    """A process of SPICE that reads one kernel after another."""

    def __init__(self) -> None:
        self.kernels: Kernels | None = None
        self.count = 0

    def read(self, path: Path) -> None:
        """Loads a kernel, asks, and unloads it. Raises InputError where it cannot be loaded, or answers nothing."""
        if self.kernels is None:
            self.kernels, self.count = Kernels([]), 0
        self.kernels.files, self.count = [path], self.count + 1
        try:
            self.kernels.load(path)
            answers = [self._answer(question) for question in QUESTIONS]
            if all(isinstance(answer, InputError) for answer in answers):
                raise answers[-1]
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        finally:
            with suppress(InputError):
                self.kernels.unload()

    def _answer(self, question: Callable[[Kernels], Any]) -> Any:
        """The answer, or the error if there is none. Raises InputError where SPICE broke down."""
        assert self.kernels is not None
        try:
            return question(self.kernels)
        except InputError as error:
            if "SPICE broke down" in str(error):
                raise
            return error

    def end(self) -> None:
        """Ends the process; the next kernel gets a new one."""
        if self.kernels is not None:
            self.kernels.close()
        self.kernels = None


SPICE = _Spice()
TIMES = ((488001500.0, "2000001", "-203"), (182502350.0, "2025143", "-130"), (604882350.0, "2101955", "-64"))
"""Times [s TDB past J2000] that the real kernels cover, with their bodies and spacecraft."""
QUESTIONS: list[Callable[[Kernels], Any]] = [
    *(partial(Kernels.position, target="SUN", time=t, frame="J2000", correction="LT+S", observer=b)
      for t, b, _ in TIMES),
    *(partial(Kernels.position, target=craft, time=t, frame="J2000", correction="NONE", observer=b)
      for t, b, craft in TIMES),
    partial(Kernels.rotation, source="J2000", target="IAU_BENNU", time=TIMES[-1][0]),
    partial(Kernels.time_of_utc, utc="2019-03-03T10:03:44"),
    partial(Kernels.time_of_clock, spacecraft=-64, clock="3/0604882350.0"),
    partial(Kernels.frame_name, code=-64361),
    partial(Kernels.keyword, name="BODY2101955_RADII"),
]  # fmt: skip
"""The last answers where no kernel gives any data."""
KERNELS_EACH = 200
"""Kernels that one process of SPICE reads: damaged ones may leave files open."""


_ARCHIVES = (
    "formats/**/*.cub",
    "formats/pds3/*.img",
    "formats/pds3/*.lbl",
    "formats/near/*/*.lbl",
    "formats/pds4/*.xml",
)
_BESIDE = (".img", ".fit", ".lbl")

READERS = {
    "image": Reader(read=lambda p: _image(read_image(p)), make=made.make_images, alone=True, share=3.0,
                    real=("vesta-opnav022/images/*.png",)),
    "mask": Reader(read=lambda p: _mask(read_mask(p)), make=made.make_images, alone=True),
    "cube": Reader(read=read_product_wholly, make=made.make_cubes, alone=True, real=("formats/**/*.cub",)),
    "pds3": Reader(read=read_product_wholly, make=made.make_pds3, real=_ARCHIVES[1:4], beside=_BESIDE),
    "pds4": Reader(read=read_product_wholly, make=made.make_pds4, real=_ARCHIVES[4:], beside=_BESIDE),
    "cube to view": Reader(read=read_view, make=made.make_cubes, alone=True),
    "pds3 to view": Reader(read=read_view, make=made.make_pds3),
    "pvl": Reader(read=lambda p: parse_pvl(p.read_bytes(), str(p)), make=made.make_labels, alone=True, share=2.0,
                  real=("formats/**/*.pvl", "formats/**/*.lbl", "spice/*/*.lbl")),
    "site.toml": Reader(read=read_site, make=made.make_sites, alone=True, real=("*/site.toml",), share=2.0),
    "suns": Reader(read=read_suns, make=made.make_suns, share=2.0),
    "control points": Reader(read=read_control_points, make=made.make_control, alone=True, share=2.0),
    "ply": Reader(read=read_mesh, make=made.make_meshes, alone=True, share=2.0),
    "obj": Reader(read=read_obj, make=made.make_obj, alone=True, share=2.0),
    "body.ply": Reader(read=read_body_ply, make=made.make_shape, alone=True, share=2.0),
    "icq": Reader(read=read_icq_model, make=made.make_icq, alone=True, share=2.0),
    "surface": Reader(read=read_ground, make=made.make_dtm, alone=True, share=2.0),
    "scene.h5": Reader(read=read_scene, make=made.make_scene),
    "truth.h5": Reader(read=read_truth_file, make=made.make_truth),
    "body truth.h5": Reader(read=read_body_truth_file, make=made.make_body_truth),
    "colmap": Reader(read=read_model, make=made.make_colmap, share=2.0),
    "text model": Reader(read=read_text_model, make=made.make_text_model, share=2.0),
    "sumfile": Reader(read=read_sumfile, make=made.make_sumfile, real=("formats/spc/*.SUM",), share=2.0),
    "held_out.json": Reader(read=read_held_out, make=made.make_held_out, share=2.0),
    "transform": Reader(read=read_similarity, make=made.make_similarity, share=2.0),
    "plan table": Reader(read=read_plan_table, make=made.make_plan_table, alone=True, share=2.0),
    "config.toml": Reader(read=read_config_file, make=made.make_config, share=2.0),
    "metrics.json": Reader(read=read_metrics_file, make=made.make_metrics, share=2.0),
    "run.json": Reader(read=read_mark_file, make=made.make_mark, share=2.0),
    "lock": Reader(read=read_lock_file, make=made.make_lock, share=2.0),
    "export.json": Reader(read=read_manifest_file, make=made.make_manifest, alone=True, share=2.0),
    "study record": Reader(read=read_study_record, make=made.make_study_record, share=2.0),
    "masked site": Reader(read=read_masked_site, make=made.make_masked_site, share=2.0),
    "stage record": Reader(read=read_stage, make=made.make_record),
    "kernel": Reader(read=read_kernel, make=made.make_kernels, real=("spice/*/*.b*", "spice/*/*.t*")),
}  # fmt: skip


def jobs_of(names: list[str], files: int, shares: dict[str, float]) -> list[Job]:
    """Batches of about `files` trials in all, shared out among the readers."""
    whole = sum(shares[name] for name in names)
    counts = {name: max(1, round(files * shares[name] / whole)) for name in names}
    return [
        Job(name, range(start, min(start + BATCH, count)))
        for name, count in counts.items()
        for start in range(0, count, BATCH)
    ]


def table(found: dict[str, Tally]) -> str:
    """One line for each reader, and one for all."""
    rows = [f"{'reader':16}{'files':>8}{'refused':>9}{'accepted':>9}{'faults':>7}{'slowest':>9}{'memory':>10}"]
    whole = Tally()
    for name, tally in [*found.items(), ("all", whole)]:
        rows.append(
            f"{name:16}{tally.files:8}{tally.refused:9}{tally.accepted:9}{len(tally.faults):7}"
            f"{tally.slowest_s:7.2f} s{tally.largest_mib:6.0f} MiB"
        )
        whole.add(tally)
    return "\n".join(rows)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=100_000, help="spoilt files in all")
    parser.add_argument("--data", type=Path, help="folder of real samples")
    parser.add_argument("--only", nargs="+", choices=READERS, default=list(READERS), help="readers")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files of each fault")
    parser.add_argument("--trial", type=int, help="read this one alone")
    options = parser.parse_args(arguments)
    logging.disable(logging.CRITICAL)
    readers = {name: READERS[name] for name in options.only}
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        good = {name: samples(r, folder / "good" / name, options.data) for name, r in readers.items()}
        if options.trial is not None:
            (name,) = options.only
            path = write_files(spoilt_files(name, good[name], options.trial, options.seed), options.keep or folder)
            print(*try_file(readers[name], path), sep="\n")
            return 0
        jobs = jobs_of(options.only, options.files, {name: r.share for name, r in readers.items()})
        found = run_jobs(readers, good, jobs, options.seed, folder, options.workers)
        for name, tally in found.items():
            for trial, what in tally.faults:
                print(f"--- {name}, --trial {trial}: {what.strip()}")
                if options.keep:
                    place = options.keep / f"{name}-{trial}".replace(" ", "-")
                    write_files(spoilt_files(name, good[name], trial, options.seed), place)
    print(table(found))
    print(f"{time.monotonic() - begin:.0f} s, seed {options.seed}")
    return int(any(tally.faults for tally in found.values()))


if __name__ == "__main__":
    sys.exit(main())
