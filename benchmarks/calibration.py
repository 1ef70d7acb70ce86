"""Whether the stated uncertainties are those of the errors: many draws of the noise over one ground.

    python benchmarks/calibration.py [side] [views] [draws]

Every draw has new errors of keypoints, brightness and Sun directions, and new scales and biases, all from the
distributions that the estimate assumes. NEES is the normalised estimation error squared, 1 where honest. The bound is
that of Cramer and Rao: the least RMS error of any unbiased estimate from these measurements alone, smoothness left out.
Smoothness is no measurement: the ground does not follow it, so it is tried with and without.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matched import Noise, matched_problem
from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.evaluate.metrics import calibration, normalised_square
from photoclinometry.evaluate.sigma_calibration import scene_errors
from photoclinometry.model.geometry import sphere_step
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import observation_brightness

KINDS = ("position", "normal", "albedo", "rotation", "center", "sun", "scale", "bias")
BRIGHTNESS_SIGMA = 0.0015


def options(smooth: bool) -> AdjustOptions:
    """With the noise as it is drawn."""
    return AdjustOptions(
        keypoint_sigma_px=Noise().keypoint_px,
        brightness_sigma=BRIGHTNESS_SIGMA,
        keypoint_correlation_px=1.0,
        brightness_correlation_px=1.0,
        keypoint_loss=np.inf,
        brightness_loss=np.inf,
        scale_sigma=Noise().scale,
        bias_sigma=Noise().bias,
        smooth_sigma_rad=0.2 if smooth else 0.0,
        reflectance_sigma=0.0,
        max_reweightings=1,
    )


def draw(start: Scene, truth: Scene, rng: np.random.Generator) -> tuple[Scene, Scene]:
    """The start and the truth with new errors of all that is measured, and new scales and biases."""
    noise, views, count = Noise(), truth.views, len(truth.views)
    pose = views.body_from_cam
    measured = sphere_step(views.sun, noise.sun_rad * rng.normal(size=(count, 2)))
    views = replace(
        views,
        scale=1 + noise.scale * rng.normal(size=count),
        bias=noise.bias * rng.normal(size=count),
        sun_measured=np.einsum("kji,kj->ki", pose.rotation, measured),
    )
    truth = replace(truth, views=views)
    tracks, keypoint = truth.tracks, np.empty_like(truth.tracks.keypoint)
    for k in range(count):
        seen = tracks.view == k
        keypoint[seen] = views.project(k, truth.landmarks.position[tracks.landmark[seen]])
    tracks = replace(
        tracks,
        keypoint=keypoint + noise.keypoint_px * rng.normal(size=keypoint.shape),
        brightness=observation_brightness(truth) + BRIGHTNESS_SIGMA * rng.normal(size=len(tracks)),
    )
    started = replace(start.views, sun_measured=views.sun_measured)
    return replace(start, tracks=tracks, views=started), replace(truth, tracks=tracks)


def measure(side: int, views: int, draws: int, smooth: bool, seed: int = 0) -> dict[str, dict[str, float]]:
    """By kind: mean NEES, the share inside 68 %, RMS error, and its ratio to the stated sigma, all of `draws`."""
    start, truth = matched_problem(side, views, seed=seed)
    rng = np.random.default_rng(seed + 1)
    errors: dict[str, list] = {kind: [] for kind in KINDS}
    stated: dict[str, list] = {kind: [] for kind in KINDS}
    for _ in range(draws):
        first, true = draw(start, truth, rng)
        found = adjust(first, options(smooth)).scene
        error = scene_errors(found, true.views, true.landmarks, 1.0)
        for kind in KINDS:
            errors[kind].append(error[kind])
            stated[kind].append(found.uncertainty[kind])
    table = {}
    for kind in KINDS:
        error, covariance = np.concatenate(errors[kind]), np.concatenate(stated[kind])
        square = np.sum(error.reshape(len(error), -1) ** 2, 1)
        variance = np.trace(covariance, axis1=1, axis2=2) if covariance.ndim == 3 else covariance**2
        known = np.isfinite(variance)
        each = [np.nanmean(normalised_square(e, s)) for e, s in zip(errors[kind], stated[kind], strict=True)]
        table[kind] = {
            "nees": float(np.mean(each)),
            "nees_spread": float(np.std(each) / np.sqrt(draws)),
            "within_68": calibration(error, covariance, "x")["x_within_68_percent"],
            "rms": float(np.sqrt(np.mean(square[known]))),
            "sigma": float(np.sqrt(np.mean(variance[known]))),
        }
    return table


def main(side: int = 40, views: int = 10, draws: int = 100) -> None:
    tables = {smooth: measure(side, views, draws, smooth) for smooth in (True, False)}
    for smooth, table in tables.items():
        print(f"{side} x {side} landmarks, {views} views, {draws} draws, {'with' if smooth else 'without'} smoothness")
        print(f"{'':10} {'NEES':>14} {'in 68 %':>8} {'RMS error':>11} {'/ stated':>9} {'/ bound':>8}")
        for kind, row in table.items():
            nees = f"{row['nees']:.3f} +- {row['nees_spread']:.3f}"
            ratio, bound = row["rms"] / row["sigma"], row["rms"] / tables[False][kind]["sigma"]
            print(f"{kind:10} {nees:>14} {row['within_68']:8.1f} {row['rms']:11.4g} {ratio:9.3f} {bound:8.3f}")


if __name__ == "__main__":
    import sys

    main(*map(int, sys.argv[1:]))
