"""Baselines: what counts as worse, what is not judged, and what a refresh writes."""

import json

import pytest

import random_sites
from baseline import compare, judge, kept_figures, machine, write_baseline
from bench import main
from cases import METRICS, SUITES, Metric

LOWER = Metric(unit="m", direction="lower", relative=0.1, absolute=0.5)
HIGHER = Metric(unit="dB", direction="higher", absolute=0.3)


@pytest.mark.parametrize(
    ("metric", "baseline", "value", "verdict"),
    [
        (LOWER, 10.0, 11.0, "same"),
        (LOWER, 10.0, 11.01, "WORSE"),
        (LOWER, 10.0, 8.9, "better"),
        (LOWER, 1.0, 1.5, "same"),  # a tenth of 1 is less than 0.5
        (LOWER, 1.0, 1.51, "WORSE"),
        (HIGHER, 40.0, 39.75, "same"),
        (HIGHER, 40.0, 39.6, "WORSE"),
        (HIGHER, 40.0, 40.4, "better"),
        (HIGHER, 40.0, None, "MISSING"),
    ],
)
def test_worse_is_beyond_the_tolerance_in_the_wrong_direction(metric, baseline, value, verdict):
    assert judge(metric, baseline, value) == verdict


FIGURES = {"demo": {"normal_error_mean_deg": 2.0, "psnr_mean_db": 38.0, "run_cpu_s": 100.0}}


def changed(tmp_path, figures, here=None):
    write_baseline(tmp_path / "small.json", FIGURES)
    baseline = json.loads((tmp_path / "small.json").read_text())
    return {c.metric: c for c in compare(baseline, figures, here or machine())}


def test_a_baseline_says_unit_direction_and_tolerance(tmp_path):
    write_baseline(tmp_path / "small.json", {"demo": {**FIGURES["demo"], "sun_error_mean_deg": float("nan")}})
    cases = json.loads((tmp_path / "small.json").read_text(), parse_constant=pytest.fail)["cases"]
    expected = {"value": 38.0, "unit": "dB", "direction": "higher", "relative": 0.0}
    assert cases["demo"]["psnr_mean_db"] == {**expected, "absolute": METRICS["psnr_mean_db"].absolute}
    assert set(cases["demo"]) == set(FIGURES["demo"])


def test_the_same_figures_are_no_regression_and_worse_ones_are(tmp_path):
    assert not any(c.is_regression for c in changed(tmp_path, FIGURES).values())
    worse = {"demo": {"normal_error_mean_deg": 3.0, "psnr_mean_db": 39.0, "run_cpu_s": 300.0}}
    verdicts = {name: c.verdict for name, c in changed(tmp_path, worse).items()}
    assert verdicts == {"normal_error_mean_deg": "WORSE", "psnr_mean_db": "better", "run_cpu_s": "WORSE"}


def test_costs_are_not_judged_on_another_machine_but_accuracy_is(tmp_path):
    worse = {"demo": {"normal_error_mean_deg": 3.0, "psnr_mean_db": 38.0, "run_cpu_s": 300.0}}
    found = changed(tmp_path, worse, "abacus, 1 core")
    assert found["run_cpu_s"].verdict == "other machine"
    assert not found["run_cpu_s"].is_regression
    assert found["normal_error_mean_deg"].is_regression


def test_costs_of_another_machine_do_not_stay_in_a_baseline_of_this_one(tmp_path):
    write_baseline(tmp_path / "small.json", FIGURES)
    baseline = json.loads((tmp_path / "small.json").read_text())
    assert kept_figures(baseline, machine()) == FIGURES
    elsewhere = kept_figures(baseline, "abacus, 1 core")["demo"]
    assert set(FIGURES["demo"]) - set(elsewhere) == {"run_cpu_s"}


def test_a_figure_that_has_gone_is_a_regression_and_a_new_one_is_not(tmp_path):
    other = {"demo": {"psnr_mean_db": 38.0, "normal_error_mean_deg": float("nan"), "sun_error_mean_deg": 0.1}}
    found = changed(tmp_path, other)
    assert found["normal_error_mean_deg"].is_regression
    assert found["run_cpu_s"].is_regression
    assert found["sun_error_mean_deg"].verdict == "new"


def test_committed_baselines_are_of_cases_and_metrics_that_there_are():
    from bench import FOLDER

    for file in FOLDER.glob("*.json"):
        cases = json.loads(file.read_text())["cases"]
        assert set(cases) <= set(SUITES[file.stem])
        assert all(set(values) <= set(METRICS) for values in cases.values())


@pytest.fixture
def no_runs(tmp_path, monkeypatch):
    """Every case gives the same figures at once, and baselines are elsewhere."""
    now = {"normal_error_mean_deg": 2.0}
    monkeypatch.setattr("bench.run_cases", lambda cases, console: {name: dict(now) for name in cases})
    monkeypatch.setattr("bench.FOLDER", tmp_path)
    return now


def test_the_exit_code_is_that_of_what_is_worse(no_runs, tmp_path, capsys):
    assert main() == 2  # no baseline yet
    assert main(update=True) == 0
    assert main() == 0
    no_runs["normal_error_mean_deg"] = 9.0
    assert main() == 1
    assert "WORSE: demo: normal_error_mean_deg" in capsys.readouterr().out
    assert main(only=("none",)) == 2


def test_a_refresh_of_one_case_leaves_the_others(no_runs, tmp_path):
    main(update=True)
    no_runs["normal_error_mean_deg"] = 9.0
    main(update=True, only=("ceres",))
    cases = json.loads((tmp_path / "small.json").read_text())["cases"]
    assert {name: c["normal_error_mean_deg"]["value"] for name, c in cases.items()} == {
        **dict.fromkeys(SUITES["small"], 2.0),
        "ceres": 9.0,
    }


def test_a_random_site_is_the_same_in_every_call_and_differs_from_the_next():
    assert random_sites.drawn(3) == random_sites.drawn(3)
    assert random_sites.drawn(3) != random_sites.drawn(4)


@pytest.mark.parametrize(
    ("figures", "warnings", "verdict"),
    [
        ((0.05, 1.0), (), "sound"),
        ((0.05, 1.0), ("view-unregistered:a.png",), "sound"),
        ((0.05, 1.0), ("view-unregistered:a.png", "sun-undecided"), "false alarm"),
        ((0.05, 4.1), (), "SILENT"),
        ((0.16, 1.0), ("sun-undecided",), "warned"),
        ((float("nan"), 1.0), (), "SILENT"),
    ],
)
def test_maps_beyond_the_limits_should_warn_and_others_should_not(figures, warnings, verdict):
    names = ("surface_distance_mean_gsd", "normal_error_mean_deg")
    outcome = random_sites.Outcome(
        site=0, simulation="", figures=dict(zip(names, figures, strict=True)), warnings=warnings
    )
    assert outcome.verdict == verdict
    assert f"1 sites: 1 {verdict}." in random_sites.table([outcome])


def test_a_site_without_a_map_is_neither_bad_nor_sound():
    none = random_sites.Outcome(site=7, simulation="demo", error="0 of 7 views registered")
    assert none.verdict == "no map"
    assert "| 0 of 7 views registered | demo |" in random_sites.table([none])
