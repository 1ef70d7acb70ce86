"""A study: its cells, its tables by hand, and a miniature one that is stopped, goes on, and equals its parts."""

import json
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.cli import main
from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.evaluate.spread import Table
from photoclinometry.io.scene_file import read_scene
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.run import RunOptions
from photoclinometry.rivals.compare import RivalOptions
from photoclinometry.rivals.spc import SpcOptions
from photoclinometry.simulate.truth_file import read_truth
from photoclinometry.study import StudyOptions, run_study
from photoclinometry.study.figures import draw_heights, draw_scales, scan_row
from photoclinometry.study.page import write_page
from photoclinometry.study.plan import GEOMETRY, MODELS, cells
from photoclinometry.study.record import Record, read_record, write_record
from photoclinometry.study.summary import groups, tables

SMALL = StudyOptions(
    presets=("demo",),
    models=("lunar-lambert",),
    surfaces=("matched",),
    hold_out_every=0,
    views=6,
    image_size=192,
    region_size=32,
)
"""Its one site is that of `runs.SITE`."""


def test_the_papers_study_is_every_combination_once():
    found = cells(StudyOptions())
    assert len({cell.name for cell in found}) == len(found) == 3 * 2 * 6
    assert len({cell.site for cell in found}) == 3 * 6  # five matched sites and Hapke's, for each place
    for cell in found:
        matched = cell.simulation.reflectance if cell.model != GEOMETRY else "lunar-lambert"
        assert cell.surface == "hapke" or cell.simulation.reflectance in (cell.model, matched)
    assert [cell.site for cell in found] == sorted(cell.site for cell in found)


def test_one_view_in_ten_is_held_out_the_same_for_every_model():
    held = {cell.hold_out for cell in cells(StudyOptions(presets=("cornelia",)))}
    assert held == {("images/005.fits", "images/015.fits", "images/025.fits")}
    assert {cell.hold_out for cell in cells(replace(SMALL, hold_out_every=0))} == {()}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"models": ("lambert",)}, "no reflectance model 'lambert'"),
        ({"models": ("auto",), "surfaces": ("matched",)}, "'auto' among the models needs surfaces that name a model"),
        ({"presets": ("mars",)}, "no preset 'mars'"),
        ({"surfaces": ("chalk",)}, "chalk"),
        ({"lightings": ("dim",)}, "no lighting 'dim'"),
        ({"seeds": ()}, "needs seeds"),
        ({"seeds": (1, 1)}, "each once"),
        ({"rivals": ("spc", "spc")}, "rivals each once"),
        ({"hold_out_every": 1}, "hold_out_every is 1; give a whole number, 2 to 1000000, or 0"),
    ],
)
def test_a_study_that_cannot_be_is_refused_before_anything_is_made(changes, message):
    with pytest.raises(InputError, match=message):
        replace(SMALL, **changes)


def records(options: StudyOptions) -> list[Record]:
    """Made-up outcomes: PSNR 30 + seed + 10 x (number of the model), heights off by 4 m, by 1 m with photometry."""
    found = []
    for cell in cells(options):
        number = MODELS.index(cell.model) if cell.model in MODELS else 9
        psnr = 30.0 + cell.simulation.seed + 10.0 * number
        true = np.add.outer(np.arange(20.0), np.arange(30.0) ** 2)
        true[3, 4] = np.nan
        off = 4.0 if cell.model == GEOMETRY else 1.0
        arrays = {
            "height": true + off * np.where(np.arange(30) % 2, 1, -1),
            "true_height": true,
            "spacing": np.array(60.0),
        }
        arrays |= {"phase": np.linspace(0.5, 1.0, 6), "scale": np.linspace(2.0, 1.0, 6)}
        found.append(Record(cell, {"psnr_mean_db": psnr, "psnr_held_out_mean_db": psnr - 1.0}, arrays))
    return found


