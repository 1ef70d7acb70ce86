"""A run of a site with a blurred image: its view is found in the first map and left out of the next ones."""

import json
import shutil
from dataclasses import replace

import pytest
from astropy.io import fits
from scipy.ndimage import gaussian_filter

from adjustments import look_for_no_errors_of_brightness
from photoclinometry.adjust import AdjustOptions
from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.pipeline.options import RelightOptions
from photoclinometry.pipeline.run import RunOptions, run
from runs import draw_no_figures

pytestmark = pytest.mark.usefixtures("no_figures", "photometry_as_stated")

BLURRED = "images/001.fits"
OPTIONS = RunOptions(
    reflectance="lunar-lambert",
    densify=DensifyOptions(min_views=4),
    relight=RelightOptions(iterations=1, direct=False),
    adjust=AdjustOptions(uncertainty=False),
)


@pytest.fixture(scope="module")
def site(mapped, tmp_path_factory):
    """The small site with one image blurred by two pixels."""
    folder = tmp_path_factory.mktemp("blurred") / "site"
    shutil.copytree(mapped.site.parent, folder)
    with fits.open(folder / BLURRED, mode="update") as content:
        content[0].data[...] = gaussian_filter(content[0].data, 2.0)
    return folder / "site.toml"


@pytest.fixture(scope="module")
def without(site):
    """The run, and its folder."""
    folder = site.parent.with_name("run")
    with pytest.MonkeyPatch.context() as patch:
        draw_no_figures(patch)
        look_for_no_errors_of_brightness(patch)
        return run(site, folder, OPTIONS), folder


def test_the_view_is_left_out_and_named(without):
    result, folder = without
    assert BLURRED not in result.scene.views.name
    assert len(result.scene.views) == 5
    assert list(result.left_out) == [BLURRED]
    metrics = json.loads((folder / "metrics.json").read_text())
    assert [(w["code"], w["view"]) for w in metrics["warnings"]] == [("view-blurred", BLURRED)]
    assert "less sharp" in metrics["left_out"][0]["reason"]


def test_the_run_is_read_back_as_it_is(site, without):
    result, folder = without
    again = run(site, folder, OPTIONS)
    assert again.metrics == result.metrics
    stages = json.loads((folder / "metrics.json").read_text())["stages"]
    assert [s["stage"] for s in stages if s["resumed"]].count("last_estimate") == 1


def test_it_stays_where_views_are_not_checked(site, tmp_path):
    result = run(site, tmp_path / "run", replace(OPTIONS, check_views=False))
    assert BLURRED in result.scene.views.name
