"""What bounds a map of a simulated site: how well its reflectance model explains the images at the true geometry.

    python benchmarks/bound.py RUN SITE       # a finished run, and the folder of its simulated site

Prints PSNR (all pixels; lit ones) of four maps: the run's; the truth averaged over the optics' footprint; true poses,
Suns and positions with normals, albedos and scales fitted to the images; and that amidst the true ground of the
reference image, whose shadows fall onto it. What the last one lacks no better matching or estimate can give: it is the
model, noise, and relief below a pixel.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from photoclinometry.cli.folders import read_run, run_images
from photoclinometry.evaluate import view_psnr
from photoclinometry.geometry import angle_between
from photoclinometry.io.truth import read_truth
from photoclinometry.predict import observation_brightness
from photoclinometry.render import landmark_faces
from photoclinometry.scene import Image, Region, Scene, Surroundings
from photoclinometry.shading import brightness_on_surface, normals_from_shading
from photoclinometry.simulate.truth import Truth, truth_maps

FITS = 4
"""Of scales, then of normals and albedos, in turns."""


def at_true_geometry(scene: Scene, truth: Truth, images: Sequence[Image]) -> Scene:
    """The scene with true poses, Suns, positions, mean normals and mean albedos, and brightness where they project."""
    maps = truth_maps(truth, scene.views.name[scene.reference], scene.region)
    at = scene.cells
    views = truth.views[[truth.views.name.index(name) for name in scene.views.name]]
    true = {name: getattr(views, name) for name in ("body_from_cam", "sun", "scale", "bias")}
    landmarks = replace(
        scene.landmarks, position=maps.position[at], normal=maps.normal_mean[at], albedo=maps.albedo_mean[at]
    )
    scene = replace(scene, surroundings=None)
    return brightness_on_surface(scene.with_estimate(replace(scene.views, **true), landmarks), images)


def true_surroundings(scene: Scene, truth: Truth) -> Surroundings:
    """The ground of the whole reference image, of a scene at the true geometry."""
    camera, pose = scene.views.cameras[scene.reference], scene.views.body_from_cam[scene.reference]
    frame = Region(row=0, col=0, height=camera.height, width=camera.width, stride=2)
    maps = truth_maps(truth, scene.views.name[scene.reference], frame)
    depth = pose.inverse()(maps.position)[..., 2]
    return Surroundings(depth=np.where(maps.hit, depth, np.nan), stride=frame.stride)


def with_scales(scene: Scene) -> Scene:
    """The views' scales by the median ratio of measured to modelled brightness."""
    tracks, model, scale = scene.tracks, observation_brightness(scene), scene.views.scale.copy()
    for k in range(len(scale)):
        lit = (tracks.view == k) & tracks.lit & (model > 0)
        scale[k] *= np.median(tracks.brightness[lit] / model[lit])
    return replace(scene, views=replace(scene.views, scale=scale))


def main(run: Path, site: Path) -> None:
    scene, truth = read_run(run), read_truth(site / "truth.h5")
    images = run_images(site / "site.toml", scene.views.name)
    true = with_scales(at_true_geometry(scene, truth, images))
    fitted = true
    for _ in range(FITS):
        fitted = with_scales(normals_from_shading(fitted))
    amidst = replace(fitted, surroundings=true_surroundings(fitted, truth))
    for title, map_ in (
        ("the run", scene),
        ("the truth", true),
        ("fitted at the true geometry", fitted),
        ("the same amidst the true ground", amidst),
    ):
        faces = landmark_faces(map_)
        found = [view_psnr(map_, k, image, faces) for k, image in enumerate(images)]
        psnr, lit = (np.mean([one[key] for one in found]) for key in ("psnr_db", "psnr_lit_db"))
        print(f"{title}: {psnr:.2f} dB, {lit:.2f} where lit", end="")
        if map_ is fitted:
            turn = np.degrees(np.mean(angle_between(map_.landmarks.normal, true.landmarks.normal)))
            ratio = map_.landmarks.albedo / true.landmarks.albedo
            print(
                f"; normals {turn:.2f} deg, albedo {100 * np.mean(np.abs(ratio / np.median(ratio) - 1)):.2f} %", end=""
            )
        print()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
