"""The table of matchers: what is in it can be chosen by name, and is what relighting iterations use too."""

from dataclasses import dataclass

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions
from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.io.site import read_site
from photoclinometry.matching.flow import FlowMatcher, FlowOptions, crop, normalise, resample, warp_by_flow
from photoclinometry.matching.interface import region_matches
from photoclinometry.matching.registry import MATCHERS, MatcherEntry, matcher_entry
from photoclinometry.matching.roma import RomaOptions
from photoclinometry.model.errors import InputError
from photoclinometry.pipeline.choices import choose, keyed_matcher
from photoclinometry.pipeline.folder.run_folder import adopt_stages
from photoclinometry.pipeline.options import RelightOptions
from photoclinometry.pipeline.run import RunOptions, run
from photoclinometry.simulate.truth_file import read_truth

MATCHED = []
"""Names of what the toy matched."""


# A matcher and its entry, in fifteen lines.
@dataclass(frozen=True)
class ToyMatcher:
    window_px: int
    name: str = "toy"

    def match(self, request):
        import cv2

        MATCHED.append(request.target.name)
        pictures = (crop(request.reference, request.padded), resample(request.target, request.prediction))
        a, b = (np.clip(128 + 32 * normalise(*p, 6.0), 0, 255).astype(np.uint8) for p in pictures)
        flow = cv2.calcOpticalFlowFarneback(a, b, np.zeros((*a.shape, 2)), 0.5, 3, self.window_px, 5, 7, 1.5, 0)
        valid = pictures[0][1] & pictures[1][1]
        ones = np.ones(a.shape)
        return region_matches(request, warp_by_flow(request.prediction, flow, order=1), ones, 0.2 * ones, valid)


TOY = MatcherEntry(options=15, make=ToyMatcher, precision="not measured")


@pytest.fixture
def toy(monkeypatch):
    monkeypatch.setitem(MATCHERS, "toy", TOY)
    MATCHED.clear()


@pytest.mark.usefixtures("no_figures", "photometry_as_stated")
def test_a_matcher_from_outside_maps_a_site_and_relights_it(mapped, tmp_path, toy):
    adopt_stages(mapped.run, tmp_path / "run", ("sparse",))
    options = RunOptions(
        matcher="toy", matching_passes=1, relight=RelightOptions(iterations=1), adjust=AdjustOptions(uncertainty=False)
    )
    result = run(mapped.site, tmp_path / "run", options)
    views = result.scene.views.name
    others = [name for k, name in enumerate(views) if k != result.scene.reference]
    assert others * 2 == MATCHED  # for the first map, and against the reference relit
    metrics = evaluate_against_truth(result.scene, read_truth(mapped.truth)).metrics
    assert metrics["surface_distance_mean_gsd"] < 0.3
    assert metrics["normal_error_mean_deg"] < 5.0


def test_relight_and_flow_are_one_matcher_with_iterations_and_without():
    for name, iterations in (("relight", 3), ("flow", 0)):
        options = RunOptions(matcher=name)
        assert (options.matcher_name, options.max_iterations) == ("flow", iterations)
        assert isinstance(keyed_matcher(options.matcher_name, options).value, FlowMatcher)
    assert RunOptions(matcher="roma", relight=RelightOptions(iterations=2)).max_iterations == 2


def test_options_of_a_matcher_are_those_of_the_run_or_of_its_entry(toy):
    flow, roma = FlowOptions(patch_px=16), RomaOptions(device="cuda")
    options = RunOptions(flow=flow, roma=roma)
    assert options.of_matcher("flow") is flow
    assert options.of_matcher("roma") is roma
    assert options.of_matcher("toy") == 15


def test_an_entry_says_what_relighting_iterations_use(toy, monkeypatch, mapped):
    entry = MatcherEntry(options=15, make=ToyMatcher, precision="not measured", relit_with="flow")
    site, options = read_site(mapped.site), RunOptions(matcher="toy", flow=FlowOptions(patch_px=16))
    assert choose(site, options).relit_matcher.value == ToyMatcher(15)
    monkeypatch.setitem(MATCHERS, "toy", entry)
    assert choose(site, options).matcher.value == ToyMatcher(15)
    assert choose(site, options).relit_matcher.value == FlowMatcher(FlowOptions(patch_px=16))
    assert MATCHERS["roma"].relit_with == "flow"


def test_a_key_tells_the_matcher_its_options_and_its_code(toy, monkeypatch):
    options = RunOptions(matcher="toy")
    keys = [keyed_matcher(name, options).key for name in ("toy", "flow")]
    other = MatcherEntry(options=21, make=ToyMatcher, precision="not measured")
    monkeypatch.setitem(MATCHERS, "toy", other)
    keys.append(keyed_matcher("toy", options).key)
    monkeypatch.setattr("photoclinometry.pipeline.choices._code_of", lambda make: "changed")
    keys.append(keyed_matcher("toy", options).key)
    assert len(set(keys)) == 4


def test_names_that_are_not_in_the_table_are_refused():
    with pytest.raises(InputError, match=r"no matcher 'rmoa'; known: relight, flow, roma"):
        RunOptions(matcher="rmoa")
    with pytest.raises(InputError, match=r"no matcher 'rmoa'; known: flow, roma; nearest: roma"):
        matcher_entry("rmoa")
