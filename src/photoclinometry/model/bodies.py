"""The bodies that this package knows by name: their numbers and sizes. What they reflect is in `model/reflectance`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Body:
    """What is known of a body; None of what is not, or is not used."""

    name: str
    """In lower case, as `site.toml` has it; case does not count there."""
    iau_number: int | None = None
    """NAIF identifier in PROJ's IAU_2015, under this name. A code there is 100 times that, plus the kind of system."""
    semi_axes_m: tuple[float, float, float] | None = None
    """Of the ellipsoid that plans and views are of, along x, y, z of the body-fixed frame [m]; from pck00010.tpc (NAIF)
    where no other source is named."""
    mean_radius_m: float | None = None
    """Of the simulator's places [m]."""


BODIES = (
    Body(name="67p"),
    Body(name="annefrank"),
    Body(name="apophis"),
    Body(name="arrokoth"),
    Body(name="bennu", semi_axes_m=(283.065, 271.215, 249.72)),  # bennu_v16.tpc (NAIF)
    Body(name="borrelly", iau_number=1000005),
    Body(name="braille"),
    Body(
        name="ceres",
        iau_number=2000001,
        semi_axes_m=(482e3, 482e3, 446e3),  # dawn_ceres_v05.tpc (NAIF)
        mean_radius_m=470e3,  # Russell et al. (2016), Science 353, 1008
    ),
    Body(name="charon"),
    Body(name="churyumov-gerasimenko", iau_number=1000012),
    Body(name="davida", iau_number=2000511),
    Body(name="deimos", iau_number=402, semi_axes_m=(7.8e3, 6.0e3, 5.1e3)),
    Body(name="didymos"),
    Body(name="dimorphos"),
    Body(name="dinkinesh"),
    Body(name="donaldjohanson"),
    Body(name="eros", iau_number=2000433, semi_axes_m=(17e3, 5.5e3, 5.5e3)),
    Body(name="gaspra", iau_number=9511010, semi_axes_m=(9.1e3, 5.2e3, 4.4e3)),
    Body(name="halley", iau_number=1000036),
    Body(name="hartley 2", iau_number=1000041),
    Body(name="ida", iau_number=2431010, semi_axes_m=(26.8e3, 12e3, 7.6e3)),
    Body(name="itokawa", iau_number=2025143, semi_axes_m=(274.0, 156.0, 138.0)),  # itokawa_gaskell_n3.tpc (NAIF)
    Body(name="kleopatra", iau_number=2000216),
    Body(name="lutetia", iau_number=2000021, semi_axes_m=(62e3, 50.5e3, 46.5e3)),
    Body(name="mathilde", iau_number=2000253, semi_axes_m=(33e3, 24e3, 23e3)),
    Body(name="mercury", iau_number=199),
    Body(name="moon", iau_number=301, semi_axes_m=(1737.4e3, 1737.4e3, 1737.4e3)),
    Body(name="phobos", iau_number=401, semi_axes_m=(13e3, 11.4e3, 9.1e3)),
    Body(name="pluto"),
    Body(name="psyche", iau_number=2000016),
    Body(name="ryugu", semi_axes_m=(448.0, 448.0, 448.0)),  # mean radius: Watanabe et al. (2019), Science 364, 268
    Body(name="steins", iau_number=2002867),
    Body(name="tempel 1", iau_number=1000093),
    Body(name="toutatis", iau_number=2004179),
    Body(
        name="vesta",
        iau_number=2000004,
        semi_axes_m=(289e3, 280e3, 229e3),
        mean_radius_m=262e3,  # Russell et al. (2012), Science 336, 684
    ),
    Body(name="wild 2", iau_number=1000107),
)
"""All that a site may name without a radius, by name: those of PROJ's IAU_2015, and others that missions went to."""

IAU_NUMBER = {
    body.name: body.iau_number
    for body in sorted(BODIES, key=lambda body: body.iau_number or 0)
    if body.iau_number is not None
}
"""Of the bodies in PROJ's IAU_2015, by name, from the lowest number on."""
SEMI_AXES_M = {body.name: body.semi_axes_m for body in BODIES if body.semi_axes_m is not None}
"""Of the bodies whose semi-axes are known, by name."""
MEAN_RADIUS_M = {body.name: body.mean_radius_m for body in BODIES if body.mean_radius_m is not None}
"""Of the bodies that places are simulated on, by name."""


def is_known(name: str) -> bool:
    """Whether `site.toml` may name a body without its radius; case does not count."""
    return name.lower() in {body.name for body in BODIES}
