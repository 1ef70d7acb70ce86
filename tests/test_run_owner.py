"""A run folder belongs to one site: another one is refused, or replaces what is there where that is asked for."""

import json
from contextlib import ExitStack
from dataclasses import replace

import pytest

from photoclinometry.io.images import write_fits
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import ImageError, RunFolderError
from photoclinometry.pipeline.folder import run_folder
from photoclinometry.pipeline.folder.run_folder import FORMAT, MARK, check_run, claimed_run, open_run
from photoclinometry.pipeline.folder.run_lock import locked
from photoclinometry.pipeline.folder.run_mark import owner_of_folder
from photoclinometry.pipeline.folder.run_owner import owner_of_model, owner_of_site
from sites import picture, write_small_site


@pytest.fixture
def site(tmp_path):
    return read_site(write_small_site(tmp_path / "site"))


@pytest.fixture
def other(tmp_path):
    """A site of the same file names, with other images."""
    path = write_small_site(tmp_path / "other")
    for number in range(4):
        write_fits(path.parent / "images" / f"{number}.fits", picture(number + 10))
    return read_site(path)


def claim(folder, site, **options):
    with claimed_run(folder, owner_of_site(site), **options):
        (folder / "stages").mkdir(exist_ok=True)
        (folder / "scene.h5").write_bytes(site.name.encode())
    return folder


def test_the_same_site_goes_on_when_moved_or_changed_a_little(site, tmp_path):
    """Moved, renamed, with other Suns, region and body unnamed, with a view fewer and one more."""
    folder = claim(tmp_path / "run", site)
    moved = read_site(write_small_site(tmp_path / "moved", views=5))
    changed = [moved, replace(site, name="renamed", body=None, region=None), replace(site, views=site.views[:3])]
    for one in changed:
        check_run(folder, owner_of_site(one))
        claim(folder, one)
    assert (folder / "scene.h5").exists()


def test_another_site_is_refused_and_named_with_the_first(site, other, tmp_path):
    folder = claim(tmp_path / "run", site)
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    named = rf"belongs to the site 'small' \(vesta, 4 images, {site.path}\); this is .*{other.path}\).*--overwrite"
    for attempt in (check_run, lambda *arguments: claimed_run(*arguments).__enter__()):
        with pytest.raises(RunFolderError, match=named):
            attempt(folder, owner_of_site(other))
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


def test_another_body_is_another_site(site, tmp_path):
    folder = claim(tmp_path / "run", site)
    check_run(folder, owner_of_site(replace(site, body="Vesta")))
    with pytest.raises(RunFolderError, match=r"\(ceres, 4 images"):
        check_run(folder, owner_of_site(replace(site, body="ceres")))


def test_overwrite_removes_what_is_there_of_another_site(site, other, tmp_path):
    folder = claim(tmp_path / "run", site)
    (folder / "metrics.json").write_text("{}")
    (folder / ".report.partial-0a").mkdir()
    with claimed_run(folder, owner_of_site(other), overwrite=True):
        assert sorted(path.name for path in folder.iterdir()) == ["lock", MARK]
        (folder / "scene.h5").write_bytes(b"")
    check_run(folder, owner_of_site(other))
    with pytest.raises(RunFolderError):
        check_run(folder, owner_of_site(site))


def test_overwrite_keeps_what_is_there_of_the_same_site(site, tmp_path):
    folder = claim(tmp_path / "run", site)
    with claimed_run(folder, owner_of_site(site), overwrite=True):
        assert (folder / "scene.h5").exists()


def test_overwrite_removes_nothing_where_anything_is_not_a_runs(site, other, tmp_path):
    folder = claim(tmp_path / "run", site)
    (folder / "thesis.tex").write_text("x")
    with pytest.raises(RunFolderError, match=r"holds thesis\.tex, which no run wrote; move it"):
        claim(folder, other, overwrite=True)
    assert (folder / "scene.h5").read_bytes() == b"small"
    assert not (folder / "lock").exists()
    (tmp_path / "papers").mkdir()
    (tmp_path / "papers" / "stages").write_text("x")
    with pytest.raises(RunFolderError, match="exists and is not a run folder"):
        claim(tmp_path / "papers", other, overwrite=True)
    assert (tmp_path / "papers" / "stages").exists()


