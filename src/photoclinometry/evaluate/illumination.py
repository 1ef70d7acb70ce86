"""Directions of the Suns and the cameras over a map."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.geometry import angle_between
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.scene import Scene, Views
from photoclinometry.surface.relief import angles_from_sun, local_frame

ANGLES = ("incidence", "emission", "phase")


def sun_span_deg(views: Views) -> float:
    """The greatest angle between the Suns of two views [degrees]."""
    return float(np.degrees(angle_between(views.sun[:, None], views.sun[None])).max())


def view_angles_deg(scene: Scene) -> dict[str, np.ndarray]:
    """(K,) medians of incidence, emission and phase [degrees] over the landmarks that each view measures, by their
    normals; NaN of a view that measures none."""
    tracks, views, landmarks = scene.tracks, scene.views, scene.landmarks
    found = np.full((len(views), len(ANGLES)), np.nan)
    for k in np.unique(tracks.view):
        at = tracks.landmark[tracks.view == k]
        center = views.body_from_cam.translation[k]
        mu0, mu, phase = photometric_angles(views.sun[k], center, landmarks.position[at], landmarks.normal[at])
        angles = np.arccos(np.clip(mu0, -1.0, 1.0)), np.arccos(np.clip(mu, -1.0, 1.0)), phase
        found[k] = np.degrees(np.median(angles, axis=1))
    return dict(zip(ANGLES, found.T, strict=True))


def light_spans_deg(scene: Scene) -> dict[str, float]:
    """Ranges of the illumination over the views, for `metrics.json`.

    The greatest angle between two Suns; the smallest arc of azimuths, in the mean plane, that holds all Suns; and the
    ranges of `view_angles_deg` of incidence and phase.
    """
    angles, frame = view_angles_deg(scene), local_frame(scene)
    azimuth = np.array([angles_from_sun(frame, sun)[0] for sun in scene.views.sun])
    found = {
        "suns_span_deg": sun_span_deg(scene.views),
        "sun_azimuth_span_deg": float(np.degrees(smallest_arc(azimuth))),
    }
    for name in ("incidence", "phase"):
        known = angles[name][np.isfinite(angles[name])]
        if len(known):
            found[f"{name}_span_deg"] = float(np.ptp(known))
    return found


def smallest_arc(azimuth: np.ndarray) -> float:
    """Length [rad] of the smallest arc of a circle that holds all azimuths (n,) [rad]."""
    around = np.sort(azimuth % (2.0 * np.pi))
    gaps = np.diff(around, append=around[0] + 2.0 * np.pi)
    return float(2.0 * np.pi - gaps.max())
