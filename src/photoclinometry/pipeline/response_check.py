"""Whether the images are linear in radiance, judged by the brightness of some landmarks."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

from photoclinometry.evaluate.cross_validation import is_larger
from photoclinometry.evaluate.response import Response, response_of
from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import Reflectance, starting_model
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.map_stages import IntermediateMap

log = logging.getLogger(__name__)

RESPONSE_LANDMARKS = 250
"""Approximate number of landmarks used. With 400, exponents of 16 maps of encoded images differ by 0.03 in the median,
and take half as long again; with 120 they scatter by 0.1 to 0.3."""
NOTICEABLE = math.log(1.3)
"""Logarithm of an exponent below which images are left as they are. Images encoded for display have 1.8 and more. Wrong
reflectance models give exponents of 0.93 to 1.08 on sites that they fit well, and of 1.45 on sites that they fit
badly."""
RESPONSE_MODEL = "hapke"
"""Fitted besides the model of the last estimate, see `response_models`."""
CODE = "response-not-linear"
METRIC = "response_gamma"
"""Name of the exponent among the figures of a run."""
LEAST_GAIN = 0.08
"""Least share by which views must be predicted better: a wrong reflectance model may cause less."""
CONFIDENCE = 0.995
"""Views are predicted better with this probability, see `is_larger`."""


@dataclass(frozen=True, kw_only=True)
class ResponseCheck:
    """The exponent of the images' response."""

    gamma: float
    """The power to which the numbers are to be raised; NaN where the images do not determine it."""
    is_clear: bool
    """Whether it is not 1, and matters."""

    def metrics(self) -> dict[str, float]:
        """For `metrics.json`; none where the images do not determine it."""
        return {} if math.isnan(self.gamma) else {METRIC: self.gamma}


@dataclass(frozen=True, kw_only=True)
class CheckResponse(Stage[ResponseCheck]):
    """Looks for an exponent that makes images linear, and warns of it."""

    name = "response"
    result = ResponseCheck
    relit: Keyed[IntermediateMap]
    models: tuple[Reflectance, ...]
    """As they are known beforehand; see `response_models`."""
    stated: tuple[float, ...]
    """Exponents that the site states for its cameras, and with which the images were decoded; each once."""

    def make(self, tools: Tools) -> ResponseCheck:
        scene = self.relit.value.scene
        try:
            found = response_of(scene, self.models, RESPONSE_LANDMARKS)
        except InputError as error:
            log.info("images are not checked for linearity: %s", error)
            return ResponseCheck(gamma=math.nan, is_clear=False)
        gamma, sigma = found.gamma, found.gamma * found.sigma
        clear = is_clear(found)
        if clear:
            warn(
                log, "response-not-linear",
                "the numbers of the images are not linear in radiance: raised to the power %.2f +- %.2f, views predict "
                "each other better by %.0f %%. Heights, normals and albedos are wrong. Get images that are linear, or "
                "%s in site.toml (`phomo calibrate --response` finds it)",
                gamma, sigma, 100.0 * found.gain, remedy(gamma, self.stated),
            )  # fmt: skip
        say_found(f"gamma {gamma:.2f} +- {sigma:.2f}, {100.0 * found.gain:.0f} % better")
        return ResponseCheck(gamma=gamma, is_clear=clear)


def response_models(scene: Scene, last: Reflectance) -> tuple[Reflectance, ...]:
    """The model of the last estimate, and Hapke's.

    A model that was chosen for images of a wrong response may compensate for most of it, as Minnaert's parameter does.
    """
    return (last, starting_model(RESPONSE_MODEL, scene.body)) if last.name != RESPONSE_MODEL else (last,)


def remedy(gamma: float, stated: tuple[float, ...]) -> str:
    """The correction to write, where images were decoded with stated exponents."""
    if len(stated) == 1:
        return f"write gamma = {gamma * stated[0]:.2f} to the camera"
    return f"multiply the gamma of each camera by {gamma:.2f}"


def is_clear(found: Response) -> bool:
    """Whether images are not linear, and it matters."""
    better = found.gain > LEAST_GAIN and is_larger(found.linear_error, found.decoded_error, CONFIDENCE)
    return better and abs(found.log_gamma) > NOTICEABLE
