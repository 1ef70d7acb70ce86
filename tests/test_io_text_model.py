"""Text models come back as they were written, agree with the authors' conventions, and contradictions are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from photoclinometry.io.models.text_model import read_text_model, write_text_model
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from scenes import synthetic_scene

DATA = Path(__file__).parents[2] / "shared" / "data" / "model-format"

CAMERAS = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n0 PINHOLE 100 80 1000.0 1000.0 50.0 40.0\n"
IMAGES = """# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, SX, SY, SZ, CAMERA_ID, NAME, SCALE, BIAS
# POINTS2D[] as (X, Y, INTENSITY, POINT3D_ID)
0 1 0 0 0 0 0 10 0 0 -1 0 a.png 1.0 0.0
50.5 40.5 0.1 -1 60.25 40.5 0.2 -1
2 0 1 0 0 1 2 20 0.6 0 0.8 0 b.png 2.0 0.5
50.5 40.5 -1 -1 60.25 40.5 0.4 7
"""
POINTS = """# POINT3D_ID, X, Y, Z, NX, NY, NZ, ALBEDO, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)
3 0.5 0 0 0 0 1 0.25 0 0 0 0.0 0 0 2 0
7 1 0 0 0 0 2 0.5 0 0 0 0.0 2 1
"""


def write_files(folder, cameras=CAMERAS, images=IMAGES, points=POINTS):
    folder.mkdir(exist_ok=True)
    for name, text in (("cameras", cameras), ("images", images), ("points3D", points)):
        (folder / f"{name}.txt").write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder


@pytest.fixture
def model(tmp_path):
    return tmp_path / "model"


@pytest.fixture(scope="module")
def scene():
    """Two cameras, names beyond ASCII, unlit brightness, a landmark without a track, scales and biases."""
    made = synthetic_scene(size=5, views=4, keypoint_noise_px=0.3, brightness_noise=0.01)
    views, tracks = made.views, made.tracks
    views = replace(
        views,
        name=("größe.png", *views.name[1:]),
        cameras=(Camera("SIMPLE_PINHOLE", 64, 48, (1e4 / 3, 32.1, 24.7)), *views.cameras[1:]),
        scale=np.linspace(0.9, 1.3, 4),
        bias=np.linspace(-1e-3, 1e-3, 4),
    )
    lit = np.arange(len(tracks)) % 7 > 0
    tracks = replace(tracks, lit=lit, brightness=np.where(lit, tracks.brightness, 0.0))
    kept = tracks.landmark != 11
    tracks = replace(
        tracks,
        start=np.concatenate([[0], np.cumsum(np.bincount(tracks.landmark[kept], minlength=25))]),
        **{k: getattr(tracks, k)[kept] for k in ("view", "keypoint", "keypoint_sigma", "brightness", "lit")},
    )
    return replace(made, views=views, tracks=tracks)


def test_the_hand_written_model_is_read_by_the_authors_conventions(model):
    """cam_from_body, Suns in the camera frame, keypoints as given, negative brightness is none, ids with gaps."""
    found = read_text_model(write_files(model), keypoint_sigma_px=0.5, sun_sigma_rad=2e-3)
    scene, views, tracks = found.scene, found.scene.views, found.scene.tracks
    assert (found.image_id.tolist(), found.point_id.tolist()) == ([0, 2], [3, 7])
    assert (scene.name, scene.brightness, scene.body, scene.reference) == ("model", "iof", None, 0)
    assert views.cameras == (Camera("PINHOLE", 100, 80, (1000.0, 1000.0, 50.0, 40.0)),) * 2
    np.testing.assert_array_equal(views.body_from_cam.translation, [[0, 0, -10], [-1, 2, 20]])
    np.testing.assert_allclose(views.body_from_cam.rotation, [np.eye(3), np.diag([1, -1, -1])], atol=1e-15)
    np.testing.assert_array_equal(views.sun_measured, [[0, 0, -1], [0.6, 0, 0.8]])
    np.testing.assert_allclose(views.sun, [[0, 0, -1], [0.6, 0, -0.8]], atol=1e-15)
    assert (views.scale.tolist(), views.bias.tolist(), views.sun_sigma.tolist()) == ([1, 2], [0, 0.5], [2e-3] * 2)
    assert (tracks.start.tolist(), tracks.view.tolist()) == ([0, 2, 3], [0, 1, 1])
    assert tracks.keypoint.tolist() == [[50.5, 40.5], [50.5, 40.5], [60.25, 40.5]]
    assert (tracks.brightness.tolist(), tracks.lit.tolist()) == ([0.1, 0, 0.4], [True, False, True])
    assert tracks.keypoint_sigma.tolist() == [0.5] * 3
    assert scene.landmarks.normal.tolist() == [[0, 0, 1]] * 2
    assert scene.landmarks.albedo.tolist() == [0.25, 0.5]
    # Landmark 3 has a keypoint in the reference, landmark 7 is projected there.
    np.testing.assert_array_equal(scene.landmarks.pixel, [[40, 50], [40, 150]])


def test_brightness_below_the_shadow_threshold_is_not_lit(model):
    tracks = read_text_model(write_files(model), shadow_threshold=0.1).scene.tracks
    assert tracks.lit.tolist() == [True, False, True]
    tracks = read_text_model(model, shadow_threshold=0.2).scene.tracks
    assert (tracks.brightness.tolist(), tracks.lit.tolist()) == ([0, 0, 0.4], [False, False, True])


def test_the_reference_is_chosen_by_name(model):
    found = read_text_model(write_files(model), reference="b.png").scene
    assert (found.reference, found.region.row, found.region.col) == (1, 40, 50)
    with pytest.raises(InputError, match=r"images\.txt: holds no image 'c\.png' .* a\.png, b\.png"):
        read_text_model(model, reference="c.png")


def test_a_scene_comes_back_bit_by_bit_and_its_poses_to_rounding(model, scene):
    write_text_model(model, scene)
    found = read_text_model(model).scene
    for part, names in (
        ("views", ("scale", "bias")),
        ("landmarks", ("position", "normal", "albedo")),
        ("tracks", ("start", "view", "keypoint", "brightness", "lit")),
    ):
        for name in names:
            written, read = getattr(getattr(scene, part), name), getattr(getattr(found, part), name)
            assert (written.dtype, written.tobytes()) == (read.dtype, read.tobytes()), name
    assert (found.views.name, found.views.cameras) == (scene.views.name, scene.views.cameras)
    poses, written = found.views.body_from_cam, scene.views.body_from_cam
    np.testing.assert_allclose(poses.rotation, written.rotation, atol=2e-15)
    np.testing.assert_allclose(poses.translation, written.translation, rtol=0, atol=4e-15 * 6e5)
    np.testing.assert_allclose(found.views.sun, scene.views.sun, atol=2e-15)


def test_the_estimated_suns_are_written(model, scene):
    sun = unit(scene.views.sun + [0.0, 0.0, 0.1])
    write_text_model(model, replace(scene, views=replace(scene.views, sun=sun)))
    np.testing.assert_allclose(read_text_model(model).scene.views.sun, sun, atol=2e-15)


def test_line_ends_of_windows_and_images_without_keypoints_are_read(model):
    image = "5 1 0 0 0 0 0 9 0 0 -1 0 empty.png 1 0\n\n"
    expected = read_text_model(write_files(model)).scene
    lines = {k: v.replace("\n", "\r\n") for k, v in {"images": IMAGES + image, "points": POINTS}.items()}
    found = read_text_model(write_files(model, **lines)).scene
    assert found.views.name == ("a.png", "b.png", "empty.png")
    assert found.tracks.view.tolist() == expected.tracks.view.tolist()
    assert found.tracks.keypoint.tobytes() == expected.tracks.keypoint.tobytes()
    assert found.landmarks.position.tobytes() == expected.landmarks.position.tobytes()


def test_the_files_own_numbers_are_kept(tmp_path, model):
    found = read_text_model(write_files(model))
    write_text_model(tmp_path / "again", found.scene, image_id=found.image_id, point_id=found.point_id)
    again = read_text_model(tmp_path / "again")
    assert (again.image_id.tolist(), again.point_id.tolist()) == ([0, 2], [3, 7])
    assert again.scene.tracks.keypoint.tobytes() == found.scene.tracks.keypoint.tobytes()


def test_without_the_added_columns_it_is_colmaps_format(model, scene):
    """What COLMAP does not know cut out of our files, pycolmap reads tracks that reproject as we say."""
    write_text_model(model, scene)
    lines = (model / "images.txt").read_text().splitlines()
    for i, line in enumerate(lines):
        words = line.split()
        if line.startswith("#"):
            continue
        if len(words) == 15:
            lines[i] = " ".join([str(int(words[0]) + 1), *words[1:8], *words[11:13]])
        else:
            lines[i] = " ".join(word for at, word in enumerate(words) if at % 4 != 2)
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    errors = {}
    lines = (model / "points3D.txt").read_text().splitlines()
    for i, line in enumerate(lines):
        if not line.startswith("#"):
            words = line.split()
            track = [str(int(word) + 1 - at % 2) for at, word in enumerate(words[12:])]
            errors[int(words[0])] = float(words[11])
            lines[i] = " ".join([*words[:4], *words[8:12], *track])
    (model / "points3D.txt").write_text("\n".join(lines) + "\n")
    found = pycolmap.Reconstruction()
    found.read_text(model)
    assert found.num_points3D() == len(scene.landmarks)
    assert found.compute_num_observations() == len(scene.tracks)
    for j, point in found.points3D.items():
        squared = []
        for element in point.track.elements:
            image = found.images[element.image_id]
            measured = image.points2D[element.point2D_idx]
            assert measured.point3D_id == j
            squared.append(np.sum((image.project_point(point.xyz) - measured.xy) ** 2))
        assert errors[j] == pytest.approx(np.sqrt(np.mean(squared)) if squared else -1.0, rel=1e-6)


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt", "points3D.txt"])
def test_a_model_cut_short_anywhere_is_refused(model, scene, name):
    write_text_model(model, scene)
    whole = (model / name).read_bytes()
    for size in np.unique(np.linspace(0, len(whole) - 1, 60).astype(int)):
        (model / name).write_bytes(whole[:size])
        with pytest.raises(InputError, match=name):
            read_text_model(model)


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt", "points3D.txt"])
def test_a_missing_file_is_named(model, name):
    (write_files(model) / name).unlink()
    with pytest.raises(InputError, match=rf"{name}: there is no such file; .*points3D\.txt"):
        read_text_model(model)


def assert_refused(model: Path, file: str, text: str, old: str, new: str, message: str):
    """One of the model's files is refused with `message` once `old` is `new` in its text."""
    assert old in text
    write_files(model, **{file: text.replace(old, new, 1).encode("latin-1")})
    with pytest.raises(InputError, match=rf"{file}(3D)?\.txt.*" + message):
        read_text_model(model)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0 PINHOLE", "x PINHOLE", r"line 2: CAMERA_ID, WIDTH and HEIGHT must be whole numbers from 0, found 'x'"),
        ("PINHOLE 100", "PINHOLE 1e2", r"line 2: .* whole numbers from 0, found '1e2'"),
        (" 100 80 1000.0 1000.0 50.0 40.0", "", r"line 2: holds 2 values, expected CAMERA_ID MODEL"),
        ("0 PINHOLE", "0 OPENCV", r"line 2: camera 0: camera model 'OPENCV' is not supported .* undistort"),
        ("40.0\n", "\n", r"line 2: camera 0: camera model PINHOLE has 4 parameters, got 3"),
        ("1000.0 50", "nan 50", r"line 2: value 6 is 'nan'"),
        ("40.0\n", "40.0\n0 PINHOLE 9 9 9 9 9 9\n", r"line 3: camera 0 is there twice"),
        ("# ", "# Number of cameras: 2\n# ", r": holds 1 cameras, 2 are announced"),
        ("# CAMERA_ID, MODEL", "\xe9", r"line 1: is not UTF-8"),
    ],
)
def test_faults_of_cameras_are_named_with_their_line(model, old, new, message):
    assert_refused(model, "cameras", CAMERAS, old, new, message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("a.png 1.0 0.0", "a.png 1.0", r"line 3: holds 14 values, expected IMAGE_ID .* BIAS"),
        ("a.png", "a b.png", r"line 3: holds 16 values, .*names cannot hold spaces"),
        ("a.png", "\xe9.png", r"line 3: is not UTF-8"),
        ("0 1 0 0 0", "0 1 0 0 x", r"line 3: value 5 is 'x'"),
        ("a.png 1.0", "a.png nan", r"line 3: value 14 is 'nan'"),
        ("a.png 1.0", "a.png 0", r"line 3: image 0: SCALE is 0, expected a positive number"),
        ("0 1 0 0 0", "0 1 1 0 0", r"line 3: image 0: QW QX QY QZ is not a rotation"),
        ("0 0 -1 0", "0 0 0 0", r"line 3: image 0 has no Sun"),
        ("0 0 -1 0", "0 0 -1 5", r"line 3: image 0 uses camera 5, which cameras\.txt does not hold"),
        ("0 1 0 0 0", "-4 1 0 0 0", r"line 3: IMAGE_ID and CAMERA_ID must be whole numbers from 0, found '-4'"),
        ("2 0 1 0 0", "0 0 1 0 0", r"line 5: the number 0 is that of an earlier image"),
        ("b.png", "a.png", r"line 5: the name a\.png is that of an earlier image"),
        (" 0.2 -1", " 0.2", r"line 4: image 0 has 7 values, no multiple of 4"),
        ("0.2 -1", "nan -1", r"line 4: value 7 is 'nan'"),
        ("0.2 -1", "0.2 -2", r"line 4: keypoint 1 of image 0 has POINT3D_ID -2"),
        ("0.2 -1", "0.2 1.5", r"line 4: keypoint 1 of image 0 has POINT3D_ID 1\.5"),
        ("0.1 -1", "0.1 7", r"line 4: keypoint 0 of image 0 has POINT3D_ID 7, but .* in the track of point 3"),
        ("0.2 -1", "0.2 9", r"line 4: keypoint 1 of image 0 has POINT3D_ID 9, points3D\.txt does not hold"),
        ("0.2 -1", "0.2 7", r"line 4: keypoint 1 of image 0 has POINT3D_ID 7, whose track .* does not name it"),
        ("50.5 40.5 0.1 -1 60.25 40.5 0.2 -1\n", "", r"line 4: value 13 is 'b\.png'"),
        ("50.5 40.5 -1 -1 60.25 40.5 0.4 7\n", "", r"line 5: the line of this image's keypoints is missing"),
        ("# IMAGE_ID", "# Number of images: 3, mean 2\n# IMAGE_ID", r": holds 2 images, 3 are announced"),
    ],
)
def test_faults_of_images_are_named_with_their_line(model, old, new, message):
    assert_refused(model, "images", IMAGES, old, new, message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.0 2 1", "0.0 2", r"line 3: holds 13 values, expected POINT3D_ID .* pairs of IMAGE_ID POINT2D_IDX"),
        ("0.5 0 0 0 0.0 2 1", "0.5 0 0", r"line 3: holds 10 values"),
        ("7 1 0 0", "7 1 nan 0", r"line 3: value 3 is 'nan'"),
        ("7 1 0 0", "7 1 \xff 0", r"line 3: value 3 is "),
        ("0 0 2 0.5", "0 0 0 0.5", r"line 3: the normal of point 7 is zero"),
        ("7 1 0 0", "3 1 0 0", r"line 3: point 3 is there twice"),
        ("7 1 0 0", "-7 1 0 0", r"line 3: -7 is not a POINT3D_ID"),
        ("0.0 2 1", "0.0 2 0.5", r"line 3: 0\.5 is not a POINT3D_ID, IMAGE_ID or POINT2D_IDX"),
        ("0.0 2 1", "0.0 1 1", r"line 3: the track of point 7 names image 1, which images\.txt does not hold"),
        ("0.0 2 1", "0.0 2 2", r"line 3: the track of point 7 names keypoint 2 of image 2, which has 2"),
        ("0.0 2 1", "0.0 2 1 2 0", r"line 3: the track of point 7 names image 2 twice"),
        ("0.0 2 1", "0.0 2 0", r"line 3: the track of point 7 names keypoint 0 of image 2, as an earlier track does"),
        ("# POINT3D_ID", "# Number of points: 1\n# POINT3D_ID", r": holds 2 points, 1 are announced"),
    ],
)
def test_faults_of_points_are_named_with_their_line(model, old, new, message):
    assert_refused(model, "points", POINTS, old, new, message)


