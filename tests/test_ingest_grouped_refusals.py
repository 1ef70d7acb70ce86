"""Files that cannot be used are told by cause: one sentence for all files with the same, each image once."""

from pathlib import Path

import pytest

from archives import plain_images, texture, write_pds3
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.ingest.refusals import Refusal, counted, message, sentences
from photoclinometry.io.spice import TimeNotCoveredError
from photoclinometry.model.errors import InputError


def uncovered(path, time):
    """The refusal of a file whose time no kernel covers, as `read_exposure` raises it."""
    cause = TimeNotCoveredError(time, "outside of what the kernels cover: load kernels of that time")
    error = InputError(f"{path}: {cause}; so the Sun's direction is unknown")
    error.__cause__ = InputError("of the exposure")
    error.__cause__.__cause__ = cause
    return Refusal.of(Path(path), error)


def test_equal_causes_are_one_sentence_with_their_times():
    refused = [
        uncovered(f"{name}.png", f"2021-06-0{day}T00:00:00")
        for name, day in zip("abcdef", (3, 1, 2, 6, 5, 4), strict=True)
    ]
    refused.append(Refusal.of(Path("g.png"), InputError("g.png: is an empty file")))
    assert sentences(refused) == [
        "a.png, b.png, c.png, d.png and 2 more: the times 2021-06-01T00:00:00 to 2021-06-06T00:00:00 are outside of "
        "what the kernels cover: load kernels of that time; so the Sun's direction is unknown",
        "g.png: is an empty file",
    ]
    assert message(refused, 9).startswith("7 of 9 files cannot be used (--keep-going leaves them out):\n  a.png, b.png")
    assert sentences(refused[:1])[0].startswith("a.png: the time 2021-06-03T00:00:00 is outside of")
    assert message(refused[:1], 1) == sentences(refused[:1])[0]


def test_a_label_and_its_image_that_cannot_be_used_count_once(tmp_path):
    files = []
    for name in ("a", "b"):
        label, data = tmp_path / f"{name}.lbl", tmp_path / f"{name}.img"
        write_pds3(label, texture(), sample_type="PC_REAL", detached=data)
        files += [label, data]
    files += plain_images(tmp_path / "in", 1)
    assert counted(files) == 3
    with pytest.raises(InputError, match=r"^3 of 3 files cannot be used") as raised:
        ingest(files, tmp_path / "site", IngestOptions())
    lines = str(raised.value).splitlines()[1:]
    assert sum(line.count("a.lbl") + line.count("a.img") for line in lines) == 1
    assert all("the Sun's direction is unknown: pass --kernels" in line for line in lines)


def test_files_left_out_are_told_by_cause(tmp_path):
    good = plain_images(tmp_path / "in", 3)
    table = tmp_path / "suns.csv"
    table.write_text("image,sun_x,sun_y,sun_z\n" + f"{good[0].name},0.6,0.0,-0.8\n")
    options = IngestOptions(suns=table, pinhole=(500.0, 500.0, 30.0, 20.0), keep_going=True)
    result = ingest(good, tmp_path / "site", options)
    assert len(result.exposures) == 1
    (reason,) = result.refused
    assert reason.startswith(f"{good[1]}, {good[2]}: the Sun's direction is unknown")
