"""Files of archives with a simulated image, of loaded kernels: OCAMS's FITS and PDS4 files, FC's PDS3 labels."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import spiceypy as spice

from photoclinometry.ingest.cameras import camera_named
from stand_in_kernels import Mission

MAPCAM = Mission(
    camera="orex-mapcam",
    filter="PAN",
    spacecraft=-64,
    bus=-64000,
    mount=-64361,
    body=2101955,
    fixed="IAU_BENNU",
    real_time="2019-03-03T10:59:40",
)
FC2 = Mission(
    camera="dawn-fc2",
    filter="1",
    spacecraft=-203,
    bus=-203000,
    mount=-203120,
    body=2000001,
    fixed="CERES_FIXED",
    real_time="2015-06-19T16:15:47",
)
_FITS_BLOCK = 2880
"""FITS headers are padded to multiples of this [bytes]."""
_EXPOSURE_MS = 5.285275
"""A usual exposure of MapCam."""
_FC_EXPOSURE_MS = 100.0
"""Of the clear filter at Ceres."""
_FC_RADIANCE = 0.05
"""Radiance of I/F 1 at Ceres, in the unit of the labels; its size is of no matter."""


def write_ocams_product(folder: Path, time: float, pixels: np.ndarray) -> Path:
    """The PDS4 label of an image by its name, with its FITS file beside it; time: the middle of the exposure."""
    begin = time - 0.5e-3 * _EXPOSURE_MS
    utc = spice.et2utc(begin, "ISOC", 3)
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
    header = _write_fits(folder / f"{stem}.fits", pixels, keywords)
    label = folder / f"{stem}.xml"
    label.write_text(_OCAMS_LABEL.format(stem=stem, utc=utc, clock=clock, header=header, size=len(pixels)))
    return label


def _write_fits(path: Path, pixels: np.ndarray, keywords: dict[str, Any]) -> int:
    """The file, in single precision; returns the length of its header [bytes]."""
    from astropy.io import fits

    hdu = fits.PrimaryHDU(pixels.astype(np.float32))
    hdu.header.update(keywords)
    stream = io.BytesIO()
    hdu.writeto(stream)
    path.write_bytes(stream.getvalue())
    return -(-len(hdu.header.tostring()) // _FITS_BLOCK) * _FITS_BLOCK


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
    header = _write_fits(folder / f"{stem}.FIT", _FC_RADIANCE * pixels, {})
    label = template.replace("\r\n", "\n")
    label = re.sub(r"(?m)^\^(FRAME_\w+|HISTORY) .*\n", "", label)
    label = re.sub(r"(?ms)^OBJECT *= (FRAME_\w+|HISTORY)\n.*?^END_OBJECT *= \1\n", "", label)
    for key, value in {
        "RECORD_BYTES": _FITS_BLOCK,
        "FILE_NAME": f'"{stem}.FIT"',
        "^IMAGE": f'("{stem}.FIT", {header // _FITS_BLOCK + 1})',
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
    }.items():
        label, count = re.subn(rf"(?m)^( *){re.escape(key)}( *)=.*$", rf"\g<1>{key}\g<2>= {value}", label)
        assert count == 1, key
    path = folder / f"{stem}.LBL"
    path.write_text(label, encoding="latin-1")
    return path
