"""Stand-ins for files of an archive: a simulated body as a mission's camera would have seen it, by SPICE.

    python benchmarks/stand_ins.py mapcam --out FOLDER --kernels ../shared/data/spice/osiris_rex_mapcam_bennu
    python benchmarks/stand_ins.py fc2 --out FOLDER --kernels ../shared/data/spice/dawn_fc_ceres

write images, their labels and kernels. `run_documents.py` places them where the pages on OSIRIS-REx and on Dawn expect
downloads. Images are 256 pixels wide, each of four by four pixels of the detector. Kernels of clock, frames, instrument
and rotation are real, those of orbits and attitudes are made up.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import spiceypy as spice

from photoclinometry.ingest.cameras import camera_named
from photoclinometry.ingest.detector import Detector, fitted, seen_pixels, upright
from photoclinometry.io.spice import kernel_files
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.scene import Region
from photoclinometry.simulate.bodies.build import build_body, preset_shape
from photoclinometry.simulate.bodies.presets import BODIES
from photoclinometry.simulate.bodies.surface import BodyRaycaster, BodySurface
from photoclinometry.simulate.camera_model import Detector as Exposing
from photoclinometry.simulate.camera_model import expose, pixel_average
from photoclinometry.simulate.observe import cast, sample_points
from photoclinometry.simulate.photometry import named_photometry, radiance_factor
from photoclinometry.simulate.trajectory import looking_at
from stand_in_files import FC2, MAPCAM, write_fc_product, write_ocams_product
from stand_in_kernels import (
    Mission,
    Shot,
    furnished,
    instrument_from_body,
    sun_from_body,
    write_orbit,
    write_shots,
)

PHOTOMETRY = named_photometry("mcewen", "bennu")
"""Lunar-Lambert, without parameters of a body."""
_NORTH = np.array([0.0, 0.0, 1.0])
_SUPERSAMPLING = 3
"""Rays across a pixel."""
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
_GOLDEN_SHARE = (math.sqrt(5.0) - 1.0) / 2.0
"""Azimuths and tilts that follow each other by these spread evenly, however many there are."""
_OTHERS_APART_DEG = 6.0
"""By how much the body turns between images of its other side."""
_INVERSIONS = 10
"""Rounds of the fixed point that inverts a distortion of a few pixels; each gains two digits."""


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """The images to make."""

    size: int = 256
    """Width and height [px]: the detector's, or the detector's binned."""
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


def bennu_like(spacing_m: float) -> BodySurface:
    """A spinning top of Bennu's size with fewer boulders, so that images of half a metre a pixel can be matched."""
    preset = BODIES["topshape"]
    relief = replace(preset.relief, boulder_cover=0.12, largest_boulder=0.1, slope_deg=7.0)
    return build_body(preset_shape(preset), replace(preset, relief=relief), spacing_m, seed=7)


def ceres_like(spacing_m: float) -> BodySurface:
    """A spinning top of Ceres's size with craters and without boulders."""
    preset = BODIES["topshape"]
    relief = replace(preset.relief, boulder_cover=0.0, crater_density=0.13, largest_crater=0.5, slope_deg=5.0)
    preset = replace(preset, relief=relief, radius=470e3, mean_albedo=0.09)
    return build_body(preset_shape(preset), preset, spacing_m, seed=7)


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
    _, cam_from_instrument, _ = upright(detector_of(mission, campaign.size))
    held = Rigid(cam_from_instrument, np.zeros(3))
    return sorted((Shot(t, pose @ held) for t, (_, pose) in zip(times, poses, strict=True)), key=lambda s: s.time)


def detector_of(mission: Mission, size: int) -> Detector:
    """The detector of images of size x size pixels, in the order of the archive's files."""
    return fitted(camera_named(mission.camera).with_filter(mission.filter), size, size)


def _time_of_hour(mission: Mission, lon_deg: float, hour_deg: float) -> float:
    """When the Sun's hour angle at a longitude has that value, first after the mission's real time."""
    begin = spice.str2et(mission.real_time)
    rate = spice.bodvcd(mission.body, "PM", 3)[1][1] / spice.spd()
    sun = sun_from_body(mission, begin)
    now = lon_deg - math.degrees(math.atan2(sun[1], sun[0]))
    return begin + ((hour_deg - now) % 360.0) / rate


def picture(mission: Mission, tracer: BodyRaycaster, size: int, time: float, seed: int) -> np.ndarray:
    """(size, size) I/F in the order of the archive's files, as the loaded kernels place camera and Sun."""
    detector, exposing = detector_of(mission, size), Exposing()
    camera, cam_from_instrument, turned = upright(detector)
    frame = Region(row=0, col=0, height=size, width=size)
    pixels = ideal_pixels(detector, sample_points(frame, _SUPERSAMPLING, exposing.margin_px))
    if turned:
        pixels[..., 1] = size - pixels[..., 1]
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


def write_ocams(folder: Path, real: Path, campaign: Campaign = Campaign(), spacing_m: float = 0.55) -> None:
    """images/ (FITS files), pds4/ (with labels) and kernels/ in `folder`; real: the folder of MapCam's real kernels."""
    labelled, alone = folder / "pds4", folder / "images"
    for images in (labelled, alone):
        images.mkdir(parents=True)
    for time, pixels in pictures(folder / "kernels", real, MAPCAM, bennu_like(spacing_m), campaign):
        label = write_ocams_product(labelled, time, pixels)
        shutil.copy2(label.with_suffix(".fits"), alone)


def write_fc(folder: Path, real: Path, campaign: Campaign = SURVEY, spacing_m: float = 1600.0) -> None:
    """images/ (PDS3 labels with FITS files) and kernels/ in `folder`; real: the folder of FC2's kernels and label."""
    (folder / "images").mkdir(parents=True)
    template = next(real.glob("*_pds3.lbl")).read_text(encoding="latin-1")
    for time, pixels in pictures(folder / "kernels", real, FC2, ceres_like(spacing_m), campaign):
        write_fc_product(folder / "images", template, time, pixels)


def pictures(
    kernels: Path, real: Path, mission: Mission, surface: BodySurface, campaign: Campaign
) -> Iterator[tuple[float, np.ndarray]]:
    """Writes the folder `kernels`, and yields the images: middle of the exposure, I/F; the kernels are loaded then."""
    write_orbit(kernels, real, mission, hours=campaign.hours)
    with furnished(kernel_files([kernels])):
        shots = planned_shots(mission, surface, campaign)
    write_shots(kernels, mission, shots)
    tracer = BodyRaycaster(surface)
    with furnished(kernel_files([kernels])):
        for k, shot in enumerate(shots):
            yield shot.time, picture(mission, tracer, campaign.size, shot.time, k)


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes the stand-ins; exit code 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("camera", choices=("mapcam", "fc2"))
    parser.add_argument("--out", type=Path, required=True, help="a new folder")
    parser.add_argument("--kernels", type=Path, required=True, help="folder of the real kernels")
    options = parser.parse_args(arguments)
    write = {"mapcam": write_ocams, "fc2": write_fc}[options.camera]
    write(options.out, options.kernels)
    return 0


if __name__ == "__main__":
    sys.exit(main())
