"""Labels in one vocabulary: what instruments, bodies, clocks, exposures and units are called in each format."""

from pathlib import Path

import pytest

from photoclinometry.ingest.cameras import known_camera
from photoclinometry.ingest.facts import read_facts, time_of
from photoclinometry.io.archives.product import Product
from photoclinometry.io.archives.pvl import parse_pvl

NOTHING = Path("nothing")


def facts(text, kind="PDS3", path=NOTHING):
    return read_facts(
        Product(path=path, data=path, kind=kind, image=None, label=parse_pvl(text.encode() + b"\nEND\n", "a"))
    )


@pytest.mark.parametrize(
    ("written", "body"),
    [('"1 CERES"', "ceres"), ('"25143 ITOKAWA"', "itokawa"), ('"(433) Eros"', "eros"), ("Bennu", "bennu")],
)
def test_bodies_lose_their_numbers(written, body):
    assert facts(f"TARGET_NAME = {written}").target == body


@pytest.mark.parametrize(
    ("written", "kind", "seconds"),
    [
        ("89.00 <ms>", "PDS3", 0.089),
        ("1800.000 <millisecond>", "PDS3", 1.8),
        (".0218 <SECOND>", "ISIS", 0.0218),
        ("3.224675 <Millisec>", "ISIS", 0.003224675),
        ("12", "PDS3", 0.012),
        ("2.5", "FITS", 2.5),
        ("2.5 <furlong>", "PDS3", None),
        ('"N/A"', "PDS3", None),
    ],
)
def test_exposures_are_seconds(written, kind, seconds):
    assert facts(f"EXPOSURE_DURATION = {written}", kind).exposure_s == (seconds and pytest.approx(seconds))


def test_an_exposure_without_unit_is_that_which_start_and_stop_allow():
    """Rosetta's NavCam: 30.71 is seconds, against PDS3's dictionary."""
    times = "START_TIME = 2005-07-10T06:50:02.557\nSTOP_TIME = 2005-07-10T06:50:33.267\n"
    assert facts(times + "EXPOSURE_DURATION = 30.71").exposure_s == 30.71
    assert facts(times + "EXPOSURE_DURATION = 30710").exposure_s == pytest.approx(30.71)


OCAMS = (
    "HOSTNAME = OREX\nCAMERAID = {}\nFILTNAME = V\nTARGET = BENNU\nEXPTIME = 5.285275\nSCLK_STR = '3/0604882742.23115'"
)


@pytest.mark.parametrize(("number", "camera"), [(0, "orex-mapcam"), (1, "orex-samcam"), (2, "orex-polycam"), (7, None)])
def test_headers_of_ocams_number_their_camera_and_count_milliseconds(number, camera):
    """An exposure taken for seconds would put the image 2.6 s late: 0.06 degrees of Bennu's rotation."""
    said = facts(OCAMS.format(number), "FITS")
    known = known_camera(said)
    assert (known and known.name) == camera
    assert (said.filter, said.target, said.clock) == ("V", "bennu", "3/0604882742.23115")
    assert said.exposure_s == pytest.approx(0.005285275)


ONC = (
    "INSTRUME = 'Optical Navigation Camera'\nSPCECRFT = HAYABUSA2\nNAIFNAME = 'HAYABUSA2_ONC-{}'\n"
    "DATE-BEG = 2018-07-10T06:34:59.100\nDATE-OBS = 2018-07-10T06:34:59.109\nXPOSURE = 0.0174\nTI0 = '0x3C2B565D'\n"
    "S_DISTHS = 147370000.0\n"
)


@pytest.mark.parametrize(("head", "camera"), [("T", "hayabusa2-onc-t"), ("W1", "hayabusa2-onc-w1")])
def test_headers_of_hayabusa2_name_their_camera_as_naif_does(head, camera):
    said = facts(ONC.format(head), "FITS")
    known = known_camera(said)
    assert known is not None
    assert known.name == camera
    assert (said.start, said.exposure_s, said.clock) == ("2018-07-10T06:34:59.100", 0.0174, None)
    assert said.sun_distance_km == 147370000.0


@pytest.mark.parametrize(("count", "clock"), [("2457499394", "2457499394"), ("'0x3C2B565D'", None)])
def test_the_clock_of_amica_s_headers_counts_and_a_hexadecimal_one_does_not(count, clock):
    """AMICA's labels have UTC in whole seconds only; SPICE reads no hexadecimal counts."""
    assert facts(f"TI_0 = {count}\nSTART_TIME = 2005-10-13T19:13:11").clock == clock


