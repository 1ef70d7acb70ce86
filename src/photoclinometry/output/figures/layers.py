"""The layers of a map that can be drawn: a table from which `pcm.plot`, `phomo figure` and the report follow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from photoclinometry.evaluate.evaluate import landmark_photometric_error
from photoclinometry.evaluate.sigmas import landmark_sigmas
from photoclinometry.evaluate.unreliable import albedo_is_known, normal_is_known, only_known
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import tangent_basis
from photoclinometry.model.scene import Scene
from photoclinometry.model.sigma import sigma_along
from photoclinometry.surface.relief import heights, lambert_shade, local_frame, sun_from_angles

STEEP_PERCENT = 98.0
"""Percentile of errors, sigmas and slopes of normals at which a colour scale ends; the worst few saturate."""
SHORT_TAIL_PERCENT = 99.5
"""As above, of slopes and of brightness, whose tails are short."""
HILLSHADE_SUN_DEG = (315.0, 35.0)
"""Azimuth and elevation of the light of hillshades: from the upper left, the cartographers' convention."""
_FLAT = 1e-9
"""Sine of the slope below which the ground has no direction of steepest descent."""

Values = Callable[[Scene], np.ndarray]
Label = Callable[[Scene], str]


@dataclass(frozen=True, kw_only=True)
class Layer:
    """One quantity of a map, and how it is drawn."""

    name: str
    title: str
    about: str
    """The quantity in words, for captions and for the command's help."""
    values: Values
    """(J,) for every landmark, NaN or infinite where it was not measured; (J, 3) local normals of "normals"."""
    label: Label
    """Quantity and unit, for colour bars and axes."""
    cmap: str = "magma"
    """A colour map of matplotlib that people with any colour vision read in the same way."""
    from_zero: float | None = STEEP_PERCENT
    """The colour scale goes from zero to this percentile; None: from the 1st percentile to the 99th."""
    sigma: Callable[[Scene], np.ndarray | None] = lambda scene: None
    """(J,) one standard deviation of the values; None where the scene states none."""
    lacks: Callable[[Scene], str | None] = lambda scene: None
    """Why a scene has no such layer; None: it has."""
    known: Callable[[Scene], np.ndarray] | None = None
    """(J,) bool: the landmarks with determined values; None: all."""

    def shown(self, scene: Scene, view: int | None = None) -> np.ndarray:
        """The values (J, ...) as figures show them: NaN where nothing determines them.

        view: whose Sun lights the shaded relief; by default the light comes from the upper left.
        """
        values = shade(scene, view) if self.name == "relief" else self.values(scene)
        return values if self.known is None else only_known(values, self.known(scene))


def length_unit(scene: Scene) -> tuple[float, str]:
    """The factor from lengths in B to those that are shown, and their unit: metres, or ground sample distances."""
    return (1.0, scene.unit) if scene.unit else (1.0 / scene.gsd, "GSD")


def local_normal(scene: Scene) -> np.ndarray:
    """Normals (J, 3) in the local frame of `relief`: right, up in the reference image, out of the ground."""
    return scene.landmarks.normal @ local_frame(scene).rotation


def height(scene: Scene) -> np.ndarray:
    """(J,) heights above the mean plane [metres, or GSD]."""
    return heights(scene) * length_unit(scene)[0]


def slope_deg(scene: Scene) -> np.ndarray:
    """(J,) angles between the normals and that of the mean plane [degrees]."""
    normal = local_normal(scene)
    return np.degrees(np.arctan2(np.hypot(normal[:, 0], normal[:, 1]), normal[:, 2]))


def shade(scene: Scene, view: int | None = None) -> np.ndarray:
    """(J,) cosines of incidence under the Sun of a view, or under light from the upper left."""
    frame = local_frame(scene)
    sun = sun_from_angles(frame, *np.deg2rad(HILLSHADE_SUN_DEG)) if view is None else scene.views.sun[view]
    return lambert_shade(scene.landmarks.normal, sun)


def residual_percent(scene: Scene) -> np.ndarray:
    """(J,) photometric error (Eq. 39) without scale and bias [% of brightness]."""
    return 100.0 * landmark_photometric_error(scene, remove_scale_and_bias=True)


def slope_sigma_deg(scene: Scene) -> np.ndarray | None:
    """(J,) standard deviation of slopes [degrees], to first order: that of the normal along the steepest descent.

    On level ground, where there is no such direction, along the first axis of the normal's tangent plane. None where
    the scene states no uncertainty of normals.
    """
    if "normal" not in scene.uncertainty:
        return None
    up = local_frame(scene).rotation[:, 2]
    downhill = up @ tangent_basis(scene.landmarks.normal)
    sine = np.linalg.norm(downhill, axis=-1, keepdims=True)
    direction = np.where(sine > _FLAT, downhill / np.maximum(sine, _FLAT), (1.0, 0.0))
    return np.degrees(sigma_along(scene.uncertainty["normal"], direction))


