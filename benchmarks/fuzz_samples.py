"""Every reader of files, with good files to spoil: made here by the writers of the package and of its tests, and real
ones from a folder, as far as it holds them.

glTF is written and never read, so it has no reader here.
"""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from archives import geometry_tables, texture, write_cube, write_pds3, write_pds4
from photoclinometry.io.images import write_fits, write_png
from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.owner import Owner
from scenes import synthetic_scene
from sites import write_small_site

_LARGEST = 1_000_000
"""Real files above this size [bytes] are left out: they cost time and hold nothing that smaller ones lack."""

_NO_PROCESS = 2**30
"""A number that no system gives to a process."""


@dataclass(frozen=True)
class Sample:
    """The files of one good input, by their place in its folder."""

    entry: str
    """The file or folder that the reader is given."""
    files: dict[str, bytes]
    spoiled: tuple[str, ...] = ()
    """The files that are spoiled; all if empty."""


@dataclass(frozen=True, kw_only=True)
class Reader:
    """One reader: what it is called with, its good files, and how much of a round it gets."""

    read: Callable[[Path], Any]
    make: Callable[[Path], Sequence[str]]
    """Writes good files into an empty folder; the entries to read."""
    real: tuple[str, ...] = ()
    """Patterns of real files below the folder of samples; each is an input of its own."""
    beside: tuple[str, ...] = ()
    """Patterns of files beside a real one that belong to it and stay whole."""
    alone: bool = False
    """Each entry made has a file of its own; otherwise all of the folder belongs to each entry."""
    share: float = 1.0
    """Files of this reader over files of others."""


def samples(reader: Reader, folder: Path, data: Path | None) -> list[Sample]:
    """The good files of a reader. folder: an empty one to make them in; data: that of the real samples."""
    folder.mkdir(parents=True)
    entries = reader.make(folder)
    whole = {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
    found = [Sample(entry, {entry: whole[entry]} if reader.alone else whole) for entry in entries]
    for pattern in reader.real if data is not None else ():
        for path in sorted(data.glob(pattern)):
            if path.is_file() and path.stat().st_size <= _LARGEST:
                others = {p.name: p.read_bytes() for b in reader.beside for p in path.parent.glob(path.stem + b)}
                found.append(Sample(path.name, others | {path.name: path.read_bytes()}, (path.name,)))
    return found


def make_images(folder: Path) -> list[str]:
    import cv2
    from astropy.io import fits

    picture = texture()
    whole = (picture * 1e6).astype(np.uint16)
    write_fits(folder / "float.fits", picture)
    hdu = fits.PrimaryHDU(whole.astype(np.int16))
    hdu.header["BLANK"], hdu.header["SATURATE"], hdu.header["DATAMAX"] = -5, 60000.0, 59000.0
    hdu.writeto(folder / "integer.fits")
    hdus = fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(picture[None])])
    hdus.writeto(folder / "extension.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(whole)]).writeto(folder / "packed.fits")
    write_png(folder / "grey16.png", whole)
    write_png(folder / "grey8.png", (whole >> 8).astype(np.uint8))
    write_png(folder / "colour.png", np.repeat((whole >> 8).astype(np.uint8)[..., None], 3, -1))
    for name, values, kind in (
        ("plain", whole, 1),
        ("lzw", whole, 5),
        ("deflate", picture, 8),
        ("packbits", whole, 32773),
    ):
        cv2.imwrite(str(folder / f"{name}.tiff"), values, [cv2.IMWRITE_TIFF_COMPRESSION, kind])
    return sorted(p.name for p in folder.iterdir())


def make_cubes(folder: Path) -> list[str]:
    tables = geometry_tables([1, 0, 0, 0], [0, 0, -5], [1, 0, 0, 0], [0.6e8, 0, -0.8e8], constant=np.eye(3))
    write_cube(folder / "tiled.cub", texture(), tile=(20, 30), tables=tables, keywords="  A = 1\n")
    write_cube(folder / "lines.cub", (texture() * 1e5).astype(np.int16), kind="SignedWord", order="Msb", tables=tables)
    return ["tiled.cub", "lines.cub"]


def make_pds3(folder: Path) -> list[str]:
    write_pds3(folder / "real.img", texture(), sample_type="PC_REAL")
    extra = "  INVALID_CONSTANT = 16#FFFF#\r\n  SCALING_FACTOR = 0.5\r\n  OFFSET = 3\r\n  LINE_PREFIX_BYTES = 0\r\n"
    whole = (texture() * 1e6).astype(">u2")
    write_pds3(
        folder / "whole.lbl", whole, sample_type="MSB_UNSIGNED_INTEGER", extra=extra, detached=folder / "whole.dat"
    )
    return ["real.img", "whole.lbl"]


def make_pds4(folder: Path) -> list[str]:
    write_pds4(folder / "a.xml", (texture() * 1e6).astype(">u2"), data_type="UnsignedMSB2", data=folder / "a.dat")
    return ["a.xml"]


def make_labels(folder: Path) -> list[str]:
    text = make_cubes(folder)[0]
    (folder / "label.pvl").write_bytes((folder / text).read_bytes()[:4000].rstrip(b"\0"))
    nested = "".join(f"OBJECT = A{k}\n X = (1, (2, {{3 <km>, 'a b'}}), \"c\")\n" for k in range(6))
    (folder / "nested.pvl").write_text(nested + "END_OBJECT\n" * 6 + "/* END */ END\n")
    return ["label.pvl", "nested.pvl"]


def make_sites(folder: Path) -> list[str]:
    path = write_small_site(folder)
    for image in (folder / "images").iterdir():
        image.unlink()
    (folder / "images").rmdir()
    prior = "cam_from_body = { rotation_wxyz = [1, 0, 0, 0], translation = [0, 0, 9.5], sigma_deg = 0.1, sigma = 1 }\n"
    (folder / "full.toml").write_text(path.read_text().replace("[camera]", "[cameras.wide]") + prior)
    return ["site.toml", "full.toml"]


def make_meshes(folder: Path) -> list[str]:
    from photoclinometry.io.meshes.ply import write_ply
    from photoclinometry.model.mesh import landmark_faces

    scene = synthetic_scene(size=3, views=3)
    write_ply(folder / "points.ply", scene)
    write_ply(folder / "mesh.ply", scene, mesh=True)
    head = "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 2\nproperty list uchar int vertex_indices\nproperty uchar flag\nend_header\n"
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]])
    rows = "".join(" ".join(map(str, row)) + "\n" for row in corners) + "3 0 1 2 7\n4 0 1 2 3 9\n"
    (folder / "text.ply").write_text(head.format("ascii") + rows)
    big = corners.astype(">f4").tobytes() + b"\3" + np.array([0, 1, 2], ">i4").tobytes() + b"\7"
    big += b"\4" + np.array([0, 1, 2, 3], ">i4").tobytes() + b"\x09"
    (folder / "big.ply").write_bytes(head.format("binary_big_endian").encode() + big)
    assert len(landmark_faces(scene))
    return ["points.ply", "mesh.ply", "text.ply", "big.ply"]


