"""`phomo measure`: lengths, slopes and volumes of a map."""

from __future__ import annotations

from pathlib import Path

import tyro


def measure(
    run: tyro.conf.Positional[Path],
    /,
    line: tuple[float, float, float, float] | None = None,
    outline: tuple[float, ...] | None = None,
) -> None:
    """Measure distances, slopes and volumes of a map, each with one standard deviation.

    Places are pixels of the reference image, as the viewer shows them. Heights are over the map's mean plane, a volume
    is over the plane through the ground along its outline, that of a hollow negative. Lengths are in metres, or in GSD
    where the map has no unit of length.

    Args:
        run: Folder of a finished run.
        line: Two places, x y x y [px]: how far the second is from the first, how much higher, and the slope up to it.
            Range: within the map.
        outline: Corners of a polygon, x y x y x y ... [px]: the volume within. Range: within the map.
    """
    import photoclinometry as pcm
    from photoclinometry.model.errors import InputError

    if line is None and outline is None:
        raise InputError("nothing to measure; give two places (--line x y x y) or an outline (--outline x y x y x y)")
    scene = pcm.read_scene(run)
    if line is not None:
        start, end = line[:2], line[2:]
        print("distance:", pcm.distance(scene, start, end))
        print("height of the second place over the first:", pcm.height_difference(scene, start, end))
        print("slope upwards:", pcm.slope(scene, start, end))
    if outline is not None:
        if len(outline) % 2:
            raise InputError(f"--outline has {len(outline)} numbers; give x and y of each corner")
        print("volume:", pcm.volume(scene, list(zip(outline[::2], outline[1::2], strict=True))))
