"""Rendering: predicted brightness at landmarks, on the map's grid, and in any view.

Relighting is rendering with another Sun. Cast shadows are off by default, as in the paper's renderings.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.sampling import filled_from_nearest, gaussian, masked_filter, sample, smoothing_px
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import reflectance_of
from photoclinometry.photometry.sampled_brightness import landmark_spacing_px
from photoclinometry.surface.map_rays import in_sunlight
from photoclinometry.surface.rasterise import draw_triangles


def landmark_brightness(
    scene: Scene,
    view: int,
    sun: np.ndarray | None = None,
    *,
    with_scale_and_bias: bool = True,
    cast_shadows: bool = False,
) -> np.ndarray:
    """Brightness (J,) of every landmark as a view's camera would measure it (Eqs. 29, 30).

    scale * albedo * rho + bias; or albedo * rho alone, which does not depend on a view's exposure. sun: (3,) towards
    the Sun in B, of any length; by default the view's own. Landmarks that are unlit or turned away give the
    bias. Raises InputError where the scene has no reflectance model.
    """
    views, landmarks = scene.views, scene.landmarks
    towards_sun = unit(views.sun[view] if sun is None else sun)
    angles = photometric_angles(
        towards_sun, views.body_from_cam.translation[view], landmarks.position, landmarks.normal
    )
    radiance = landmarks.albedo * reflectance_of(scene)(*angles)
    if cast_shadows:
        radiance = radiance * sunlit_share(scene, in_sunlight(scene, towards_sun, scene.surroundings))
    return views.scale[view] * radiance + views.bias[view] if with_scale_and_bias else radiance


def sunlit_share(scene: Scene, lit: np.ndarray) -> np.ndarray:
    """(J,) share in sunlight of the 3 x 3 landmarks about each. lit: (J,) bool, of each (`in_sunlight`).

    An image averages over its pixels and point-spread function, so that cast shadows have edges three pixels wide. At a
    stride above 1 a single landmark is as wide as that.
    """
    from scipy.ndimage import convolve

    window = np.ones((3, 3) if scene.region.stride == 1 else (1, 1))
    average, _ = masked_filter(scene.grid(lit.astype(float)), lambda grid: convolve(grid, window, mode="constant"))
    return average[scene.cells]


def as_resolved(scene: Scene, view: int, value: np.ndarray) -> np.ndarray:
    """Values (J,) of the landmarks averaged over a pixel of a view that is coarser than the map; else as they are."""
    sigma = averaging_sigma(scene, view)
    return masked_filter(scene.grid(value), gaussian(sigma))[0][scene.cells] if sigma else value


def averaging_sigma(scene: Scene, view: int) -> float:
    """Standard deviation [landmarks] of the Gaussian by which a view coarser than the map averages; 0 of others."""
    both = scene.views[[view, scene.reference]]
    finer_by = 1.0 / landmark_spacing_px(both, scene.landmarks.position, 1)[0]
    return smoothing_px(float(finer_by)) / scene.region.stride


def render_reference(
    scene: Scene, view: int | None = None, sun: np.ndarray | None = None, **options: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Brightness on the map's grid: image (h, w), zero where there is no landmark, and mask (h, w).

    As `landmark_brightness` for the camera of `view` (default: the reference); options are its options.
    """
    view = scene.reference if view is None else view
    image = scene.grid(landmark_brightness(scene, view, sun, **options))
    mask = np.isfinite(image)
    return np.where(mask, image, 0.0), mask


def render_view(
    scene: Scene,
    view: int,
    sun: np.ndarray | None = None,
    *,
    faces: np.ndarray | None = None,
    with_scale_and_bias: bool = True,
    cast_shadows: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """The map as one view's camera sees it: image (H, W), zero outside the map, and mask (H, W) bool.

    The landmarks' grid is a mesh; the nearest surface hides those behind it. Brightness is computed at its vertices and
    interpolated at pixel centres as `draw_smoothly` does. with_scale_and_bias, cast_shadows: as of
    `landmark_brightness`. faces: `landmark_faces(scene)`, to compute them only once for many views.
    """
    radiance = landmark_brightness(scene, view, sun, with_scale_and_bias=False, cast_shadows=cast_shadows)
    image, mask = draw_smoothly(scene, view, as_resolved(scene, view, radiance), faces)
    if with_scale_and_bias:
        image[mask] = scene.views.scale[view] * image[mask] + scene.views.bias[view]
    return image, mask


def draw_smoothly(
    scene: Scene, view: int, value: np.ndarray, faces: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """`draw_landmarks` of values (J,) that are nowhere negative, such as radiance, by a cubic spline over the map's
    grid: as images are interpolated between their pixels (`sample_image`).

    A map holds brightness of wavelengths down to two landmarks. Halfway between landmarks, linear interpolation reduces
    the amplitude of waves of four landmarks by three tenths: 1 - cos(45 degrees).
    """
    cell, mask = draw_landmarks(scene, view, cell_coordinates(scene), faces)
    drawn = np.zeros(mask.shape)
    drawn[mask] = np.maximum(by_splines(scene, value, cell[mask]), 0.0)
    return drawn, mask


def cell_coordinates(scene: Scene) -> np.ndarray:
    """(J, 2) column and row of each landmark in the map's grid, whose first one is at (0.5, 0.5)."""
    row, col = scene.cells
    return np.stack([col, row], axis=-1) + 0.5


def by_splines(scene: Scene, value: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """(n,) values (J,) of the landmarks at places (n, 2) in the map's grid (`cell_coordinates`), by a cubic spline.

    Holes have the nearest landmark's value.
    """
    grid = scene.grid(value)
    return sample(filled_from_nearest(grid, np.isfinite(grid)), cell)


def draw_landmarks(
    scene: Scene, view: int, value: np.ndarray, faces: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Values (J,) or (J, n) of the landmarks drawn in a view: image (H, W) or (H, W, n), linear between landmarks and
    zero outside the map, and mask (H, W)."""
    camera = scene.views.cameras[view]
    faces = landmark_faces(scene) if faces is None else faces
    in_cam = scene.views.body_from_cam[view].inverse()(scene.landmarks.position)
    return draw_triangles(camera.pixel_from_cam(in_cam), in_cam[:, 2], value, faces, (camera.height, camera.width))
