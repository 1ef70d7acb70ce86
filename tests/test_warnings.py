"""Warnings reach the result: terminal, metrics.json, report, `RunResult`; a map that is not to be trusted says so."""

import ast
import json
import logging
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from commands import phomo
from photoclinometry.evaluate.verdict import CARE, SOUND, UNCHECKED_RELIEF, WRONG, Judgement
from photoclinometry.model.warning import CODES, Warned, collected_warnings, distinct, warn
from photoclinometry.photometry.predict import observation_brightness
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.checks.rendering_check import OFF, POOR_FIT_PERCENT, POOR_PSNR_DB, warn_of_renderings
from photoclinometry.pipeline.folder.run_folder import open_run
from photoclinometry.pipeline.folder.stage import Stage, Tools
from photoclinometry.pipeline.frame.pose_priors import prior_table
from photoclinometry.pipeline.products import RunSummary, write_products
from photoclinometry.pipeline.result_display import result_card
from photoclinometry.pipeline.trust import LEAST_EXPLAINED, brightness_off, change_explained, why_untrusted

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "photoclinometry"

log = logging.getLogger("photoclinometry.tests")


def calls(name: str) -> list[tuple[Path, ast.Call]]:
    """Calls of a function or method of this name in the sources."""
    found = []
    for file in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", None)) == name:
                found.append((file, node))
    return found


def test_every_warning_of_the_library_has_a_code():
    """Nothing is warned of but by `warn`, which asks for a code; the codes are those of the table, all of them used."""
    assert {file.name for file, call in calls("warning") if isinstance(call.func, ast.Attribute)} == {"warning.py"}
    used = set()
    for _, call in calls("warn"):
        code = call.args[1]
        choices = [code.body, code.orelse] if isinstance(code, ast.IfExp) else [code]
        used |= {choice.value for choice in choices if isinstance(choice, ast.Constant)}
    assert used == set(CODES)


def test_the_page_of_symptoms_has_the_meaning_of_every_code_and_what_to_do():
    page = (ROOT / "docs" / "howto" / "symptoms.md").read_text(encoding="utf-8")
    table = page[page.index("## All warnings") :]
    rows = re.findall(r"^\| `([\w-]+)` \| (.+?) \| (.+) \|$", table, flags=re.MULTILINE)
    assert {code: meaning for code, meaning, _ in rows} == CODES


def test_a_warning_is_logged_and_collected_however_logging_is_set_up(caplog):
    quiet = logging.getLogger("photoclinometry.quiet")
    quiet.setLevel(logging.CRITICAL)
    with collected_warnings() as outer, collected_warnings() as inner:
        warn(log, "view-brightness", "%s is %d %% off", "a", 7, view="a")
        warn(quiet, "no-uncertainty", "100 % lost")
    warn(log, "no-uncertainty", "after the block")
    assert outer == inner
    assert outer == [Warned("view-brightness", "a is 7 % off", "a"), Warned("no-uncertainty", "100 % lost")]
    (first, last) = caplog.records
    assert (first.getMessage(), first.code, first.view) == ("a is 7 % off", "view-brightness", "a")
    assert first.filename == "test_warnings.py"
    assert last.getMessage() == "after the block"
    with pytest.raises(ValueError, match="no code of a warning"):
        warn(log, "oops", "x")


def test_of_warnings_about_one_view_the_latest_counts():
    said = [
        Warned("a", "5 % off", "v"),
        Warned("b", "x"),
        Warned("a", "4 % off", "v"),
        Warned("b", "x"),
        Warned("b", "y"),
    ]
    assert distinct(said) == (Warned("a", "4 % off", "v"), Warned("b", "x"), Warned("b", "y"))


@pytest.mark.parametrize(
    ("metrics", "codes"),
    [
        ({"psnr_mean_db": POOR_PSNR_DB - 0.1}, ["renderings-differ"]),
        ({"psnr_mean_db": POOR_PSNR_DB, OFF: POOR_FIT_PERCENT}, []),
        ({"psnr_mean_db": POOR_PSNR_DB + 9.0, OFF: POOR_FIT_PERCENT + 0.1}, ["renderings-differ"]),
        ({}, []),
    ],
)
def test_renderings_that_differ_from_the_images_are_warned_of(metrics, codes):
    with collected_warnings() as warned:
        warn_of_renderings(metrics)
    assert [each.code for each in warned] == codes


@dataclass(frozen=True)
class Nothing:
    """A result."""

    value: float


@dataclass(frozen=True, kw_only=True)
class Doubtful(Stage[Nothing]):
    """A stage that warns."""

    name = "warning"
    result = Nothing

    def make(self, tools: Tools) -> Nothing:
        warn(log, "view-left-out", "%s is left out", "a", view="a")
        return Nothing(1.0)


def test_a_stage_that_is_read_back_warns_again(tmp_path):
    made, again = open_run(tmp_path), open_run(tmp_path)
    with collected_warnings() as made.warned:
        made.result_of(Doubtful())
    again.result_of(Doubtful())
    assert again.costs[0].resumed
    assert made.warnings == again.warnings == (Warned("view-left-out", "a is left out", "a"),)


