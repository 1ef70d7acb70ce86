"""Laser altimetry: tables, shots beside landmarks, maps that follow them, tracks and shots that are wrong."""

import json
import logging
from dataclasses import replace

import numpy as np
import pytest

from drawn_priors import priors_of, with_priors
from estimate_starts import INDEPENDENT, start_of
from photoclinometry.adjust import PosePriors, ScenePriors, adjust
from photoclinometry.adjust.altimeter_tracks import altimetry_at
from photoclinometry.adjust.frame import in_its_frame
from photoclinometry.adjust.graph.altimetry import Altimetry
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.io.altimetry_csv import read_altimetry, write_altimetry
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, so3_log
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.frame.altimetry import (
    altimetry_table,
    on_shots,
    tracks_over,
    warn_of_altimetry,
    write_shots,
)
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.registration.altimetry import shift_to_altimetry
from photoclinometry.simulate.altimetry import altimeter_tracks
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import ground_place
from photoclinometry.simulate.truth_file import read_truth
from scenes import GSD, bumpy_surface, synthetic_scene

SHOT_M, TRACK_M = 2.0, 30.0
UNSTATED = replace(INDEPENDENT, uncertainty=False)
"""Of estimates whose standard deviations nothing asks for."""
HEADER = "track,x_m,y_m,z_m,sigma_m,track_sigma_m\n"


def tracks_on(surface, half, rng, shot=SHOT_M, track=TRACK_M, step=0.7 * GSD):
    """Six tracks over a square of ground, three each way, their shots off by what they state."""
    along = np.arange(-half, half, step)
    lines = [np.column_stack([along, np.full_like(along, y)]) for y in np.array([-0.6, 0.0, 0.6]) * half]
    xy = np.concatenate([*lines, *(line[:, ::-1] for line in lines)])
    number = np.repeat(np.arange(6), len(along))
    height = surface.height(xy) + shot * rng.normal(size=len(xy))
    shift = track * rng.normal(size=(6, 3))
    return (
        AltimeterTracks(
            name=tuple(f"T{n}" for n in range(6)),
            shift_sigma=np.full(6, track),
            track=number,
            position=np.column_stack([xy, height]) + shift[number],
            sigma=np.full(len(xy), shot),
        ),
        shift,
    )


@pytest.fixture(scope="module")
def known():
    """A scene in metres, tracks over its ground, the shifts that these have, and loose pose priors."""
    scene = replace(synthetic_scene(size=24, views=6, keypoint_noise_px=0.3, brightness_noise=0.01), frame=BODY_FIXED)
    tracks, shift = tracks_on(bumpy_surface(), 14 * GSD, np.random.default_rng(3))
    loose = PosePriors(
        body_from_cam=scene.views.body_from_cam,
        rotation_sigma=np.full(6, 1e-4),
        center_sigma=np.full(6, 20.0),
        common_rotation_sigma=1e-3,
        common_center_sigma=600.0,
    )
    return scene, tracks, shift, loose


