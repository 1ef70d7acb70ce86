"""One line on the terminal for each stage; developers' text stays in the log file."""

import logging
import re
from pathlib import Path

import pytest

import photoclinometry
from photoclinometry.cli.stage_lines import NAMES, shown_name, stage_line
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.folder.stage import say_found
from runs import lines_shown


@pytest.fixture
def shown():
    """Lines that the records of the package's log make."""
    with lines_shown() as lines:
        yield lines


def test_a_stage_is_one_line_of_what_it_found_and_its_time(shown):
    folder = logging.getLogger("photoclinometry.pipeline.folder.run_folder")
    folder.info("%s ...", "sparse")
    logging.getLogger("photoclinometry.adjust").info("reweighting iteration 1: Noise(keypoint_factor=0.4354)")
    say_found("29 of 29 views, 41,203 points, 0.31 px")
    logging.getLogger("photoclinometry.sfm").warning("images/3.fits is left out: no matches")
    folder.info("it has ended", extra={"ended": "sparse", "wall_s": 12.4})
    folder.info("so has this", extra={"ended": "relighting_2", "wall_s": None})
    assert shown == [
        "images/3.fits is left out: no matches",
        "sparse          29 of 29 views, 41,203 points, 0.31 px                 12.4 s",
        "relighting 2    as in the earlier run",
    ]


def test_what_each_estimate_warns_of_is_told_once_for_each_view(shown):
    log = logging.getLogger("photoclinometry.pipeline.frame.pose_priors")
    for metres in (193, 21, 10):
        for view in ("7.fits", "8.fits"):
            warn(log, "prior-contradicts", "%s: its pose prior is %d m off", view, metres, view=view)
    warn(log, "view-brightness", "7.fits: its brightness is off", view="7.fits")
    assert shown == [
        "7.fits: its pose prior is 193 m off",
        "8.fits: its pose prior is 193 m off",
        "7.fits: its brightness is off",
    ]


def test_lines_fit_80_columns():
    assert len(stage_line("inconsistent_views", "x" * 50, 599.9) or "") <= 80
    assert "20.0 min" in (stage_line("last_estimate", "", 1200.0) or "")
    assert stage_line("initialise", "", 0.01) is None


def test_every_stage_of_a_run_has_a_name(mapped):
    stages = {file.stem for file in (mapped.run / "stages").glob("*.npz")}
    names = {re.sub(r" \d+$", "", shown_name(stage)) for stage in stages}
    assert names <= set(NAMES.values())


def test_every_stage_of_the_program_has_a_name():
    """A name with an underscore is one that developers write."""
    source = Path(photoclinometry.__file__).parent
    text = "".join(
        file.read_text(encoding="utf-8") for part in ("pipeline", "body") for file in (source / part).glob("*.py")
    )
    stages = set(re.findall(r'^    name = "(\w+)"|\.timed\("(\w+)"\)', text, flags=re.MULTILINE))
    assert {name or part for name, part in stages} <= set(NAMES)
    assert not any("_" in name for name in NAMES.values())


def test_findings_of_a_run_fit_their_column_and_its_work_ends_at_its_totals(mapped):
    """All stages, from the images."""
    told = mapped.told
    assert {"images", "features", "matches", "mapping", "match 1", "relight 1"} <= set(told.progress)
    assert all(done == total for done, total in told.progress.values() if total)
    lines = {line[:16].strip(): line for line in told.lines}
    assert "6 of 6 views, " in lines["sparse"]
    assert "32 x 32 px of images/" in lines["region"]
    assert " landmarks (" in lines["dense"]
    assert "matches moved" in lines["relighting 1"]
    assert "landmarks in 6 views" in lines["last estimate"]
    assert all(len(line) <= 80 for line in told.lines)
    assert not any("Noise(" in line for line in told.lines)
