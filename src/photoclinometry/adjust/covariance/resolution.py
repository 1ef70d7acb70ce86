"""Relief that images are too coarse to show, as an error of the positions."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.scene import Scene
from photoclinometry.surface.relief import local_frame
from photoclinometry.surface.sampling import gaussian, masked_filter, smoothing_px

FINEST = 1.0
"""Standard deviation of the Gaussian that takes the finest relief off the map [landmarks]: wavelengths up to six
landmarks. Of an image of one landmark a pixel, pixel and point-spread function leave about seven tenths of these. As
much as is left is missing."""

BLUR_PX = 0.7
"""Standard deviation of the Gaussian that makes such a map of the true ground [px]."""

NEARBY = 2.0
"""Standard deviation of the Gaussian over which the size of such relief is averaged [landmarks]."""

WHOLE = 0.99
"""Part of the Gaussian's weight that must fall on the map: at edges, slopes are not told from relief."""


def unresolved_relief(scene: Scene) -> np.ndarray:
    """(J, 3, 3) covariances of positions from heights over the mean plane that the map lacks about each landmark.

    Pixels are averages of the ground. What the map shows of its finest relief stands for what it does not show: where
    images leave a share m of its amplitude, sqrt(1 / m^2 - 1) times what is left is missing, as much again for m = 0.7.
    Images of several pixels a landmark are smoothed to the grid (`smoothing_px`), but blur less of it than pixels do of
    theirs; the variance that is missing goes with the square of the blur.
    """
    stride = scene.region.stride
    blur = np.hypot(BLUR_PX, smoothing_px(stride)) / stride
    position = scene.landmarks.position
    up = local_frame(scene).rotation[:, 2]
    height = scene.grid((position - position.mean(0)) @ up)
    smooth, share = masked_filter(height, gaussian(FINEST))
    fine = np.where(share > WHOLE, (height - smooth) ** 2, np.nan)
    mean, _ = masked_filter(fine, gaussian(NEARBY))
    missing = (blur / BLUR_PX) ** 2 * np.nan_to_num(mean[scene.cells])
    return missing[:, None, None] * np.outer(up, up)
