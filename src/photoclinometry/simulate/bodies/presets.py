"""The bodies that can be simulated: shape, size, relief and camera.

The recipes are chosen by eye, so that images look like those of spacecraft; nothing in the estimate depends on them.
"""

from __future__ import annotations

from dataclasses import dataclass

from photoclinometry.simulate.bodies.shapes import Implicit, bent_potato, contact_binary, spinning_top


@dataclass(frozen=True, kw_only=True)
class Relief:
    """Landforms upon the smooth shape. Sizes are in mean radii."""

    slope_deg: float
    """RMS slope of the fractal relief between neighbouring vertices."""
    longest: float
    """Longest wavelength of the fractal relief."""
    crater_density: float
    """Craters as a share of saturation."""
    crater_depth: float
    """Depth of craters over that of `terrain.fresh_profile`."""
    largest_crater: float
    """Diameter."""
    boulder_cover: float
    """Share of the ground that boulders cover, in the mean."""
    largest_boulder: float
    """Diameter."""
    patches: float
    """Change of log albedo in patches."""


@dataclass(frozen=True, kw_only=True)
class BodyPreset:
    """A body to simulate. Options of a simulation may override the number and size of the images."""

    shape: Implicit
    relief: Relief
    radius: float
    """Radius of the sphere of the same volume [m]."""
    body: str
    """The body whose published reflectance it has."""
    mean_albedo: float
    views: int = 120
    image_size: int = 512
    """Width and height [px]."""
    focal_px: float = 3000.0
    """Images of 512 pixels are 9.8 degrees wide."""


BODIES = {
    # Bennu: 245 m, a rubble pile with boulders of up to a fifth of its radius and worn, shallow craters.
    "topshape": BodyPreset(
        shape=spinning_top,
        relief=Relief(
            slope_deg=9.0,
            longest=0.8,
            crater_density=0.035,
            crater_depth=0.55,
            largest_crater=0.75,
            boulder_cover=0.30,
            largest_boulder=0.22,
            patches=0.12,
        ),
        radius=245.0,
        body="ceres",
        mean_albedo=0.045,
    ),
    # Itokawa and Arrokoth in shape, in size between them: boulders on the lobes, smooth ground in the neck.
    "bilobed": BodyPreset(
        shape=contact_binary,
        relief=Relief(
            slope_deg=7.0,
            longest=0.7,
            crater_density=0.05,
            crater_depth=0.75,
            largest_crater=0.6,
            boulder_cover=0.16,
            largest_boulder=0.16,
            patches=0.18,
        ),
        radius=900.0,
        body="ceres",
        mean_albedo=0.09,
    ),
    # Eros: 8.4 km, craters of all sizes under regolith, few boulders, a saddle.
    "potato": BodyPreset(
        shape=bent_potato,
        relief=Relief(
            slope_deg=6.0,
            longest=0.8,
            crater_density=0.13,
            crater_depth=1.0,
            largest_crater=0.9,
            boulder_cover=0.03,
            largest_boulder=0.05,
            patches=0.10,
        ),
        radius=8420.0,
        body="vesta",
        mean_albedo=0.25,
    ),
}