def make_shape(folder: Path) -> list[str]:
    from photoclinometry.io.meshes.shape_ply import write_shape_ply
    from photoclinometry.model.shape_model import ShapeModel
    from photoclinometry.surface.closed_mesh import icosahedron

    vertices, faces = icosahedron()
    ones = np.ones(len(vertices))
    sigma = {"height": 0.1 * ones, "normal": 0.02 * ones, "albedo": 0.03 * ones}
    counts = np.arange(len(vertices))
    write_shape_ply(
        folder / "a.ply", ShapeModel(vertices, faces, vertices, 0.04 * ones, sigma, counts, counts - 1, "m")
    )
    write_shape_ply(folder / "b.ply", ShapeModel(vertices, faces))
    return ["a.ply", "b.ply"]


def make_icq(folder: Path) -> list[str]:
    from photoclinometry.io.models.icq import icq_directions, write_icq

    write_icq(folder / "SHAPE.TXT", 0.25 * icq_directions(3))
    return ["SHAPE.TXT"]


def make_obj(folder: Path) -> list[str]:
    from photoclinometry.io.meshes.obj import write_obj

    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    write_obj(folder / "a.obj", corners, faces, normal=np.tile([0.0, 0, 1], (4, 1)))
    (folder / "b.obj").write_text("o x\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1 4/1\nf -1 -2 -3\n")
    return ["a.obj", "b.obj"]


def make_scene(folder: Path) -> list[str]:
    from photoclinometry.io.scene_file import write_scene

    write_scene(folder / "a.h5", synthetic_scene(size=3, views=3))
    return ["a.h5"]


def make_truth(folder: Path) -> list[str]:
    from photoclinometry.model.reflectance import published
    from photoclinometry.simulate.surface import Surface
    from photoclinometry.simulate.truth import Truth
    from photoclinometry.simulate.truth_file import write_truth

    surface = Surface(texture((8, 8)), 0.2 + texture((8, 8)), 1.0, (-4.0, -4.0))
    about = {"psf_sigma_px": 0.5, "brightness": "iof", "photometry": published("lunar-lambert", "vesta")}
    write_truth(
        folder / "a.h5",
        Truth(name="a", body="vesta", surface=surface, views=synthetic_scene(size=3, views=3).views, **about),
    )
    return ["a.h5"]


