"""Options of `ingest`: facts about the images that their files do not hold, and how the site is made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from photoclinometry.model.ranges import Pinhole, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class IngestOptions(Ranged):
    """Facts that the files do not hold, and how the site is made. Defaults come from labels, kernels and tables."""

    kernels: tuple[Path, ...] = ()
    """SPICE kernels: a folder, a meta-kernel, or files in loading order. They give poses, Suns and cameras."""
    sumfiles: tuple[Path, ...] = ()
    """SUMFILEs (SPC), or folders of them: cameras, poses and Suns of the images with their name or time."""
    suns: Path | None = None
    """CSV file with the columns image,sun_x,sun_y,sun_z and optionally sun_sigma_deg: unit vectors towards the Sun in
    the camera frame (x right, y down, z forward)."""
    camera: str | None = None
    """Name of a camera in the table, such as dawn-fc2, for files that do not name theirs. A wrong name lists all."""
    pinhole: Pinhole | None = None
    """fx fy cx cy [px] of a camera without distortion that is not in the table."""
    body: str | None = None
    """Name of the body in the images, as in SPICE, such as bennu."""
    name: str | None = None
    """The site's name; the output folder's by default."""
    solar_flux: Annotated[float | None, Range(above=0)] = None
    """Solar irradiance in the filter at 1 AU [W m^-2 um^-1], to convert radiance to I/F."""
    uncalibrated: bool = False
    """Treat all brightness as uncalibrated, I/F included; needed if only some images are I/F."""
    linear: bool = False
    """PNG files are linear in radiance although they declare gamma, sRGB or a colour profile."""
    lines: Literal["label", "down", "up"] = "label"
    """Order of the image's lines, for labels without it or with a wrong one: up if the first belongs at the bottom."""
    undistorted: bool = False
    """The images are free of distortion, or were corrected for it."""
    pose_priors: bool = True
    """Write known poses into site.toml as priors."""
    sun_sigma_deg: Annotated[float, Range(above=0, most=180)] = 0.05
    """Standard deviation of Suns from kernels, tables and labels [degrees]."""
    sun_common_sigma_deg: Annotated[float | None, Range(least=0, most=180)] = None
    """Standard deviation of the common rotation error of all Suns of an arc, in addition to each one's own error
    [degrees]. Left out, 0.05, as cameras are aligned to about that; not stated where --suns gives the Suns of all
    images."""
    position_sigma: Annotated[float, Range(above=0)] = 1e-3
    """Standard deviation of camera positions, as a share of the distance to the body; SUMFILEs state theirs."""
    pointing_sigma_deg: Annotated[float, Range(above=0, most=180)] = 0.03
    """Standard deviation of camera attitudes [degrees]; SUMFILEs state theirs."""
    pose_common_sigma: Annotated[tuple[float, float] | None, Range(least=0)] = None
    """In addition, standard deviations of the rotation of the cameras [degrees] and of the shift [m] that all pose
    priors of an arc have in common, such as by an error of the orbit. Left out, their errors are assumed to be
    independent."""
    keep_going: bool = False
    """Leave out files that cannot be used, instead of making no site."""

    @property
    def lines_up(self) -> bool | None:
        """Whether the first line belongs at the bottom; None to follow the label."""
        return {"label": None, "down": False, "up": True}[self.lines]
