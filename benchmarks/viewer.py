"""Size, speed and accuracy of the viewer of a run, in a headless Chromium that draws by the processor.

    python benchmarks/viewer.py RUN [VIEW ...]       # a finished run, and numbers of views; default: the reference view
    python benchmarks/viewer.py BODY                 # a finished body
    python benchmarks/viewer.py --landmarks 1000000  # a made-up map of so many, and none of a run's

Size of the page with the run's images [MB], time until its map is drawn, time of a frame under another Sun and from
another camera [ms, median], and the difference of its brightness from `render` [% of the mean brightness]. Of a body
the page of its report, and times of frames at both levels of detail; its brightness is compared in the tests.
"""

from __future__ import annotations

import base64
import sys
import tempfile
from pathlib import Path

import numpy as np

from photoclinometry.io.run_files import is_body, read_run, run_images, site_path
from photoclinometry.output.viewer import write_viewer
from photoclinometry.photometry.render import render_view
from photoclinometry.surface.relief import local_frame, sun_from_angles

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from browser import Page, browser, why_no_browser
from scenes import synthetic_scene

SUNS_DEG = ((315.0, 50.0), (90.0, 25.0), (200.0, 12.0))
"""Azimuth and elevation, beside the view's own Sun."""
FRAMES = 9

FRAME_MS = """
const [frames, what, shadows, level] = arguments, { gl } = viewer.renderer, { state } = viewer.store, times = [];
Object.assign(state, { shadows, layer: "rendering" });
for (let i = 0; i < frames; i++) {
  const start = performance.now();
  state[what] = (state[what] + 7) % 360;
  viewer.draw(level);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));  // waits until all is drawn
  times.push(performance.now() - start);
}
return times.sort((a, b) => a - b)[Math.floor(frames / 2)];
"""

RENDERED = """
const bytes = new Uint8Array(viewer.renderingOf(...arguments).buffer), parts = [];
for (let i = 0; i < bytes.length; i += 8192) parts.push(String.fromCharCode(...bytes.subarray(i, i + 8192)));
return btoa(parts.join(""));
"""


def main(run: Path, chosen: list[int]) -> None:
    if is_body(run):
        return main_body(run.resolve() / "report" / "viewer.html")
    scene = read_run(run)
    with tempfile.TemporaryDirectory() as folder, browser(Path(folder)) as page:
        path = write_viewer(Path(folder) / "viewer.html", scene, run_images(site_path(run), scene.views.name))
        print(f"{len(scene.landmarks)} landmarks, {len(scene.views)} images: {path.stat().st_size / 1e6:.1f} MB")
        page.open(path)
        print(f"drawn after {page.run('return viewer.openedIn'):.0f} ms")
        print_both_frames(page)
        for view in chosen or [scene.reference]:
            compare(page, scene, view)


def main_made_up(count: int) -> None:
    """Size and times of a made-up map: smooth ground in four views, whose brightness is not compared."""
    scene = synthetic_scene(size=round(count**0.5), views=4)
    with tempfile.TemporaryDirectory() as folder, browser(Path(folder)) as page:
        path = write_viewer(Path(folder) / "viewer.html", scene)
        print(f"{len(scene.landmarks)} landmarks, no images: {path.stat().st_size / 1e6:.1f} MB")
        page.open(path)
        print(f"drawn after {page.run('return viewer.openedIn'):.0f} ms")
        print_both_frames(page)


def main_body(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder, browser(Path(folder)) as page:
        print(f"{path.stat().st_size / 1e6:.1f} MB")
        page.open(path)
        print(f"drawn after {page.run('return viewer.openedIn'):.0f} ms")
        for level, indices in enumerate(page.run("return viewer.renderer.levels.map(level => level.indices)")):
            print(f"{indices // 3} facets")
            print_frames(page, level)


def print_both_frames(page: Page) -> None:
    """Prints the times of frames of a region: at rest, by splines, and while it moves."""
    for level, when in enumerate(("at rest", "while it moves")):
        print(when)
        print_frames(page, level)


def print_frames(page: Page, level: int) -> None:
    """Prints the times of frames at a level of detail."""
    for what in ("azimuth", "heading"):
        times = [page.run(FRAME_MS, FRAMES, what, shadows, level) for shadows in (False, True)]
        print(f"frame, other {what}: {times[0]:.0f} ms, with shadows {times[1]:.0f} ms")


def compare(page: Page, scene, view: int) -> None:
    """Prints the differences of one view under its own and other Suns."""
    own = page.run(
        "const v = viewer.map.scene.views[arguments[0]]; return [v.sun_azimuth_deg, v.sun_elevation_deg]", view
    )
    camera = scene.views.cameras[view]
    for azimuth, elevation in (tuple(own), *SUNS_DEG):
        sun = sun_from_angles(local_frame(scene), np.radians(azimuth), np.radians(elevation))
        for shadows in (False, True):
            text = page.run(RENDERED, view, azimuth, elevation, shadows)
            got = np.frombuffer(base64.b64decode(text), np.float32).reshape(camera.height, camera.width)
            wanted, mask = render_view(scene, view, sun, cast_shadows=shadows)
            both = mask & np.isfinite(got)
            off = 100.0 * np.abs(got - wanted)[both] / wanted[mask].mean()
            how = "with shadows" if shadows else "without     "
            figures = f"mean {off.mean():.3f} %, 99 % of pixels within {np.percentile(off, 99):.2f} %"
            print(f"view {view}, Sun {azimuth:.0f} {elevation:.0f}, {how}: {figures}")


if __name__ == "__main__":
    if why_no_browser():
        sys.exit(why_no_browser())
    if sys.argv[1] == "--landmarks":
        main_made_up(int(sys.argv[2]))
    else:
        main(Path(sys.argv[1]), [int(text) for text in sys.argv[2:]])
