"""Whatever is in a file, reading it ends soon, with an image or with a complaint that names the file."""

import time
import warnings

import numpy as np
import pytest

from archives import geometry_tables, texture, write_cube, write_pds3, write_pds4
from photoclinometry.ingest.exposure import AuxiliaryData, read_exposure
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.io.archives.archive import read_product
from photoclinometry.io.images import write_fits, write_png
from photoclinometry.io.models.sumfile import read_sumfile, sumfile_of_view, write_sumfile
from photoclinometry.io.suns_csv import read_suns
from photoclinometry.model.errors import InputError

TRIALS = 150
SECONDS = 5.0


def make_cube(folder):
    tables = geometry_tables([1, 0, 0, 0], [1, 2, 3], [0, 1, 0, 0], [1, 2, 3], constant=np.eye(3))
    return write_cube(folder / "a.cub", texture(), tile=(20, 30), tables=tables)


def make_sum(folder):
    from photoclinometry.model.camera import Camera
    from photoclinometry.model.geometry import Rigid

    camera = Camera("PINHOLE", 60, 40, (3000.0, 3000.0, 30.5, 19.5))
    pose = Rigid(np.eye(3), np.array([0.0, 0.0, -5.0]))
    write_sumfile(folder / "a.SUM", sumfile_of_view("A", camera, pose, np.array([0, 0, 1.0]), utc="2020 JAN 01"))
    return folder / "a.SUM"


def make_suns(folder):
    (folder / "a.csv").write_text("image,sun_x,sun_y,sun_z,sun_sigma_deg\na.png,0.6,0,-0.8,0.1\nb.png,1,0,0,\n")
    return folder / "a.csv"


def make_fits(folder):
    write_fits(folder / "a.fits", texture())
    return folder / "a.fits"


def make_png(folder):
    write_png(folder / "a.png", (texture() * 1e6).astype(np.uint16))
    return folder / "a.png"


def read_view(path):
    """The whole way to a view, with all that can be asked of a label."""
    return read_exposure(path, IngestOptions(pinhole=(500.0, 500.0, 30.0, 20.0)), AuxiliaryData())


READERS = {
    "cube": (make_cube, read_product),
    "cube to view": (make_cube, read_view),
    "pds3": (lambda f: write_pds3(f / "a.img", texture(), sample_type="PC_REAL"), read_product),
    "pds3 to view": (lambda f: write_pds3(f / "a.img", texture(), sample_type="PC_REAL"), read_view),
    "pds4": (lambda f: write_pds4(f / "a.xml", texture(), data_type="UnsignedMSB2", data=f / "a.dat"), read_product),
    "fits": (make_fits, read_product),
    "png": (make_png, read_product),
    "sumfile": (make_sum, read_sumfile),
    "suns": (make_suns, read_suns),
}


def spoilt(data, rng):
    """The bytes with one kind of damage: cut, overwritten, doubled, or a number or word of the label changed."""
    kind, at = rng.integers(6), int(rng.integers(max(len(data), 1)))
    head = min(len(data), 3000)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + rng.bytes(int(rng.integers(1, 200))) + data[at + 50 :]
    if kind == 2:
        at = int(rng.integers(head))
        return data[:at] + data[at : at + 300] + data[at:]
    if kind == 3:
        digits = [k for k in range(head) if chr(data[k]).isdigit()]
        where = int(rng.choice(digits)) if digits else 0
        number = rng.choice([b"0", b"-1", b"1e9", b"1000000000", b"99999999999999999999", b"nan", b"1e400", b"16#FF#"])
        return data[:where] + bytes(number) + data[where + 1 :]
    at = int(rng.integers(head))
    if kind == 4:
        return (
            data[:at]
            + bytes(rng.choice([b"(", b")", b'"', b"=", b"<", b"/*", b"\xff", b"\0", b"-\n", b"&a;"]))
            + data[at + 1 :]
        )
    return data[:at] + rng.bytes(1) + data[at + 1 :]


@pytest.mark.parametrize("name", READERS)
def test_spoilt_files_are_read_or_refused_by_name(tmp_path, name):
    make, read = READERS[name]
    path = make(tmp_path)
    data = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = []
    for trial in range(TRIALS):
        path.write_bytes(spoilt(data, rng))
        begin = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                read(path)
        except InputError as error:
            refused.append(str(error))
        assert time.perf_counter() - begin < SECONDS, f"trial {trial}"
    assert len(refused) > TRIALS // 20
    assert [message for message in refused if str(path) not in message] == []


def test_random_bytes_are_refused_by_name(tmp_path):
    rng = np.random.default_rng(1)
    heads = [
        b"",
        b"PDS_VERSION_ID = PDS3\n",
        b"Object = IsisCube\n",
        b"<?xml version='1.0'?>",
        b"SIMPLE  =",
        b"\x89PNG\r\n\x1a\n",
    ]
    for head in heads:
        for _ in range(20):
            (tmp_path / "x").write_bytes(head + rng.bytes(int(rng.integers(0, 3000))))
            with pytest.raises(InputError, match=str(tmp_path / "x")):
                read_product(tmp_path / "x")
