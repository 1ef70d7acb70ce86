"""Names of bodies that a site may give: those with a sphere of the IAU, and others that spacecraft have seen."""

from __future__ import annotations

import difflib

KNOWN_BODIES = (
    *("mercury", "moon", "phobos", "deimos"),
    *("ceres", "vesta", "psyche", "lutetia", "kleopatra", "mathilde", "eros", "davida", "steins", "toutatis"),
    *("itokawa", "ida", "gaspra", "bennu", "ryugu", "didymos", "dimorphos", "apophis", "annefrank", "braille"),
    *("dinkinesh", "donaldjohanson", "arrokoth", "pluto", "charon"),
    *("borrelly", "churyumov-gerasimenko", "67p", "halley", "hartley 2", "tempel 1", "wild 2"),
)
"""In lower case, as NAIF writes them."""


def unknown_body(body: str | None) -> str | None:
    """What is to be said of a body's name that is not known, in one sentence; None where there is nothing to say."""
    name = (body or "").lower()
    if body is None or name in KNOWN_BODIES:
        return None
    near = difflib.get_close_matches(name, KNOWN_BODIES, n=1)
    meant = f"did you mean {near[0]!r}? " if near else ""
    return (
        f"body {body!r} is not known: {meant}known are {', '.join(KNOWN_BODIES)}; for another body leave `body` out, "
        "and give its radius where maps of it are exported (`phomo export --radii-m`)"
    )