def test_a_judgement_is_its_verdict_and_its_reasons():
    """Distrust outweighs warnings and care; these outweigh nothing at all. As `metrics.json` has it."""
    warned, wrong, care = Warned("view-left-out", "a is left out", "a"), "the relief is off", "few views"
    assert Judgement().verdict == SOUND
    assert Judgement(warnings=(warned,)).verdict == Judgement(care=(care,)).verdict == CARE
    found = Judgement(warnings=(warned,), distrust=(wrong,), care=(care,))
    assert (found.verdict, found.trusted, found.reasons) == (WRONG, False, (wrong, care))
    assert found.as_json() == {
        "verdict": "do not trust",
        "trusted": False,
        "not_trusted_because": [wrong],
        "care": [care],
        "warnings": [{"code": "view-left-out", "words": "a is left out", "view": "a"}],
    }


def test_a_result_has_the_parts_of_its_judgement_by_name(mapped):
    judgement = Judgement(warnings=(Warned("suns-moved", "w"),), distrust=("d",), care=("c",))
    result = replace(mapped.result, judgement=judgement)
    for name in ("verdict", "trusted", "warnings", "distrust", "care"):
        assert getattr(result, name) == getattr(judgement, name)


@pytest.fixture
def doubtful(mapped, monkeypatch, no_figures, photometry_as_stated):
    """Runs that warn at their end of what makes a map untrusted; the folder to run into."""

    def warning(*arguments):
        warn(log, "most-suns-contradict", "the Sun directions <contradict> each other")
        return prior_table(*arguments)

    monkeypatch.setattr("photoclinometry.pipeline.products.prior_table", warning)


def test_a_run_that_warns_says_so_at_its_end_and_in_its_files(mapped, tmp_path, capsys, doubtful):
    folder = mapped.copy(tmp_path / "run")
    assert phomo("run", mapped.site, "--out", folder) == 3
    said = capsys.readouterr()
    end = " ".join(said.err.split())
    assert end.index("6 views, mean PSNR") < end.index(
        "warnings: 1 - the Sun directions <contradict> each other [most-"
    )
    assert said.err.splitlines()[-1].startswith("phomo: the map is written, but not to be trusted: the Sun directions")
    assert said.out.strip() == str(folder / "report" / "index.html")
    content = json.loads((folder / "metrics.json").read_text())
    row = {"code": "most-suns-contradict", "words": "the Sun directions <contradict> each other", "view": ""}
    assert content["warnings"] == [row]
    assert content["trusted"] is False
    assert content["verdict"] == "do not trust"
    assert "verdict: do not trust" in end
    assert "check the convention of `sun`" in content["not_trusted_because"][0]
    assert not (folder / "lock").exists()


def test_a_result_shows_its_warnings(mapped, tmp_path, doubtful):
    result = pipeline.run(mapped.site, mapped.copy(tmp_path / "run"))
    assert [warned.code for warned in result.warnings] == ["most-suns-contradict"]
    assert not result.trusted
    assert "1 warnings; NOT TO BE TRUSTED" in repr(result)
    assert "&lt;contradict&gt; each other [most-suns-contradict]" in result_card(result)


def test_the_verdict_is_the_same_everywhere(mapped, tmp_path, capsys, caplog):
    """Of a map to take care of: in its files, in the log and the terminal, in `phomo info`, and in a notebook."""
    result = mapped.result
    few = replace(result.scene, tracks=result.scene.tracks.of_views(np.arange(4)))
    summary = RunSummary(adjustment=replace(result.adjustment, scene=few), config={}, left_out={})
    with caplog.at_level(logging.INFO):
        found = write_products(open_run(tmp_path), summary)
    care = "few views: 4.0 measure a landmark, 5 or more are good"
    assert (found.verdict, found.care[0]) == ("usable with care", care)
    assert {"verdict: usable with care", f"usable with care: {care}"} <= set(caplog.messages)
    content = json.loads((tmp_path / "metrics.json").read_text())
    assert (content["verdict"], tuple(content["care"])) == (found.verdict, found.care)
    html = found.report.read_text(encoding="utf-8")
    assert html.index("<b>Usable with care:</b>") < html.index(f"<li>{care}</li>") < html.index("What was mapped")
    assert "usable with care" in repr(found)
    assert f">{care}" in result_card(found)
    assert phomo("info", tmp_path) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"verdict: usable with care take care: {care}" in said


def test_info_tells_the_codes_of_warnings(mapped, tmp_path, capsys):
    folder = mapped.copy(tmp_path / "run")
    content = json.loads((folder / "metrics.json").read_text())
    content["warnings"] = [Warned("view-left-out", "a is left out", "a").as_row()]
    (folder / "metrics.json").write_text(json.dumps(content))
    assert phomo("info", folder) == 0
    assert "warning: a is left out [view-left-out]" in capsys.readouterr().out


@pytest.mark.parametrize("code", ["relief-by-shading", "relief-inverted"])
def test_a_map_whose_relief_is_inverted_is_not_trusted(mapped, code):
    inverted = Warned(code, "brightness contradicts the slopes of the sparse model")
    (reason,) = why_untrusted(mapped.result.adjustment, 0, (inverted,))
    assert "hills for hollows: check `sun`" in reason