def test_tables_by_hand():
    """Two places, two seeds: means over seeds, their standard deviation 1 / sqrt(2), and the average of the rows."""
    options = replace(
        SMALL, presets=("demo", "ahuna"), models=("akimov", "mcewen"), seeds=(0, 1), views=9, hold_out_every=3
    )
    psnr, held, errors, heights = tables(options, records(options))
    assert psnr.columns == ("akimov", "mcewen")
    assert [row for row, _ in psnr.rows] == ["ahuna", "demo", "average"]
    assert [value.mean for value in psnr.rows[0][1]] == [30.5, 40.5]
    assert psnr.rows[0][1][0].std == pytest.approx(np.sqrt(0.5))
    assert psnr.rows[2][1][1].mean == 40.5
    assert held.rows[0][1][0].mean == 29.5
    assert len(errors.rows) == 2 * 3
    assert "| demo | 30.50 ± 0.71 | 40.50 ± 0.71 |" in psnr.markdown()
    without, with_it, gain = heights.rows[0][1]
    assert (without.mean, with_it.mean, gain.mean) == (4.0, 1.0, 75.0)


def test_tables_of_rivals_by_hand():
    """Two seeds: what is unknown of one of them is not in the mean, and a rival that found no map is a dash."""
    options = replace(SMALL, geometry_alone=False, seeds=(0, 1), views=9, hold_out_every=3, rivals=("spc", "mvs"))
    key = "psnr_held_out_mean_db"
    beside = [
        {"phomo": {key: 40.0, "albedo_error_mean_percent": 1.0}, "spc": {key: 38.0}, "mvs": {key: 30.0}},
        {"phomo": {key: 42.0, "albedo_error_mean_percent": 3.0}, "spc": {key: 41.0, "ssim": None}},
    ]
    found = [replace(r, rivals=figures) for r, figures in zip(records(options), beside, strict=True)]
    held, figures = tables(options, found)[-2:]
    assert held.title.startswith("Table 5")
    assert held.columns == ("phomo", "spc", "mvs")
    assert "| demo | 41.00 ± 1.41 | 39.50 ± 2.12 | 30.00 |" in held.markdown()
    assert [label for label, _ in figures.rows] == ["demo: phomo", "demo: spc", "demo: mvs"]
    shown = dict(zip(figures.columns, figures.rows[0][1], strict=True))
    assert shown["albedo [%]"].mean == 2.0
    assert shown["SSIM"] is None
    assert not any("rivals" in table.title for table in tables(replace(options, rivals=()), found))


def test_a_run_that_failed_is_a_dash_and_not_a_number():
    found = [replace(r, metrics={}, failure="2 of 9 views registered") for r in records(SMALL)]
    for table in tables(SMALL, found):
        assert all(value is None for _, values in table.rows for value in values)
        assert "–" in table.markdown()
        json.dumps(table.as_dict(), allow_nan=False)


def test_tables_fit_a_terminal_and_cut_no_value():
    """Five models, two surfaces and two seeds; nine columns of `mean ± deviation` go below each other."""
    options = replace(SMALL, presets=("demo", "ahuna"), models=MODELS, surfaces=("matched", "hapke"), seeds=(0, 1))
    for table in tables(options, records(options)):
        text = table.terminal(80)
        assert max(map(len, text.splitlines())) <= 80
        shown = " ".join(text.split())
        for value in (value for row in table.cells() for value in row):
            assert value in shown
        for word in " ".join((table.title, *table.columns, *(label for label, _ in table.rows))).split():
            assert word in shown
        assert Table.from_dict(json.loads(json.dumps(table.as_dict()))) == table


def test_the_command_shows_the_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")

    def made(options, out, progress):
        return write_page(out, SMALL, records(SMALL))

    monkeypatch.setattr("photoclinometry.study.run_study", made)
    main(["study", "--out", str(tmp_path)])
    said = capsys.readouterr()
    assert said.out.strip() == str(tmp_path / "study.md")
    assert "Table 4: errors against truth, mean over landmarks" in said.err
    assert max(map(len, said.err.splitlines())) <= 80


