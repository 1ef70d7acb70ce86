"""Names of bodies: known ones pass, others are answered by the nearest or by all."""

import pytest

from photoclinometry.io.rasters.globe import NAIF_NUMBER
from photoclinometry.model.bodies import KNOWN_BODIES, unknown_body
from photoclinometry.model.reflectance import MODELS


def test_bodies_of_the_program_s_tables_are_known():
    published = {body for model in MODELS.values() for body in model.published}
    assert {*NAIF_NUMBER, *published} <= set(KNOWN_BODIES)


@pytest.mark.parametrize("body", [None, "vesta", "Vesta", "BENNU"])
def test_nothing_is_said_of_bodies_that_are_known_or_not_given(body):
    assert unknown_body(body) is None


def test_a_body_that_is_not_known_is_answered_by_those_that_are_and_what_to_do():
    said = unknown_body("tatooine")
    assert said is not None
    assert said.startswith("body 'tatooine' is not known: known are mercury, moon,")
    assert "leave `body` out" in said
    assert "--radii-m" in said
    assert "did you mean 'vesta'?" in str(unknown_body("vestta"))


def test_a_run_warns_of_it(mapped, caplog):
    from dataclasses import replace

    from photoclinometry.io.site import read_site
    from photoclinometry.pipeline.choices import choose
    from photoclinometry.pipeline.options import RunOptions

    with caplog.at_level("WARNING"):
        choose(replace(read_site(mapped.site), body="tatooine"), RunOptions())
    assert "site.toml: body 'tatooine' is not known" in caplog.text
