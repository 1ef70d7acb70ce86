"""Which folders a command may write, and what it says of the others."""

import pytest

from photoclinometry.io.output_folder import check_output_folder
from photoclinometry.model.errors import RunFolderError


@pytest.fixture
def full(tmp_path):
    (tmp_path / "diary.txt").write_text("dear diary")
    return tmp_path


def test_new_and_empty_folders_are_free(tmp_path):
    for mark in (None, "plan.json"):
        check_output_folder(tmp_path, "plan", mark, overwrite=False)
        check_output_folder(tmp_path / "new", "plan", mark, overwrite=False)


def test_what_is_replaced_by_its_kind_is_free_unless_it_is_to_stay(full):
    (full / "plan.json").write_text("{}")
    check_output_folder(full, "plan", "plan.json")
    with pytest.raises(RunFolderError, match=r"holds a plan already; pass --overwrite, or choose another folder$"):
        check_output_folder(full, "plan", "plan.json", overwrite=False)


@pytest.mark.parametrize(
    ("option", "full_says", "file_says"),
    [
        (None, "choose another folder", "choose a folder for the plan"),
        ("--out", "choose another --out", r"choose a folder for the plan \(--out\)"),
    ],
)
def test_what_holds_something_else_is_left_alone(full, option, full_says, file_says):
    with pytest.raises(RunFolderError, match=rf"is not empty and holds no plan; {full_says}$"):
        check_output_folder(full, "plan", "plan.json", option=option)
    with pytest.raises(RunFolderError, match=rf"is a file; {file_says}$"):
        check_output_folder(full / "diary.txt", "plan", "plan.json", option=option)


def test_what_nothing_replaces_must_be_free(full):
    for path in (full, full / "diary.txt"):
        with pytest.raises(RunFolderError, match=r"exists and is not empty; choose another folder for the site$"):
            check_output_folder(path, "site")