def make_body_truth(folder: Path) -> list[str]:
    from photoclinometry.model.reflectance import published
    from photoclinometry.simulate.bodies.surface import BodySurface
    from photoclinometry.simulate.bodies.truth import BodyTruth, write_body_truth
    from photoclinometry.surface.closed_mesh import icosahedron

    vertices, faces = icosahedron()
    truth = BodyTruth(
        name="a",
        body="vesta",
        views=synthetic_scene(size=3, views=3).views,
        psf_sigma_px=0.5,
        brightness="iof",
        photometry=published("lunar-lambert", "vesta"),
        surface=BodySurface(vertices, faces, vertices, np.full(len(vertices), 0.2), 1.0),
        gsd=1.0,
    )
    write_body_truth(folder / "a.h5", truth)
    return ["a.h5"]


def make_colmap(folder: Path) -> list[str]:
    from photoclinometry.io.models.colmap import write_colmap

    write_colmap(folder / "sparse", synthetic_scene(size=3, views=3))
    return ["sparse"]


def make_text_model(folder: Path) -> list[str]:
    from photoclinometry.io.models.text_model import write_text_model

    write_text_model(folder / "model", synthetic_scene(size=3, views=3))
    return ["model"]


def make_sumfile(folder: Path) -> list[str]:
    from photoclinometry.io.models.sumfile import sumfile_of_view, write_sumfile

    camera = Camera("PINHOLE", 60, 40, (3000.0, 3000.0, 30.5, 19.5))
    pose = Rigid(np.eye(3), np.array([0.0, 0.0, -5.0]))
    write_sumfile(folder / "a.SUM", sumfile_of_view("A", camera, pose, np.array([0, 0, 1.0]), utc="2020 JAN 01"))
    return ["a.SUM"]


def make_suns(folder: Path) -> list[str]:
    rows = 'image,sun_x,sun_y,sun_z,sun_sigma_deg\na.png,0.6,0,-0.8,0.1\nb.png,1,0,0,\n"c,d.png",0,0,-1,2\n'
    (folder / "a.csv").write_text(rows)
    return ["a.csv"]


def make_control(folder: Path) -> list[str]:
    rows = "point,view,x_px,y_px,x_m,y_m,z_m,sigma_m,sigma_px\na,0.fits,1.5,2,3,4,5,0.1,\na,1.fits,7,8,3,4,5,0.1,2\n"
    (folder / "a.csv").write_text(rows)
    (folder / "b.csv").write_text(
        "point,view,x_px,y_px,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m\na,v,1,2,3,4,5,1,2,3\n"
    )
    return ["a.csv", "b.csv"]


def make_dtm(folder: Path) -> list[str]:
    import rasterio

    place = rasterio.Affine(10.0, 0.0, -30.0, 0.0, -20.0, 40.0)
    about = {"driver": "GTiff", "count": 1, "height": 16, "width": 16, "dtype": "float32", "transform": place}
    crs = "+proj=stere +lat_0=10 +lon_0=20 +a=285000 +b=229000 +units=m"
    options = {
        "plain": {},
        "packed": {"compress": "deflate", "predictor": 2},
        "tiles": {"tiled": True, "blockxsize": 16, "blockysize": 16},
    }
    for name, more in options.items():
        kind = {"dtype": "int16"} if name == "packed" else {}
        with rasterio.open(folder / f"{name}.tif", "w", crs=crs, nodata=-9.0, **(about | kind | more)) as file:
            file.write((texture((16, 16)) * 1000).astype((about | kind)["dtype"]), 1)
            file.scales, file.offsets = (0.5,), (100.0,)
    return [f"{name}.tif" for name in options]


def make_held_out(folder: Path) -> list[str]:
    from photoclinometry.io.held_out import write_held_out

    write_held_out(folder / "held_out.json", synthetic_scene(size=3, views=3).views)
    return ["held_out.json"]


def make_similarity(folder: Path) -> list[str]:
    from photoclinometry.io.similarity import write_similarity
    from photoclinometry.model.geometry import Similarity

    write_similarity(folder / "a.toml", Similarity(2.0, np.eye(3), np.arange(3.0)))
    return ["a.toml"]


def make_record(folder: Path) -> list[str]:
    from photoclinometry.pipeline.folder.records import write_record

    write_record(folder / "a.npz", "key", synthetic_scene(size=3, views=3))
    return ["a.npz"]