def test_a_file_of_comments_alone_is_refused(model):
    for name in ("cameras", "images", "points"):
        write_files(model, **{name: "# nothing\n"})
        with pytest.raises(InputError, match=rf"{name.replace('points', 'points3D')}\.txt: holds 0 {name}"):
            read_text_model(model)


def test_what_the_format_cannot_hold_is_refused_before_anything_is_written(model, scene):
    spaced = replace(scene, views=replace(scene.views, name=("a b.png", *scene.views.name[1:])))
    with pytest.raises(InputError, match=r"'a b\.png'.*rename"):
        write_text_model(model, spaced)
    dark = replace(scene, tracks=replace(scene.tracks, brightness=scene.tracks.brightness - 1.0))
    with pytest.raises(InputError, match="lit and negative"):
        write_text_model(model, dark)
    assert not model.exists()


@pytest.mark.data
def test_the_synthetic_model_is_read_as_the_arrays_it_was_made_from(tmp_path):
    if not (DATA / "site_2500").exists():
        pytest.skip(f"the model in the authors' format is not at {DATA}")
    with np.load(DATA / "site_2500_truth.npz") as stored:
        truth = dict(stored)
    scene = read_text_model(DATA / "site_2500").scene
    views, landmarks, tracks = scene.views, scene.landmarks, scene.tracks
    np.testing.assert_allclose(views.body_from_cam.rotation.swapaxes(1, 2), truth["R_CW_init"], atol=1e-15)
    np.testing.assert_allclose(views.body_from_cam.translation, truth["C_W_init"], atol=1e-11)
    np.testing.assert_allclose(views.sun, truth["s_W_init"], atol=1e-14)
    np.testing.assert_allclose(landmarks.position, truth["X_init"], atol=1e-14)
    np.testing.assert_allclose(landmarks.normal, truth["n_init"], atol=1e-14)
    np.testing.assert_allclose(landmarks.albedo, truth["a_init"], atol=1e-14)
    np.testing.assert_array_equal(tracks.landmark, truth["obs_pt"])
    np.testing.assert_array_equal(tracks.view, truth["obs_cam"])
    np.testing.assert_array_equal(tracks.keypoint, truth["obs_xy"])
    np.testing.assert_array_equal(tracks.brightness, truth["obs_I"])
    assert scene.gsd == pytest.approx(truth["gsd_km"], rel=5e-3)
    write_text_model(tmp_path / "again", scene)
    again = read_text_model(tmp_path / "again").scene
    assert again.landmarks.position.tobytes() == landmarks.position.tobytes()
    assert again.landmarks.normal.tobytes() == landmarks.normal.tobytes()
    assert again.tracks.keypoint.tobytes() == tracks.keypoint.tobytes()
