"""Random ground as the simulation has it, and points well inside of it."""

import numpy as np
from scipy.ndimage import gaussian_filter

from photoclinometry.simulate.surface import Surface


def rough_surface(size=40, spacing=3.0, seed=0, amplitude=4.0):
    """A smooth random surface; albedo rises from 0.2 to 0.4 towards the east."""
    rng = np.random.default_rng(seed)
    height = gaussian_filter(rng.standard_normal((size, size)), 2.0)
    albedo = np.broadcast_to(np.linspace(0.2, 0.4, size), (size, size)).copy()
    return Surface(height * amplitude / height.std(), albedo, spacing, (-7.0, 11.0))


def inner_points(surface, count, seed=1, margin=2):
    """Points (count, 2) at least `margin` samples inside."""
    x0, x1, y0, y1 = surface.extent
    m = margin * surface.spacing
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(x0 + m, x1 - m, count), rng.uniform(y0 + m, y1 - m, count)], -1)
