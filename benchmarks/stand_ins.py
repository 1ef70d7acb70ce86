"""Stand-ins for files of an archive: a simulated body as a mission's camera would have seen it, by SPICE.

    python benchmarks/stand_ins.py CAMERA --out FOLDER --data ../shared/data      # mapcam, fc2, amica, msi, onc-t, nac

writes images, their labels and kernels. `run_documents.py` places them where the missions' pages expect downloads.
Images are 128 or 256 pixels wide, of 4 x 4 to 16 x 16 pixels of the detector each; MSI's are whole. Kernels of clock,
frames, instrument and rotation are real for MapCam, FC2 and AMICA; for the others they have the figures of the public
ones (`stand_in_missions.py`). Those of orbits and attitudes are made up.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import spiceypy as spice

from photoclinometry.ingest.cameras import camera_named
from photoclinometry.ingest.detector import Detector, fitted, seen_pixels, upright
from photoclinometry.io.archives.fits_header import read_fits_header
from photoclinometry.io.spice import kernel_files
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.region import Region
from photoclinometry.simulate.bodies.build import build_body, preset_shape
from photoclinometry.simulate.bodies.presets import BODIES
from photoclinometry.simulate.bodies.surface import BodyRaycaster, BodySurface
from photoclinometry.simulate.camera_model import Detector as Exposing
from photoclinometry.simulate.camera_model import expose, pixel_average
from photoclinometry.simulate.observe import cast, sample_points
from photoclinometry.simulate.photometry import named_photometry, radiance_factor
from photoclinometry.simulate.trajectory import looking_at
from stand_in_files import (
    write_amica_cube,
    write_amica_product,
    write_fc_product,
    write_msi_deblurred,
    write_msi_product,
    write_nac_product,
    write_navcam_product,
    write_ocams_product,
    write_onc_product,
)
from stand_in_kernels import (
    Mission,
    Shot,
    furnished,
    instrument_from_body,
    sun_from_body,
    write_orbit,
    write_shots,
)
from stand_in_missions import AMICA, FC2, MAPCAM, MSI, NAC, NAVCAM, ONC_T

PHOTOMETRY = named_photometry("mcewen", "bennu")
"""Lunar-Lambert, without parameters of a body."""
_NORTH = np.array([0.0, 0.0, 1.0])
_SUPERSAMPLING = 3
"""Rays across a pixel."""
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
_GOLDEN_SHARE = (math.sqrt(5.0) - 1.0) / 2.0
"""Azimuths and tilts that follow each other by these spread evenly, however many there are."""
_OTHERS_APART_DEG = 6.0
"""Rotation of the body between images of its other side."""
_INVERSIONS = 10
"""Rounds of the fixed point that inverts a distortion of a few pixels; each gains two digits."""


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """The images to make."""

    size: int = 256
    """Width [px], and height where a `Look` does not give it: the detector's, or the detector's binned."""
    lon_lat_deg: tuple[float, float] = (43.0, 56.0)
    """The site of the close-ups, eastward and planetocentric."""
    close_ups: int = 12
    """Images of the site, from morning to afternoon."""
    others: int = 4
    """Images of the other side of the body."""
    distance_m: float = 2000.0
    """From the camera to the ground."""
    hours_deg: tuple[float, float] = (-38.0, 38.0)
    """The Sun's hour angle at the site in the first and the last close-up."""
    tilts_deg: tuple[float, float] = (6.0, 28.0)
    """Range of the close-ups' emission angles."""
    phase_deg: float = 25.0
    """Of the images of the other side."""
    hours: float = 5.0
    """Of the orbits from the real time on: longer than the body takes to turn round."""


SURVEY = Campaign(lon_lat_deg=(10.0, 15.0), distance_m=4.4e6, tilts_deg=(4.0, 24.0), others=0, hours=10.0)
"""Dawn's survey orbit about Ceres."""
_MORNING = Campaign(size=128, others=0, tilts_deg=(4.0, 20.0), hours_deg=(-60.0, -15.0))
"""Small images whose shadows fall to one side: they match each other."""


