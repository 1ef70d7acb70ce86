"""Files appear whole or not at all, whatever goes wrong while they are written."""

import errno
import os

import numpy as np
import pytest

from fault_place import small_disk
from photoclinometry.io.atomic import atomic_path, write_bytes, write_text
from photoclinometry.io.images import write_fits, write_png
from photoclinometry.io.meshes.ply import write_ply
from photoclinometry.io.models.colmap import write_colmap
from photoclinometry.io.scene_file import write_scene
from photoclinometry.io.site import read_site, write_site
from photoclinometry.model.errors import RunFolderError
from scenes import synthetic_scene


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=20, views=4)


def write_example_site(path, scene):
    views = "".join(f'[[views]]\nimage = "{n}.fits"\nsun = [0, 0, -1]\n' for n in range(3))
    camera = '[camera]\nmodel = "PINHOLE"\nwidth = 9\nheight = 9\nparams = [9, 9, 4, 4]\n'
    source = path.parent.parent / "source.toml"
    if not source.exists():
        source.write_text(f'name = "three"\nbrightness = "dn"\n{camera}{views}')
    write_site(path, read_site(source))


WRITERS = {
    "landmarks.ply": write_ply,
    "scene.h5": write_scene,
    "sparse": write_colmap,
    "image.fits": lambda path, scene: write_fits(path, np.zeros((64, 64))),
    "image.png": lambda path, scene: write_png(path, np.arange(4096, dtype=np.uint16).reshape(64, 64)),
    "site.toml": write_example_site,
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_writer_leaves_nothing_behind_on_a_full_disk(tmp_path, scene, name):
    path = tmp_path / "out" / name
    with small_disk(300), pytest.raises(RunFolderError, match=rf"{name}: cannot be written.*output folder"):
        WRITERS[name](path, scene)
    assert not path.parent.exists()
    WRITERS[name](path, scene)
    assert [p.name for p in path.parent.iterdir()] == [name]


@pytest.mark.parametrize("name", WRITERS)
def test_every_writer_keeps_the_old_file_when_the_new_one_fails(tmp_path, scene, name):
    path = tmp_path / "out" / name
    WRITERS[name](path, scene)
    file = path / "images.bin" if path.is_dir() else path
    before = file.read_bytes()
    with small_disk(300), pytest.raises(RunFolderError):
        WRITERS[name](path, scene)
    assert file.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [name]


@pytest.mark.parametrize(
    ("code", "cure"),
    [
        (errno.ENOSPC, "free some space"),
        (errno.EROFS, "read-only; choose another output folder"),
        (errno.EACCES, "change the permissions"),
        (errno.EIO, "check the disk"),
    ],
)
def test_failures_of_the_disk_say_what_to_do(tmp_path, monkeypatch, code, cure):
    def fail(_descriptor):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(RunFolderError, match=rf"a\.txt: cannot be written: {os.strerror(code)}; .*{cure}"):
        write_text(tmp_path / "a.txt", "x")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_other_exceptions_pass_through_and_leave_nothing(tmp_path, error):
    def interrupted():
        with atomic_path(tmp_path / "a.bin") as temporary:
            temporary.write_bytes(b"half")
            raise error

    with pytest.raises(error):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way_of_a_folder_is_named(tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(RunFolderError, match="is a file, not a folder"):
        write_bytes(tmp_path / "out" / "deep" / "a.bin", b"")


def test_a_folder_in_the_way_of_a_file_is_named(tmp_path):
    (tmp_path / "a.bin").mkdir()
    with pytest.raises(RunFolderError, match="a folder of this name is in the way"):
        write_bytes(tmp_path / "a.bin", b"")
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]


def test_success_makes_parents_replaces_and_keeps_the_suffix(tmp_path):
    path = tmp_path / "new" / "deeper" / "a.png"
    for content in (b"1", b"22"):
        with atomic_path(path) as temporary:
            assert temporary.suffix == ".png"
            assert temporary.parent == path.parent
            temporary.write_bytes(content)
        assert path.read_bytes() == content
    assert [p.name for p in path.parent.iterdir()] == ["a.png"]


def fill(path):
    """Writes the folder `path` with two files."""
    with atomic_path(path) as temporary:
        temporary.mkdir()
        for name in ("a", "b"):
            (temporary / name).write_text(name)


@pytest.mark.parametrize("leads_to", ["an empty folder", "a full folder", "nothing"])
def test_a_link_to_a_folder_stays_and_the_folder_is_replaced(tmp_path, leads_to):
    there, link = tmp_path / "disk" / "there", tmp_path / "link"
    if leads_to != "nothing":
        there.mkdir(parents=True)
    if leads_to == "a full folder":
        (there / "old").write_text("old")
    link.symlink_to(there)
    fill(link)
    assert link.is_symlink()
    assert sorted(path.name for path in there.iterdir()) == ["a", "b"]
    assert [path.name for path in there.parent.iterdir()] == ["there"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "link"]


def test_a_link_to_a_file_is_replaced_like_a_file(tmp_path):
    (tmp_path / "there").write_text("old")
    (tmp_path / "link").symlink_to("there")
    write_text(tmp_path / "link", "new")
    assert not (tmp_path / "link").is_symlink()
    assert [(tmp_path / name).read_text() for name in ("there", "link")] == ["old", "new"]


@pytest.fixture
def working(tmp_path, monkeypatch):
    """The working folder, with a file in it."""
    folder = tmp_path / "working"
    folder.mkdir()
    (folder / "old").write_text("old")
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize("given", [".", "../working"])
def test_the_working_folder_stays_itself_and_its_content_is_replaced(working, given):
    """A shell in there would else be in a folder that is no more."""
    before = os.stat(".").st_ino
    fill(given)
    assert os.stat(".").st_ino == os.stat(working).st_ino == before
    assert sorted(os.listdir(".")) == ["a", "b"]
    assert os.listdir("..") == ["working"]


def test_the_content_of_the_working_folder_goes_back_where_its_replacement_fails(working, monkeypatch):
    replace = os.replace

    def failing(source, target):
        if os.path.basename(target) == "b":
            raise OSError(errno.EIO, "Input/output error")
        replace(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(RunFolderError, match=r"working: cannot be written: Input/output error"):
        fill(".")
    assert os.listdir(".") == ["old"]
    assert os.listdir("..") == ["working"]


def test_a_file_is_not_written_in_the_place_of_the_working_folder(working):
    with pytest.raises(RunFolderError, match="working: cannot be written: Is a directory"):
        write_text(".", "x")
    assert os.listdir(".") == ["old"]


def test_a_block_that_writes_nothing_is_an_error(tmp_path):
    with pytest.raises(RunFolderError, match=r"a\.bin: cannot be written"), atomic_path(tmp_path / "a.bin"):
        pass


def test_of_a_path_that_is_too_long_the_beginning_is_told(tmp_path):
    path = tmp_path / (300 * "x")
    said = (
        rf"\.\.\. \({len(str(path))} characters\): cannot be written: File name too long; choose a shorter output path"
    )
    with pytest.raises(RunFolderError, match=said) as raised:
        write_text(path, "")
    assert len(str(raised.value)) < 200
