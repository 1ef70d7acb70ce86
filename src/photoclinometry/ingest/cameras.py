"""Table of cameras of missions to small bodies, for images whose labels and kernels do not give the intrinsics.

Each entry names its source. Samples and lines are in the order of the bytes of the archive's files.
"""

from __future__ import annotations

from dataclasses import replace

from photoclinometry.ingest.detector import Detector
from photoclinometry.ingest.distortion import BrownConrady, InverseRadial, Radial
from photoclinometry.ingest.facts import Facts
from photoclinometry.ingest.known_camera import KnownCamera
from photoclinometry.model.errors import InputError


def _dawn(number: int, distortion: tuple[float, ...]) -> KnownCamera:
    """FC1 or FC2 with 8 filters; distortion: the kernel's E1 of each [1e-6 / mm^2]."""
    focal = (150.07, 150.11, 150.04, 150.12, 150.16, 150.08, 150.06, 150.38)
    base = Detector(
        width=1024,
        height=1024,
        focal_mm=focal[0],
        pitch_mm=(0.014004, 0.013995),
        center=(512.0, 512.0),
        axes=((1.0, 0.0), (0.0, -1.0)),
    )
    filters = {
        str(n): replace(base, focal_mm=f, distortion=Radial((0.0, 0.0, k * 1e-6)))
        for n, (f, k) in enumerate(zip(focal, distortion, strict=True), start=1)
    }
    code = -203100 - 10 * number
    return KnownCamera(
        name=f"dawn-fc{number}",
        detector=filters["1"],
        instruments=(f"FC{number}",),
        spacecraft=("DAWN",),
        spacecraft_code=-203,
        code=code,
        source="instrument kernel dawn_fc_v10.ti (CCD_CENTER 511.5 counts from 0); line order: LINE_DISPLAY_DIRECTION",
        filters=filters,
        filter_codes={name: code - int(name) for name in filters},
        cube_lines_turned=True,
        display=((True, False),),
        delay_s=0.193,
    )


_OCAMS = Detector(
    width=1024,
    height=1024,
    focal_mm=125.20,
    pitch_mm=(0.0085, 0.0085),
    center=(512.0, 512.0),
    axes=((0.0, 1.0), (1.0, 0.0)),
)
# OpenCV's k1 ... k6, and p1, p2.
_NAVCAM_TERMS = ((-0.53766, 0.37526, -0.18368, 0.0, 0.0, 0.0), (2.3432e-4, 9.0875e-4))
_NFTCAM_TERMS = ((-0.53831, 0.38214, -0.20281, 0.0, 0.0, 0.0), (-6.2239e-4, -1.2388e-4))


def _ocams_radial(k: tuple[float, ...], center: tuple[float, float]) -> Radial:
    """The distortion of an ISIS addendum: OD_K [mm^-i] and OD_CENTER (sample, line, counted from 1)."""
    x, y = ((c - 0.5 - middle) * pitch for c, middle, pitch in zip(center, _OCAMS.center, _OCAMS.pitch_mm, strict=True))
    return Radial(k, (x, y))


def _mapcam() -> KnownCamera:
    figures = {
        "PAN": (125.20, (2.21e-5, 1.71e-4, 5.96e-5), (486.2, 450.3)),
        "B": (125.37, (5.06e-5, 1.63e-4, 6.00e-5), (497.3, 456.8)),
        "V": (125.11, (7.45e-5, 2.20e-4, 6.22e-5), (494.3, 473.8)),
        "W": (125.13, (2.21e-5, 1.32e-4, 6.08e-5), (510.3, 461.2)),
        "X": (125.42, (2.44e-5, -3.61e-5, 8.87e-5), (504.5, 450.5)),
    }
    filters = {n: replace(_OCAMS, focal_mm=f, distortion=_ocams_radial(k, c)) for n, (f, k, c) in figures.items()}
    return KnownCamera(
        name="orex-mapcam",
        detector=filters["PAN"],
        instruments=("MAPCAM", "OCAMS_MAPCAM", "OCAMS-MAPCAM"),
        spacecraft=("OSIRIS-REX", "ORX", "OREX"),
        spacecraft_code=-64,
        code=-64361,
        source="orx_ocams_v07.ti and ISIS's orex_ocams_addendum_v10.ti; distortion as ISIS's OsirisRexDistortionMap",
        filters=filters,
    )


