"""A folder with one good example of everything that commands are given, and changes that spoil a part of it.

Paths are relative to the folder, in which a command then runs: the words of a fault are those that a person types.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from photoclinometry.io.images import read_image, write_fits, write_png
from sites import SIZE, picture, write_small_site

Change = Callable[[], None]
"""Spoils something below the working folder."""


def build_place(folder: Path) -> None:
    """site/: images of nothing in particular; mapped/: a site, and in mapped/run its map; priors/: a site with pose
    priors and without images; model/: a text model; photos/: images to ingest; export/: an earlier export."""
    from archives import plain_images, suns_of
    from photoclinometry.io.models.text_model import write_text_model
    from photoclinometry.io.site import write_site
    from posed_views import site_under_many_suns
    from scenes import synthetic_scene

    write_small_site(folder / "site")
    write_mapped_site(folder / "mapped")
    write_site(folder / "priors" / "site.toml", site_under_many_suns(3))
    model = synthetic_scene(size=8, views=4, keypoint_noise_px=0.05, brightness_noise=1e-3)
    write_text_model(folder / "model", model)
    suns_of(folder / "photos", plain_images(folder / "photos"))


def write_mapped_site(folder: Path) -> None:
    """A site with its images, and in `run` what a run of it leaves, without figures."""
    from photoclinometry.io.scene_file import write_scene
    from photoclinometry.io.site import Site, SiteView, read_site, write_site
    from photoclinometry.pipeline.folder.run_mark import write_mark
    from photoclinometry.pipeline.folder.run_owner import owner_of_site
    from scenes import synthetic_images, synthetic_scene

    scene = synthetic_scene(size=12, views=4)
    views = []
    for k, image in enumerate(synthetic_images(scene)):
        write_fits(folder / image.name, image.brightness)
        sun = scene.views.sun_measured[k]
        views.append(SiteView(image.name, folder / image.name, scene.views.cameras[k], sun))
    path = folder / "site.toml"
    write_site(path, Site("place", None, "iof", tuple(views), None, path))
    run = folder / "run"
    run.mkdir()
    write_scene(run / "scene.h5", scene)
    put(run / "config.toml", 'site = "mapped/site.toml"\n')()
    put(run / "metrics.json", json.dumps({"metrics": {"psnr_mean_db": 41.5, "views": 4}}))()
    write_mark(run, owner_of_site(read_site(path)))


def contents(folder: Path) -> dict[str, str]:
    """Everything below a folder, files with a digest of their bytes."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        for path in folder.rglob("*")
    }


def put(path: Path | str, content: str | bytes) -> Change:
    """Writes a file, in a new folder where there is none."""

    def change() -> None:
        file = Path(path)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content.encode() if isinstance(content, str) else content)

    return change


def edit(path: str, old: str, new: str) -> Change:
    """Replaces a text that occurs in a file, the first time that it does."""

    def change() -> None:
        text = Path(path).read_text()
        assert old in text, f"{path} has no {old!r}"
        Path(path).write_text(text.replace(old, new, 1))

    return change


def cut(path: str, size: int) -> Change:
    """Leaves the first bytes of a file."""
    return lambda: Path(path).write_bytes(Path(path).read_bytes()[:size]) and None


def remove(*paths: str) -> Change:
    def change() -> None:
        for path in paths:
            Path(path).unlink()

    return change


def folder(path: str) -> Change:
    return lambda: Path(path).mkdir(parents=True)


def copy(source: str, target: str) -> Change:
    return lambda: Path(target).write_bytes(Path(source).read_bytes()) and None


def both(*changes: Change) -> Change:
    def change() -> None:
        for one in changes:
            one()

    return change


def frame(number: int, values: np.ndarray) -> Change:
    """An image of the small site with other brightness (SIZE, SIZE)."""
    return lambda: write_fits(Path(f"site/images/{number}.fits"), np.asarray(values, np.float32))


def frames(brightness: Callable[[np.ndarray], np.ndarray], numbers: tuple[int, ...] = (0, 1, 2, 3)) -> Change:
    """Images of the small site with a function of their brightness."""
    return both(*(frame(number, brightness(picture(number))) for number in numbers))


def scaled(factor: float, *paths: str) -> Change:
    """Images with so many times their brightness."""

    def change() -> None:
        for path in paths:
            write_fits(Path(path), np.float32(factor) * read_image(Path(path)).brightness)

    return change


def noise(level: float, sigma: float) -> np.ndarray:
    return np.random.default_rng(0).normal(level, sigma, (SIZE, SIZE))


def saturated_png() -> None:
    """An image that is white all over."""
    write_png(Path("white.png"), np.full((SIZE, SIZE), 255, np.uint8))
    Path("white.png").replace("site/images/1.fits")


def gamma_png() -> None:
    """A PNG that declares a gamma of 1 / 2.2."""
    write_png(Path("gamma.png"), (1e4 * picture(0)).astype(np.uint16))
    data, chunk = Path("gamma.png").read_bytes(), b"gAMA" + struct.pack(">I", 45455)
    Path("gamma.png").unlink()
    whole = data[:33] + struct.pack(">I", 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[33:]
    Path("site/images/1.fits").write_bytes(whole)


def colour_png() -> None:
    """A PNG whose channels differ."""
    import cv2

    values = np.stack([(1e3 * picture(channel)).astype(np.uint8) for channel in range(3)], -1)
    Path("site/images/1.fits").write_bytes(cv2.imencode(".png", values)[1].tobytes())


def cube_fits() -> None:
    from astropy.io import fits

    fits.PrimaryHDU(np.zeros((3, 4, 5))).writeto("site/images/1.fits", overwrite=True)


def table_fits() -> None:
    from astropy.io import fits

    column = fits.Column(name="a", format="E", array=np.zeros(3))
    fits.HDUList([fits.PrimaryHDU(), fits.BinTableHDU.from_columns([column])]).writeto(
        "site/images/1.fits", overwrite=True
    )


def geometry_alone() -> None:
    """The map is one without photometry."""
    from photoclinometry.io.scene_file import write_scene
    from scenes import synthetic_scene

    write_scene(Path("mapped/run/scene.h5"), synthetic_scene(size=12, views=4, reflectance=None))


def exported_map(out: str) -> Change:
    """An export of another map than that of `mapped`."""

    def change() -> None:
        from dataclasses import replace

        from photoclinometry.output.export import ExportOptions, export_scene
        from scenes import synthetic_scene

        scene = synthetic_scene(size=12, views=4)
        suns = -scene.views.sun_measured
        other = replace(scene, name="other", views=replace(scene.views, sun_measured=suns))
        export_scene(other, out, ExportOptions(products=("csv",)))

    return change


def lock(**content: object) -> Change:
    """A lock of a process that lives, in the run folder `mapped/run`."""

    def change() -> None:
        import socket

        import psutil

        started = psutil.Process().create_time()
        own = dict(pid=os.getpid(), host=socket.gethostname(), since="2026-01-02T03:04:05Z", process_started=started)
        Path("mapped/run/lock").write_text(json.dumps(own | content))

    return change


@contextmanager
def small_disk(size: int | None) -> Iterator[None]:
    """No file of this process may grow beyond `size` bytes: writing fails in the middle, as on a full disk."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft if size is None else size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
