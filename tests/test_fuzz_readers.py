"""Every reader meets spoilt files: a short round of the benchmark, and the faults that long rounds have found."""

import json
import logging
import pickle
import struct
import time
import zipfile

import h5py
import numpy as np
import pytest

from archives import FORMATS, SHARED
from fuzz_readers import READERS, SPICE, main, read_kernel
from fuzz_samples import samples
from fuzz_workers import SECONDS, spoilt_files, try_file, write_files
from photoclinometry.io.arrays import read_arrays
from photoclinometry.io.ground import read_ground
from photoclinometry.io.hdf5 import check_hdf5
from photoclinometry.io.held_out import read_held_out
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.io.meshes.ply import read_ply
from photoclinometry.io.models.colmap import read_colmap, write_colmap
from photoclinometry.io.models.sumfile import read_sumfile
from photoclinometry.io.models.text_model import read_text_model
from photoclinometry.io.scene_file import read_scene, write_scene
from photoclinometry.io.similarity import read_similarity
from photoclinometry.io.suns_csv import read_suns
from photoclinometry.io.toml_file import read_toml
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.pipeline.folder.records import read_record
from photoclinometry.simulate.truth_file import read_truth
from scenes import synthetic_scene

FILES = 30
"""Spoilt files of each reader in a short round."""


@pytest.fixture(autouse=True)
def _quiet():
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


@pytest.fixture
def _spice():
    yield
    SPICE.end()


@pytest.mark.usefixtures("_spice")
@pytest.mark.parametrize("name", READERS)
def test_a_short_round_finds_no_fault(tmp_path, name):
    pytest.importorskip({"surface": "rasterio", "kernel": "spiceypy"}.get(name, "numpy"))
    good = samples(READERS[name], tmp_path / "good", SHARED if FORMATS.is_dir() else None)
    whole = [try_file(READERS[name], write_files(sample, tmp_path / f"whole{n}")) for n, sample in enumerate(good)]
    assert "accepted" in [outcome for outcome, *_ in whole]
    assert [what for outcome, what, _ in whole if outcome == "fault"] == []
    outcomes = set()
    for trial in range(FILES):
        path = write_files(spoilt_files(name, good, trial, 0), tmp_path / f"{trial}")
        outcome, what, _ = try_file(READERS[name], path)
        assert outcome != "fault", f"--seed 0 --only {name!r} --trial {trial}: {what}"
        outcomes.add(outcome)
    assert "refused" in outcomes or name == "stage record"


@pytest.mark.usefixtures("_spice")
def test_a_process_of_spice_that_breaks_down_costs_no_other_kernel(tmp_path):
    """The kernel at hand is read again, by a new process, and alone."""
    pytest.importorskip("spiceypy")
    (tmp_path / "a.tpc").write_text("KPL/PCK\n\\begindata\nBODY2101955_RADII = ( 1 2 3 )\n\\begintext\n")
    read_kernel(tmp_path / "a.tpc")
    first = SPICE.kernels
    read_kernel(tmp_path / "a.tpc")
    assert SPICE.kernels is first
    first._child.process.kill()
    first._child.process.wait()
    read_kernel(tmp_path / "a.tpc")
    assert SPICE.kernels is not first


def test_the_benchmark_ends_with_a_table(capsys):
    assert main(["--files", "20", "--only", "suns", "transform"]) == 0
    table = capsys.readouterr().out
    assert "suns" in table
    assert "all" in table