def test_a_sound_map_is_trusted_and_has_no_warnings(mapped):
    content = json.loads((mapped.run / "metrics.json").read_text())
    assert content["trusted"] is True
    assert content["not_trusted_because"] == content["warnings"] == []
    assert content["metrics"]["brightness_change_explained_percent"] > 80.0
    assert mapped.result.trusted
    report = mapped.result.report.read_text(encoding="utf-8")
    assert content["verdict"] == mapped.result.verdict
    unsure = content["metrics"]["relief_over_parallax_sigma"]  # so small a map has few matches: 6 to 12 % by machine
    with_care = unsure > UNCHECKED_RELIEF
    assert f"<b>{'Usable with care' if with_care else 'Sound'}:</b>" in report
    assert report.count(f"<li>parallax checks the relief to {100.0 * unsure:.0f} % only") == with_care


def mirrored(scene):
    """All Suns mirrored, x -> -x in C."""
    rotation = scene.views.body_from_cam.rotation
    in_cam = np.einsum("kji,kj->ki", rotation, scene.views.sun) * [-1.0, 1.0, 1.0]
    return replace(scene, views=replace(scene.views, sun=np.einsum("kij,kj->ki", rotation, in_cam)))


def equal(scene):
    """All Suns the same in C."""
    rotation = scene.views.body_from_cam.rotation
    first = rotation[0].T @ scene.views.sun[0]
    return replace(scene, views=replace(scene.views, sun=rotation @ first))


def exposed_otherwise(scene):
    """The brightness of two views of three ten times what the map was made of."""
    factor = np.where(scene.tracks.view % 3, 10.0, 1.0)
    return replace(scene, tracks=replace(scene.tracks, brightness=scene.tracks.brightness * factor))


@pytest.mark.parametrize("spoil", [mirrored, equal, exposed_otherwise])
def test_a_map_that_explains_less_than_flat_ground_is_not_trusted(mapped, spoil):
    scene = spoil(mapped.result.scene)
    assert change_explained(scene) < LEAST_EXPLAINED
    (reason,) = why_untrusted(replace(mapped.result.adjustment, scene=scene), 0, ())
    assert reason.startswith(f"the brightness is {100 * brightness_off(scene):.0f} % off what the map predicts")


def test_light_that_does_not_change_is_no_reason_for_distrust(mapped):
    """Nothing is left to explain but noise, and the map explains none of it: it is not off by much, either."""
    scene = mapped.result.scene
    suns = np.repeat(scene.views.sun[:1], len(scene.views), axis=0)
    scene = replace(scene, views=replace(scene.views, sun=suns))
    noise = 1.0 + 0.02 * np.random.default_rng(0).normal(size=len(scene.tracks))
    same = replace(scene, tracks=replace(scene.tracks, brightness=observation_brightness(scene) * noise))
    assert change_explained(same) < LEAST_EXPLAINED
    assert why_untrusted(replace(mapped.result.adjustment, scene=same), 0, ()) == ()


def test_an_estimate_that_has_not_converged_is_not_trusted(mapped):
    stopped = replace(mapped.result.adjustment, converged=False, message="stopped after 3 steps")
    assert why_untrusted(stopped, 0, ()) == ("the joint estimate has not converged: stopped after 3 steps",)


@pytest.mark.parametrize(("left_out", "trusted"), [(6, True), (7, False)])
def test_a_map_of_the_smaller_part_of_the_views_is_not_trusted(mapped, left_out, trusted):
    reasons = why_untrusted(mapped.result.adjustment, left_out, ())
    assert reasons == (() if trusted else ("7 of 13 views are left out",))


def test_an_albedo_that_no_surface_has_is_not_trusted(mapped):
    """I/F in percent."""
    scene = mapped.result.scene
    percent = replace(
        scene,
        landmarks=replace(scene.landmarks, albedo=100.0 * scene.landmarks.albedo),
        tracks=replace(scene.tracks, brightness=100.0 * scene.tracks.brightness),
        views=replace(scene.views, bias=100.0 * scene.views.bias),
    )
    (reason,) = why_untrusted(replace(mapped.result.adjustment, scene=percent), 0, ())
    assert "which no surface has: the brightness is not I/F" in reason


def test_what_was_warned_of_is_in_the_report(mapped, tmp_path):
    from photoclinometry.output.report import ReportContent, write_report
    from scenes import synthetic_scene

    scene = synthetic_scene(size=12, views=3, reflectance=None)
    warned = Warned("view-left-out", "a.fits is left out")
    content = ReportContent(judgement=Judgement(warnings=(warned,), distrust=("7 of 13 views are left out",)))
    html = write_report(tmp_path / "report", scene, content=content).read_text(encoding="utf-8")
    parts = (
        "<b>Do not trust:</b>",
        "7 of 13 views are left out",
        "1 warning<",
        "a.fits is left out",
        "What was mapped",
    )
    assert sorted(map(html.index, parts)) == [html.index(part) for part in parts]
