"""Small made-up files in the formats of archives, exactly known, for reading and for spoiling."""

from pathlib import Path

import numpy as np
import pytest

from photoclinometry.io.images import write_png
from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, so3_exp, unit

SHARED = Path(__file__).parents[2] / "shared" / "data"
FORMATS = SHARED / "formats"
SPICE = SHARED / "spice"

needs_formats = pytest.mark.skipif(not FORMATS.is_dir(), reason="no ../shared/data/formats beside the repository")
needs_spice = pytest.mark.skipif(not SPICE.is_dir(), reason="no ../shared/data/spice beside the repository")


def texture(shape=(40, 60), seed=0):
    """Smooth random brightness between 0.02 and 0.06, float32."""
    from scipy.ndimage import gaussian_filter

    field = gaussian_filter(np.random.default_rng(seed).normal(size=shape), 1.5)
    return (0.04 + 0.02 * field / np.abs(field).max()).astype(np.float32)


def table_bytes(columns):
    """(label text, bytes) of an ISIS table of doubles; columns: name -> numbers."""
    fields = "".join(
        f"  Group = Field\n    Name = {n}\n    Type = Double\n    Size = 1\n  End_Group\n" for n in columns
    )
    rows = np.stack([np.asarray(v, float) for v in columns.values()], -1)
    return fields, rows.astype("<f8").tobytes(), len(rows)


def geometry_tables(pointing, position, rotation, sun, constant=None):
    """ISIS's four tables by name: quaternions J2000 -> frame, vectors in J2000 [km]; (columns, extra label text)."""
    quaternion = [f"J2000Q{k}" for k in range(4)]
    vector = ["J2000X", "J2000Y", "J2000Z"]

    def columns(keys, values):
        return {key: [value] for key, value in zip(keys, values, strict=True)}

    turn = (
        "" if constant is None else f"  ConstantRotation = ({', '.join(repr(float(v)) for v in np.ravel(constant))})\n"
    )
    return {
        "InstrumentPointing": (columns(quaternion, pointing), turn),
        "InstrumentPosition": (columns(vector, position), ""),
        "BodyRotation": (columns(quaternion, rotation), ""),
        "SunPosition": (columns(vector, sun), ""),
    }


