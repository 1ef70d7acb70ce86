"""Published data sets, from a stand-in server on the loopback address: what arrives is whole, or is not there."""

import sys

import numpy as np
import pytest

from commands import phomo
from hub_server import COMMIT, NAME, HubServer, serving
from photoclinometry.io import hub
from photoclinometry.io.hub import fetch_files, list_files
from photoclinometry.io.models.text_model import read_text_model, write_text_model
from photoclinometry.model.errors import FetchError, InputError, RunFolderError
from scenes import synthetic_scene

pytest.importorskip("huggingface_hub")

MODEL = "reconstructions/cornelia/init"


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    """A data set of one site's model, of two sites' images, and a page."""
    folder = tmp_path_factory.mktemp("published") / "model"
    write_text_model(folder, synthetic_scene(size=8, views=4))
    files = {f"{MODEL}/{path.name}": path.read_bytes() for path in folder.iterdir()}
    for site in ("cornelia", "ahuna"):
        files[f"images/{site}/FC 1.png"] = np.random.default_rng(len(site)).bytes(200_000)
    return files | {"README.md": b"about\n", "images/empty.txt": b""}


@pytest.fixture
def server(content, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr("time.sleep", lambda _: None)  # between attempts
    monkeypatch.setattr("huggingface_hub.constants.DOWNLOAD_CHUNK_SIZE", 10_000)  # of 10 MB; less than that is lost
    with serving(dict(content)) as running:
        yield running


def site(server: HubServer, name="cornelia"):
    data = list_files(endpoint=server.endpoint)
    return data, data.named(name)


def test_a_data_set_lists_its_folders(server, content):
    data, files = site(server)
    assert data.commit == COMMIT
    assert list(data.folders()) == [
        "images",
        "images/ahuna",
        "images/cornelia",
        "reconstructions",
        "reconstructions/cornelia",
        MODEL,
    ]
    assert data.folders()["images"] == (3, 400_000)
    assert {f.path for f in files} == {path for path in content if "cornelia" in path}
    assert {f.path for f in data.named(MODEL)} == {path for path in content if path.startswith(MODEL)}
    assert data.named("images/ahuna/") == tuple(f for f in data.files if "ahuna" in f.path)
    for wrong in ("ikapati", "", "FC 1.png", "cornelia/init"):
        with pytest.raises(InputError, match=r"has no folder.*ahuna, cornelia"):
            data.named(wrong)


def test_what_is_fetched_is_what_was_published_and_refines(server, content, tmp_path):
    data, files = site(server)
    told = []
    fetched = fetch_files(data, files, tmp_path, lambda *progress: told.append(progress))
    assert sorted(fetched) == sorted(f.path for f in files)
    assert all((tmp_path / path).read_bytes() == content[path] for path in fetched)
    assert told[-1] == ("fetch", sum(f.size for f in files), sum(f.size for f in files))
    assert [done for _, done, _ in told] == sorted(done for _, done, _ in told)
    assert len(read_text_model(tmp_path / MODEL).scene.landmarks) == 64


def test_what_is_there_is_checked_and_not_fetched_again(server, content, tmp_path):
    data, files = site(server)
    fetch_files(data, files, tmp_path)
    spoiled = tmp_path / "images/cornelia/FC 1.png"
    spoiled.write_bytes(bytes(200_000))
    server.ranges.clear()
    assert fetch_files(data, files, tmp_path) == ["images/cornelia/FC 1.png"]
    assert server.ranges == [("images/cornelia/FC 1.png", None)]
    assert spoiled.read_bytes() == content["images/cornelia/FC 1.png"]


def test_a_download_that_broke_off_goes_on_where_it_stopped(server, content, tmp_path):
    """A first call gets 60 % and then nothing; a second asks for the rest alone."""
    data, files = site(server, "ahuna")
    path, whole = files[0].path, content[files[0].path]
    server.break_after = 120_000
    server.files[path] = whole[:120_000]  # what is asked for beyond is not there
    with pytest.raises(FetchError, match=r"FC 1\.png arrived in part"):
        fetch_files(data, files, tmp_path)
    part = tmp_path / (path + ".part")
    assert part.read_bytes() == whole[:120_000]
    assert not (tmp_path / path).exists()
    server.break_after, server.files[path] = None, whole
    server.ranges.clear()
    fetch_files(data, files, tmp_path)
    assert server.ranges == [(path, "bytes=120000-")]
    assert (tmp_path / path).read_bytes() == whole
    assert not part.exists()


def test_connections_that_break_are_taken_up_again(server, content, tmp_path):
    data, files = site(server, "ahuna")
    server.break_after = 70_000
    fetch_files(data, files, tmp_path)
    assert [wanted for _, wanted in server.ranges] == [None, "bytes=70000-", "bytes=140000-"]
    assert (tmp_path / files[0].path).read_bytes() == content[files[0].path]


def test_a_server_that_ignores_ranges_sends_all_again(server, content, tmp_path):
    data, files = site(server, "ahuna")
    part = tmp_path / (files[0].path + ".part")
    part.parent.mkdir(parents=True)
    part.write_bytes(content[files[0].path][:5000])
    server.ignore_ranges = True
    fetch_files(data, files, tmp_path)
    assert (tmp_path / files[0].path).read_bytes() == content[files[0].path]


@pytest.mark.parametrize("begun", [b"\0" * 5000, b"\0" * 200_000, b"\0" * 300_000], ids=["short", "whole", "long"])
def test_a_beginning_that_is_of_something_else_is_thrown_away(server, content, tmp_path, begun):
    data, files = site(server, "ahuna")
    part = tmp_path / (files[0].path + ".part")
    part.parent.mkdir(parents=True)
    part.write_bytes(begun)
    fetch_files(data, files, tmp_path)
    assert (tmp_path / files[0].path).read_bytes() == content[files[0].path]


@pytest.mark.parametrize("path", ["images/ahuna/FC 1.png", f"{MODEL}/cameras.txt"])
def test_content_with_another_checksum_is_refused(server, tmp_path, path):
    """Large files by SHA-256, small ones by git's."""
    data, _ = site(server)
    files = tuple(f for f in data.files if f.path == path)
    assert len(files[0].digest) == (64 if path.endswith("png") else 40)
    server.files[path] = bytes([server.files[path][0] ^ 1]) + server.files[path][1:]
    with pytest.raises(FetchError, match="arrived damaged"):
        fetch_files(data, files, tmp_path)
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


@pytest.mark.parametrize("path", ["../outside.txt", "/etc/outside.txt", "images/../../outside.txt", "a\\..\\b"])
def test_names_that_lead_out_of_the_folder_are_refused(server, path):
    server.published[path] = b"x"
    with pytest.raises(FetchError, match="outside of the output folder"):
        list_files(endpoint=server.endpoint)


def test_what_is_not_there_is_said(server, tmp_path):
    with pytest.raises(FetchError, match="no such public data set"):
        list_files("nobody/nothing", endpoint=server.endpoint)
    with pytest.raises(FetchError, match="has no revision 'v9'"):
        list_files(revision="v9", endpoint=server.endpoint)
    with pytest.raises(InputError, match="OWNER/NAME"):
        list_files("a b/c/d", endpoint=server.endpoint)
    data, files = site(server)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RunFolderError, match="cannot be written"):
        fetch_files(data, files, tmp_path / "file")


