"""A disk that is full, or cannot be written: one line with file and reason, exit code 1, nothing half-written."""

import errno
import os
import shlex

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from commands import phomo
from fault_place import small_disk
from photoclinometry.io.models.text_model import write_text_model
from photoclinometry.io.site import read_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import OutputError, RunFolderError
from photoclinometry.model.image import Image
from photoclinometry.output.export import ExportOptions, export_scene
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.folder.records import read_record, write_record
from photoclinometry.sfm import reconstruct_sparse
from photoclinometry.sfm.database import disk_errors
from runs import draw_no_figures
from scenes import synthetic_scene
from sites import write_small_site


@pytest.mark.parametrize("size", [1_000, 20_000, 100_000], ids="{} bytes".format)
def test_the_sparse_stage(tmp_path, size):
    """SQLite and COLMAP fail in other ways at each."""
    rng = np.random.default_rng(0)
    ground = [gaussian_filter(rng.normal(size=(160, 160)), 1.5).astype(np.float32) for _ in range(4)]
    images = [Image(str(n), picture, np.ones(picture.shape, bool)) for n, picture in enumerate(ground)]
    cameras = [Camera("PINHOLE", 160, 160, (800.0, 800.0, 80.0, 80.0))] * 4
    reason = rf"{os.strerror(errno.EFBIG)}; .*choose another output folder"
    with small_disk(size), pytest.raises(OutputError, match=rf"work/.*: cannot be written: {reason}"):
        reconstruct_sparse(images, cameras, tmp_path / "work")


def test_the_sparse_stage_where_nothing_may_be_written(tmp_path):
    (tmp_path / "file").write_text("x")
    site = read_site(write_small_site(tmp_path))
    cameras = [view.camera for view in site.views]
    with pytest.raises(RunFolderError, match="file/work: cannot be written: Not a directory"):
        reconstruct_sparse(load_images(site), cameras, tmp_path / "file" / "work")


def test_other_errors_of_the_sparse_stage_are_left_as_they_are(tmp_path):
    with pytest.raises(RuntimeError, match=r"^a mistake of ours$"), disk_errors(tmp_path):
        raise RuntimeError("a mistake of ours")
    refused = pytest.raises(OutputError, match=r"database\.db: cannot be written: SQLite error: disk I/O error")
    with refused, disk_errors(tmp_path):
        raise RuntimeError("SQLite error: disk I/O error")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("product", ["dtm", "obj", "gltf", "ply", "colmap", "text-model", "csv"])
@pytest.mark.parametrize("size", [300, 4000], ids="{} bytes".format)
def test_every_product_of_an_export(tmp_path, product, size):
    if product == "dtm":
        pytest.importorskip("rasterio")
    scene = synthetic_scene(size=64, views=4)
    scene.landmarks.position[:, 2] += np.random.default_rng(0).normal(scale=0.1, size=len(scene.landmarks))
    out = tmp_path / "maps"
    with small_disk(size), pytest.raises(OutputError, match=rf"{out}/.*: cannot be written: File too large"):
        export_scene(scene, out, ExportOptions(products=(product,), unit_m=1.0))
    assert not list(tmp_path.iterdir())


def test_a_stages_result(tmp_path):
    file = tmp_path / "stages" / "dense.npz"
    write_record(file, "old", 1.0)
    with small_disk(3000), pytest.raises(OutputError, match=r"dense\.npz: cannot be written: File too large"):
        write_record(file, "new", {"a": np.zeros(10_000)})
    kept = read_record(file, "old", float)
    assert kept is not None
    assert kept.value == 1.0
    assert [path.name for path in file.parent.iterdir()] == ["dense.npz"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO])
def test_any_other_write_of_a_command(tmp_path, monkeypatch, capsys, code):
    """An error of the disk that nothing else has caught, such as that of the kernels' cache."""

    def fails(*_):
        raise OSError(code, os.strerror(code), "/somewhere/kernel.nbi")

    monkeypatch.setattr(pipeline, "run", fails)
    assert phomo("run", write_small_site(tmp_path / "site"), "--out", tmp_path / "run") == 1
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert last == f"phomo: /somewhere/kernel.nbi: {os.strerror(code)}; free some space, or choose another place"


def test_missing_files_of_the_program_are_no_disk_errors(tmp_path, monkeypatch):
    def fails(*_):
        raise FileNotFoundError(errno.ENOENT, "a bug")

    monkeypatch.setattr(pipeline, "run", fails)
    with pytest.raises(FileNotFoundError):
        phomo("run", write_small_site(tmp_path / "site"), "--out", tmp_path / "run")


SMALL = "--image-size 32 --views 3"
PLACE, BODY = f"simulate {SMALL} --reflectance akimov+ --out", f"simulate {SMALL} --preset bilobed --out"
REFINE = "refine model --min-observations 1 --min-view-observations 1 --out"
LARGEST_IMAGE = 10_000
"""Bytes that hold an image of 32 x 32 pixels, and no truth."""


@pytest.mark.parametrize(
    ("command", "size", "file", "like"),
    [
        (PLACE, LARGEST_IMAGE, "truth.h5", PLACE),
        (BODY, LARGEST_IMAGE, "truth.h5", BODY),
        (
            f"study {SMALL} --presets demo --run.densify.min-views 3 --out",
            LARGEST_IMAGE,
            "sites/demo-moderate-akimov+-0/truth.h5",
            PLACE,
        ),
        (REFINE, 300, "stages/refine.npz", REFINE),
    ],
    ids=["simulate a place", "simulate a body", "study", "refine"],
)
def test_a_command_that_computes(tmp_path, monkeypatch, capsys, command, size, file, like):
    """like: what compiles and caches the same kernels. Their files would not fit on the small disk, either."""
    draw_no_figures(monkeypatch)
    if "bilobed" in command:
        pytest.importorskip("embreex")
    monkeypatch.chdir(tmp_path)
    model = synthetic_scene(size=8, views=4, keypoint_noise_px=0.05, brightness_noise=1e-3)
    write_text_model(tmp_path / "model", model)
    assert phomo(*shlex.split(like), "first") == 0
    capsys.readouterr()
    with small_disk(size):
        assert phomo(*shlex.split(command), "out") == 1
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert last.startswith(f"phomo: out/{file}: cannot be written: File too large")
    assert not list((tmp_path / "out").rglob("*.partial-*"))
