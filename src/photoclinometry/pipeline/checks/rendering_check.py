"""Whether the renderings of the finished map look like the images."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping

from photoclinometry.model.warning import warn

log = logging.getLogger(__name__)

POOR_PSNR_DB = 30.0
"""Mean PSNR below which renderings differ from images by more than 3 % of the peak. Of 104 maps of sites simulated at
random those within 0.25 GSD of the truth have 32 dB and more, 40 in the median; three that are more than 1 GSD off have
20, 27 and 33."""


POOR_FIT_PERCENT = 2.0
"""If half of all lit observations differ by more than this from the map's prediction, its sigmas and its relief rest on
a model that does not fit the images. Of 218 maps those that are within 0.15 GSD of the truth have 1.8 at most, 0.5 in
the median, also of ground of another reflectance; of images of a wrong response or with all Suns off by 3 degrees 2 to
10. Detectors have noise of a half to one percent."""

OFF = "brightness_off_percent"
"""Name of that figure of a map."""


def warn_of_renderings(metrics: Mapping[str, float]) -> None:
    """Warns of renderings that differ from the images. metrics: of the map, as of `evaluate_scene`, and OFF."""
    psnr, off = metrics.get("psnr_mean_db", math.inf), metrics.get(OFF, 0.0)
    if psnr < POOR_PSNR_DB:
        found = f"by more than 3 % of their peak (mean PSNR {psnr:.1f} dB)"
    elif off > POOR_FIT_PERCENT:
        found = f"by more than {off:.1f} % of their brightness at half of all observations"
    else:
        return
    warn(
        log, "renderings-differ",
        "renderings of the map differ from the images %s: compare them in the report. Where they differ, heights, "
        "Suns, poses or brightness are wrong, or images are noisy",
        found,
    )  # fmt: skip