def write_cube(
    path, pixels, *, kind="Real", order="Lsb", base=0.0, multiplier=1.0, tile=None, groups="", keywords="", tables=None
):
    """An ISIS cube of `pixels` (lines, samples) of the stored type; groups, keywords: more text for the label."""
    start = 65537
    raw = pixels.astype(pixels.dtype.newbyteorder(">" if order == "Msb" else "<"))
    if tile is not None:
        height, width = tile
        padded = np.zeros((-(-raw.shape[0] // height) * height, -(-raw.shape[1] // width) * width), raw.dtype)
        padded[: raw.shape[0], : raw.shape[1]] = raw
        raw = padded.reshape(-1, height, padded.shape[1] // width, width).transpose(0, 2, 1, 3)
    body = raw.tobytes()
    layout = "BandSequential" if tile is None else f"Tile\n    TileSamples = {tile[1]}\n    TileLines = {tile[0]}"
    described = ""
    for name, (columns, extra) in (tables or {}).items():
        fields, data, records = table_bytes(columns)
        described += (
            f"Object = Table\n  Name = {name}\n  StartByte = {start + len(body)}\n  Bytes = {len(data)}\n"
            f"  Records = {records}\n  ByteOrder = Lsb\n{extra}{fields}End_Object\n"
        )
        body += data
    lines, samples = pixels.shape
    label = (
        f"Object = IsisCube\n  Object = Core\n    StartByte = {start}\n    Format = {layout}\n"
        f"    Group = Dimensions\n      Samples = {samples}\n      Lines = {lines}\n      Bands = 1\n    End_Group\n"
        f"    Group = Pixels\n      Type = {kind}\n      ByteOrder = {order}\n      Base = {base}\n"
        f"      Multiplier = {multiplier}\n    End_Group\n  End_Object\n{groups}End_Object\n"
        f"{described}Object = NaifKeywords\n{keywords}End_Object\nEnd\n"
    )
    path.write_bytes(label.encode().ljust(start - 1, b"\0") + body)
    return path


def write_pds3(path, pixels, *, sample_type, extra="", top="", detached=None):
    """A PDS3 image; attached, or with its pixels in the file `detached`."""
    lines, samples = pixels.shape
    record = 512
    pointer = f'("{detached.name}", 1 <BYTES>)' if detached else "9"
    label = (
        f"PDS_VERSION_ID = PDS3\r\nRECORD_TYPE = FIXED_LENGTH\r\nRECORD_BYTES = {record}\r\n^IMAGE = {pointer}\r\n{top}"
        f"OBJECT = IMAGE\r\n  LINES = {lines}\r\n  LINE_SAMPLES = {samples}\r\n"
        f"  SAMPLE_BITS = {8 * pixels.dtype.itemsize}\r\n  SAMPLE_TYPE = {sample_type}\r\n{extra}"
        "END_OBJECT = IMAGE\r\nEND\r\n"
    ).encode()
    if detached:
        path.write_bytes(label)
        detached.write_bytes(pixels.tobytes())
    else:
        assert len(label) <= 8 * record
        path.write_bytes(label.ljust(8 * record) + pixels.tobytes())
    return path


def write_pds4(path, pixels, *, data_type, data, extra="", special=""):
    """A PDS4 label and its file of raw pixels."""
    lines, samples = pixels.shape
    path.write_text(
        f"""<?xml version="1.0" encoding="UTF-8"?>
<Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1"><Observation_Area>{extra}</Observation_Area>
<File_Area_Observational><File><file_name>{data.name}</file_name></File>
<Array_2D_Image><offset unit="byte">16</offset><axes>2</axes><axis_index_order>Last Index Fastest</axis_index_order>
<Element_Array><data_type>{data_type}</data_type><scaling_factor>0.5</scaling_factor><value_offset>3</value_offset>
</Element_Array>
<Axis_Array><axis_name>Line</axis_name><elements>{lines}</elements><sequence_number>1</sequence_number></Axis_Array>
<Axis_Array><axis_name>Sample</axis_name><elements>{samples}</elements><sequence_number>2</sequence_number></Axis_Array>
{special}</Array_2D_Image></File_Area_Observational></Product_Observational>
"""
    )
    data.write_bytes(b"\0" * 16 + pixels.tobytes())
    return path


CAMERA = Camera("PINHOLE", 60, 40, (3000.0, 3000.0, 30.5, 19.5))
POSE = Rigid(so3_exp(np.array([0.2, -0.1, 0.4])), np.array([1.0, -2.0, -8.0]))
SUN = unit(np.array([1.0, -0.5, 0.3]))


def plain_images(folder, count=3):
    """16-bit PNG files of `texture`, named after a time."""
    folder.mkdir(exist_ok=True)
    paths = []
    for k in range(count):
        paths.append(folder / f"2019030{k + 1}T101500.png")
        write_png(paths[-1], (texture(seed=k) * 1e6).astype(np.uint16))
    return paths


def suns_of(folder, paths, sigma=""):
    """A table with the same Sun for every image."""
    table = folder / "suns.csv"
    rows = "".join(f"{p.name},{0.6},{0.0},{-0.8},{sigma}\n" for p in paths)
    table.write_text("image,sun_x,sun_y,sun_z,sun_sigma_deg\n" + rows)
    return table


MAPCAM = """Group = Instrument
  SpacecraftName = OSIRIS-REX
  InstrumentId = MapCam
  TargetName = Bennu
End_Group
Group = BandBin
  FilterName = PAN
End_Group
Group = Kernels
  NaifFrameCode = -64361
End_Group
"""


def mapcam_cube(path, **changes):
    """A cube of MapCam, 5 km from the body's centre, under a Sun of 10^8 km."""
    tables = geometry_tables([1, 0, 0, 0], [0.0, 0.0, -5.0], [1, 0, 0, 0], [0.6e8, 0.0, -0.8e8])
    return write_cube(path, **({"pixels": texture((1024, 1024)), "groups": MAPCAM, "tables": tables} | changes))
