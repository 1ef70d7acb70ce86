"""Files of archives with a simulated image, of loaded kernels: formats, names and keywords are those of the archives.

Each writer is given a folder, the middle of the exposure [s TDB past J2000] and the image in I/F, in the file's order.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import spiceypy as spice

from photoclinometry.ingest.cameras import camera_named
from stand_in_labels import FITS_BLOCK, compact, image_object, statements, utc_of, with_values, write_fits
from stand_in_missions import AMICA, FC2, MAPCAM, MSI, NAC, NAVCAM, ONC_T

_EXPOSURE_MS = 5.285275
"""A usual exposure of MapCam."""
_FC_EXPOSURE_MS = 100.0
"""Of the clear filter at Ceres."""
_FC_RADIANCE = 0.05
"""Radiance of I/F 1 at Ceres, in the unit of the labels; its size is of no matter."""
_AMICA_EXPOSURE_S, _MSI_EXPOSURE_S, _ONC_EXPOSURE_S = 0.0218, 0.089, 0.0174
_NAC_EXPOSURE_S, _NAVCAM_EXPOSURE_S = 0.3, 4.0
"""Usual exposures [s]."""
_AMICA_DN, _NAVCAM_DN = 4000.0, 4000.0
"""Number of the detector for I/F 1; of 12 bits."""
_CUBE_LABEL_BYTES = 65536
"""Offset of the pixels in ISIS's cubes."""
_NAC_RECORD, _NAC_LABEL_RECORDS = 512, 8
"""Record [bytes], and how many the label takes."""


def write_ocams_product(folder: Path, time: float, pixels: np.ndarray) -> Path:
    """The PDS4 label of an image by its name, with its FITS file beside it; time: the middle of the exposure."""
    begin = time - 0.5e-3 * _EXPOSURE_MS
    utc = utc_of(begin)
    stem = utc.replace("-", "").replace(":", "").replace(".", "S") + "_map_iofL2pan"
    clock = spice.sce2s(MAPCAM.spacecraft, begin).strip()
    # The keywords that ISIS reads of OCAMS's files.
    keywords = {
        "MISSION": "OSIRIS-REx",
        "HOSTNAME": "OREX",
        "CAMERAID": 0,
        "FILTNAME": "PAN",
        "TARGET": "BENNU",
        "DATE_OBS": utc,
        "EXPTIME": _EXPOSURE_MS,
        "SCLK_STR": clock,
        "MTR_POS": 270,
        "PCNAIFID": "N/A",
    }
    header = write_fits(folder / f"{stem}.fits", pixels, keywords)
    label = folder / f"{stem}.xml"
    label.write_text(_OCAMS_LABEL.format(stem=stem, utc=utc, clock=clock, header=header, size=len(pixels)))
    return label


_OCAMS_LABEL = """<?xml version="1.0" encoding="UTF-8"?>
<Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1" xmlns:orex="http://pds.nasa.gov/pds4/mission/orex/v1">
  <Identification_Area>
    <logical_identifier>urn:nasa:pds:orex.ocams:data_calibrated:{stem}.fits</logical_identifier>
    <title>Stand-in for an OSIRIS-REx OCAMS image</title>
    <information_model_version>1.7.0.0</information_model_version>
    <product_class>Product_Observational</product_class>
  </Identification_Area>
  <Observation_Area>
    <Time_Coordinates><start_date_time>{utc}Z</start_date_time></Time_Coordinates>
    <Observing_System>
      <name>OSIRIS-REx Camera Suite (OCAMS)</name>
      <Observing_System_Component><name>OSIRIS-REx</name><type>Spacecraft</type></Observing_System_Component>
      <Observing_System_Component><name>OCAMS</name><type>Instrument</type></Observing_System_Component>
    </Observing_System>
    <Target_Identification><name>(101955) Bennu</name><type>Asteroid</type></Target_Identification>
    <Mission_Area>
      <orex:OCAMS_Instrument_Attributes><orex:camera_id>0</orex:camera_id></orex:OCAMS_Instrument_Attributes>
      <orex:Time><orex:spacecraft_clock_start_count>{clock}</orex:spacecraft_clock_start_count></orex:Time>
    </Mission_Area>
  </Observation_Area>
  <File_Area_Observational>
    <File><file_name>{stem}.fits</file_name></File>
    <Header>
      <offset unit="byte">0</offset><object_length unit="byte">{header}</object_length>
      <parsing_standard_id>FITS 3.0</parsing_standard_id>
    </Header>
    <Array_2D_Image>
      <offset unit="byte">{header}</offset>
      <axes>2</axes>
      <axis_index_order>Last Index Fastest</axis_index_order>
      <Element_Array><data_type>IEEE754MSBSingle</data_type></Element_Array>
      <Axis_Array>
        <axis_name>Line</axis_name><elements>{size}</elements><sequence_number>1</sequence_number>
      </Axis_Array>
      <Axis_Array>
        <axis_name>Sample</axis_name><elements>{size}</elements><sequence_number>2</sequence_number>
      </Axis_Array>
    </Array_2D_Image>
  </File_Area_Observational>
</Product_Observational>
"""