def body_like(
    preset: str, spacing_m: float, radius_m: float, mean_albedo: float | None = None, **relief: float
) -> BodySurface:
    """A preset's shape of that mean radius; relief: changes of the preset's."""
    body = BODIES[preset]
    body = replace(body, relief=replace(body.relief, **relief), radius=radius_m)
    body = body if mean_albedo is None else replace(body, mean_albedo=mean_albedo)
    return build_body(preset_shape(body), body, spacing_m, seed=7)


_FEW_BOULDERS = {"boulder_cover": 0.12, "largest_boulder": 0.1, "slope_deg": 7.0}
"""Images of some thousandths of a radius a pixel can be matched."""


def bennu_like(spacing_m: float) -> BodySurface:
    """A spinning top of Bennu's size with fewer boulders."""
    return body_like("topshape", spacing_m, 245.0, **_FEW_BOULDERS)


def ceres_like(spacing_m: float) -> BodySurface:
    """A spinning top of Ceres's size with craters and without boulders."""
    craters = {"boulder_cover": 0.0, "crater_density": 0.13, "largest_crater": 0.5, "slope_deg": 5.0}
    return body_like("topshape", spacing_m, 470e3, 0.09, **craters)


def planned_shots(mission: Mission, surface: BodySurface, campaign: Campaign) -> list[Shot]:
    """The images in the order of time; the kernels of `write_orbit` are loaded, and say where the Sun is."""
    lon, lat = np.radians(campaign.lon_lat_deg)
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east = unit(np.cross(_NORTH, up))
    north = np.cross(up, east)
    site = surface.vertices[np.argmax(unit(surface.vertices) @ up)]
    poses: list[tuple[float, Rigid]] = []
    for k, hour in enumerate(np.linspace(*campaign.hours_deg, campaign.close_ups)):
        low, high = campaign.tilts_deg
        tilt, azimuth = math.radians(low + (high - low) * (k * _GOLDEN_SHARE % 1.0)), k * _GOLDEN_ANGLE
        away = math.cos(tilt) * up + math.sin(tilt) * (math.cos(azimuth) * east + math.sin(azimuth) * north)
        poses.append((float(hour), looking_at(site + campaign.distance_m * away, site, 0.05 * math.sin(k), _NORTH)))
    for k in range(campaign.others):
        hour = 180.0 + _OTHERS_APART_DEG * k
        below = lon - math.radians(hour - campaign.phase_deg)
        away = np.array([math.cos(below), math.sin(below), 0.0])
        poses.append((hour, looking_at(campaign.distance_m * away, np.zeros(3), 0.0, _NORTH)))
    times = [_time_of_hour(mission, math.degrees(lon), hour) for hour, _ in poses]
    _, cam_from_instrument, _ = upright(camera_named(mission.camera).with_filter(mission.filter))
    held = Rigid(cam_from_instrument, np.zeros(3))
    return sorted((Shot(t, pose @ held) for t, (_, pose) in zip(times, poses, strict=True)), key=lambda s: s.time)


def detector_of(mission: Mission, width: int, height: int) -> Detector:
    """The detector of images of width x height pixels, in the order of the archive's files."""
    known = camera_named(mission.camera)
    detector = fitted(known.with_filter(mission.filter), width, height, known.raw_lines)
    return replace(detector, distortion=None) if mission.undistorted else detector


def _time_of_hour(mission: Mission, lon_deg: float, hour_deg: float) -> float:
    """When the Sun's hour angle at a longitude has that value, first after the mission's real time."""
    begin = spice.str2et(mission.real_time)
    rate = spice.bodvcd(mission.body, "PM", 3)[1][1] / spice.spd()
    sun = sun_from_body(mission, begin)
    now = lon_deg - math.degrees(math.atan2(sun[1], sun[0]))
    return begin + ((hour_deg - now) % 360.0) / rate


