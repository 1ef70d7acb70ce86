"""The table of known bodies, and names of bodies that a site may give."""

import re

import pytest

from photoclinometry.io.rasters.globe import find_globe
from photoclinometry.io.site_body import read_body
from photoclinometry.io.table import Table
from photoclinometry.model.bodies import BODIES, IAU_NUMBER, MEAN_RADIUS_M, SEMI_AXES_M, is_known
from photoclinometry.model.errors import SiteError
from photoclinometry.model.reflectance import MODELS
from photoclinometry.registration.place import semi_axes
from photoclinometry.simulate.bodies.presets import BODIES as SIMULATED
from photoclinometry.simulate.presets import PRESETS

NAMES = [body.name for body in BODIES]


def site_of(body):
    return Table({"body": body}, "site.toml").expect("body", "body_radius_m")


def test_each_body_stands_once_in_order():
    assert sorted(set(NAMES)) == NAMES
    assert [name.lower() for name in NAMES] == NAMES


def test_the_table_has_known_values():
    assert IAU_NUMBER["moon"] == 301
    assert SEMI_AXES_M["moon"] == (1_737_400.0, 1_737_400.0, 1_737_400.0)
    assert (IAU_NUMBER["vesta"], SEMI_AXES_M["vesta"]) == (2000004, (289_000.0, 280_000.0, 229_000.0))
    assert MEAN_RADIUS_M == {"ceres": 470_000.0, "vesta": 262_000.0}
    assert list(IAU_NUMBER.values()) == sorted(IAU_NUMBER.values())


@pytest.mark.parametrize("body", IAU_NUMBER)
def test_proj_has_the_body_under_its_number(body):
    pytest.importorskip("rasterio")
    globe = find_globe(body)
    assert globe.name.lower().startswith(body)
    if body in SEMI_AXES_M:
        assert 0.95 * min(SEMI_AXES_M[body]) < globe.radii_m[1] <= globe.radii_m[0] < 1.05 * max(SEMI_AXES_M[body])


def test_mean_radii_are_those_of_the_ellipsoids():
    for body, radius in MEAN_RADIUS_M.items():
        a, b, c = semi_axes(body)
        assert radius == pytest.approx((a * b * c) ** (1.0 / 3.0), rel=0.02)


def test_a_site_may_name_the_bodies_of_the_table_and_no_others():
    assert [read_body(site_of(name)) for name in NAMES] == [(name, None) for name in NAMES]
    with pytest.raises(SiteError, match=re.escape(f"(known: {', '.join(NAMES)})")):
        read_body(site_of("tatooine"))


def test_bodies_of_the_program_s_tables_are_known():
    published = {body for model in MODELS.values() for body in model.published}
    simulated = {preset.body for preset in [*PRESETS.values(), *SIMULATED.values()]}
    assert published | simulated <= set(NAMES)
    assert {preset.body for preset in PRESETS.values()} <= set(MEAN_RADIUS_M)


@pytest.mark.parametrize(("body", "known"), [("Vesta", True), ("BENNU", True), ("tatooine", False), ("", False)])
def test_case_does_not_count(body, known):
    assert is_known(body) == known
