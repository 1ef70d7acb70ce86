"""`phomo calibrate`: a site whose cameras state the distortion that its images show."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from photoclinometry.cli import main
from photoclinometry.io.images import write_fits
from photoclinometry.io.site import read_site, write_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.errors import ReconstructionError, RunFolderError
from photoclinometry.model.lens import NO_DISTORTION, Lens
from photoclinometry.model.progress import no_progress
from photoclinometry.model.warning import Warned, collected_warnings
from photoclinometry.pipeline import calibrate as calibrate_module
from photoclinometry.pipeline.calibrate import CalibrationOptions, calibrate
from photoclinometry.pipeline.camera_check import CheckCameras
from photoclinometry.pipeline.folder.run_folder import RunFolder, open_run
from photoclinometry.pipeline.sparse_stages import SparseReconstruction, read_inputs
from photoclinometry.sfm import SfmOptions
from photoclinometry.sfm.self_calibration import LensEstimate
from sites import write_small_site

CORNER_PX = 5.0
ONE_THREAD = SfmOptions(threads=1)


@pytest.fixture(scope="module", autouse=True)
def sparse_once():
    """Structure from motion of the same images with the same options is computed once for all tests."""
    compute, known = RunFolder.result_of, {}

    def once(self, stage):
        if stage.name != SparseReconstruction.name:
            return compute(self, stage)
        if stage.key not in known:
            known[stage.key] = compute(self, stage)
        return known[stage.key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunFolder, "result_of", once)
        yield


@pytest.fixture(scope="module")
def distorted(mapped, tmp_path_factory):
    """The small site seen through a lens that moves the corners by CORNER_PX; and the clean one."""
    clean, folder = read_site(mapped.site), tmp_path_factory.mktemp("distorted")
    camera = clean.views[0].camera
    lens = Lens.of_corner_px(np.array([CORNER_PX, 0.0, 0.0, 0.0]), camera)
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    observed = np.stack([x, y], -1)
    ideal = observed
    for _ in range(50):
        ideal = observed - lens.displacement(ideal, camera)
    for image, view in zip(load_images(clean), clean.views, strict=True):
        row_col = np.moveaxis(ideal[..., ::-1] - 0.5, -1, 0)
        seen = map_coordinates(image.brightness.astype(float), row_col, order=3, mode="nearest")
        write_fits(folder / view.name, seen.astype(np.float32))
    views = tuple(replace(view, image=folder / view.name) for view in clean.views)
    write_site(folder / "site.toml", replace(clean, views=views, path=folder / "site.toml"))
    return folder / "site.toml", clean, lens


@pytest.fixture(scope="module")
def calibrated(distorted, tmp_path_factory):
    out = tmp_path_factory.mktemp("calibrated") / "new.toml"
    return calibrate(distorted[0], out, CalibrationOptions(sfm=ONE_THREAD))


def test_the_new_site_states_the_lens(distorted, calibrated):
    """By 0.3 px at the corners, whose displacement is 5; the sparse keypoints lie within."""
    _, clean, lens = distorted
    camera = clean.views[0].camera
    (found,) = calibrated.cameras
    pixels = np.stack(np.meshgrid(np.linspace(20, 172, 9), np.linspace(20, 172, 9)), -1)
    off = found.camera.lens.displacement(pixels, camera) - lens.displacement(pixels, camera)
    assert found.changed
    assert found.shown.is_clear
    assert found.left.shift_px < 1.0
    assert np.abs(off).max() < 0.3
    assert {view.lens for view in read_site(calibrated.site).views} == {found.camera.lens}


def test_the_new_site_shows_the_images_without_distortion(distorted, calibrated):
    """Pixels are three to ten times nearer to those of the clean images, whose relief has waves of some pixels."""
    site, clean, _ = distorted
    truth, before, after = load_images(clean), load_images(read_site(site)), load_images(read_site(calibrated.site))
    for a, b, t in zip(after, before, truth, strict=True):
        both = a.valid & b.valid & t.valid
        assert both.mean() > 0.8
        far = np.std(b.brightness[both] - t.brightness[both])
        assert np.std(a.brightness[both] - t.brightness[both]) < far / 3


def test_the_new_site_names_the_same_images_and_region(distorted, calibrated):
    old, new = read_site(distorted[0]), read_site(calibrated.site)
    assert [view.image.resolve() for view in new.views] == [view.image.resolve() for view in old.views]
    if old.region is not None and old.region.reference is not None:
        reference = {view.name: view.image.resolve() for view in new.views}[new.region.reference]
        assert reference == {view.name: view.image.resolve() for view in old.views}[old.region.reference]
    assert [view.pose_prior is None for view in new.views] == [view.pose_prior is None for view in old.views]


@pytest.mark.parametrize(("which", "warned"), [("distorted", True), ("clean", False)])
def test_a_run_warns_of_distortion_that_the_site_lacks(distorted, tmp_path, which, warned):
    site = read_site(distorted[0]) if which == "distorted" else distorted[1]
    folder = open_run(tmp_path / "run")
    inputs = read_inputs(folder, site)
    sparse = folder.result_of(SparseReconstruction(inputs=inputs, options=ONE_THREAD))
    with collected_warnings() as warnings:
        found = folder.result_of(CheckCameras(inputs=inputs, sparse=sparse)).value
    assert [warning.code for warning in warnings] == ["camera-distorted"] * warned
    assert len(found.shift_px) == 1
    assert (found.shift_px[0] > 0.5) == warned


def test_a_clean_site_stays_as_it_is(distorted, tmp_path, capsys):
    _, clean, _ = distorted
    main(["calibrate", str(clean.path), "--out", str(tmp_path / "same.toml"), "--sfm.threads", "1"])
    said = capsys.readouterr()
    assert said.out.strip() == str(tmp_path / "same.toml")
    assert "the camera stays as it is" in said.err
    assert {view.lens for view in read_site(tmp_path / "same.toml").views} == {NO_DISTORTION}


def test_a_file_that_exists_is_not_written_over(distorted, tmp_path):
    (tmp_path / "there.toml").write_text("mine")
    with pytest.raises(RunFolderError, match=r"there.toml: exists; choose another --out"):
        calibrate(distorted[0], tmp_path / "there.toml")
    assert (tmp_path / "there.toml").read_text() == "mine"


def test_images_of_too_few_keypoints_are_an_error(distorted, tmp_path, monkeypatch):
    monkeypatch.setattr(calibrate_module, "estimate_lenses", lambda *_: [])
    with pytest.raises(ReconstructionError, match=r"keypoints of 6 views do not suffice .* --sfm.max-features"):
        calibrate(distorted[0], tmp_path / "new.toml", CalibrationOptions(sfm=ONE_THREAD))
    assert not (tmp_path / "new.toml").exists()


def test_the_maps_of_a_response_have_the_images_where_the_folder_of_temporary_files_is_a_link(tmp_path, monkeypatch):
    """As on macOS, whose /var is /private/var."""
    (tmp_path / "far" / "deep" / "er").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "far" / "deep" / "er")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "link"))
    site = read_site(write_small_site(tmp_path / "site"))

    def mapped(site_file, *_):
        views = read_site(site_file).views
        assert [view.image.resolve() for view in views] == [view.image.resolve() for view in site.views]
        assert all(view.image.is_file() for view in views)
        return SimpleNamespace(warnings=[], metrics={})

    monkeypatch.setattr("photoclinometry.pipeline.run.run", mapped)
    assert calibrate_module._response(site, CalibrationOptions(), no_progress) == 1.0
    moved = calibrate_module._moved(site, tmp_path / "link" / "new.toml")
    assert all((tmp_path / "link" / view.name).is_file() for view in moved.views)


def response_calibrated(site, tmp_path, monkeypatch, found):
    """The calibration of a site whose maps find exponents one after the other, the first clearly; and what its images
    were decoded by for each map."""
    decoded, left = [], list(found)

    def mapped(site_file, out, options, progress):
        decoded.append({view.gamma for view in read_site(site_file).views})
        gamma = left.pop(0)
        warnings = [Warned("response-not-linear", "")] if abs(np.log(gamma)) > np.log(1.3) else []
        return SimpleNamespace(warnings=warnings, metrics={"response_gamma": gamma})

    monkeypatch.setattr("photoclinometry.pipeline.run.run", mapped)
    clean = LensEstimate(
        camera=site.views[0].camera,
        corner_px=np.zeros(4),
        covariance=np.zeros((4, 4)),
        shift_px=0.1,
        shift_sigma_px=0.1,
    )
    monkeypatch.setattr(calibrate_module, "_estimates", lambda *_: [clean])
    options = CalibrationOptions(response=True)
    return calibrate(site.path, tmp_path / "new.toml", options), decoded


def test_the_response_is_found_by_maps_of_images_decoded_so_far(distorted, tmp_path, monkeypatch):
    found, decoded = response_calibrated(distorted[1], tmp_path, monkeypatch, [2.5, 0.9, 1.01])
    assert decoded == [{1.0}, {2.5}, {2.25}]
    assert found.gamma == 2.25
    assert {view.gamma for view in read_site(found.site).views} == {2.25}


def test_a_response_that_is_not_clear_stays_as_it_is(distorted, tmp_path, monkeypatch):
    found, decoded = response_calibrated(distorted[1], tmp_path, monkeypatch, [1.2])
    assert found.gamma == 1.0
    assert len(decoded) == 1
    assert {view.gamma for view in read_site(found.site).views} == {1.0}
