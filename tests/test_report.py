"""The report folder is whole: the page parses, every file that it names is there, every figure is drawn."""

import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from photoclinometry.evaluate.evaluate import view_table
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.output.report import ReportContent, write_report
from scenes import synthetic_images, synthetic_scene

VOID = {"meta", "img", "br", "link"}


class Page(HTMLParser):
    """Collects links and text, and checks that tags nest."""

    def __init__(self, html: str):
        super().__init__()
        self.open, self.files, self.text = [], set(), []
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        self.files |= {v for k, v in attrs if k in ("src", "href") and v and not v.startswith("#")}

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A noisy uncalibrated-looking scene with a hole, a view left out, stages and a convergence history."""
    scene = synthetic_scene(size=40, views=4, keypoint_noise_px=0.2, brightness_noise=0.01)
    rows = view_table(scene, synthetic_images(scene))
    rows = [{"used": True, **row} for row in rows] + [{"used": False, "name": "images/<odd>.fits"}]
    folder = tmp_path_factory.mktemp("run") / "report"
    path = write_report(
        folder,
        replace(scene, uncertainty={"albedo": np.full(1600, 1e-3), "sun": np.zeros((4, 2))}, frame=BODY_FIXED),
        synthetic_images(scene),
        ReportContent(
            per_view=rows,
            stages=[
                {"stage": "sparse", "wall_s": 12.25, "cpu_s": 20.5, "peak_memory_gb": 1.25},
                {"stage": "adjust", "wall_s": 30.0, "cpu_s": 55.0, "peak_memory_gb": 2.5},
            ],
            pose_priors=[{"name": "images/prior.fits", "used": False, "center_off_m": 812.5, "off_sigmas": 13.8}],
            convergence=[{"projection": 1e6 / 4**i, "photometric": 3e6 / 9**i + 1e3, "sun": 0.0} for i in range(6)],
            errors={"normal_error_deg": np.abs(np.random.default_rng(0).normal(size=1600))},
            options={"adjust": {"iterations": 10, "sigma": {"keypoint_px": 1.0}}, "matcher": "flow"},
        ),
    )
    return path, Page(path.read_text(encoding="utf-8"))


def test_every_file_that_the_page_names_exists_and_nothing_else(report):
    path, page = report
    present = {p.name for p in path.parent.iterdir()}
    assert page.files <= present
    assert present - page.files == {"index.html", "summary.json"}
    assert all((path.parent / file).stat().st_size > 3000 for file in page.files)


def test_all_figures_of_a_photometric_run_are_there(report):
    _, page = report
    expected = {"reference", "albedo", "height", "normals", "slope", "photometric_error", "views_per_landmark"}
    expected |= {"relit", "convergence", "difference_normal_error_deg", "uncertainty_albedo_sigma_percent"}
    assert {f"{name}.png" for name in expected} <= page.files
    assert sum(file.startswith("rendering_") for file in page.files) == 4


def test_page_shows_views_stages_and_options(report):
    _, page = report
    text = "\n".join(page.text)
    for fragment in (
        "images/<odd>.fits",
        "peak memory [GB]",
        "12.25",
        "images/prior.fits",
        "center off [m]",
        "812.5",
        "adjust.sigma.keypoint_px = 1.0",
        "PSNR [dB]",
    ):
        assert fragment in text, fragment


def test_summary_is_strict_json_with_units_in_its_keys(report):
    path, _ = report
    summary = json.loads((path.parent / "summary.json").read_text(), parse_constant=pytest.fail)
    assert summary["photometric_error_mean_percent"] == pytest.approx(0.95, abs=0.2)
    assert summary["psnr_mean_db"] > 40


def test_geometry_alone_has_no_photometric_figures(tmp_path):
    scene = synthetic_scene(size=16, views=4, reflectance=None)
    path = write_report(tmp_path / "report", scene, synthetic_images(scene))
    page = Page(path.read_text(encoding="utf-8"))
    maps = {"reference.png", "height.png", "normals.png", "slope.png", "views_per_landmark.png"}
    assert maps | {"viewer.html", "overview.png"} == page.files


def test_report_is_written_without_images(tmp_path):
    path = write_report(tmp_path / "report", synthetic_scene(size=16, views=3))
    page = Page(path.read_text(encoding="utf-8"))
    assert "reference.png" not in page.files
    assert "relit.png" in page.files


def test_a_report_replaces_an_older_one_whole(tmp_path):
    scene = synthetic_scene(size=16, views=3, reflectance=None)
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "old.png").write_text("old")
    write_report(tmp_path / "report", scene)
    assert not (tmp_path / "report" / "old.png").exists()


def test_an_unwritable_place_is_an_error_that_names_it(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RunFolderError, match="file"):
        write_report(tmp_path / "file" / "report", synthetic_scene(size=16, views=3, reflectance=None))


def test_reweighting_iterations_are_told_apart():
    """By their starts, also where the cost falls from one to the next; without numbers, where the cost rises."""
    from photoclinometry.adjust import Iteration
    from photoclinometry.output.report.curves import REWEIGHTING, cost_by_reweighting, split_reweightings

    def step(cost: float, solved: int, accepted: bool = True) -> Iteration:
        moved = 0.1 * (solved > 0)
        return Iteration(
            cost={"sun": cost},
            damping=1.0,
            cg_iterations=solved,
            accepted=accepted,
            position_step=moved,
            wall_s=0,
            cpu_s=0,
        )

    log = [step(9, 0), step(5, 3), step(7, 2, False), step(4, 0), step(3, 5), step(60, 0), step(50, 1)]
    rows = cost_by_reweighting(log)
    assert [row[REWEIGHTING] for row in rows] == [1, 1, 2, 2, 3, 3]
    total = np.array([9.0, 5, 4, 3, 60, 50])
    assert split_reweightings([row[REWEIGHTING] for row in rows], total) == [(0, 2), (2, 4), (4, 6)]
    assert split_reweightings([None] * 6, total) == [(0, 4), (4, 6)]
