"""Names of bodies that a site may give."""

import pytest

from photoclinometry.io.bodies import is_known
from photoclinometry.io.rasters.globe import NAIF_NUMBER
from photoclinometry.model.reflectance import MODELS
from photoclinometry.registration.place import SEMI_AXES_M


def test_bodies_of_the_program_s_tables_are_known():
    published = {body for model in MODELS.values() for body in model.published}
    assert all(is_known(body) for body in {*NAIF_NUMBER, *SEMI_AXES_M, *published})


@pytest.mark.parametrize(("body", "known"), [("Vesta", True), ("BENNU", True), ("tatooine", False), ("", False)])
def test_case_does_not_count(body, known):
    assert is_known(body) == known