def _polycam() -> KnownCamera:
    return KnownCamera(
        name="orex-polycam",
        detector=replace(_OCAMS, focal_mm=628.70),
        instruments=("POLYCAM", "OCAMS_POLYCAM", "OCAMS-POLYCAM"),
        spacecraft=("OSIRIS-REX", "ORX", "OREX"),
        spacecraft_code=-64,
        code=-64360,
        source="orx_ocams_v07.ti, nominal focus: at close range it is up to 4 % off; distortion (below 1 px) left out",
    )


def _samcam() -> KnownCamera:
    return KnownCamera(
        name="orex-samcam",
        detector=replace(
            _OCAMS,
            focal_mm=24.12992,
            axes=((-1.0, 0.0), (0.0, 1.0)),
            distortion=_ocams_radial((2.06e-3, -2.21e-3, 9.68e-4, -1.63e-4, 1.07e-5), (512.0, 512.0)),
        ),
        instruments=("SAMCAM", "OCAMS_SAMCAM", "OCAMS-SAMCAM"),
        spacecraft=("OSIRIS-REX", "ORX", "OREX"),
        spacecraft_code=-64,
        code=-64362,
        source="ISIS's orex_ocams_addendum_v10.ti; of its distortions the one that keeps the kernel's field of view",
    )


def _tagcams(
    name: str,
    instrument: str,
    code: int,
    focal: float,
    center: tuple[float, float],
    focal_px: tuple[float, float],
    terms: tuple[tuple[float, ...], tuple[float, float]],
) -> KnownCamera:
    """focal: nominal [mm]; center (sample, line, counted from 1), focal_px, terms: those of OpenCV's model."""
    pitch = 0.0022
    stretch = (focal_px[0] * pitch / focal, focal_px[1] * pitch / focal)
    return KnownCamera(
        name=name,
        detector=Detector(
            width=2592,
            height=1944,
            focal_mm=focal,
            pitch_mm=(pitch, pitch),
            center=(center[0] - 0.5, center[1] - 0.5),
            axes=((1.0, 0.0), (0.0, -1.0)),
            distortion=BrownConrady(focal, terms[0], terms[1], stretch),
        ),
        instruments=(instrument, f"TAGCAMS_{instrument}"),
        spacecraft=("OSIRIS-REX", "ORX", "OREX"),
        spacecraft_code=-64,
        code=code,
        source="orx_navcam_v02.ti and ISIS's orex_tagcams_addendum_v06.ti, at 0 degrees Celsius",
        saturation=4095.0,
    )


def _msi() -> KnownCamera:
    deblurred = Detector(
        width=537,
        height=412,
        focal_mm=167.35,
        pitch_mm=(0.016, 0.027 * 244 / 412),
        center=(268.5, 206.0),
        frame=((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)),
    )
    return KnownCamera(
        name="near-msi",
        detector=deblurred,
        instruments=("MSI", "MSI.004", "MULTI-SPECTRAL IMAGER"),
        spacecraft=("NEAR",),
        spacecraft_code=-93,
        code=-93001,
        source="instrument catalogue of the MSI (167.35 mm; 16 x 27 micron, 537 x 244 pixels); axes checked on "
        "headers' quaternions and the light in images; no distortion published",
        cube_lines_turned=True,
        display=((True, False), (True, True)),
        clock_in_one_field=True,
        raw_lines=244,
    )


def _amica() -> KnownCamera:
    return KnownCamera(
        name="hayabusa-amica",
        detector=Detector(
            width=1024,
            height=1024,
            focal_mm=120.80,
            pitch_mm=(0.012, 0.012),
            center=(512.0, 512.0),
            axes=((1.0, 0.0), (0.0, 1.0)),
            distortion=InverseRadial((0.0, 0.0, 2.8e-5)),
        ),
        instruments=("AMICA",),
        spacecraft=("HAYABUSA",),
        spacecraft_code=-130,
        code=-130102,
        source="amica31.ti (CENTER 511.5 counts from 0), Ishiguro et al. (2010), Icarus 207, 714, and amica2isis",
        cube_lines_turned=True,
    )


def _onc(name: str, instrument: str, code: int, focal: float, cubic: float, quintic: float) -> KnownCamera:
    """focal [mm]; cubic, quintic: a3 [px^-2], a5 [px^-4] of R' = R + a3 R^3 + a5 R^5, from measured to ideal radius."""
    pitch = 0.013
    return KnownCamera(
        name=name,
        detector=Detector(
            width=1024,
            height=1024,
            focal_mm=focal,
            pitch_mm=(pitch, pitch),
            center=(512.0, 512.0),
            distortion=InverseRadial((0.0, 0.0, -cubic / pitch**2, 0.0, -quintic / pitch**4)),
        ),
        instruments=(instrument, instrument.replace("-", "_"), instrument.replace("-", ""), f"HAYABUSA2_{instrument}"),
        spacecraft=("HAYABUSA2", "HAYABUSA-2", "HAYABUSA 2"),
        spacecraft_code=-37,
        code=code,
        source="focal length: ISIS, hyb2onc2isis; distortion: archive hyb2_onc, c_dist_20190131.db (Suzuki et al. "
        "2018, Tatsumi et al. 2019); images of level l2c and above are undistorted already: pass --undistorted",
    )


