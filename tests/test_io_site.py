"""site.toml is read as documented and written so that it reads the same."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from photoclinometry.io.site import (
    RegionRequest,
    Site,
    read_site,
    write_site,
)
from photoclinometry.io.site_images import input_fingerprint, load_images
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import SiteError
from photoclinometry.model.geometry import Rigid, so3_exp
from photoclinometry.model.pose_prior import (
    PosePrior,
)
from sites import SIZE, picture, write_small_site

VESTA = Path(__file__).parents[2] / "shared" / "data" / "vesta-opnav022" / "site.toml"


@pytest.fixture
def path(tmp_path):
    return write_small_site(tmp_path)


def test_a_small_site_says_what_its_file_says(path):
    site = read_site(path)
    assert (site.name, site.body, site.brightness, site.path) == ("small", "vesta", "iof", path)
    assert site.region == RegionRequest("images/1.fits", (30.0, 32.0), (40, 20))
    assert [v.name for v in site.views] == [f"images/{n}.fits" for n in range(4)]
    view = site.views[2]
    assert view.image == path.parent / "images" / "2.fits"
    assert view.camera == Camera("PINHOLE", 64, 64, (640.0, 640.0, 32.0, 32.0))
    np.testing.assert_allclose(view.sun, [0.6, 0, -0.8], atol=1e-15)
    assert view.sun_sigma_rad == 1e-3
    assert view.pose_prior is None


def test_what_may_be_left_out_is_none(path):
    text = path.read_text().replace('body = "vesta"\n', "")
    path.write_text(text[: text.index("[region]")] + text[text.index("[[views]]") :])
    site = read_site(path)
    assert site.body is None
    assert site.region is None


def test_a_rounded_sun_is_normalised_and_its_sigma_is_degrees(path):
    path.write_text(path.read_text().replace("[0.6, 0.0, -0.8]", "[0.6004, 0, -0.8]\nsun_sigma_deg = 2", 1))
    view = read_site(path).views[0]
    np.testing.assert_allclose(np.linalg.norm(view.sun), 1.0, atol=1e-15)
    np.testing.assert_allclose(view.sun_sigma_rad, np.deg2rad(2.0))


def test_views_choose_among_named_cameras(path):
    text = path.read_text().replace("[camera]", "[cameras.wide]")
    text = text.replace(
        "[region]",
        '[cameras.long]\nmodel = "SIMPLE_PINHOLE"\nwidth = 64\nheight = 64\nparams = [900, 32, 32]\n[region]',
    )
    text = text.replace("sun =", 'camera = "wide"\nsun =').replace('camera = "wide"', 'camera = "long"', 1)
    path.write_text(text)
    assert [v.camera.params[0] for v in read_site(path).views] == [900, 640, 640, 640]


def test_a_pose_prior_is_read_with_its_quaternion_scalar_first(path):
    prior = "cam_from_body = { rotation_wxyz = [0.8, 0.6, 0, 0], translation = [1, 2, 3], sigma_deg = 0.1, sigma = 5 }"
    path.write_text(path.read_text() + prior)
    found = read_site(path).views[-1].pose_prior
    np.testing.assert_allclose(found.cam_from_body.rotation, so3_exp([2 * np.arctan2(0.6, 0.8), 0, 0]), atol=1e-15)
    np.testing.assert_array_equal(found.cam_from_body.translation, [1, 2, 3])
    np.testing.assert_allclose([found.rotation_sigma_rad, found.translation_sigma], [np.deg2rad(0.1), 5])


def same_site(a: Site, b: Site):
    assert (a.name, a.body, a.brightness, a.region) == (b.name, b.body, b.brightness, b.region)
    assert len(a.views) == len(b.views)
    for v, w in zip(a.views, b.views, strict=True):
        assert (v.name, v.image, v.camera) == (w.name, w.image, w.camera)
        np.testing.assert_allclose(v.sun, w.sun, rtol=0, atol=1e-15)
        np.testing.assert_allclose(v.sun_sigma_rad, w.sun_sigma_rad, rtol=1e-14)
        assert (v.pose_prior is None) == (w.pose_prior is None)
        if v.pose_prior is not None and w.pose_prior is not None:
            p, q = v.pose_prior, w.pose_prior
            np.testing.assert_allclose(p.cam_from_body.rotation, q.cam_from_body.rotation, atol=1e-14)
            np.testing.assert_array_equal(p.cam_from_body.translation, q.cam_from_body.translation)
            np.testing.assert_allclose(p.rotation_sigma_rad, q.rotation_sigma_rad, rtol=1e-14)
            assert p.translation_sigma == q.translation_sigma
            np.testing.assert_allclose(p.common_rotation_sigma_rad, q.common_rotation_sigma_rad, rtol=1e-14)
            assert p.common_translation_sigma == q.common_translation_sigma


def variants(site):
    rng = np.random.default_rng(0)
    views = []
    for view in site.views:
        sun = rng.normal(size=3)
        pose = Rigid(so3_exp(rng.normal(size=3)), rng.normal(size=3))
        prior = PosePrior(pose, 1e-4, 0.3, 2e-5, 700.0)
        views.append(replace(view, sun=sun / np.linalg.norm(sun), sun_sigma_rad=0.0123, pose_prior=prior))
    views[1] = replace(views[1], camera=Camera("SIMPLE_PINHOLE", 64, 64, (900 / 7, 32.0, 31.0)), pose_prior=None)
    yield site
    yield replace(site, views=tuple(views), body=None)
    yield replace(site, region=RegionRequest(None, None, (20, 10), 3))
    yield replace(site, region=None, name='with "quotes" \\ and\nnewline')


@pytest.mark.parametrize("number", range(4))
def test_what_is_written_reads_the_same(path, number):
    site = list(variants(read_site(path)))[number]
    write_site(path.with_name("again.toml"), site)
    same_site(site, read_site(path.with_name("again.toml")))


def test_images_are_loaded_in_order_and_named_as_their_views(path):
    seen = []
    images = load_images(read_site(path), progress=lambda what, done, total: seen.append((done, total)))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    for number, image in enumerate(images):
        assert image.name == f"images/{number}.fits"
        np.testing.assert_array_equal(image.brightness, picture(number))
        assert image.valid.all()


def test_sky_is_not_valid_in_loaded_images(tmp_path, monkeypatch):
    path = write_small_site(tmp_path)
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2
    body = np.hypot(x, y) < 25
    monkeypatch.setattr("sites.picture", lambda number: np.where(body, 0.1 + 0.01 * number * np.sin(x), 0))
    write_small_site(tmp_path)
    for image in load_images(read_site(path)):
        assert image.valid[body].all()
        assert image.valid[~body].mean() < 0.02


def test_the_fingerprint_changes_with_content_only(tmp_path):
    path = write_small_site(tmp_path / "a")
    first = input_fingerprint(read_site(path))
    assert first == input_fingerprint(read_site(write_small_site(tmp_path / "b")))
    path.write_text("# a comment\n" + path.read_text().replace("iof", "iof"))
    assert first == input_fingerprint(read_site(path))
    path.write_text(path.read_text().replace("[40, 20]", "[40, 22]"))
    second = input_fingerprint(read_site(path))
    assert second != first
    image = path.parent / "images" / "3.fits"
    data = bytearray(image.read_bytes())
    data[-3000] ^= 1
    image.write_bytes(data)
    assert input_fingerprint(read_site(path)) not in (first, second)


@pytest.mark.data
def test_the_real_vesta_site_loads():
    if not VESTA.exists():
        pytest.skip(f"the real images are not at {VESTA.parent}")
    site = read_site(VESTA)
    assert len(site.views) == len(load_images(site)) == 4
    np.testing.assert_allclose([v.sun_sigma_rad for v in site.views], np.deg2rad(2.0))


def without_each_key(table):
    """A document with one key less, for each key of it and of the tables in it."""
    for key, value in table.items():
        yield {k: v for k, v in table.items() if k != key}
        if isinstance(value, dict):
            yield from (table | {key: less} for less in without_each_key(value))
        if isinstance(value, list) and isinstance(value[0], dict):
            yield from (table | {key: [less, *value[1:]]} for less in without_each_key(value[0]))


def test_a_missing_key_is_never_told_to_be_another_one_that_is_right(path):
    """A site with every key that a site may have, but for cameras by name."""
    document = tomllib.loads(path.read_text())
    prior = {"rotation_wxyz": [1, 0, 0, 0], "translation": [0, 0, 9e5], "sigma_deg": 0.1, "sigma": 1}
    masked = {"mask": "mask.png", "border_px": [0, 0, 0, 0]}
    document |= {"body_radius_m": 2.5e5, "linear": True, "sun_common_sigma_deg": 0.1}
    document |= {"pose_common_sigma_deg": 0.01, "pose_common_sigma": 5.0}
    document["camera"] |= masked
    document["region"] |= {"stride": 2}
    document["views"][0] |= {"sun_sigma_deg": 0.1, "cam_from_body": prior, **masked}
    path.write_text(tomli_w.dumps(document))
    read_site(path)
    messages = []
    for less in without_each_key(document):
        path.write_text(tomli_w.dumps(less))
        try:
            read_site(path)
        except SiteError as error:
            messages.append(str(error))
    assert sum("is missing" in message for message in messages) == 12
    assert not any("unknown" in message for message in messages), messages
