import os
from importlib import import_module
from pathlib import Path

import pytest

LONG = ("body_run", "stages", "viewer_page", "viewer_light", "viewer_body", "plan", "left_out")
"""Modules of half a minute and more. They begin first: the last to begin runs in one process, while others idle."""


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: item.module.__name__.removeprefix("test_") not in LONG)


@pytest.fixture(scope="session")
def mapped(tmp_path_factory):
    """A small simulated site and the run that mapped it (`runs.Mapped`); for reading only."""
    from runs import small_run, small_run_left_in

    made = os.environ.get("SMALL_RUN")
    return small_run_left_in(Path(made).resolve()) if made else small_run(tmp_path_factory.mktemp("mapped"))


@pytest.fixture
def adjust_nothing(monkeypatch):
    """The joint estimate stops at once, for tests of what surrounds it; the options of each call."""
    from adjustments import look_for_no_errors_of_brightness, not_adjusted
    from photoclinometry.pipeline import joint_estimate

    calls = []

    def stand_in(scene, options, priors, **_):
        calls.append(options)
        return not_adjusted(scene, pose_priors=priors.pose_priors)

    monkeypatch.setattr(joint_estimate, "adjust", stand_in)
    look_for_no_errors_of_brightness(monkeypatch)
    return calls


@pytest.fixture
def no_figures(monkeypatch, mapped):
    """Figures are drawn once, for the shared run; `test_report.py` proves them."""
    from runs import draw_no_figures

    draw_no_figures(monkeypatch)


@pytest.fixture
def photometry_as_stated(monkeypatch):
    """The reflectance model, the response and the error that all Suns share are those that a run begins with.

    `test_model_ranking.py` proves the choice of the model.
    """
    from adjustments import look_for_no_errors_of_brightness

    def kept(scene, known, candidates, progress=None):
        return known, f"{known.name}, models are not compared"

    for user in ("pipeline.model_choice", "plan.forecast"):
        monkeypatch.setattr(import_module(f"photoclinometry.{user}"), "model_by_cross_validation", kept)
    look_for_no_errors_of_brightness(monkeypatch)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where pages of the viewer lie, and where the browser saves what they write."""
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def window(folder):
    """The browser (`browser.Page`)."""
    from browser import browser

    with browser(folder) as found:
        yield found


@pytest.fixture
def page(window, file):
    """The page `file` of a module, just opened; whatever a test does, nothing is logged."""
    window.open(file)
    window.settle()
    yield window
    assert window.messages() == []
