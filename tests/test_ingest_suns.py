"""A row of the table of Suns that names no file is told where a file has no row."""

import pytest

from archives import mapcam_cube, plain_images, suns_of
from photoclinometry.ingest.exposure import SUNS_GIVEN
from photoclinometry.ingest.ingest import ingest
from photoclinometry.ingest.options import IngestOptions
from photoclinometry.model.errors import InputError


def renamed(table, old, new):
    table.write_text(table.read_text().replace(old, new))
    return table


def test_a_row_that_names_no_file_is_refused_where_a_file_has_none(tmp_path):
    """The file would have the Sun of its own label in place of the one that the row gives."""
    paths = [mapcam_cube(tmp_path / f"{name}.cub") for name in "ab"]
    table = renamed(suns_of(tmp_path, paths), "b.cub", "raw/b.cub")
    with pytest.raises(InputError) as raised:
        ingest(paths, tmp_path / "site", IngestOptions(undistorted=True, suns=table))
    assert str(raised.value) == (
        f"{table}: no file is named 'raw/b.cub', and there is no row for b.cub; write names of files, without their "
        "folders, or remove the rows"
    )
    assert not (tmp_path / "site").exists()


def test_a_table_may_have_rows_of_other_images_or_be_of_some(tmp_path):
    paths = [mapcam_cube(tmp_path / f"{name}.cub") for name in "ab"]
    table = suns_of(tmp_path, paths)
    (exposure,) = ingest(paths[:1], tmp_path / "one", IngestOptions(undistorted=True, suns=table)).exposures
    assert exposure.sources["sun"] == SUNS_GIVEN
    table = suns_of(tmp_path, paths[:1])
    found = ingest(paths, tmp_path / "two", IngestOptions(undistorted=True, suns=table)).exposures
    assert [exposure.sources["sun"] for exposure in found] == [SUNS_GIVEN, "ISIS tables"]


def test_a_file_that_is_left_out_may_have_a_row(tmp_path):
    paths = [mapcam_cube(tmp_path / f"{name}.cub") for name in "ab"]
    table = suns_of(tmp_path, paths[1:])
    paths[1].write_bytes(b"nothing")
    found = ingest(paths, tmp_path / "site", IngestOptions(undistorted=True, suns=table, keep_going=True))
    assert len(found.exposures) == 1


def test_a_table_that_was_passed_is_said_not_to_name_the_file(tmp_path):
    paths = plain_images(tmp_path / "in", 1)
    table = renamed(suns_of(tmp_path, paths), paths[0].name, f"raw/{paths[0].name}")
    with pytest.raises(InputError, match=r"Sun's direction is unknown: .*; no row of .*suns\.csv has its name"):
        ingest(paths, tmp_path / "site", IngestOptions(suns=table, pinhole=(500.0, 500.0, 30.0, 20.0)))
