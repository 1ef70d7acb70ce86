"""Stand-ins for a joint estimate and for searches by many estimates, for tests of what surrounds them."""

from __future__ import annotations

import numpy as np

from photoclinometry.adjust import Adjustment, Noise
from photoclinometry.model.errors import InputError
from photoclinometry.pipeline import common_sun_error, response_check


def not_adjusted(scene, message="not adjusted", *, pose_priors=None, brightness_sigma=0.001):
    """The scene as if it were adjusted."""
    noise = Noise(
        keypoint_factor=1.0,
        keypoint_correlation_px=1.0,
        pose_only_keypoint_factor=1.0,
        sparse_keypoint_factor=1.0,
        brightness_sigma=brightness_sigma,
        brightness_correlation_px=1.0,
    )
    used = np.zeros(0, bool) if pose_priors is None else np.isfinite(pose_priors.center_sigma)
    return Adjustment(scene, True, message, (), noise, scene.tracks.lit, pose_priors_used=used)


def look_for_no_errors_of_brightness(patch):
    """Suns that are off alike and images that are not linear are not looked for: both take more estimates than a small
    map does. `test_common_sun_error.py` and `test_response.py` prove the search."""

    def not_told(*_):
        raise InputError("a test does not look for it")

    patch.setattr(response_check, "response_of", not_told)
    patch.setattr(common_sun_error, "common_sun_turn", not_told)
