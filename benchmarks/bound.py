"""Bound on a map of a simulated site: the fit of its reflectance model to the images at the true geometry.

    python benchmarks/bound.py RUN SITE       # a finished run, and the folder of its simulated site

Prints PSNR (all pixels; lit ones) of four maps: the run's; the truth averaged over the optics' footprint; true poses,
Suns and positions with normals, albedos and scales fitted to the images; and that amidst the true ground of the
reference image, whose shadows fall onto it. What the last one lacks no better matching or estimate can give: it is the
model, noise, and relief below a pixel. Where the ground has another reflectance than the run's, a line says by how
much normals and albedos are off that are fitted with the ground's own: what inverting with it can give. Where views
were held out, a last line gives their PSNR, and what it would be were each as bright as suits it most, by up to 3 %:
what of it is how bright the model says other phases are.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from photoclinometry.evaluate.evaluate import held_out_table, view_psnr
from photoclinometry.io.held_out import read_held_out
from photoclinometry.io.run_files import HELD_OUT_FILE, read_run, run_images
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.image import Image
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Scene, Surroundings, Views
from photoclinometry.photometry.predict import observation_brightness, reflectance_of
from photoclinometry.photometry.shading import brightness_on_surface, normals_from_shading
from photoclinometry.simulate.photometry import radiance_factor
from photoclinometry.simulate.truth import Truth, truth_maps
from photoclinometry.simulate.truth_file import read_truth

FITS = 4
"""Of scales, then of normals and albedos, in turns."""
BRIGHTER = np.linspace(0.97, 1.03, 13)
"""How much brighter a view held out may be than the model says, to find what suits it most."""


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
    frame = Region.of_image(camera.height, camera.width, stride=2)
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


def with_reflectance_of_ground(true: Scene, truth: Truth) -> Scene:
    """Normals and albedos fitted to the images by the true reflectance instead of the scene's, scales held.

    The scene's fit does it, to brightness times what the scene's model gives over what the true one gives: the same
    ground explains both, at the normals of each turn.
    """
    fitted = true
    for _ in range(FITS):
        tracks, marks = fitted.tracks, fitted.landmarks
        at, center = tracks.landmark, fitted.views.body_from_cam.translation[tracks.view]
        angles = photometric_angles(fitted.views.sun[tracks.view], center, marks.position[at], marks.normal[at])
        own = marks.albedo[at] * reflectance_of(fitted)(*angles)
        ground = radiance_factor(truth.photometry, marks.albedo[at], *angles)
        ratio = np.divide(own, ground, out=np.ones_like(own), where=ground > 0)
        bias = fitted.views.bias[tracks.view]
        as_own = replace(true.tracks, brightness=bias + (true.tracks.brightness - bias) * ratio)
        fitted = normals_from_shading(replace(fitted, tracks=as_own))
    return fitted


def errors(fitted: Scene, true: Scene) -> str:
    """Mean errors of normals, and of albedos after one common factor."""
    turn = np.degrees(np.mean(angle_between(fitted.landmarks.normal, true.landmarks.normal)))
    ratio = fitted.landmarks.albedo / true.landmarks.albedo
    return f"normals {turn:.2f} deg, albedo {100 * np.mean(np.abs(ratio / np.median(ratio) - 1)):.2f} %"


def held_out_psnr(scene: Scene, held_out: Views, images: Sequence[Image]) -> np.ndarray:
    """(len(BRIGHTER), H) PSNR [dB] of H views held out, with their scales times BRIGHTER."""
    tables = [held_out_table(scene, replace(held_out, scale=held_out.scale * by), images) for by in BRIGHTER]
    return np.array([[row["psnr_db"] for row in table] for table in tables])


def main(run: Path, site: Path) -> None:
    scene, truth = read_run(run), read_truth(site / "truth.h5")
    images = run_images(site / "site.toml", scene.views.name)
    ground = at_true_geometry(scene, truth, images)
    true = with_scales(ground)
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
        print(f"; {errors(map_, true)}" if map_ is fitted else "")
    if truth.photometry != scene.reflectance:
        print(f"fitted with the ground's own reflectance: {errors(with_reflectance_of_ground(ground, truth), ground)}")
    held_out = read_held_out(run / HELD_OUT_FILE)
    if held_out is not None:
        psnr = held_out_psnr(scene, held_out, run_images(site / "site.toml", held_out.name))
        as_is, best = psnr[len(BRIGHTER) // 2].mean(), psnr.max(0).mean()
        print(f"held out: {as_is:.2f} dB; each as bright as suits it most, within 3 %: {best:.2f} dB")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