def _height_sigma(scene: Scene) -> np.ndarray:
    return landmark_sigmas(scene)["height_sigma_gsd"] * scene.gsd * length_unit(scene)[0]


def _albedo_sigma(scene: Scene) -> np.ndarray | None:
    found = landmark_sigmas(scene).get("albedo_sigma_percent")
    return None if found is None else found / 100.0 * scene.landmarks.albedo


def _stated_sigma(name: str) -> Values:
    return lambda scene: landmark_sigmas(scene)[name]


def _of_length(words: str) -> Label:
    return lambda scene: f"{words} [{length_unit(scene)[1]}]"


def _no_light(scene: Scene) -> str | None:
    return "it holds geometry alone (reflectance = none)" if scene.reflectance is None else None


def _not_stated(quantity: str) -> Callable[[Scene], str | None]:
    def lacks(scene: Scene) -> str | None:
        there = any(name.startswith(f"{quantity}_sigma") for name in landmark_sigmas(scene))
        return None if there else f"it states no uncertainty of the {quantity}"

    return lacks


def _albedo_label(scene: Scene) -> str:
    return "normal albedo [I/F]" if scene.brightness == "iof" else "relative albedo"


_ALL = (
    Layer(
        name="albedo",
        title="Albedo",
        about="Albedo. Shading of the relief must not be visible in it.",
        values=lambda scene: scene.landmarks.albedo,
        label=_albedo_label,
        cmap="gray",
        from_zero=None,
        sigma=_albedo_sigma,
        lacks=_no_light,
        known=albedo_is_known,
    ),
    Layer(
        name="relief",
        title="Shaded relief",
        about="Normals under the Sun of a view, or under light from the upper left; the same albedo everywhere.",
        values=shade,
        label=lambda scene: "cosine of incidence",
        cmap="gray",
        from_zero=None,
        known=normal_is_known,
    ),
    Layer(
        name="height",
        title="Height",
        about="Height above the robust mean plane, with contours, dashed below it; hillshade from the upper left.",
        values=height,
        label=_of_length("height"),
        cmap="viridis",
        from_zero=None,
        sigma=lambda scene: _height_sigma(scene) if "height_sigma_gsd" in landmark_sigmas(scene) else None,
    ),
    Layer(
        name="slope",
        title="Slope",
        about="Angle between the normals and that of the mean plane.",
        values=slope_deg,
        label=lambda scene: "slope [°]",
        cmap="inferno",
        from_zero=SHORT_TAIL_PERCENT,
        sigma=slope_sigma_deg,
        known=normal_is_known,
    ),
    Layer(
        name="normals",
        title="Normals",
        about="Normals. Bright: facing up in the image, dark: down, orange: right, blue: left; stretched.",
        values=local_normal,
        label=lambda scene: "direction that the ground faces",
        known=normal_is_known,
    ),
    Layer(
        name="height-sigma",
        title="Uncertainty of heights",
        about="One standard deviation of heights above the mean plane.",
        values=_height_sigma,
        label=_of_length("sigma of the height"),
        lacks=_not_stated("height"),
    ),
    Layer(
        name="normal-sigma",
        title="Uncertainty of normals",
        about="One standard deviation of the angle between normals and the true ones.",
        values=_stated_sigma("normal_sigma_deg"),
        label=lambda scene: "sigma of the normal [°]",
        lacks=_not_stated("normal"),
        known=normal_is_known,
    ),
    Layer(
        name="albedo-sigma",
        title="Uncertainty of albedos",
        about="One standard deviation of albedos.",
        values=_stated_sigma("albedo_sigma_percent"),
        label=lambda scene: "sigma of the albedo [%]",
        lacks=_not_stated("albedo"),
        known=albedo_is_known,
    ),
    Layer(
        name="views",
        title="Views per landmark",
        about="Number of views that measure each landmark.",
        values=lambda scene: np.diff(scene.tracks.start).astype(float),
        label=lambda scene: "views",
        cmap="viridis",
        from_zero=100.0,
    ),
    Layer(
        name="residual",
        title="Photometric error",
        about="Photometric error of each landmark (Eq. 39), scale and bias removed.",
        values=residual_percent,
        label=lambda scene: "photometric error [% of brightness]",
        lacks=_no_light,
    ),
)

LAYERS: dict[str, Layer] = {layer.name: layer for layer in _ALL}
"""In the order in which they are offered."""


def find_layer(scene: Scene, name: str) -> Layer:
    """The layer of this name. Raises InputError for a name that is none, and where the scene has no such layer."""
    if name not in LAYERS:
        raise InputError(f"no layer {name!r}; known: {', '.join(LAYERS)}")
    if not len(scene.landmarks):
        raise InputError(f"scene {scene.name!r} has no landmarks to draw; run the site again")
    why = LAYERS[name].lacks(scene)
    if why is not None:
        raise InputError(f"scene {scene.name!r} has no layer {name!r}: {why}")
    return LAYERS[name]
