"""The missions for which `stand_ins.py` makes files, with their names in SPICE.

Of NEAR, Hayabusa2 and Rosetta no kernels are at hand: `definitions` has names, numbers and angles of the public ones.
"""

from __future__ import annotations

from collections.abc import Sequence

from stand_in_kernels import Elements, Mission

_BEGIN = "\\begindata\n"


def _list(values: Sequence[object]) -> str:
    return f"( {' '.join(str(v) for v in values)} )"


def _frame(name: str, code: int, kind: int, center: int) -> str:
    """Statements of all frames; kind: SPICE's class of the frame."""
    return (
        f"FRAME_{name} = {code}\nFRAME_{code}_NAME = '{name}'\nFRAME_{code}_CLASS = {kind}\n"
        f"FRAME_{code}_CLASS_ID = {code}\nFRAME_{code}_CENTER = {center}\n"
    )


def _attitude_frame(name: str, code: int, spacecraft: int) -> str:
    """A frame by kernels of attitudes."""
    return f"{_frame(name, code, 3, spacecraft)}CK_{code}_SCLK = {spacecraft}\nCK_{code}_SPK = {spacecraft}\n"


def _fixed_frame(
    name: str, code: int, spacecraft: int, relative: str, angles: Sequence[float], axes: Sequence[int]
) -> str:
    """A frame fixed to another; angles [degrees] from this frame to the other."""
    return (
        f"{_frame(name, code, 4, spacecraft)}TKFRAME_{code}_SPEC = 'ANGLES'\nTKFRAME_{code}_RELATIVE = '{relative}'\n"
        f"TKFRAME_{code}_ANGLES = {_list(angles)}\nTKFRAME_{code}_AXES = {_list(axes)}\n"
        f"TKFRAME_{code}_UNITS = 'DEGREES'\n"
    )


def _body_frame(name: str, body: int, called: str = "") -> str:
    """A body's frame by constants of rotation; called: the body's name, if SPICE's own tables may lack it."""
    named = f"NAIF_BODY_NAME += ( '{called}' )\nNAIF_BODY_CODE += ( {body} )\n" if called else ""
    return f"{named}{_frame(name, body, 2, body)}OBJECT_{body}_FRAME = '{name}'\n"


def _rotation(body: int, pole_deg: tuple[float, float], meridian_deg: tuple[float, float]) -> str:
    """Constants of rotation: right ascension and declination of the pole, prime meridian and its turn in a day."""
    return (
        f"BODY{body}_POLE_RA = ( {pole_deg[0]} 0 0 )\nBODY{body}_POLE_DEC = ( {pole_deg[1]} 0 0 )\n"
        f"BODY{body}_PM = ( {meridian_deg[0]} {meridian_deg[1]} 0 )\n"
    )


def _clock(spacecraft: int, system: int, moduli: Sequence[float], span: tuple[float, float], line: str) -> str:
    """A clock of one partition (`span`); line: count, time (system 1: TDB, 2: TDT), seconds in its first field."""
    number = -spacecraft
    return (
        f"SCLK_KERNEL_ID = ( @2000-01-01 )\nSCLK_DATA_TYPE_{number} = ( 1 )\n"
        f"SCLK01_TIME_SYSTEM_{number} = ( {system} )\nSCLK01_N_FIELDS_{number} = ( {len(moduli)} )\n"
        f"SCLK01_MODULI_{number} = {_list(moduli)}\n"
        f"SCLK01_OFFSETS_{number} = {_list([0] * len(moduli))}\nSCLK01_OUTPUT_DELIM_{number} = ( 1 )\n"
        f"SCLK_PARTITION_START_{number} = ( {span[0]} )\nSCLK_PARTITION_END_{number} = ( {span[1]} )\n"
        f"SCLK01_COEFFICIENTS_{number} = ( {line} )\n"
    )


