"""The viewer's light in a real browser: every model, every Sun, and shadows are those of `render`."""

from dataclasses import replace

import numpy as np
import pytest

from browser import browser, why_no_browser
from photoclinometry.model.reflectance import MODELS
from photoclinometry.model.scene import Surroundings
from photoclinometry.photometry.render import render_view
from photoclinometry.surface.map_rays import in_sunlight
from photoclinometry.surface.relief import angles_from_sun, local_frame, sun_from_angles
from scenes import thinned, with_coarse_view, with_landmarks
from viewer_pages import RENDERED, SUNS_DEG, page_of, scene_of

pytestmark = pytest.mark.skipif(why_no_browser() is not None, reason=str(why_no_browser()))

LIMIT = 0.005
"""Of the mean brightness: largest mean difference from `render`."""

LIT = """
    viewer.renderingOf(0, ...arguments, true);
    const { gl, passes } = viewer.renderer;
    const { frame, width, height } = passes.lit;
    const read = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, read);
    return Array.from(read).filter((x, i) => i % 4 === 0);
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("downloads")) as found:
        yield found


@pytest.fixture(scope="module", params=MODELS)
def scene(page, tmp_path_factory, request):
    """The scene of a model, whose page is open for all tests of that model."""
    found = scene_of(request.param)
    page.open(page_of(tmp_path_factory.mktemp("page"), found))
    yield found
    assert page.messages() == []


def sun_of(scene, azimuth_deg, elevation_deg):
    return sun_from_angles(local_frame(scene), np.radians(azimuth_deg), np.radians(elevation_deg))


def shares_of_mean(page, scene, view, azimuth_deg, elevation_deg, shadows=False):
    """Differences from `render_view` over the mean brightness, (n,), and the share of pixels in one of both alone."""
    camera = scene.views.cameras[view]
    got = np.array(page.run(RENDERED, view, azimuth_deg, elevation_deg, shadows), float)
    got = got.reshape(camera.height, camera.width)
    wanted, mask = render_view(scene, view, sun_of(scene, azimuth_deg, elevation_deg), cast_shadows=shadows)
    both = mask & np.isfinite(got)
    return (got - wanted)[both] / wanted[mask].mean(), (mask != np.isfinite(got)).sum() / mask.sum()


def test_every_model_under_three_suns_is_that_of_render(page, scene):
    for sun in SUNS_DEG:
        for view in (0, 2):
            off, elsewhere = shares_of_mean(page, scene, view, *sun)
            assert np.abs(off).mean() < LIMIT
            assert np.percentile(np.abs(off), 99) < 4 * LIMIT
            assert elsewhere < 0.05  # of the map's edge, one pixel wide


def test_models_are_those_of_the_compiled_functions_at_any_angle(page, scene):
    """Without interpolation, at the landmarks of the reference view: to single precision, grazing angles included."""
    row, col = scene.landmarks.pixel.T
    for azimuth in np.arange(0.0, 360.0, 60.0):
        for elevation in (89.0, 40.0, 3.0):
            got = np.array(page.run(RENDERED, 0, azimuth, elevation, False), float)
            camera = scene.views.cameras[0]
            inner = (slice(1, -1), slice(1, -1))
            got = got.reshape(camera.height, camera.width)[row, col].reshape(40, 40)[inner]
            wanted = render_view(scene, 0, sun_of(scene, azimuth, elevation))[0][row, col].reshape(40, 40)[inner]
            # Normals are stored to 0.002 degrees, a thousandth of the cosine at 2 degrees above the ground.
            np.testing.assert_allclose(got, wanted, rtol=2e-3, atol=1e-3 * wanted.mean())


def test_models_at_zero_phase_are_those_of_render(page, scene):
    """The Sun behind the camera, where angles are hardly defined."""
    behind = scene.views.body_from_cam.translation[0] - scene.landmarks.position.mean(axis=0)
    sun = np.degrees(angles_from_sun(local_frame(scene), behind / np.linalg.norm(behind)))
    off, _ = shares_of_mean(page, scene, 0, *sun)
    assert np.abs(off).max() < LIMIT


def test_cast_shadows_are_those_of_render(page, tmp_path):
    scene = scene_of()
    page.open(page_of(tmp_path, scene))
    shaded = []
    for azimuth, elevation in ((0.0, 4.0), (120.0, 8.0), (250.0, 12.0)):
        lit = scene.grid(in_sunlight(scene, sun_of(scene, azimuth, elevation)))
        got = np.array(page.run(LIT, azimuth, elevation)).reshape(lit.shape)
        assert (got != lit).mean() < 2e-3
        off, _ = shares_of_mean(page, scene, 1, azimuth, elevation, shadows=True)
        assert np.abs(off).mean() < 2 * LIMIT
        shaded.append(1.0 - lit.mean())
    assert max(shaded) > 0.05


def test_shadows_of_gaps_strides_and_surroundings_are_those_of_render(page, tmp_path):
    scene = scene_of()
    camera = scene.views.cameras[0]
    distance = np.linalg.norm(scene.views.body_from_cam.translation[0])
    depth = np.full((camera.height // 4, camera.width // 4), distance)
    depth[:, :4] -= 250.0
    depth[3] = np.nan
    gaps = with_landmarks(scene, np.random.default_rng(0).random(1600) > 0.05)
    gaps = replace(gaps, surroundings=Surroundings(depth=depth, stride=4), uncertainty={})
    for changed in (gaps, replace(thinned(replace(scene, uncertainty={}), 2), uncertainty={})):
        page.open(page_of(tmp_path, changed))
        for azimuth, elevation in ((270.0, 6.0), (90.0, 6.0)):
            sun = sun_of(changed, azimuth, elevation)
            lit = changed.grid(in_sunlight(changed, sun, changed.surroundings), fill=0.0)
            got = np.array(page.run(LIT, azimuth, elevation)).reshape(lit.shape)
            assert (got != lit).mean() < 5e-3
            off, _ = shares_of_mean(page, changed, 0, azimuth, elevation, shadows=True)
            assert np.abs(off).mean() < 2 * LIMIT


def test_views_coarser_than_the_map_are_averaged_as_by_render(page, tmp_path):
    scene = with_coarse_view(scene_of(), 2)
    page.open(page_of(tmp_path, replace(scene, uncertainty={})))
    off, _ = shares_of_mean(page, scene, 2, *SUNS_DEG[1])
    assert np.abs(off).mean() < LIMIT
    assert page.run("return viewer.map.scene.views[2].averaging") > 0.5


def test_uncalibrated_views_have_their_scales_and_biases(page, tmp_path):
    scene = scene_of("mcewen")
    assert scene.brightness == "dn"
    page.open(page_of(tmp_path, scene))
    off, _ = shares_of_mean(page, scene, 3, *SUNS_DEG[0])
    assert np.abs(off).mean() < LIMIT
