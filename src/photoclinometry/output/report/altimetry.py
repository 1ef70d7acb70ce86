"""The figure of a laser altimeter's tracks over a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.draw import panels, save, style
from photoclinometry.surface.relief import local_frame

if TYPE_CHECKING:
    from photoclinometry.adjust import AltimetryFit

TRACKS = 4
"""Tracks that are drawn: those of the most shots on the map."""
CAPTION = (
    "Heights above the mean plane along the tracks of most shots: of the shots, less the shift of their track, and of "
    "the map below them. Crosses are shots that were not used."
)
_MAP, _SHOTS, _LEFT_OUT = "#0072b2", "black", "#d55e00"
"""Blue and vermilion of Okabe and Ito's palette."""


def draw_tracks(path: Path, scene: Scene, fit: AltimetryFit) -> Path:
    """Profiles of the shots on a map, and of the map below them."""
    count = np.bincount(fit.tracks.track[fit.met], minlength=len(fit.tracks.name))
    chosen = np.argsort(-count, kind="stable")[: min(TRACKS, int(np.count_nonzero(count)))]
    to_local = local_frame(scene).inverse()
    with style():
        figure, axes = panels(len(chosen), 1, 6.4, 0.3, (0.0, 0.75), (0.8, 0.2, 0.6, 0.35))
        for axis, n in zip(axes[:, 0], chosen, strict=True):
            own = np.flatnonzero(fit.met & (fit.tracks.track == n))
            shots = fit.tracks.position[own] - fit.shift[n]
            ground = shots - fit.off[own, None] * scene.landmarks.normal[fit.landmark[own]]
            measured, mapped, used = to_local(shots), to_local(ground), fit.used[own]
            along = np.linalg.norm(measured[:, :2] - measured[0, :2], axis=1)
            order = np.argsort(along)
            axis.plot(along[order], mapped[order, 2], color=_MAP, lw=1.2, label="map")
            axis.plot(along[used], measured[used, 2], ".", color=_SHOTS, ms=3, label="shots")
            if not used.all():
                axis.plot(along[~used], measured[~used, 2], "x", color=_LEFT_OUT, ms=5, label="not used")
            axis.set_title(fit.tracks.name[n], loc="left")
            axis.set_ylabel("height [m]")
        axes[-1, 0].set_xlabel("distance along the track [m]")
        axes[0, 0].legend(frameon=False, fontsize="small", ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
        return save(figure, path)