def _rosetta(
    name: str,
    instruments: tuple[str, ...],
    code: int,
    focal: float,
    pitch: float,
    size: int,
    source: str,
    *,
    osiris: bool = True,
) -> KnownCamera:
    """focal, pitch [mm]; size: samples and lines. OSIRIS's images are those that their labels display."""
    return KnownCamera(
        name=name,
        detector=Detector(
            width=size,
            height=size,
            focal_mm=focal,
            pitch_mm=(pitch, pitch),
            center=(size / 2, size / 2),
            axes=((0.0, -1.0), (1.0, 0.0)) if osiris else ((1.0, 0.0), (0.0, 1.0)),
        ),
        displayed=osiris,
        instruments=instruments,
        spacecraft=("ROSETTA", "RO"),
        spacecraft_code=-226,
        code=code,
        source=source,
    )


_KELLER = "Keller et al. (2007), Space Sci. Rev. 128, 433: "
_OSIRIS_AXES = (
    "axes: columns along x and lines along y of the camera's frame (ROS_V38.TF), x up and y right once an image is "
    "displayed by its label and turned by 180 degrees (BROWINFO.TXT of the archive)"
)
CAMERAS = {
    camera.name: camera
    for camera in (
        _dawn(1, (7.7, 7.7, 7.7, 7.7, 7.7, 7.7, 7.7, 1.5)),
        _dawn(2, (8.4, 6.7, 8.4, 10.0, 10.3, 9.2, 7.6, 5.6)),
        _mapcam(),
        _polycam(),
        _samcam(),
        _tagcams("orex-navcam", "NAVCAM", -64081, 7.64, (1269.083, 950.747), (3473.26, 3473.321), _NAVCAM_TERMS),
        _tagcams("orex-nftcam", "NFTCAM", -64082, 7.61, (1310.53, 969.487), (3462.53, 3462.532), _NFTCAM_TERMS),
        _msi(),
        _amica(),
        _onc("hayabusa2-onc-t", "ONC-T", -37100, 121.1, -9.28e-9, 0.0),
        _onc("hayabusa2-onc-w1", "ONC-W1", -37110, 10.35, 3.134e-7, -1.716e-13),
        _onc("hayabusa2-onc-w2", "ONC-W2", -37120, 10.44, 2.893e-7, -1.365e-13),
        _rosetta(
            "rosetta-nac",
            ("OSINAC", "OSIRIS-NAC"),
            -226111,
            717.4,
            0.0135,
            2048,
            f"{_KELLER}717.4 mm; {_OSIRIS_AXES}; for distortion-corrected images",
        ),
        _rosetta(
            "rosetta-wac",
            ("OSIWAC", "OSIRIS-WAC"),
            -226112,
            133.7,
            0.0135,
            2048,
            f"{_KELLER}101 microrad a pixel of 13.5 micron, good to 1 %: load the instrument kernel for better; "
            f"{_OSIRIS_AXES}",
        ),
        _rosetta(
            "rosetta-navcam",
            ("NAVCAM", "CAM1", "CAM2"),
            -226170,
            152.5,
            0.013,
            1024,
            "instrument catalogue of the NavCam: 5 degrees across 1024 pixels of 13 micron; axes not known to be right",
            osiris=False,
        ),
    )
}
"""By name, as for `phomo ingest --camera NAME`."""


def known_camera(facts: Facts) -> KnownCamera | None:
    """The entry for the instrument and spacecraft of a label; None if there is none."""
    instrument, spacecraft = (facts.instrument or "").upper(), (facts.spacecraft or "").upper()
    for camera in CAMERAS.values():
        if instrument in camera.instruments and (
            not spacecraft or any(name in spacecraft for name in camera.spacecraft)
        ):
            return camera
    return None


def camera_named(name: str) -> KnownCamera:
    """The entry of that name. Raises InputError that lists all names."""
    if name not in CAMERAS:
        raise InputError(f"there is no camera {name!r} in the table; known: {', '.join(CAMERAS)}")
    return CAMERAS[name]