class Harm:
    """Unpickling it would make a folder."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return (self.mark.__class__.mkdir, (self.mark,))


def test_pickles_in_archives_of_arrays_are_never_loaded(tmp_path):
    mark = tmp_path / "mark"
    np.savez(tmp_path / "a.npz", key=np.array("k"), text=np.array([Harm(mark)], object))
    with pytest.raises(ValueError, match="allow_pickle=False"):
        read_arrays(tmp_path / "a.npz")
    assert read_record(tmp_path / "a.npz", "k", type(synthetic_scene(size=3, views=3))) is None
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:  # a member that is nothing but a pickle
        archive.writestr("key.npy", pickle.dumps(Harm(mark)))
    with pytest.raises(ValueError, match="no arrays"):
        read_arrays(tmp_path / "b.npz")
    assert not mark.exists()


def hostile(path, change):
    """A scene file to which something was added."""
    write_scene(path, synthetic_scene(size=3, views=3))
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def _huge(file):
    file.create_dataset("huge", (10**12,), "f8", chunks=(10**6,), compression="gzip")


def _elsewhere(file):
    file.create_dataset("elsewhere", (10,), "u1", external=[("/etc/hostname", 0, 10)])


def _foreign_filter(file):
    space, plist = h5py.h5s.create_simple((8,)), h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((8,))
    plist.set_filter(32015, h5py.h5z.FLAG_OPTIONAL)
    h5py.h5d.create(file.id, b"foreign", h5py.h5t.NATIVE_INT32, space, plist)


HOSTILE = {
    "huge array": (_huge, "cannot hold"),
    "values of another file": (_elsewhere, "in another file"),
    "link to another file": (lambda f: f.__setitem__("out", h5py.ExternalLink("/etc/hostname", "/")), "a link to"),
    "link": (lambda f: f.__setitem__("out", h5py.SoftLink("/nothing")), "link to elsewhere"),
    "group within itself": (lambda f: f["views"].__setitem__("again", f), "nested too deeply"),
    "references": (lambda f: f.create_dataset("r", data=f.ref, dtype=h5py.ref_dtype), "objects"),
    "filter of a plugin": (_foreign_filter, "needs the filters"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hdf5_files_that_reach_beyond_themselves_are_refused(tmp_path, name):
    change, said = HOSTILE[name]
    path = hostile(tmp_path / "a.h5", change)
    with pytest.raises(
        RunFolderError, match=rf"a\.h5: is not a scene file, or is damaged \(.*{said}.*\); run the site"
    ):
        read_scene(path)


def test_a_file_that_ends_the_checking_process_is_refused_and_the_next_is_checked(tmp_path, monkeypatch):
    from photoclinometry.io import hdf5

    path = hostile(tmp_path / "a.h5", lambda f: None)
    process = hdf5._checks._started().process
    process.kill()
    process.wait()
    with pytest.raises(InputError, match="crashes on it, or does not end"):
        check_hdf5(path, "scene file", "run again")
    check_hdf5(path, "scene file", "run again")


def test_a_truth_file_with_broken_json_is_refused(tmp_path):
    (sample,) = samples(READERS["truth.h5"], tmp_path / "good", None)
    path = write_files(sample, tmp_path)
    for key, value in (("photometry", '"unended'), ("photometry", "[]"), ("psf_sigma_px", "much")):
        with h5py.File(path, "r+") as file:
            kept = file.attrs[key]
            file.attrs[key] = value
        with pytest.raises(InputError, match=r"a\.h5: cannot be read as a truth file"):
            read_truth(path)
        with h5py.File(path, "r+") as file:
            file.attrs[key] = kept
    with h5py.File(path, "r+") as file:
        file["views/scale"][0] = np.nan
    with pytest.raises(InputError, match=r"a\.h5: scale is not of \(3,\) finite numbers"):
        read_truth(path)


def test_numbers_beyond_doubles_and_arrays_that_disagree_are_refused_in_held_out_views(tmp_path):
    (sample,) = samples(READERS["held_out.json"], tmp_path / "good", None)
    path = write_files(sample, tmp_path)
    content = json.loads(path.read_text())
    for key, value in (("scale", [10**400] * 3), ("scale", [1.0]), ("rotation", [[1.0]]), ("name", [1, 2, 3])):
        path.write_text(json.dumps(content | {key: value}))
        with pytest.raises(RunFolderError, match=r"held_out\.json: is damaged"):
            read_held_out(path)


def test_a_transform_whose_products_overflow_is_refused(tmp_path):
    (tmp_path / "a.toml").write_text(
        "scale = 1\nrotation = [[1e300, 1e300, 0], [0, 1, 0], [0, 0, 1]]\ntranslation = [0, 0, 0]\n"
    )
    with pytest.raises(InputError, match=r"a\.toml: rotation: is not a rotation"):
        read_similarity(tmp_path / "a.toml")


TOO_MUCH = {
    "a key of 100,000 parts": ("a" + ".a" * 100_000 + " = 1", "a key of more than 64 parts"),
    "a table of 100,000 parts": ("[a" + ' . "a"' * 100_000 + "]", "a key of more than 64 parts"),
    "a number of 100,000 digits": ("a = 1" + "0" * 100_000, "more digits than Python reads"),
    "100,000 lists": ("a = " + "[" * 100_000, "nested too deeply"),
}


@pytest.mark.parametrize("name", TOO_MUCH)
def test_toml_that_would_take_minutes_or_cannot_be_held_is_refused_at_once(tmp_path, name):
    text, said = TOO_MUCH[name]
    (tmp_path / "a.toml").write_text(text + "\n")
    begin = time.process_time()
    with pytest.raises(InputError, match=rf"a\.toml: .*{said}"):
        read_toml(tmp_path / "a.toml")
    assert time.process_time() - begin < SECONDS


def test_keys_of_many_parts_are_read(tmp_path):
    (tmp_path / "a.toml").write_text(".".join("abcdefgh" * 8) + " = 1\nb = 'a sentence. Another one. 1.5, 2.5'\n")
    assert read_toml(tmp_path / "a.toml").content["b"] == "a sentence. Another one. 1.5, 2.5"


def test_signalling_nans_of_a_mesh_are_no_warning(tmp_path):
    (tmp_path / "a.ply").write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
        + b"".join(b"property float %s\n" % name for name in (b"x", b"y", b"z", b"nx", b"ny", b"nz"))
        + b"end_header\n"
        + struct.pack("<5f", 1, 2, 3, 0, 0)
        + struct.pack("<I", 0x7F800001)
    )
    assert np.isnan(read_ply(tmp_path / "a.ply").normal[0, 2])


def test_faults_that_other_modules_find_name_the_file(tmp_path):
    (sample,) = samples(READERS["truth.h5"], tmp_path / "truth", None)
    path = write_files(sample, tmp_path)
    with h5py.File(path, "r+") as file:
        file.attrs["photometry"] = file.attrs["photometry"].replace("lunar-lambert", "lunatic")
    with pytest.raises(InputError, match=r"a\.h5: no reflectance model 'lunatic'.*; simulate it again"):
        read_truth(path)
    (sample,) = samples(READERS["text model"], tmp_path / "text", None)
    folder = write_files(sample, tmp_path)
    cameras = (folder / "cameras.txt").read_text().splitlines()
    words = cameras[-1].split()
    (folder / "cameras.txt").write_text("\n".join([*cameras[:-1], " ".join([*words[:2], "1", "1", *words[4:]])]) + "\n")
    with pytest.raises(InputError, match=r"points3D\.txt: .* landmarks lie far outside of the reference image"):
        read_text_model(folder)


def test_numbers_that_no_integer_holds_are_refused_in_obj(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 99999999999999999999\n")
    with pytest.raises(InputError, match=r"a\.obj: is not a complete OBJ file"):
        read_obj(tmp_path / "a.obj")


def test_vectors_whose_length_overflows_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text("image,sun_x,sun_y,sun_z\na.png,1e200,1e200,1e200\n")
    with pytest.raises(InputError, match=r"a\.csv, line 2: the Sun has length 1\.73205e\+200"):
        read_suns(tmp_path / "a.csv")
    write_colmap(tmp_path / "sparse", synthetic_scene(size=3, views=3))
    images = bytearray((tmp_path / "sparse" / "images.bin").read_bytes())
    images[12:20] = struct.pack("<d", 1e200)
    (tmp_path / "sparse" / "images.bin").write_bytes(images)
    with pytest.raises(InputError, match=r"images\.bin: .*no valid pose"):
        read_colmap(tmp_path / "sparse")
    (sample,) = samples(READERS["sumfile"], tmp_path / "sum", None)
    path = write_files(sample, tmp_path)
    path.write_text(path.read_text().replace("1.0000000000E+00", "1.000000000E+200", 1))
    with pytest.raises(InputError, match=r"a\.SUM: .*unit vectors"):
        read_sumfile(path)


def test_a_map_with_letters_of_no_alphabet_is_refused(tmp_path):
    pytest.importorskip("rasterio")
    good = samples(READERS["surface"], tmp_path / "good", None)
    content = good[0].files[good[0].entry]
    assert b"unknown|" in content
    (tmp_path / "a.tif").write_bytes(content.replace(b"unknown|", b"unkn\x90\xe3n|"))
    with pytest.raises(InputError, match=r"a\.tif: cannot be read as a GeoTIFF"):
        read_ground(tmp_path / "a.tif")