def picture(mission: Mission, tracer: BodyRaycaster, size: tuple[int, int], time: float, seed: int) -> np.ndarray:
    """(height, width) I/F in the order of the archive's files, as the loaded kernels place camera and Sun.

    size: (width, height).
    """
    detector, exposing = detector_of(mission, *size), Exposing()
    camera, cam_from_instrument, turned = upright(detector)
    frame = Region.of_image(size[1], size[0])
    pixels = ideal_pixels(detector, sample_points(frame, _SUPERSAMPLING, exposing.margin_px))
    if turned:
        pixels[..., 1] = size[1] - pixels[..., 1]
    pose = (Rigid(cam_from_instrument, np.zeros(3)) @ instrument_from_body(mission, time)).inverse()
    sun = sun_from_body(mission, time)
    samples = cast(tracer, camera, pose, sun, pixels)
    lit = samples.lit
    angles = photometric_angles(sun, pose.translation, samples.position[lit], samples.normal[lit])
    fine = np.zeros(lit.shape, np.float32)
    fine[lit] = radiance_factor(PHOTOMETRY, samples.albedo[lit], *angles)
    seen = pixel_average(fine, _SUPERSAMPLING, exposing.margin_px, exposing.psf_sigma_px)
    return expose(seen, exposing, np.random.default_rng([seed]), shows_sky=True).iof


def ideal_pixels(detector: Detector, seen: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) without distortion of pixels of the file: the inverse of `seen_pixels`."""
    ideal = seen.copy()
    for _ in range(_INVERSIONS):
        ideal += seen - seen_pixels(detector, ideal)
    return ideal


Files = Callable[[Path, float, np.ndarray], None]
"""Writes the files of one image below a folder: the folder, the middle of the exposure, I/F in the file's order."""


@dataclass(frozen=True)
class Look:
    """The images that one camera takes of the shots, and the files made of them."""

    mission: Mission
    files: Callable[[Path], Files]
    """Of the folder of real data."""
    lines: int | None = None
    """Height of the images, where it is not the width [px]."""
    every: int = 1
    """1 for an image of every shot, 4 for one of every fourth."""


@dataclass(frozen=True)
class Archive:
    """A mission's stand-ins; the first camera is the one that is pointed."""

    real: str
    """The folder with real kernels, below that of real data: the mission's, or leap seconds and constants alone."""
    surface: Callable[[float], BodySurface]
    """By the spacing of its vertices [m]."""
    spacing_m: float
    campaign: Campaign
    looks: tuple[Look, ...]


def _below(folder: str, write: Callable[..., Any], *given: Any) -> Files:
    """A writer of one product into a folder of its own; given: what it needs before time and pixels."""

    def files(out: Path, time: float, pixels: np.ndarray) -> None:
        (out / folder).mkdir(parents=True, exist_ok=True)
        write(out / folder, *given, time, pixels)

    return files


def _ocams_files(_: Path) -> Files:
    """FITS files with labels, and FITS files alone."""

    def files(out: Path, time: float, pixels: np.ndarray) -> None:
        for folder in ("pds4", "images"):
            (out / folder).mkdir(parents=True, exist_ok=True)
        label = write_ocams_product(out / "pds4", time, pixels)
        shutil.copy2(label.with_suffix(".fits"), out / "images")

    return files


def _fc_files(data: Path) -> Files:
    template = next((data / "spice" / "dawn_fc_ceres").glob("*_pds3.lbl")).read_text(encoding="latin-1")
    return _below("images", write_fc_product, template)


def _amica_cubes(data: Path) -> Files:
    template = next((data / "spice" / "hayabusa_amica_itokawa").glob("*_isis.lbl")).read_text()
    return _below("cubes", write_amica_cube, template)


def _msi_files(label: str, write: Callable[..., Any]) -> Callable[[Path], Files]:
    """label: of a real image, below the folder of formats, with its FITS file beside it."""

    def files(data: Path) -> Files:
        path = data / "formats" / label
        header = read_fits_header(path.with_suffix(".fit"))
        keywords = {key: value for key, value in header.statements if key.startswith(("NEAR-", "BUNIT"))}
        return _below("images", write, path.read_text(encoding="latin-1"), keywords)

    return files


