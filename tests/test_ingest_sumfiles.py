"""Each image has the SUMFILE of its own name or time, and no image that of another."""

import logging
from pathlib import Path

import pytest

from archives import CAMERA, POSE, SUN, mapcam_cube, plain_images
from photoclinometry.ingest.facts import Facts
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.ingest.sumfiles import NamedSum, sumfile_of
from photoclinometry.io.models.sumfile import sumfile_of_view, write_sumfile
from photoclinometry.model.errors import InputError

LONG_AGO = "2000 JAN 01 00:00:00"


def named(*names, inside=None):
    """SUMFILEs of these file names; inside: the name that each begins with, by default that of the file."""
    return [
        NamedSum(Path(f"{name}.SUM"), sumfile_of_view(inside or name, CAMERA, POSE, SUN, utc=LONG_AGO))
        for name in names
    ]


def found(image, known):
    match = sumfile_of(Path(image), Facts(), known)
    return match and match.path.stem


@pytest.mark.parametrize(
    ("image", "names", "expected"),
    [
        ("img1.fits", ["IMG1", "IMG10"], "IMG1"),
        ("img10.fits", ["IMG1", "IMG10"], "IMG10"),
        ("img10.fits", ["IMG1"], None),
        ("img10_cal.fits", ["IMG1", "IMG10"], "IMG10"),
        ("ocams_M605862153F5L2.fits", ["M605862153F5"], "M605862153F5"),
        ("n2395699394.fits", ["2395699394"], "2395699394"),
        ("n12395699394.fits", ["2395699394"], None),
        ("cat.fits", ["A"], None),
        ("img1_2_cal.fits", ["IMG1", "IMG1_2"], "IMG1_2"),
        ("10_img_1.fits", ["1"], "1"),
    ],
)
def test_a_sumfile_is_that_of_the_longest_whole_name_in_the_image_s(image, names, expected):
    assert found(image, named(*names)) == expected
    assert found(image, named(*reversed(names))) == expected


def test_the_name_within_a_sumfile_counts_like_that_of_the_file():
    assert found("img10.fits", named("x", inside="IMG10") + named("y", inside="IMG1")) == "x"


def test_two_sumfiles_of_one_name_are_refused():
    with pytest.raises(InputError, match=r"img1\.fits: matches both a\.SUM and b\.SUM; pass one of them"):
        found("img1.fits", named("a", "b", inside="IMG1"))


def test_a_sumfile_is_of_one_image(tmp_path):
    """The image of another name that begins alike would have the pose and the Sun of this one."""
    (path,) = plain_images(tmp_path / "in", 1)
    other = path.with_name(f"{path.stem}-2.png")
    other.write_bytes(path.read_bytes())
    write_sumfile(tmp_path / f"{path.stem}.SUM", sumfile_of_view(path.stem, CAMERA, POSE, SUN, utc=LONG_AGO))
    options = IngestOptions(sumfiles=(tmp_path / f"{path.stem}.SUM",), body="bennu")
    with pytest.raises(InputError, match=rf"{path.stem}-2\.png: has the SUMFILE .*, and so has {path.name}. A"):
        ingest([path, other], tmp_path / "site", options)
    assert not (tmp_path / "site").exists()
    assert len(ingest([path, path], tmp_path / "site", options).exposures) == 1


def test_an_image_without_a_sumfile_is_warned_of_where_one_describes_no_image(tmp_path, caplog):
    """It would have the pose of its own label without a word."""
    paths = [mapcam_cube(tmp_path / f"{name}.cub") for name in ("a1", "b1")]
    for name in ("A1", "C1"):
        write_sumfile(tmp_path / f"{name}.SUM", sumfile_of_view(name, CAMERA, POSE, SUN, utc=LONG_AGO))
    given = (tmp_path / "A1.SUM", tmp_path / "C1.SUM")
    about = {"undistorted": True, "pinhole": (9000.0, 9000.0, 512.0, 512.0)}
    with caplog.at_level(logging.WARNING):
        ingest(paths, tmp_path / "site", IngestOptions(sumfiles=given, **about))
    (said,) = (r.getMessage() for r in caplog.records if "SUMFILE" in r.getMessage())
    assert "the time of b1.cub (1 of 2 images)" in said
    assert "those of C1.SUM (1 of 2 SUMFILEs)" in said
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        ingest(paths[:1], tmp_path / "of-all", IngestOptions(sumfiles=given, **about))
        ingest(paths, tmp_path / "all-used", IngestOptions(sumfiles=given[:1], **about))
    assert not [r for r in caplog.records if "SUMFILE" in r.getMessage()]


def test_sumfiles_that_were_passed_are_said_not_to_match(tmp_path):
    (path,) = plain_images(tmp_path / "in", 1)
    write_sumfile(tmp_path / "A.SUM", sumfile_of_view("A", CAMERA, POSE, SUN, utc=LONG_AGO))
    with pytest.raises(InputError, match=r"no SUMFILE given has its name or time$"):
        ingest([path], tmp_path / "site", IngestOptions(sumfiles=(tmp_path / "A.SUM",), body="bennu"))
