"""Images that are not linear in radiance: told by brightness, warned of where it is clear, decoded where stated."""

import math
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.response import Response, response_of
from photoclinometry.io.images import write_png
from photoclinometry.io.site import read_site, write_site
from photoclinometry.io.site_images import input_fingerprint, read_view_image
from photoclinometry.model.errors import SiteError
from photoclinometry.model.gamma import gamma_corrected
from photoclinometry.model.progress import no_progress
from photoclinometry.model.reflectance import published
from photoclinometry.model.warning import collected_warnings
from photoclinometry.pipeline import response_check
from photoclinometry.pipeline.folder.stage import Keyed, Tools, digest
from photoclinometry.pipeline.map_stages import IntermediateMap
from photoclinometry.pipeline.response_check import (
    RESPONSE_LANDMARKS,
    CheckResponse,
    is_clear,
    remedy,
    response_models,
)
from scenes import synthetic_scene

HAPKE, MINNAERT = published("hapke", "vesta"), published("minnaert", "vesta")


def encoded_scene(gamma, views=8, model=HAPKE):
    """A scene whose images have numbers V ~ L^(1 / gamma)."""
    scene = replace(synthetic_scene(size=16, views=views, reflectance=model, brightness_noise=0.003), body="vesta")
    tracks = scene.tracks
    top = float(tracks.brightness.max())
    return replace(scene, tracks=replace(tracks, brightness=gamma_corrected(tracks.brightness, 1.0 / gamma, top)))


def checked(scene, tmp_path, found=response_of):
    """What the stage finds of a scene, whose response is `found`, and its warnings."""
    stage = CheckResponse(relit=Keyed(IntermediateMap(scene=scene), "a"), models=(HAPKE,), stated=(1.0,))
    with collected_warnings() as warnings, pytest.MonkeyPatch.context() as patch:
        patch.setattr(response_check, "response_of", found)
        return stage.make(Tools(progress=no_progress, scratch=tmp_path)), warnings


def test_a_power_keeps_the_sign_and_one_value():
    np.testing.assert_allclose(
        gamma_corrected(np.array([-4.0, 0.0, 1.0, 4.0, 9.0]), 0.5, 4.0), [-4.0, 0.0, 2.0, 4.0, 6.0]
    )


@pytest.fixture(scope="module")
def response_once():
    """`response_of`, computed once for the same scene, models and number of landmarks."""
    known = {}

    def of(*given):
        key = digest(given)
        if key not in known:
            known[key] = response_of(*given)
        return known[key]

    return of


@pytest.mark.parametrize("gamma", [0.6, 1.0, 1.8])
def test_the_exponent_is_found(response_once, gamma):
    found = response_once(encoded_scene(gamma), (HAPKE,), RESPONSE_LANDMARKS)
    assert abs(found.log_gamma - math.log(gamma)) < 0.1
    assert found.gain == 0.0 if gamma == 1.0 else found.gain > 0.1


def test_a_model_that_takes_the_response_upon_itself_is_not_asked_alone():
    scene = encoded_scene(2.2)
    assert response_models(scene, MINNAERT)[0] == MINNAERT
    assert abs(response_of(scene, response_models(scene, MINNAERT), 300).log_gamma - math.log(2.2)) < 0.1
    assert response_models(scene, HAPKE) == (HAPKE,)


def test_linear_images_of_ground_of_another_model_are_not_called_encoded():
    scene = encoded_scene(1.0, model=MINNAERT)
    assert not is_clear(response_of(scene, (MINNAERT, HAPKE), 300))


def test_encoded_images_are_warned_of_and_linear_ones_are_not(response_once, tmp_path):
    found, warnings = checked(encoded_scene(1.8), tmp_path, response_once)
    assert found.is_clear
    assert [warned.code for warned in warnings] == ["response-not-linear"]
    assert f"write gamma = {found.gamma:.2f} to the camera" in warnings[0].words
    found, warnings = checked(encoded_scene(1.0), tmp_path, response_once)
    assert not found.is_clear
    assert not warnings


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ((1.0,), "write gamma = 1.80 to the camera"),
        ((1.2,), "write gamma = 2.16 to the camera"),  # the images were decoded by 1.2 already
        ((1.0, 1.2), "multiply the gamma of each camera by 1.80"),
    ],
)
def test_the_remedy_names_the_whole_exponent(stated, words):
    assert remedy(1.8, stated) == words


def test_too_few_views_tell_nothing(tmp_path):
    found, warnings = checked(encoded_scene(2.2, views=4), tmp_path)
    assert math.isnan(found.gamma)
    assert not found.is_clear
    assert not warnings


@pytest.mark.parametrize(
    ("log_gamma", "decoded", "clear"),
    [
        (0.5, [0.8, 0.7, 0.75, 0.8, 0.7, 0.75], True),
        (0.2, [0.8, 0.7, 0.75, 0.8, 0.7, 0.75], False),  # what models that are not the ground's make up for
        (0.5, [0.95, 0.93, 0.94, 0.96, 0.95, 0.94], False),  # hardly better
        (0.5, [0.2, 1.0, 0.99, 1.01, 1.0, 1.0], False),  # by one view
    ],
)
def test_an_exponent_is_clear_where_it_is_large_and_helps_all_views(log_gamma, decoded, clear):
    found = Response(log_gamma=log_gamma, sigma=0.05, linear_error=np.ones(6), decoded_error=np.array(decoded))
    assert is_clear(found) == clear


@pytest.fixture
def site_of_png(tmp_path):
    """A site of three PNG images of a known ramp."""
    ramp = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64)
    lines = ['name = "ramp"', 'brightness = "dn"', "[camera]", 'model = "PINHOLE"', "width = 64", "height = 48"]
    lines += ["params = [500.0, 500.0, 32.0, 24.0]", "gamma = 2.2"]
    for k in range(3):
        write_png(tmp_path / f"{k}.png", ramp + np.uint16(k))
        lines += ["[[views]]", f'image = "{k}.png"', "sun = [0.0, 0.6, -0.8]"]
    (tmp_path / "site.toml").write_text("\n".join(lines))
    return tmp_path / "site.toml"


def test_images_are_decoded_when_they_are_read(site_of_png):
    site = read_site(site_of_png)
    image = read_view_image(site, site.views[1])
    np.testing.assert_allclose(image.brightness.ravel(), (np.arange(48 * 64) + 1.0) ** 2.2, rtol=1e-5)


def test_the_exponent_is_written_and_is_part_of_what_a_site_is(site_of_png):
    site = read_site(site_of_png)
    write_site(site_of_png.with_name("again.toml"), site)
    again = read_site(site_of_png.with_name("again.toml"))
    assert {view.gamma for view in again.views} == {2.2}
    other = replace(site, views=tuple(replace(view, gamma=1.8) for view in site.views))
    assert input_fingerprint(site) == input_fingerprint(again) != input_fingerprint(other)


@pytest.mark.parametrize("value", ["0.0", "-2.2", "22"])
def test_what_is_no_exponent_is_refused(site_of_png, value):
    site_of_png.write_text(site_of_png.read_text().replace("gamma = 2.2", f"gamma = {value}"))
    with pytest.raises(SiteError, match="gamma"):
        read_site(site_of_png)
