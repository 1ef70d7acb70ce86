"""Gradients of the brightness that a map predicts in its images.

Noise of an image is in its gradients, too: they look larger than those of the ground, and the errors of positions that
follow from them smaller. A map from many images predicts brightness with a fraction of the noise of one. Gradients of
predicted brightness take the place of those of the image in the linearisation, as in inverse compositional alignment
(Baker and Matthews 2004, doi:10.1023/B:VISI.0000011205.11775.fd).
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.sampling import central_difference
from photoclinometry.model.scene import Scene
from photoclinometry.model.threads import in_threads
from photoclinometry.photometry.render import landmark_brightness


def with_predicted_gradients(scene: Scene, gradient: np.ndarray) -> np.ndarray:
    """Gradients (N, 2) float32 of the predicted brightness, those given where the map has no neighbours for one.

    gradient: (N, 2) of the images at the projections of the landmarks, along x and y [brightness per px]. They are
    returned as they are for a map whose landmarks are more than a pixel apart: differences between its landmarks see
    less of the ground than a gradient between pixels. Raises InputError where the scene has no reflectance model.
    """
    if scene.region.stride > 1:
        return gradient
    tracks, found = scene.tracks, gradient.astype(np.float32)

    def of_view(k: int) -> None:
        seen = np.flatnonzero(tracks.view == k)
        predicted = predicted_gradient(scene, k)[tracks.landmark[seen]]
        known = np.isfinite(predicted).all(-1)
        found[seen[known]] = predicted[known]

    in_threads(of_view, range(len(scene.views)))
    return found


def predicted_gradient(scene: Scene, view: int) -> np.ndarray:
    """Gradient (J, 2) of the predicted brightness in a view's image at the landmarks [brightness per px].

    NaN where a landmark lacks a neighbour on either side. Raises InputError where the scene has no reflectance model.
    """
    brightness = scene.grid(landmark_brightness(scene, view))
    pixel = scene.grid(scene.views.project(view, scene.landmarks.position))
    (x_row, y_row), (x_col, y_col) = (np.moveaxis(_difference(pixel, axis), -1, 0) for axis in (0, 1))
    of_row, of_col = (_difference(brightness, axis) for axis in (0, 1))
    # Brightness changes along rows and columns as the pixel does: d of_row = x_row gx + y_row gy, and so for columns.
    area = x_row * y_col - y_row * x_col
    area[area == 0.0] = np.nan
    along_x, along_y = of_row * y_col - of_col * y_row, of_col * x_row - of_row * x_col
    return (np.stack([along_x, along_y], -1) / area[..., None])[scene.cells]


def _difference(values: np.ndarray, axis: int) -> np.ndarray:
    """Derivative of a grid (h, w, ...) by row or column: of a quartic through five cells, or else a parabola through
    three; NaN with fewer."""
    derivative = central_difference(values, axis)
    to, of = np.moveaxis(derivative, axis, 0), np.moveaxis(values, axis, 0)
    wide = (8.0 * (of[3:-1] - of[1:-3]) - (of[4:] - of[:-4])) / 12.0
    to[2:-2] = np.where(np.isfinite(wide), wide, to[2:-2])
    return derivative
