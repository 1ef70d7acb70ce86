"""Images whose numbers are a power of the radiance, as those encoded for display: V ~ L^(1 / gamma).

Poynton (2012), Digital Video and HD, chapter 27: displays have exponents of 1.8 to 2.6, and files are encoded by the
inverse.
"""

from __future__ import annotations

import numpy as np

LINEAR = 1.0
"""The exponent of images that are linear in radiance."""


def gamma_corrected(values: np.ndarray, gamma: float, fixed: float) -> np.ndarray:
    """Values to the power gamma, each with its sign; `fixed` (above 0) is the value that stays as it is."""
    return np.sign(values) * fixed * np.abs(values / fixed) ** gamma
