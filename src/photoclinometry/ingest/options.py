"""What a person may say about images that their files do not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class IngestOptions:
    """How files become a site; what is left out is taken from labels, kernels and tables."""

    kernels: tuple[Path, ...] = ()
    """SPICE kernels: a folder, a meta-kernel, or files in loading order. Poses, Suns and cameras are then theirs."""
    sumfiles: tuple[Path, ...] = ()
    """SUMFILEs (SPC), or folders of them: cameras, poses and Suns of the images whose name or time they bear."""
    suns: Path | None = None
    """CSV with columns image,sun_x,sun_y,sun_z (camera frame: x right, y down, z forward), or sun_sigma_deg too."""
    camera: str | None = None
    """Name of a known camera, for files that do not name theirs (such as dawn-fc2; a wrong name lists the others)."""
    pinhole: tuple[float, float, float, float] | None = None
    """fx fy cx cy [px] of an undistorted camera that is not known."""
    body: str | None = None
    """The body in the images, as SPICE names it, such as bennu."""
    name: str | None = None
    """The site's name; the output folder's by default."""
    solar_flux: float | None = None
    """The Sun's irradiance in the filter at 1 AU [W m^-2 um^-1]: radiance is then converted to I/F."""
    uncalibrated: bool = False
    """Take all brightness for uncalibrated, also I/F; needed where only some images are I/F."""
    lines: Literal["label", "down", "up"] = "label"
    """How lines run, for labels that do not say or say it wrongly: up if the first belongs at the bottom."""
    undistorted: bool = False
    """The images are free of distortion already."""
    pose_priors: bool = True
    """Write poses that are known into site.toml."""
    sun_sigma_deg: float = 0.05
    """Standard deviation of Suns from kernels, tables and labels [degrees]."""
    position_sigma: float = 1e-3
    """Standard deviation of camera positions, in parts of the distance to the body; SUMFILEs have their own."""
    pointing_sigma_deg: float = 0.03
    """Standard deviation of camera attitudes [degrees]; SUMFILEs have their own."""
    keep_going: bool = False
    """Leave out files that cannot be used, instead of making no site."""

    @property
    def lines_up(self) -> bool | None:
        """Whether the first line belongs at the bottom; None where the label is to say."""
        return {"label": None, "down": False, "up": True}[self.lines]