def test_groups_are_named_by_what_differs():
    options = replace(SMALL, surfaces=("matched", "hapke"), lightings=("moderate", "strong"))
    rows = tables(options, records(options))[0].rows
    assert rows[0][0] == "demo, moderate, hapke"
    assert len(groups(records(options))) == 4


def test_the_scanned_row_has_the_greatest_relief_and_is_nearly_whole():
    height = np.zeros((5, 10))
    height[1, 3], height[2, 0], height[4, 2] = 50.0, 20.0, 90.0
    height[4, 4:9] = np.nan
    assert scan_row(height) == 1


def test_pictures_are_drawn(tmp_path):
    options = replace(SMALL, models=("akimov", "mcewen", "lunar-lambert"), surfaces=("matched", "hapke"))
    by_model = {r.cell.model: r for r in records(options) if r.cell.surface == "hapke"}
    assert draw_heights(tmp_path / "h.png", by_model[GEOMETRY], by_model["mcewen"]).stat().st_size > 10_000
    for surface in ("matched", "hapke"):
        free = [r for r in records(options) if r.cell.surface == surface and r.cell.model in ("akimov", "mcewen")]
        assert draw_scales(tmp_path / f"{surface}.png", free, "vesta").stat().st_size > 10_000


def test_a_record_is_read_back_under_its_key_only(tmp_path):
    record = records(SMALL)[0]
    record = replace(record, metrics={**record.metrics, "odd": float("nan")})
    write_record(tmp_path / "r", record, "key")
    found = read_record(tmp_path / "r", record.cell, "key")
    np.testing.assert_equal(found.metrics, record.metrics)
    np.testing.assert_array_equal(found.arrays["height"], record.arrays["height"])
    assert read_record(tmp_path / "r", record.cell, "other") is None
    (tmp_path / "r" / "values.npz").write_bytes(b"PK damaged")
    assert read_record(tmp_path / "r", record.cell, "key") is None
    write_record(tmp_path / "r", replace(record, arrays={"height": record.arrays["height"]}), "key")
    assert read_record(tmp_path / "r", record.cell, "key") is None
    write_record(tmp_path / "r", replace(record, failure="no map"), "key")
    assert read_record(tmp_path / "r", record.cell, "key") is None  # it is tried again


@pytest.fixture
def study(mapped, tmp_path):
    """A study whose one run with photometry has been made already (that of `mapped`)."""
    folder = tmp_path / "study"
    (folder / "runs").mkdir(parents=True)
    (folder / "study.toml").write_text("")
    mapped.copy(folder / "runs" / "demo-moderate-lunar-lambert-0" / "lunar-lambert")
    return folder