def test_a_camera_s_number_of_another_spacecraft_says_nothing():
    assert facts("CAMERAID = 0\nHOSTNAME = VOYAGER", "FITS").instrument is None
    assert facts("CAMERAID = 0\nHOSTNAME = OREX\nINSTRUME = NAVCAM", "FITS").instrument == "NAVCAM"


@pytest.mark.parametrize(
    ("text", "kind", "name", "unit"),
    [
        ("PROCESSING_HISTORY_TEXT = IOF_GBL", "PDS3", "a", "iof"),
        ("BUNIT = 'I/F     '", "FITS", "a", "iof"),
        ("RADIOMETRICTYPE = IOF", "ISIS", "a", "iof"),
        ("UNIT = 'W/m**2/micron/sr'", "PDS3", "a", "radiance"),
        ("UNIT = DU", "PDS3", "a", "dn"),
        ("DATA_SET_ID = 'DAWN-A-FC2-2-EDR-CERES-IMAGES-V1.0'", "PDS3", "a", "dn"),
        ("BUNIT = 'RAW-DN'\nNEAR-013 = 2", "FITS", "a", "iof"),
        ("A = 1", "ISIS", "20190303T100344S990_map_iofL2pan.cub", "iof"),
        ("A = 1", "PDS4", "20190303T100344S990_map_iofL2pan.xml", "iof"),
        ("A = 1", "plain", "ocams20190314t190123s972_map_iofl2pan.png", None),
        ("A = 1", "FITS", "hyb2_onc_20180710_060852_tvf_l2d.fit", "iof"),
        ("A = 1", "FITS", "hyb2_onc_20180710_060852_tvf_l2b.fit", None),
        ("A = 1", "FITS", "a", None),
    ],
)
def test_units_are_what_labels_say(text, kind, name, unit):
    """A PNG is stretched somehow, whatever its name says."""
    assert facts(text, kind, Path(name)).unit == unit


@pytest.mark.parametrize("text", ["LINE_EXPOSURE_DURATION = 0.3 <ms>", "INSTRUMENT_ID = HRSC"])
def test_line_scanners_are_told(text):
    assert facts(text).scanner
    assert not facts("INSTRUMENT_ID = FC2").scanner


def test_bytes_before_each_line_make_no_line_scanner():
    """Images of frame cameras have them, too: Cassini's ISS, Galileo's SSI."""
    image = "OBJECT = IMAGE\nLINE_PREFIX_BYTES = {}\nEND_OBJECT = IMAGE"
    assert not facts("INSTRUMENT_ID = ISSNA\n" + image.format(24)).scanner
    assert not facts(image.format(0)).scanner
    assert facts(image.format(0) + "\nLINE_EXPOSURE_DURATION = 1.88 <ms>").scanner
    assert facts("INSTRUMENT_ID = HRSC\n" + image.format(0)).scanner


def test_distances_are_kilometres_or_astronomical_units():
    assert facts("SPACECRAFT_SOLAR_DISTANCE = 248900000.0").sun_distance_km == 248900000.0
    assert facts("SOLAR_DISTANCE = 1.5").sun_distance_km == pytest.approx(1.5 * 149597870.7)


@pytest.mark.parametrize(
    ("written", "km"),
    [
        ("353123456789.0 <m>", 353123456.789),
        ("353123456.789 <KM>", 353123456.789),
        ("900.5 <km>", 900.5),
        ("0.98865575639954 <AU>", 0.98865575639954 * 149597870.7),
        ("2000.0 <au>", 2000.0 * 149597870.7),
        ("3.5 <furlong>", None),
        ("-3.5e8 <km>", None),
        ("1e16 <m>", None),
    ],
)
def test_a_distance_with_a_unit_is_in_that_unit(written, km):
    """Metres that are taken for kilometres make I/F a million times too large."""
    assert facts(f"SPACECRAFT_SOLAR_DISTANCE = {written}").sun_distance_km == (km and pytest.approx(km, rel=1e-12))


def test_times_are_read_in_three_ways():
    assert (
        time_of("2015-170T16:15:46.345") == time_of("2015-06-19T16:15:46.345Z") == time_of("2015 JUN 19 16:15:46.345")
    )
    assert time_of("soon") is None


def test_silence_is_none():
    said = facts("A = 1")
    assert {said.spacecraft, said.instrument, said.target, said.start, said.exposure_s, said.clock, said.unit} == {None}