def test_overwrite_leaves_alone_what_links_point_to(site, other, tmp_path):
    folder = claim(tmp_path / "run", site)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "kept").write_text("x")
    (folder / "sparse").symlink_to(tmp_path / "elsewhere")
    claim(folder, other, overwrite=True)
    assert (tmp_path / "elsewhere" / "kept").exists()
    assert not (folder / "sparse").is_symlink()


def test_a_map_of_an_unknown_site_is_refused(site, tmp_path):
    """Stages alone may be used: each says by its key what it is of."""
    folder = open_run(tmp_path / "run").path
    (folder / "stages").mkdir()
    check_run(folder, owner_of_site(site))
    (folder / "scene.h5").write_bytes(b"")
    with pytest.raises(RunFolderError, match="holds a map, and not of which site"):
        check_run(folder, owner_of_site(site))


def test_another_format_is_refused_unless_it_is_overwritten(site, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / MARK).write_text(json.dumps({"format": FORMAT + 1, "version": "9"}))
    with pytest.raises(RunFolderError, match="made by version 9"):
        claim(tmp_path / "run", site)
    claim(tmp_path / "run", site, overwrite=True)


@pytest.mark.parametrize("owner", [{}, {"kind": "site"}, [], "x", 7])
def test_a_damaged_owner_is_refused(site, tmp_path, owner):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / MARK).write_text(json.dumps({"format": FORMAT, "version": "1", "owner": owner}))
    with pytest.raises(RunFolderError, match=rf"{MARK}: damaged"):
        check_run(tmp_path / "run", owner_of_site(site))


@pytest.mark.parametrize(("looks", "begin"), [("check_run", claim), ("check_new", lambda folder, _: open_run(folder))])
def test_of_two_runs_begun_together_the_second_leaves_the_mark_of_the_first(site, tmp_path, monkeypatch, looks, begin):
    """The first begins when the second has found nothing there yet, as commands of an array of jobs do."""
    look, first, folder = getattr(run_folder, looks), ExitStack(), tmp_path / "run"

    def look_too_early(*given, **options):
        look(*given, **options)
        monkeypatch.setattr(run_folder, looks, look)
        first.enter_context(claimed_run(folder, owner_of_site(site)))

    monkeypatch.setattr(run_folder, looks, look_too_early)
    with first, pytest.raises(RunFolderError, match="has been writing to this folder"):
        begin(folder, site)
    assert owner_of_folder(folder) == owner_of_site(site)


def test_a_run_that_has_only_its_lock_is_in_use(site, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    with locked(folder):
        for look in (lambda: check_run(folder, owner_of_site(site)), lambda: open_run(folder)):
            with pytest.raises(RunFolderError, match="has been writing to this folder"):
                look()


def test_a_model_and_a_site_do_not_share_a_folder(site, tmp_path):
    from scenes import synthetic_scene

    folder, scene = claim(tmp_path / "run", site), synthetic_scene(size=8, views=3)
    with pytest.raises(RunFolderError, match=r"belongs to the site .*; this is the model"):
        check_run(folder, owner_of_model(tmp_path / "model", scene))
    assert owner_of_model(tmp_path / "a", scene).is_same(owner_of_model(tmp_path / "b", scene))


def test_missing_images_are_listed_before_anything_is_touched(site, tmp_path):
    (site.path.parent / "images" / "2.fits").unlink()
    with pytest.raises(ImageError, match="1 of 4 images do not exist"):
        owner_of_site(site)


def test_a_folder_without_results_is_nobodys(site, other, tmp_path):
    """As after a run that ended at its images: corrected ones have another content."""
    with claimed_run(tmp_path / "run", owner_of_site(site)) as folder:
        folder.write_config({})
        (folder.path / "log").write_text("stopped")
    check_run(tmp_path / "run", owner_of_site(other))
    claim(tmp_path / "run", other)
    with pytest.raises(RunFolderError, match="belongs to the site"):
        check_run(tmp_path / "run", owner_of_site(site))