def write_fc_product(folder: Path, template: str, time: float, pixels: np.ndarray) -> Path:
    """A real PDS3 label, in which times, sizes and pixels are replaced, with its FITS file of radiance beside it."""
    begin = time - 0.5e-3 * _FC_EXPOSURE_MS
    start, stop = (spice.et2utc(t, "ISOD", 3) for t in (begin, time + 0.5e-3 * _FC_EXPOSURE_MS))
    counted = spice.sce2s(FC2.spacecraft, begin - camera_named(FC2.camera).delay_s)
    stem = f"FC21B0000001_{re.sub('[-T:.]', '', start)[2:13]}F1A"
    header = write_fits(folder / f"{stem}.FIT", _FC_RADIANCE * pixels, {})
    label = template.replace("\r\n", "\n")
    label = re.sub(r"(?m)^\^(FRAME_\w+|HISTORY) .*\n", "", label)
    label = re.sub(r"(?ms)^OBJECT *= (FRAME_\w+|HISTORY)\n.*?^END_OBJECT *= \1\n", "", label)
    values = {
        "RECORD_BYTES": FITS_BLOCK,
        "FILE_NAME": f'"{stem}.FIT"',
        "^IMAGE": f'("{stem}.FIT", {header // FITS_BLOCK + 1})',
        "SPACECRAFT_CLOCK_START_COUNT": f'"{counted.strip().partition("/")[2].replace(".", ":")}"',
        "START_TIME": start,
        "STOP_TIME": stop,
        "FILTER_NUMBER": '"1"',
        "EXPOSURE_DURATION": f"{_FC_EXPOSURE_MS} <millisecond>",
        "LINES": len(pixels),
        "LINE_SAMPLES": len(pixels),
        "SAMPLE_BITS": 32,
        "SAMPLE_TYPE": '"IEEE_REAL"',
        "UNIT": '"W/(m**2 sr nm)"',
    }
    path = folder / f"{stem}.LBL"
    path.write_text(with_values(label, values), encoding="latin-1")
    return path