def test_a_server_that_is_not_there_is_said(monkeypatch):
    monkeypatch.setattr("time.sleep", lambda _: None)
    with serving({}) as gone:
        endpoint = gone.endpoint
    with pytest.raises(FetchError, match="check the network"):
        list_files(endpoint=endpoint)


def test_no_access_token_is_sent(server, monkeypatch, tmp_path):
    monkeypatch.setenv("HF_TOKEN", "hf_secret")
    seen = []
    original = type(server).finish_request

    def finish_request(self, request, address):
        seen.append(request.recv(4096, 2).lower())  # MSG_PEEK
        original(self, request, address)

    monkeypatch.setattr(type(server), "finish_request", finish_request)
    data, files = site(server, "ahuna")
    fetch_files(data, files, tmp_path)
    assert seen
    assert not any(b"authorization" in head or b"hf_secret" in head for head in seen)


def test_without_the_extra_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(InputError, match=r"photoclinometry\[fetch\]"):
        hub.list_files(NAME)


def test_the_command_lists_and_fetches(server, tmp_path, capsys):
    assert phomo("fetch", "--endpoint", server.endpoint) == 0
    assert "images/cornelia  1 files, 0.2 MB" in capsys.readouterr().out
    assert phomo("fetch", "cornelia", "--out", tmp_path / "data", "--endpoint", server.endpoint) == 0
    said = capsys.readouterr()
    assert said.out.strip() == str(tmp_path / "data")
    assert f"4 files, 0.2 MB, verified; 4 fetched now, from {NAME} at {COMMIT}" in said.err
    assert phomo("fetch", "nowhere", "--out", tmp_path / "no", "--endpoint", server.endpoint) == 2
    assert "it has ahuna, cornelia" in capsys.readouterr().err
    server.files.clear()
    assert phomo("fetch", "ahuna", "--out", tmp_path / "data", "--endpoint", server.endpoint) == 1
    assert "cannot be fetched" in capsys.readouterr().err