def test_a_table_reads_back_as_it_was_written(known, tmp_path):
    tracks = known[1]
    write_altimetry(tmp_path / "shots.csv", tracks, {"off_m": np.zeros(len(tracks))})
    found = read_altimetry(tmp_path / "shots.csv")
    assert found.name == tracks.name
    for name in ("shift_sigma", "track", "position", "sigma"):
        np.testing.assert_array_equal(getattr(found, name), getattr(tracks, name))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("track,x_m,y_m,z_m,sigma_m\nA,1,2,3,4\n", "no column 'track_sigma_m'"),
        (HEADER, "has no shot"),
        (HEADER + "A,1,2,3,4,5\nA,1,2,3,4,6\n", "line 3: track 'A' has a track_sigma_m of 5 m above and 6 m here"),
        (HEADER + "A,1,2,3,0,5\n", "line 2: sigma_m is 0, expected a positive number"),
        (HEADER + "A,1,2,high,1,5\n", "line 2: z_m is 'high', expected a number"),
        (HEADER + ",1,2,3,1,5\n", "line 2: track is empty"),
        (HEADER + "A,1,2,3,1,\n", "line 2: track_sigma_m is empty"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path, text, message):
    (tmp_path / "shots.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_altimetry(tmp_path / "shots.csv")


def test_a_tracks_sigma_may_be_stated_once(tmp_path):
    (tmp_path / "shots.csv").write_text(HEADER + "A,1,2,3,4,5\nB,0,0,0,1,7\nA,1,2,3,4,\n", encoding="utf-8")
    found = read_altimetry(tmp_path / "shots.csv")
    assert found.shift_sigma.tolist() == [5.0, 7.0]
    assert found.track.tolist() == [0, 1, 0]


def test_shots_lie_where_they_are_measured(known):
    """Of the true scene: off by their own errors and the track's shift, and none beside the map."""
    scene, tracks, shift, _ = known
    estimate = Estimate(scene.views, scene.landmarks, np.zeros(3), systematic=np.zeros((6, 10)))
    estimate.systematic[:, :3] = shift
    fit = altimetry_at(tracks, estimate, len(scene.landmarks), scene.spacing, 0)
    inside = np.linalg.norm((tracks.position - shift[tracks.track])[:, :2], axis=1) < 10 * GSD
    assert fit.met[inside].all()
    assert not fit.met[np.linalg.norm(tracks.position[:, :2], axis=1) > 18 * GSD].any()
    assert np.sqrt(np.mean((fit.off[fit.met] / fit.stated_sigma[fit.met]) ** 2)) == pytest.approx(1.0, abs=0.15)
    assert fit.used[fit.met].all()
    assert fit.inflation < 1.2


def test_a_map_follows_its_shots(known):
    """Priors have a common error of 600 m: the map's height is in place to what the tracks tell, as the run states.

    Without shots it is where the start was, since nothing else tells.
    """
    scene, tracks, shift, loose = known
    start = start_of(transform_scene(Similarity(1.0, np.eye(3), np.array([40.0, -30.0, 150.0])), scene))
    found = adjust(start, INDEPENDENT, priors=ScenePriors(pose_priors=loose, altimetry=tracks))
    assert found.converged
    off = found.scene.landmarks.position - scene.landmarks.position
    stated = np.sqrt(np.diag(found.frame_covariance)[3:6])
    assert np.all(np.abs(off.mean(0)) < 3.0 * stated)
    assert stated[2] < 15.0, "six tracks of 30 m"
    rows = altimetry_table(found.altimetry)
    assert [row.name for row in rows] == [f"T{n}" for n in range(6)]
    assert all(row.off_sigmas < 1.5 and row.shift_off_sigmas < 2.5 and not row.left_out for row in rows)
    up = found.altimetry.shift[:, 2] - found.altimetry.shift[:, 2].mean()
    np.testing.assert_allclose(up, shift[:, 2] - shift[:, 2].mean(), atol=5.0 * SHOT_M)
    alone = adjust(start, INDEPENDENT, priors=ScenePriors(pose_priors=loose))
    assert np.linalg.norm(np.diag(alone.frame_covariance)[3:6]) > 1000.0 * np.linalg.norm(stated**2)


def test_wrong_shots_are_left_out_and_named(known, tmp_path, caplog):
    scene, tracks, _, loose = known
    rng = np.random.default_rng(0)
    wrong = rng.random(len(tracks)) < 0.15
    spoiled = replace(tracks, position=tracks.position + np.where(wrong, 400.0, 0.0)[:, None] * [0.0, 0.0, 1.0])
    found = adjust(start_of(scene), UNSTATED, priors=ScenePriors(pose_priors=loose, altimetry=spoiled))
    fit = found.altimetry
    assert not fit.used[wrong].any()
    assert fit.used[fit.met & ~wrong].all()
    with caplog.at_level(logging.WARNING):
        warn_of_altimetry(altimetry_table(fit), given=True)
    assert "lie too far off the map to be used; altimetry.csv names them" in caplog.text
    write_shots(tmp_path, fit)
    lines = (tmp_path / "altimetry.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].endswith("off_m,off_sigmas,used")
    assert sum(line.endswith(",0") for line in lines) == int((fit.met & wrong).sum())
    write_shots(tmp_path, None)
    assert not (tmp_path / "altimetry.csv").exists()


def test_a_wrong_track_is_named(known, caplog):
    scene, tracks, _, loose = known
    wrong = tracks.position + np.where(tracks.track == 4, 400.0, 0.0)[:, None] * [0.0, 0.0, 1.0]
    found = adjust(
        start_of(scene), UNSTATED, priors=ScenePriors(pose_priors=loose, altimetry=replace(tracks, position=wrong))
    )
    with caplog.at_level(logging.WARNING):
        warn_of_altimetry(altimetry_table(found.altimetry), given=True)
    assert "altimeter track T4" in caplog.text
    assert not any(f"track T{n}" in caplog.text for n in (0, 1, 2, 3, 5))


def test_a_map_that_is_not_where_its_shots_are_says_so(known, caplog):
    """Shots of other ground: they scatter about the map by tens of their standard deviations, whatever is done."""
    scene, _, _, loose = known
    strange = tracks_on(bumpy_surface(seed=9), 14 * GSD, np.random.default_rng(3))[0]
    found = adjust(start_of(scene), UNSTATED, priors=ScenePriors(pose_priors=loose, altimetry=strange))
    with caplog.at_level(logging.WARNING):
        warn_of_altimetry(altimetry_table(found.altimetry), given=True)
    assert "scatter about the map by" in caplog.text
    assert found.altimetry.inflation > 5.0
    heights = found.scene.landmarks.position[:, 2] - scene.landmarks.position[:, 2]
    assert np.std(heights) < 0.3 * GSD, "the map keeps its shape"


def test_shots_elsewhere_are_said_to_be_unused(known, caplog):
    scene, tracks, *_ = known
    assert tracks_over(scene, replace(tracks, position=tracks.position + 1e5)) is None
    with caplog.at_level(logging.WARNING):
        warn_of_altimetry([], given=False)
        assert not caplog.records
        warn_of_altimetry([], given=True)
    assert "no shot of the laser altimeter can be used" in caplog.text
    assert tracks_over(scene, replace(tracks, position=tracks.position / 1000.0)) is None, "kilometres"


def test_tracks_of_single_shots_are_warned_of(known, caplog):
    """A table whose `track` counts shots. Every eighth is enough: each has systematic errors of its own to estimate."""
    scene, tracks, _, loose = known
    position, sigma = tracks.position[::8], tracks.sigma[::8]
    each = np.arange(len(sigma))
    own = AltimeterTracks(
        name=tuple(map(str, each)),
        shift_sigma=np.full(len(sigma), TRACK_M),
        track=each,
        position=position,
        sigma=sigma,
    )
    found = adjust(start_of(scene), UNSTATED, priors=ScenePriors(pose_priors=loose, altimetry=own))
    with caplog.at_level(logging.WARNING):
        warn_of_altimetry(altimetry_table(found.altimetry), given=True)
    assert "have a single shot" in caplog.text


def test_only_tracks_over_a_map_are_its_own(known):
    scene, tracks, *_ = known
    far = np.where(tracks.track[:, None] < 2, tracks.position + 1e5, tracks.position)
    found = tracks_over(scene, replace(tracks, position=far))
    assert found.name == ("T2", "T3", "T4", "T5")
    assert set(found.track) == {0, 1, 2, 3}
    np.testing.assert_array_equal(found.position, tracks.position[tracks.track >= 2])


def test_a_map_far_beside_its_place_is_shifted_onto_the_shots(known):
    """By six ground samples, a quarter of the map and a half of its waves; from where it belongs it stays."""
    scene = known[0]
    surface = tracks_on(bumpy_surface(), 14 * GSD, np.random.default_rng(1), track=3.0)[0]
    np.testing.assert_array_equal(shift_to_altimetry(scene, surface), 0.0)
    off = np.array([4.5 * GSD, -4.0 * GSD, 500.0])
    moved = replace(transform_scene(Similarity(1.0, np.eye(3), off), scene), frame=BODY_FIXED)
    found = on_shots(moved, surface)
    assert found.frame == BODY_FIXED
    np.testing.assert_allclose(found.landmarks.position, scene.landmarks.position, atol=0.2 * GSD)


def test_a_map_is_moved_as_a_whole_to_where_priors_and_shots_put_it():
    """Exact priors and shots of a scene that was turned, shifted and scaled: all is where it was."""
    scene = synthetic_scene(size=12, views=5)
    moved = transform_scene(
        Similarity(1.004, so3_exp(np.array([2e-3, -1e-3, 3e-3])), np.array([30.0, -20.0, 80.0])), scene
    )
    pose = scene.views.body_from_cam
    priors = PosePriors(body_from_cam=pose, rotation_sigma=np.full(5, 1e-2), center_sigma=np.full(5, 1e4))
    shots = Altimetry(
        landmark=np.arange(144),
        track=np.arange(144) % 3,
        position=scene.landmarks.position,
        sigma=np.full(144, 0.1),
        shift_sigma=np.full(3, 10.0),
    )
    start = Estimate(moved.views, moved.landmarks, moved.landmarks.position.mean(0), systematic=np.ones((3, 10)))
    found = in_its_frame(start, lambda _: [priors, shots], scene.spacing)
    off = np.linalg.norm(found.landmarks.position - scene.landmarks.position, axis=1)
    assert off.max() < 0.02 * GSD
    np.testing.assert_allclose(found.systematic[:, :3], 0.0, atol=1.0)
    np.testing.assert_array_equal(found.landmarks.albedo, moved.landmarks.albedo)
    np.testing.assert_allclose(
        so3_log(found.views.body_from_cam.rotation @ np.swapaxes(pose.rotation, 1, 2)), 0.0, atol=1e-4
    )


def test_level_ground_is_not_shifted_along_itself(known):
    """Its shots tell the height alone."""
    scene, tracks, *_ = known
    level = scene.landmarks.position * [1.0, 1.0, 0.0]
    up = np.tile([0.0, 0.0, 1.0], (len(level), 1))
    flat = replace(scene, landmarks=replace(scene.landmarks, position=level, normal=up))
    shots = replace(tracks, position=tracks.position * [1.0, 1.0, 0.0] + [0.0, 0.0, 300.0])
    np.testing.assert_allclose(shift_to_altimetry(flat, shots), [0.0, 0.0, 300.0], atol=1e-6)


def test_simulated_shots_lie_on_the_true_ground():
    """But for their stated errors: those of single shots, and those of whole tracks."""
    place = ground_place(SimulationOptions(image_size=64, region_size=32, altimetry=(3.0, 1e-6)))
    shots = place.altimetry
    off = shots.position[:, 2] - place.tracer.surface.height_at(shots.position[:, :2])
    assert np.std(off) == pytest.approx(3.0, rel=0.15)
    shifted = ground_place(SimulationOptions(image_size=64, region_size=32, altimetry=(3.0, 50.0))).altimetry
    shift = shifted.position - shots.position
    assert np.std(shift[:, 0]) == pytest.approx(50.0, rel=0.6)
    for n in range(len(shots.name)):
        np.testing.assert_allclose(np.ptp(shift[shots.track == n], axis=0), 0.0, atol=1e-4)
    with pytest.raises(InputError, match="--altimetry is of places"):
        SimulationOptions(preset="topshape", altimetry=(3.0, 50.0))


@pytest.mark.usefixtures("no_figures", "photometry_as_stated")
def test_a_run_with_altimetry_is_in_place(mapped, tmp_path):
    """Pose priors have an error of 2 km in common. The map lies where the shots put it, and says how well it does."""
    truth = read_truth(mapped.truth)
    rng = np.random.default_rng(7)
    found = priors_of(truth.views.name, truth.views.body_from_cam, 1e-4, 50.0, rng)
    shared = {
        name: replace(
            prior,
            cam_from_body=(Rigid(pose.rotation, pose.translation + [900.0, -700.0, 500.0])).inverse(),
            common_translation_sigma=1000.0,
        )
        for name, prior in found.items()
        for pose in (prior.cam_from_body.inverse(),)
    }
    scene = mapped.result.scene
    width = scene.region.width * 60.0
    tracks = altimeter_tracks(truth.surface, width, 60.0, (2.0, 10.0), rng)
    write_altimetry(tmp_path / "shots.csv", tracks)
    site = with_priors(mapped, shared, tmp_path / "site")
    found = pipeline.run(site, mapped.copy(tmp_path / "run"), pipeline.RunOptions(altimetry=tmp_path / "shots.csv"))
    assert not [warned for warned in found.warnings if warned.code.startswith("altimetry")]
    metrics = found.metrics | evaluate_against_truth(found.scene, truth).metrics
    assert metrics["frame_offset_sigma_m"] < 40.0
    assert metrics["frame_offset_m"] < 3.0 * metrics["frame_offset_sigma_m"]
    assert abs(metrics["frame_scale_error_percent"]) < 3.0 * metrics["frame_scale_sigma_percent"]
    assert 600.0 < metrics["altimetry_moved_m"] < 2500.0
    assert metrics["altimetry_left_out"] < 0.05 * metrics["altimetry_shots"]
    table = json.loads((tmp_path / "run" / "metrics.json").read_text())["altimetry"]
    assert len(table) >= 6
    assert set(read_altimetry(tmp_path / "run" / "altimetry.csv").name) == {row["name"] for row in table}
    with pytest.raises(InputError, match="the site has no pose priors"):
        pipeline.run(mapped.site, tmp_path / "other", pipeline.RunOptions(altimetry=tmp_path / "shots.csv"))