def test_a_study_goes_on_where_it_was_stopped_and_equals_its_parts(mapped, study, monkeypatch):
    monkeypatch.setattr("photoclinometry.output.report.write_report", lambda folder, *_, **__: folder / "index.html")
    proper = pipeline.run

    def stopped(site, out, options, **rest):
        if options.reflectance == GEOMETRY:
            raise KeyboardInterrupt
        return proper(site, out, options, **rest)

    monkeypatch.setattr(pipeline, "run", stopped)
    with pytest.raises(KeyboardInterrupt):
        run_study(SMALL, study)
    assert not (study / "study.md").exists()

    def no_photometry(site, out, options, **rest):
        assert options.reflectance == GEOMETRY, "what was finished is done again"
        return proper(site, out, options, **rest)

    monkeypatch.setattr(pipeline, "run", no_photometry)
    page = run_study(SMALL, study)
    resumed = json.loads((study / "runs/demo-moderate-lunar-lambert-0/none/metrics.json").read_text())["stages"]
    assert [s["stage"] for s in resumed if s["resumed"]] == ["sparse", "region", "dense"]

    content = json.loads((study / "study.json").read_text(), parse_constant=pytest.fail)
    metrics = {cell["model"]: cell["metrics"] for cell in content["cells"]}
    run = study / "runs/demo-moderate-lunar-lambert-0/lunar-lambert"
    expected = evaluate_against_truth(read_scene(run / "scene.h5"), read_truth(mapped.truth)).metrics
    assert metrics["lunar-lambert"]["normal_error_mean_deg"] == pytest.approx(expected["normal_error_mean_deg"])
    written = json.loads((run / "metrics.json").read_text())
    assert metrics["lunar-lambert"]["psnr_mean_db"] == pytest.approx(written["metrics"]["psnr_mean_db"])
    assert metrics["none"]["normal_error_mean_deg"] > metrics["lunar-lambert"]["normal_error_mean_deg"]
    text = page.read_text()
    for line in text.splitlines():
        if line.startswith("!["):
            assert (study / line[line.rindex("(") + 1 : -1]).stat().st_size > 10_000
    assert text.count("![") == 4  # errors, map, relit, heights

    monkeypatch.setattr(pipeline, "run", stopped)
    monkeypatch.setattr("photoclinometry.study.work.simulate_site", None)
    assert run_study(SMALL, study) == page
    assert page.read_text() == text


def test_rivals_of_a_study_are_those_of_the_run_and_kept(study, monkeypatch):
    monkeypatch.setattr("photoclinometry.output.report.write_report", lambda folder, *_, **__: folder / "index.html")
    rival = RivalOptions(spc=SpcOptions(iterations=1))
    options = replace(SMALL, geometry_alone=False, rivals=("spc",), rival=rival)
    page = run_study(options, study)
    run = study / "runs/demo-moderate-lunar-lambert-0/lunar-lambert"
    written = json.loads((run / "rivals" / "rivals.json").read_text())["figures"]
    (cell,) = json.loads((study / "study.json").read_text())["cells"]
    assert cell["rivals"] == written
    assert list(written) == ["phomo", "spc"]
    text = page.read_text()
    assert f"| demo: spc | {written['spc']['psnr_mean_db']:.2f} |" in text
    assert (study / "figures" / "demo-moderate-matched-rivals.png").stat().st_size > 10_000

    monkeypatch.setattr(pipeline, "run", None)
    monkeypatch.setattr("photoclinometry.study.work.compare_rivals", None)
    assert run_study(options, study).read_text() == text


def test_a_site_without_a_map_does_not_stop_a_study(study, monkeypatch):
    def fails(*_, **__):
        raise ReconstructionError("2 of 6 views registered; add views")

    monkeypatch.setattr(pipeline, "run", fails)
    text = run_study(SMALL, study).read_text()
    assert "Runs without a map: demo-moderate-matched-0/lunar-lambert, demo-moderate-matched-0/none." in text
    assert "| demo | – |" in text


def test_a_folder_that_is_no_study_is_left_alone(tmp_path, capsys):
    (tmp_path / "letters").write_text("dear")
    with pytest.raises(InputError, match="is not a study"):
        run_study(SMALL, tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(["study", "--out", str(tmp_path / "new"), "--presets", "mars"])
    assert stop.value.code == 2
    assert "no preset 'mars'" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_each_run_may_choose_its_model():
    options = replace(SMALL, models=("lunar-lambert", "auto"), surfaces=("hapke",), geometry_alone=False)
    assert [cell.run_options(options).reflectance for cell in cells(options)] == ["lunar-lambert", "auto"]
    assert {cell.simulation.reflectance for cell in cells(options)} == {"hapke"}


def test_options_of_runs_are_the_studys():
    options = replace(SMALL, run=RunOptions(matching_passes=1, reflectance="mcewen", hold_out=("x",)))
    assert cells(options)[0].run_options(options) == RunOptions(matching_passes=1, reflectance="lunar-lambert")