def write_amica_product(folder: Path, time: float, pixels: np.ndarray) -> Path:
    """The PDS3 label of an image with its FITS file: raw numbers, UTC in whole seconds, the clock in the header.

    Keywords are those that ISIS's amica2isis translates, and those of the labels of AMICA's backplanes.
    """
    begin, end = time - 0.5 * _AMICA_EXPOSURE_S, time + 0.5 * _AMICA_EXPOSURE_S
    first, last = _amica_count(begin), _amica_count(end)
    stem = f"st_{first}_v"
    whole = {"START_V": 0, "LAST_V": 1023, "START_H": 0, "LAST_H": 1023, "BINNING": 1024 // len(pixels)}
    header = write_fits(folder / f"{stem}.fit", _AMICA_DN * pixels, {"TI_0": first, "TI_1": last, **whole})
    label = {
        "PDS_VERSION_ID": "PDS3",
        "RECORD_TYPE": "FIXED_LENGTH",
        "RECORD_BYTES": FITS_BLOCK,
        "^IMAGE": f'("{stem}.fit", {header // FITS_BLOCK + 1})',
        "DATA_SET_ID": '"HAY-A-AMICA-3-HAYAMICA-V1.0"',
        "PRODUCT_NAME": f'"{compact(utc_of(begin))[:8]}:{stem.upper()}.FIT"',
        "INSTRUMENT_HOST_NAME": '"HAYABUSA"',
        "INSTRUMENT_ID": '"AMICA"',
        "TARGET_NAME": '"25143 ITOKAWA"',
        "START_TIME": utc_of(begin).partition(".")[0],
        "STOP_TIME": utc_of(end).partition(".")[0],
        "FILTER_NAME": '"V"',
        "EXPOSURE_DURATION": f"{_AMICA_EXPOSURE_S} <SECOND>",
        "IMAGE": image_object(pixels.astype(np.float32), "IEEE_REAL"),
    }
    path = folder / f"{stem}.lbl"
    path.write_text(statements(label) + "END\r\n")
    return path


def _amica_count(time: float) -> int:
    """The first field of Hayabusa's clock [s / 32]."""
    return int(re.split("[/:]", spice.sce2s(AMICA.spacecraft, time))[1])


def write_amica_cube(folder: Path, template: str, time: float, pixels: np.ndarray) -> Path:
    """A cube of ISIS after spiceinit: a real label, in which times, sizes and tables are replaced.

    Its lines run against those of the FITS file, as amica2isis has them.
    """
    begin = time - 0.5 * _AMICA_EXPOSURE_S
    first = _amica_count(begin)
    core = (_AMICA_DN * pixels[::-1]).astype("<f4").tobytes()
    # Of the tables all are wanted; the history and the original label are left out.
    label = re.sub(r"(?ms)^Object = (History|OriginalLabel)\n.*?^End_Object\n+", "", template)
    label = with_values(
        label,
        {
            "SpacecraftClockStartCount": f"{first} <1/32sec>",
            "StartTime": utc_of(begin).partition(".")[0],
            "ExposureDuration": f"{_AMICA_EXPOSURE_S} <SECOND>",
            "Samples": pixels.shape[1],
            "Lines": pixels.shape[0],
            "TileSamples": pixels.shape[1],
            "TileLines": pixels.shape[0],
        },
    )
    for name, row in _isis_tables(time).items():
        data = np.array(row, "<f8").tobytes()
        place = rf"(Object = Table\n  Name *= {name}\n  StartByte *= )\d+"
        label, count = re.subn(place, rf"\g<1>{_CUBE_LABEL_BYTES + 1 + len(core)}", label)
        assert count == 1, name
        core += data
    path = folder / f"st_{first}_v.cub"
    path.write_bytes(label.encode().ljust(_CUBE_LABEL_BYTES, b"\0") + core)
    return path


def _isis_tables(time: float) -> dict[str, list[float]]:
    """The one row of each table that spiceinit writes, by its name: quaternions and positions [km] in J2000."""
    body, rest = str(AMICA.body), [0.0, 0.0, 0.0, time]
    camera = spice.spkpos(str(AMICA.spacecraft), time, "J2000", "NONE", body)[0]
    sun = spice.spkpos("SUN", time, "J2000", "LT+S", body)[0]
    return {
        "InstrumentPointing": [*spice.m2q(spice.pxform("J2000", spice.frmnam(AMICA.bus), time)), *rest],
        "InstrumentPosition": [*camera, *rest],
        "BodyRotation": [*spice.m2q(spice.pxform("J2000", AMICA.fixed, time)), *rest],
        "SunPosition": [*sun, *rest],
    }


def write_msi_product(folder: Path, label: str, keywords: Mapping[str, Any], time: float, pixels: np.ndarray) -> Path:
    """A real PDS3 label and the keywords of its real FITS file, in which times, pixels and geometry are replaced."""
    begin, end = time - 0.5 * _MSI_EXPOSURE_S, time + 0.5 * _MSI_EXPOSURE_S
    met = _msi_clock(begin)
    stem = f"m0{met[:9]}f4_2p_iof"
    header = write_fits(folder / f"{stem}.fit", pixels, {**keywords, **_msi_geometry(time)})
    values = {
        "^HEADER": f'"{stem.upper()}.FIT"',
        "^IMAGE": f'("{stem.upper()}.FIT", {header // FITS_BLOCK + 1})',
        "START_TIME": utc_of(begin),
        "STOP_TIME": utc_of(end),
        "SPACECRAFT_CLOCK_START_COUNT": met,
        "SPACECRAFT_CLOCK_STOP_COUNT": _msi_clock(end),
        "EXPOSURE_DURATION": f"{1e3 * _MSI_EXPOSURE_S:.2f} <ms>",
    }
    label = re.sub(r"(?ms)^(EMECL_SC_QUATERNION|SUN_SC_POSITION_VECTOR) *=.*?\) *\r?\n", "", label)
    path = folder / f"{stem}.lbl"
    path.write_text(with_values(label.replace("\r\n", "\n"), values))
    return path


def write_msi_deblurred(folder: Path, label: str, keywords: Mapping[str, Any], time: float, pixels: np.ndarray) -> Path:
    """As `write_msi_product`, of a real PDS4 label."""
    begin, end = time - 0.5 * _MSI_EXPOSURE_S, time + 0.5 * _MSI_EXPOSURE_S
    met = _msi_clock(begin)
    stem = f"m0{met[:9]}f4_2p_cif_gbl"
    header = write_fits(folder / f"{stem}.fit", pixels, {**keywords, **_msi_geometry(time)})
    for tag, value in {
        "start_date_time": f"{utc_of(begin)}Z",
        "stop_date_time": f"{utc_of(end)}Z",
        "msn:spacecraft_clock_start": met,
        "msn:spacecraft_clock_stop": _msi_clock(end),
        'img:exposure_duration unit="ms"': 1e3 * _MSI_EXPOSURE_S,
        'object_length unit="byte"': header,
    }.items():
        label, count = re.subn(rf"<{tag}>[^<]*", f"<{tag}>{value}", label)
        assert count == 1, tag
    label = re.sub(r'(<name>FITS Image Array</name>.*?<offset unit="byte">)\d+', rf"\g<1>{header}", label, flags=re.S)
    path = folder / f"{stem}.xml"
    path.write_text(re.sub(r"m\d+f\d_2p_cif_gbl(?=\.fit)", stem, label))
    return path


def _msi_clock(time: float) -> str:
    """Seconds and milliseconds, as NEAR's labels have them; its clock counts milliseconds."""
    count = round(spice.sce2c(MSI.spacecraft, time))
    return f"{count // 1000}.{count % 1000:03d}"


def _msi_geometry(time: float) -> dict[str, Any]:
    """The header's keywords of exposure [ms], attitude J2000 -> spacecraft, and the place from the Sun [km]."""
    attitude = spice.m2q(spice.pxform("J2000", spice.frmnam(MSI.bus), time))
    place = spice.spkpos(str(MSI.spacecraft), time, "J2000", "NONE", "SUN")[0]
    values = (1e3 * _MSI_EXPOSURE_S, *attitude, *place)
    return dict(zip(("NEAR-010", *(f"NEAR-{n:03d}" for n in range(19, 26))), map(float, values), strict=True))


def write_onc_product(folder: Path, time: float, pixels: np.ndarray) -> Path:
    """A FITS file of level 2d: an empty header, and the image as its extension with the keywords of real headers.

    DATE-OBS is the middle of the exposure there.
    """
    begin, end = time - 0.5 * _ONC_EXPOSURE_S, time + 0.5 * _ONC_EXPOSURE_S
    count = round(spice.sce2c(ONC_T.spacecraft, begin))
    keywords = {
        "EXTNAME": "ONC-LEVEL2d",
        "DATE-BEG": utc_of(begin),
        "DATE-OBS": utc_of(time),
        "DATE-END": utc_of(end),
        "TELESCOP": "HAYABUSA2",
        "SPCECRFT": "HAYABUSA2",
        "INSTRUME": "Optical Navigation Camera",
        "OBJECT": "RYUGU",
        "NAIFNAME": ONC_T.frame,
        "NAIFID": ONC_T.code,
        "XPOSURE": _ONC_EXPOSURE_S,
        "TI0": f"0x{count:08X}",
        "NPIXBIN": 1024 // len(pixels),
        "SCCL-BEG": f"1/{count}",
        "DISTCR": "T",
        "RADCONV": "T",
        "S_DISTHS": float(np.linalg.norm(spice.spkpos(str(ONC_T.spacecraft), time, "J2000", "NONE", "SUN")[0])),
    }
    path = folder / f"hyb2_onc_{compact(utc_of(begin)).replace('T', '_')}_tvf_l2d.fit"
    write_fits(path, pixels, keywords, extension=True)
    return path


def write_nac_product(folder: Path, time: float, pixels: np.ndarray) -> Path:
    """An image of level 4 with its PDS3 label attached: reflectances, whose lines the label displays upwards.

    Keywords are those that ISIS's rososiris2isis translates.
    """
    begin, end = time - 0.5 * _NAC_EXPOSURE_S, time + 0.5 * _NAC_EXPOSURE_S
    stored = pixels[::-1].astype("<f4")
    utc = utc_of(begin)
    label = {
        "PDS_VERSION_ID": "PDS3",
        "RECORD_TYPE": "FIXED_LENGTH",
        "RECORD_BYTES": _NAC_RECORD,
        "LABEL_RECORDS": _NAC_LABEL_RECORDS,
        "^IMAGE": _NAC_LABEL_RECORDS + 1,
        "DATA_SET_ID": '"RO-C-OSINAC-4-PRL-67P-M07-REFL-V1.0"',
        "PROCESSING_LEVEL_ID": '"4"',
        "MISSION_ID": '"ROSETTA"',
        "INSTRUMENT_HOST_NAME": '"ROSETTA-ORBITER"',
        "INSTRUMENT_ID": '"OSINAC"',
        "TARGET_NAME": '"67P/CHURYUMOV-GERASIMENKO 1 (1969 R1)"',
        "START_TIME": utc,
        "STOP_TIME": utc_of(end),
        "SPACECRAFT_CLOCK_START_COUNT": f'"{spice.sce2s(NAC.spacecraft, begin)}"',
        "SPACECRAFT_CLOCK_STOP_COUNT": f'"{spice.sce2s(NAC.spacecraft, end)}"',
        "SAMPLE_DISPLAY_DIRECTION": "RIGHT",
        "LINE_DISPLAY_DIRECTION": "UP",
        "GROUP SR_MECHANISM_STATUS": {"FILTER_NUMBER": '"22"', "FILTER_NAME": '"FFP-Vis_Orange"'},
        "GROUP SR_ACQUIRE_OPTIONS": {"EXPOSURE_DURATION": f"{_NAC_EXPOSURE_S} <s>"},
        "GROUP SR_COMPRESSION": {"PIXEL_AVERAGING_WIDTH": 2048 // len(pixels)},
        "IMAGE": image_object(stored, "PC_REAL", FIRST_LINE=1, FIRST_LINE_SAMPLE=1),
    }
    path = folder / f"N{compact(utc)}{utc[-3:]}ID40F22.IMG"
    text = (statements(label) + "END\r\n").encode()
    path.write_bytes(text.ljust(_NAC_RECORD * _NAC_LABEL_RECORDS) + stored.tobytes())
    return path


def write_navcam_product(folder: Path, time: float, pixels: np.ndarray) -> Path:
    """A raw image with its PDS3 label; the label counts the exposure in seconds, without saying so."""
    begin, end = time - 0.5 * _NAVCAM_EXPOSURE_S, time + 0.5 * _NAVCAM_EXPOSURE_S
    stored = np.clip(np.rint(_NAVCAM_DN * pixels), 0, _NAVCAM_DN).astype("<u2")
    stem = f"ROS_CAM1_{compact(utc_of(time))}"
    label = {
        "PDS_VERSION_ID": "PDS3",
        "RECORD_TYPE": "FIXED_LENGTH",
        "RECORD_BYTES": stored[0].nbytes,
        "FILE_RECORDS": len(stored),
        "^IMAGE": f'("{stem}.IMG",1)',
        "DATA_SET_ID": '"RO-C-NAVCAM-2-PRL-MTP007-V1.0"',
        "PRODUCT_ID": f'"{stem}"',
        "IMAGE_TIME": utc_of(time),
        "START_TIME": utc_of(begin),
        "STOP_TIME": utc_of(end),
        "SPACECRAFT_CLOCK_START_COUNT": f'"{spice.sce2s(NAVCAM.spacecraft, begin)}"',
        "SPACECRAFT_CLOCK_STOP_COUNT": f'"{spice.sce2s(NAVCAM.spacecraft, end)}"',
        "INSTRUMENT_HOST_NAME": '"ROSETTA-ORBITER"',
        "TARGET_NAME": '"67P/CHURYUMOV-GERASIMENKO 1 (1969 R1)"',
        "INSTRUMENT_ID": "NAVCAM",
        "CHANNEL_ID": '"CAM1"',
        "EXPOSURE_DURATION": f"{_NAVCAM_EXPOSURE_S:.2f}",
        "IMAGE": image_object(stored, "LSB_UNSIGNED_INTEGER"),
    }
    (folder / f"{stem}.IMG").write_bytes(stored.tobytes())
    path = folder / f"{stem}.LBL"
    path.write_text(statements(label) + "END\r\n")
    return path