def make_plan_table(folder: Path) -> list[str]:
    head = "view,x_m,y_m,z_m,sun_x,sun_y,sun_z,focal_px,width_px,height_px"
    (folder / "plain.csv").write_text(
        f"{head}\na,0,0,9000,0.6,0,0.8,2000,160,120\nb,90,0,9000,0,0.6,0.8,2000,160,120\n"
    )
    more = "target_x_m,target_y_m,target_z_m,center_sigma_m,rotation_sigma_deg,sun_sigma_deg"
    (folder / "target.csv").write_text(f"{head},{more}\na,0,0,9000,0.6,0,0.8,2000,160,120,1,2,1000,5,0.01,0.1\n")
    (folder / "attitude.csv").write_text(f"{head},qw,qx,qy,qz\na,0,0,9000,0.6,0,0.8,2000,160,120,0,1,0,0\n")
    return ["plain.csv", "target.csv", "attitude.csv"]


def make_config(folder: Path) -> list[str]:
    from photoclinometry.io.options import write_options
    from photoclinometry.pipeline.options import RunOptions

    (folder / "run").mkdir()
    write_options(folder / "run" / "config.toml", {"site": "a/site.toml", "options": asdict(RunOptions())})
    return ["run"]


def make_metrics(folder: Path) -> list[str]:
    from photoclinometry.io.json_file import write_json

    warned = [{"code": "view-blurred", "view": "a.fits", "words": "a.fits is less sharp"}]
    metrics = {"psnr_mean_db": 41.5, "normal_error_mean_deg": 0.9, "normal_error_rms_deg": 1.1, "views": 4, "x": None}
    (folder / "run").mkdir()
    write_json(
        folder / "run" / "metrics.json", {"metrics": metrics, "warnings": warned, "not_trusted_because": ["Suns"]}
    )
    return ["run"]


def owner() -> Owner:
    """The site of the run folders and exports whose files are spoiled."""
    return Owner(kind="site", name="place", body="vesta", place="a/site.toml", images=("1234", "5678"))


def make_mark(folder: Path) -> list[str]:
    from photoclinometry.pipeline.folder.run_mark import write_mark

    (folder / "run").mkdir()
    write_mark(folder / "run", owner())
    return ["run"]


def make_lock(folder: Path) -> list[str]:
    from photoclinometry.io.json_file import write_json
    from photoclinometry.pipeline.folder.run_lock import NAME, Holder

    (folder / "run").mkdir()
    holder = Holder(_NO_PROCESS, socket.gethostname(), "2026-01-02T03:04:05Z", "123456")
    write_json(folder / "run" / NAME, asdict(holder) | {"token": "0123abcd"})
    return ["run"]


def make_manifest(folder: Path) -> list[str]:
    from photoclinometry.output.export import ExportOptions, export_scene

    export_scene(synthetic_scene(size=3, views=3), folder, ExportOptions(products=("csv",)))
    return ["export.json"]


def study_cell() -> Any:
    """The cell of the study whose record is spoiled."""
    from photoclinometry.simulate.options import SimulationOptions
    from photoclinometry.study.plan import Cell

    return Cell(surface="matched", simulation=SimulationOptions(), model="akimov", hold_out=())


def make_study_record(folder: Path) -> list[str]:
    from photoclinometry.study.record import Record, write_record

    arrays = {name: np.linspace(0.0, 1.0, 12).reshape(3, 4) for name in ("height", "true_height")}
    arrays |= {"spacing": np.array(2.0), "scale": np.ones(3), "phase": np.ones(3)}
    write_record(folder / "cell", Record(study_cell(), {"normal_error_mean_deg": 0.9}, arrays), "key")
    return ["cell"]


def make_masked_site(folder: Path) -> list[str]:
    path = write_small_site(folder)
    for image in (folder / "images").iterdir():
        image.unlink()
    (folder / "images").rmdir()
    for name in ("dust", "limb"):
        mask = np.full((64, 64), 255, np.uint8)
        mask[:9] = 0
        write_png(folder / f"{name}.png", mask)
    text = path.read_text().replace("[region]", 'mask = "dust.png"\nborder_px = [1, 2, 3, 4]\n\n[region]')
    path.write_text(text + 'mask = ["limb.png"]\nborder_px = [0, 0, 0, 9]\n')
    return ["site.toml"]


def make_kernels(folder: Path) -> list[str]:
    (folder / "a.tpc").write_text("KPL/PCK\n\\begindata\nBODY2101955_RADII = ( 1.0 2.0 @2019-MAR-01 )\n\\begintext\n")
    (folder / "m.tm").write_text(
        "KPL/MK\n\\begindata\nPATH_VALUES = ( '.' )\nPATH_SYMBOLS = ( 'K' )\n"
        "KERNELS_TO_LOAD = ( '$K/a.tpc' )\n\\begintext\n"
    )
    return ["a.tpc", "m.tm"]