ARCHIVES = {
    "mapcam": Archive("osiris_rex_mapcam_bennu", bennu_like, 0.55, Campaign(), (Look(MAPCAM, _ocams_files),)),
    "fc2": Archive("dawn_fc_ceres", ceres_like, 1600.0, SURVEY, (Look(FC2, _fc_files),)),
    "amica": Archive(
        "hayabusa_amica_itokawa",
        lambda spacing_m: body_like("bilobed", spacing_m, 162.0, **_FEW_BOULDERS),
        0.5,
        replace(_MORNING, lon_lat_deg=(0.0, 0.0), distance_m=700.0, hours=13.0),
        (Look(AMICA, lambda _: _below("images", write_amica_product)), Look(AMICA, _amica_cubes)),
    ),
    "msi": Archive(
        "osiris_rex_mapcam_bennu",
        lambda spacing_m: body_like("potato", spacing_m, 8420.0),
        25.0,
        replace(_MORNING, size=537, lon_lat_deg=(0.0, 30.0), distance_m=1.2e5, hours=6.0),
        (
            Look(MSI, _msi_files("near/msi2isis/m0126865998f4_2p_iof.lbl", write_msi_product), lines=244),
            Look(MSI, _msi_files("pds4/m0154651923f6_2p_cif_gbl.xml", write_msi_deblurred), lines=412, every=4),
        ),
    ),
    "onc-t": Archive(
        "osiris_rex_mapcam_bennu",
        lambda spacing_m: body_like("topshape", spacing_m, 448.0, **_FEW_BOULDERS),
        2.0,
        replace(_MORNING, lon_lat_deg=(20.0, 10.0), distance_m=3000.0, others=4, hours=8.5),
        (Look(ONC_T, lambda _: _below("images", write_onc_product)),),
    ),
    "nac": Archive(
        "osiris_rex_mapcam_bennu",
        lambda spacing_m: body_like("bilobed", spacing_m, 1650.0, 0.06, **_FEW_BOULDERS),
        5.0,
        replace(_MORNING, lon_lat_deg=(0.0, 20.0), distance_m=18e3, hours=13.5),
        (
            Look(NAC, lambda _: _below("images", write_nac_product)),
            Look(NAVCAM, lambda _: _below("images", write_navcam_product), every=4),
        ),
    ),
}
"""By the camera's name, as for the command line."""


def write_archive(
    folder: Path, name: str, data: Path, campaign: Campaign | None = None, spacing_m: float | None = None
) -> None:
    """The images and kernels/ of an entry of `ARCHIVES` in `folder`; data: the folder of real data."""
    archive = ARCHIVES[name]
    campaign = campaign or archive.campaign
    pointed, kernels = archive.looks[0].mission, folder / "kernels"
    surface = archive.surface(spacing_m or archive.spacing_m)
    write_orbit(kernels, data / "spice" / archive.real, pointed, hours=campaign.hours)
    with furnished(kernel_files([kernels])):
        shots = planned_shots(pointed, surface, campaign)
    write_shots(kernels, pointed, shots)
    tracer = BodyRaycaster(surface)
    looks = [(look, look.files(data)) for look in archive.looks]
    with furnished(kernel_files([kernels])):
        for k, shot in enumerate(shots):
            for look, files in looks:
                if k % look.every == 0:
                    size = (campaign.size, look.lines or campaign.size)
                    files(folder, shot.time, picture(look.mission, tracer, size, shot.time, k))


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes the stand-ins; exit code 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("camera", choices=ARCHIVES)
    parser.add_argument("--out", type=Path, required=True, help="a new folder")
    parser.add_argument("--data", type=Path, required=True, help="folder of real kernels and labels (spice, formats)")
    options = parser.parse_args(arguments)
    write_archive(options.out, options.camera, options.data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