def _kernel(*parts: str) -> str:
    return "KPL/FK\n" + _BEGIN + "".join(parts)


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
AMICA = Mission(
    camera="hayabusa-amica",
    filter="V",
    spacecraft=-130,
    bus=-130000,
    body=2025143,
    fixed="ITOKAWA_FIXED",
    real_time="2005-10-13T19:13:11.695",
)
MSI = Mission(
    camera="near-msi",
    filter="4",
    spacecraft=-93,
    bus=-93000,
    body=2000433,
    fixed="EROS_FIXED",
    real_time="2000-02-25T05:16:12",
    elements=Elements(
        perihelion_au=1.133,
        eccentricity=0.2229,
        inclination_deg=10.83,
        node_deg=304.4,
        argument_deg=178.6,
        at_perihelion="1999-09-20",
    ),
    # near_171.tsc, NAIF's msi15.ti and eros_fixed.tf. Rotation: pck00010.tpc.
    definitions=_kernel(
        _clock(-93, 2, [2.0e12], (0.0, 2.0e12), "1.25932731e+11 @14-FEB-2000-10:02:49.319 9.9999966865e-04"),
        _attitude_frame("NEAR_SC_BUS_PRIME", -93000, -93),
        _fixed_frame("NEAR_MSI", -93001, -93, "NEAR_SC_BUS_PRIME", (0.0277221, 0.082635, 0.0), (3, 2, 1)),
        _body_frame("EROS_FIXED", 2000433),
    ),
)
ONC_T = Mission(
    camera="hayabusa2-onc-t",
    filter="",
    spacecraft=-37,
    bus=-37000,
    body=2162173,
    fixed="RYUGU_FIXED",
    real_time="2018-07-10T04:00:00",
    undistorted=True,
    elements=Elements(
        perihelion_au=0.963,
        eccentricity=0.190,
        inclination_deg=5.88,
        node_deg=251.6,
        argument_deg=211.4,
        at_perihelion="2018-06-05",
    ),
    # Clock, hyb2_v10.tf and hyb2_onc_v00.ti as public; rotation: Watanabe et al. (2019), Science 364, 268.
    definitions=_kernel(
        _clock(-37, 1, [4294967296], (0.0, 4294967295.0), "0.0 4.7082726973458749e+08 3.125e-02"),
        _attitude_frame("HAYABUSA2_SC_BUS_PRIME", -37000, -37),
        _fixed_frame(
            "HAYABUSA2_ONC-T", -37100, -37, "HAYABUSA2_SC_BUS_PRIME", (0.0, -179.9292340, 0.1365657), (3, 2, 1)
        ),
        _body_frame("RYUGU_FIXED", 2162173, "RYUGU"),
        _rotation(2162173, (96.40, -66.40), (0.0, 1131.98)),
        "INS-37100_FOCAL_LENGTH = ( 121.1 )\nINS-37100_PIXEL_SIZE = ( 0.013 0.013 )\n"
        "INS-37100_PIXEL_SAMPLES = ( 1024 )\nINS-37100_PIXEL_LINES = ( 1024 )\n"
        "INS-37100_CCD_CENTER = ( 512.5 512.5 )\n",
    ),
)
NAC = Mission(
    camera="rosetta-nac",
    filter="22",
    spacecraft=-226,
    bus=-226000,
    mount=-226111,
    body=1000012,
    fixed="67P/C-G_FIXED",
    real_time="2014-09-22T04:00:00",
    elements=Elements(
        perihelion_au=1.243,
        eccentricity=0.641,
        inclination_deg=7.04,
        node_deg=50.1,
        argument_deg=12.8,
        at_perihelion="2015-08-13",
    ),
    # ROS_160929_STEP.TSC and ROS_V38.TF, with the NavCam straight. Rotation: Preusker et al. (2015), A&A 583, A33.
    definitions=_kernel(
        _clock(
            -226,
            2,
            [4294967296, 65536],
            (2.4123675052450e12, 2.8147497671065e14),
            "2.1819955692360e+13 4.6440724496400e+08 1.0000003309643e+00",
        ),
        _attitude_frame("ROS_SPACECRAFT", -226000, -226),
        _attitude_frame("ROS_OSIRIS_NAC", -226111, -226),
        _fixed_frame("ROS_NAVCAM-A", -226170, -226, "ROS_SPACECRAFT", (0.0, 0.0, 0.0), (1, 2, 3)),
        _body_frame("67P/C-G_FIXED", 1000012, "67P/C-G"),
        _rotation(1000012, (69.54, 64.11), (114.69, 696.5)),
    ),
)
NAVCAM = Mission(
    camera="rosetta-navcam",
    filter="",
    spacecraft=NAC.spacecraft,
    bus=NAC.bus,
    body=NAC.body,
    fixed=NAC.fixed,
    real_time=NAC.real_time,
)
