"""The pictures of docs/howto/symptoms.md: maps of one simulated site as it is, and with faults.

python benchmarks/symptoms.py --out symptoms        ten minutes; copy OUT/symptom-*.png to docs/images
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

import photoclinometry as pcm
from faults import SITES, region_of
from image_faults import Images, blurred, distortion, gamma, hits, jpeg, read_images, write_spoiled
from photoclinometry.io.site import read_site
from photoclinometry.model.geometry import so3_exp
from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.draw import add_bar, bare, colour_map, limits, panels, save, style
from photoclinometry.output.figures.layers import find_layer
from photoclinometry.simulate.site import simulate_site

SITE, VIEW = "moderate", 3
"""And the view that a fault of one image is put into."""
GAMMA, CORNER_PX, SUN_OFF_DEG = 2.2, 10.0, 10.0
OFFSET = 0.4
"""Left in all images, as a share of their median brightness."""
HIDDEN_VIEWS, HIDDEN = 7, 0.45
"""Views whose masks hide one corner, and its share of their width and height."""
NAMES = ("sound", "spoilt")
WIDTH, GAP, MARGIN = 2.1, (0.75, 0.2), (0.05, 0.65, 0.05, 0.3)
"""Of panels, between and around them [inches]."""
DIFFERENCES = (-10.0, 10.0)
"""Ends of the scale of differences [%]."""
Panel = tuple[str, str, np.ndarray]
"""Title, unit (empty: grey without a bar), and values."""


def main(out: Path) -> None:
    """Map the site with each fault and draw what it looks like.

    Args:
        out: Folder for the pictures and, meanwhile, sites and runs.
    """
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(out / "site", ignore_errors=True)
    clean_file = simulate_site(SITES[SITE], out / "site")
    images = read_images(read_site(clean_file))
    sound, name = _mapped(clean_file, out), images.site.views[VIEW].name

    def spoilt(fault: Callable[[Images], Images]) -> tuple[Scene, Images]:
        changed = fault(images)
        return _mapped(write_spoiled(changed, images.site, out / "spoilt", region_of(sound)), out), changed

    encoded, _ = spoilt(lambda clean: gamma(clean, np.random.default_rng(0), GAMMA))
    _draw(out / "symptom-not-linear.png", [*_pair("relief", sound, encoded), *_pair("albedo", sound, encoded)])
    distorted, seen = spoilt(lambda clean: distortion(clean, np.random.default_rng(0), CORNER_PX))
    differences = _differences(name, (sound, images), (distorted, seen))
    _draw(out / "symptom-distorted.png", [*_pair("relief", sound, distorted), *differences])
    soft, seen = spoilt(lambda clean: clean.with_one(VIEW, blurred))
    _draw(out / "symptom-blurred.png", _differences(name, (sound, images), (soft, seen)))
    turned, seen = spoilt(_with_wrong_sun)
    _draw(out / "symptom-wrong-sun.png", _differences(name, (sound, images), (turned, seen)))
    compressed, seen = spoilt(lambda clean: jpeg(clean, np.random.default_rng(0)))
    differences = _differences(name, (sound, images), (compressed, seen))
    _draw(out / "symptom-compressed.png", [*_pair("relief", sound, compressed), *differences])
    offset, _ = spoilt(lambda clean: clean.changed(lambda pixels: pixels + OFFSET * np.nanmedian(pixels)))
    _draw(out / "symptom-dark-level.png", [*_pair("relief", sound, offset), *_pair("albedo", sound, offset)])
    struck, seen = spoilt(lambda clean: hits(clean, np.random.default_rng(0)))
    differences = _differences(name, (sound, images), (struck, seen))
    _draw(out / "symptom-cosmic-rays.png", [*_pair("relief", sound, struck), *differences])
    hidden, _ = spoilt(_with_hidden_corners)
    _draw(out / "symptom-holes.png", [*_pair("relief", sound, hidden), *_pair("views", sound, hidden)])
    lit = [_lit(sound, azimuth) for azimuth in (315.0, 135.0)]
    _draw(out / "symptom-lit-from-below.png", [("light from above", "", lit[0]), ("light from below", "", lit[1])])
    for folder in ("site", "spoilt", "run"):
        shutil.rmtree(out / folder, ignore_errors=True)


def _mapped(site_file: Path, out: Path) -> Scene:
    """The map of a site; all views take part."""
    return pcm.run(site_file, out / "run", check_views=False, overwrite=True).scene


def _with_wrong_sun(clean: Images) -> Images:
    turn = so3_exp(np.deg2rad([0.0, SUN_OFF_DEG, 0.0]))
    return clean.with_views(lambda k, view: replace(view, sun=turn @ view.sun) if k == VIEW else view)


def _with_hidden_corners(clean: Images) -> Images:
    """The lower left of most images is no data."""
    pixels = []
    for k, image in enumerate(clean.pixels):
        changed = image.copy()
        if k < HIDDEN_VIEWS:
            changed[int((1.0 - HIDDEN) * len(image)) :, : int(HIDDEN * image.shape[1])] = np.nan
        pixels.append(changed)
    return replace(clean, pixels=tuple(pixels))


def _pair(layer: str, sound: Scene, spoilt: Scene) -> list[Panel]:
    """A layer of both maps."""
    if layer == "relief":
        return [("relief, sound", "", _lit(sound, 315.0)), ("relief, spoilt", "", _lit(spoilt, 315.0))]
    found = [scene.grid(find_layer(scene, layer).values(scene)) for scene in (sound, spoilt)]
    return [
        (f"{layer}, {which}", " ", values / np.nanmedian(values)) for which, values in zip(NAMES, found, strict=True)
    ]


def _lit(scene: Scene, azimuth_deg: float) -> np.ndarray:
    """The map under a low Sun, with one albedo."""
    even = replace(scene, landmarks=replace(scene.landmarks, albedo=np.ones(len(scene.landmarks))))
    image = pcm.render(even, sun_azimuth_deg=azimuth_deg, sun_elevation_deg=30.0, geometry="reference")
    return np.where(image.valid, image.brightness, np.nan)


def _differences(name: str, *maps: tuple[Scene, Images]) -> list[Panel]:
    """Rendering minus image of a view, of both maps [% of the mean brightness]."""
    out: list[Panel] = []
    for which, (scene, images) in zip(NAMES, maps, strict=True):
        rendered = pcm.render(scene, view=name)
        image = images.pixels[[view.name for view in images.site.views].index(name)]
        off = np.where(rendered.valid, rendered.brightness - image, np.nan) / np.nanmean(image[rendered.valid])
        rows, cols = np.nonzero(rendered.valid)
        out.append((f"rendering - image, {which}", "%", 100.0 * off[rows.min() : rows.max(), cols.min() : cols.max()]))
    return out


def _draw(file: Path, content: Sequence[Panel]) -> None:
    """Panels side by side; those of one unit have one scale."""
    with style():
        figure, axes = panels(1, len(content), WIDTH, 1.0, GAP, MARGIN)
        for panel, (title, unit, values) in zip(axes[0], content, strict=True):
            alike = np.concatenate([each.ravel() for _, other, each in content if other == unit])
            clim = DIFFERENCES if unit == "%" else limits(alike)
            shown: Any = bare(panel, title).imshow(
                np.ma.masked_invalid(values),
                cmap=colour_map("RdBu_r" if unit == "%" else "gray"),
                vmin=clim[0],
                vmax=clim[1],
                interpolation="nearest",
            )
            if unit:
                add_bar(panel, shown, values, unit.strip())
        save(figure, file)


if __name__ == "__main__":
    tyro.cli(main)
