"""Bound on the prediction of whole disks of a simulated body by a surface at the images' resolution without other
errors.

Images hold relief down to half a ground sample. A map has what their pixels and optics resolve. Rendered are the true
mesh and its mean over that resolution (place, normal and albedo), with true poses and Suns, with and without the true
point-spread function. The reflectance is the true one at the body's mean albedo.

    phomo simulate --preset bilobed --views 120 --image-size 512 --reflectance hapke --seed 5 --out bil
    python benchmarks/body_bound.py bil
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.body.renderings import disk_psnr
from photoclinometry.evaluate.body import mean_around, resolution_gsd
from photoclinometry.io.site import read_site
from photoclinometry.io.site_images import load_images
from photoclinometry.photometry.shape_rendering import ShadedSurface, rendered_shape, through_optics
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.simulate.bodies.truth import BodyTruth, read_body_truth
from photoclinometry.simulate.photometry import Photometry, radiance_factor
from photoclinometry.surface.mesh_rays import MeshRays

PART = 200_000
"""Vertices that are averaged at a time: their neighbours fill memory."""


@dataclass(frozen=True)
class AtMeanAlbedo:
    """The simulator's reflectance, whose shape depends a little on the albedo, at one albedo."""

    photometry: Photometry
    albedo: float

    def __call__(self, mu0: np.ndarray, mu: np.ndarray, phase: np.ndarray) -> np.ndarray:
        albedo = np.full(len(mu0), self.albedo)
        return radiance_factor(self.photometry, albedo, mu0, mu, phase) / self.albedo


def surfaces(truth: BodyTruth) -> dict[str, ShadedSurface]:
    """The true surface, and its mean over the resolution of the images."""
    surface, mesh = truth.surface, MeshSurface(truth.surface.vertices, truth.surface.faces, closed=True)
    reflectance: Any = AtMeanAlbedo(truth.photometry, float(surface.albedo.mean()))
    width = resolution_gsd(truth) * truth.gsd
    parts = np.array_split(surface.vertices, max(1, len(surface.vertices) // PART))
    place, normal, albedo = (
        np.concatenate(each) for each in zip(*(mean_around(truth, mesh, part, width) for part in parts), strict=True)
    )

    def shaded(vertices: np.ndarray, normals: np.ndarray, values: np.ndarray) -> ShadedSurface:
        rays = MeshRays(vertices, surface.faces, surface.spacing)
        return ShadedSurface(rays=rays, normals=normals, albedo=values, reflectance=reflectance)

    return {
        "true surface": shaded(surface.vertices, surface.normals, surface.albedo),
        f"mean over {resolution_gsd(truth):.2f} GSD": shaded(place, normal, albedo),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("site", type=Path, help="folder of a simulated body")
    parser.add_argument("--views", type=int, default=12, help="how many images, spread over all")
    options = parser.parse_args()
    truth, site = read_body_truth(options.site / "truth.h5"), read_site(options.site / "site.toml")
    images, views = load_images(site), truth.views
    chosen = np.linspace(0, len(images) - 1, options.views).astype(int)
    for name, surface in surfaces(truth).items():
        found = []
        for k in chosen:
            drawn = rendered_shape(surface, views.cameras[k], views.body_from_cam[k], views.sun[k])
            drawn = views.scale[k] * drawn + views.bias[k]
            blurred = through_optics(drawn, truth.psf_sigma_px)
            absolute = site.brightness == "iof"
            found.append([disk_psnr(images[k], each, absolute=absolute) for each in (drawn, blurred)])
        sharp, blurry = np.mean(found, axis=0)
        print(f"{name}: PSNR {sharp:.1f} dB, {blurry:.1f} dB with the point-spread function")


if __name__ == "__main__":
    main()
