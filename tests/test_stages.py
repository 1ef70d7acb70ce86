"""Keys of stages: whatever option is changed in a finished run folder, nothing is read back that depends on it."""

import typing
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import pytest

from adjustments import look_for_no_errors_of_brightness, not_adjusted
from photoclinometry.adjust import AdjustOptions
from photoclinometry.io.site import read_site
from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.matching.flow import FlowMatcher, FlowOptions
from photoclinometry.matching.registry import MATCHERS
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.ranges import numeric_parts
from photoclinometry.model.reflectance import starting_model
from photoclinometry.pipeline import direct_refinement, joint_estimate, model_choice
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.folder.run_folder import RunFolder, adopt_stages
from photoclinometry.pipeline.folder.stage import Keyed, digest
from photoclinometry.pipeline.options import RelightOptions
from photoclinometry.pipeline.run import RunOptions, run
from photoclinometry.sfm import SfmOptions
from photoclinometry.sfm.region import RegionOptions
from photoclinometry.simulate.truth_file import read_truth

pytestmark = pytest.mark.usefixtures("no_figures")

HELD_OUT = ("images/001.fits",)
BASE = RunOptions(hold_out=HELD_OUT, densify=DensifyOptions(min_views=4))
CHOICES = {"matcher": "flow", "reflectance": "akimov", "hold_out": ("images/002.fits",), "iterations": 2}
"""Other legal values of options whose type does not tell them; of `iterations`, fewer, as more are not needed."""


@pytest.fixture(scope="module")
def site(mapped, tmp_path_factory):
    """The small site with a pose prior for every view: that of the truth."""
    found, true = read_site(mapped.site), read_truth(mapped.truth).views
    known = true.body_from_cam.inverse()
    views = [replace(view, pose_prior=PosePrior(known[true.name.index(view.name)], 1e-3, 1e3)) for view in found.views]
    path = mapped.changed_site(tmp_path_factory.mktemp("priors") / "site", views=tuple(views))
    CHOICES["control"] = path.with_name("points.csv")
    CHOICES["control"].write_text(
        f"point,view,x_px,y_px,x_m,y_m,z_m,sigma_m\nA,{views[0].name},9,9,1,2,3,4\n", encoding="utf-8"
    )
    CHOICES["altimetry"] = path.with_name("shots.csv")
    CHOICES["altimetry"].write_text("track,x_m,y_m,z_m,sigma_m,track_sigma_m\nA,1,2,3,4,5\n", encoding="utf-8")
    return path


def stand_in(scene, options, priors, gradients=None, **_):
    """A joint estimate that stops at once, and whose message tells what it was given."""
    message = f"{options} {'by images' if gradients is not None else 'by matches'}"
    return not_adjusted(scene, message, pose_priors=priors.pose_priors)


def any_model(scene, known, candidates, progress):
    """A choice of the reflectance model that is another for another scene, without a comparison."""
    number = int(digest((scene, known)), 16) % len(candidates)
    return starting_model(candidates[number], scene.body), f"number {number}"


@pytest.fixture(scope="module", autouse=True)
def tell_options():
    """Joint estimates and the choice of the model are stood in for, and images are used from three views on."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_estimate, "adjust", stand_in)
        patch.setattr(model_choice, "model_by_cross_validation", any_model)
        patch.setattr(direct_refinement, "MIN_LIT", 3)
        look_for_no_errors_of_brightness(patch)
        yield


# Which options a stage reads, and which keys an option changes.


def leaves(options, prefix=""):
    """The dotted names of all options, those of nested dataclasses too."""
    for field in fields(options):
        value = getattr(options, field.name)
        if is_dataclass(value):
            yield from leaves(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name


def changed(options, name):
    """The options with another legal value of one, by its type."""
    first, _, rest = name.partition(".")
    value = getattr(options, first)
    if rest:
        return replace(options, **{first: changed(value, rest)})
    kind = typing.get_type_hints(type(options), include_extras=True)[first]
    if first in CHOICES:
        other = CHOICES[first]
    elif typing.get_origin(kind) is typing.Literal:
        other = next(choice for choice in typing.get_args(kind) if choice != value)
    elif isinstance(value, bool):
        other = not value
    elif isinstance(value, (int, float)):
        limits = [limits for _, limits in numeric_parts(kind) if limits is not None]
        step = max(limit.multiple_of for limit in limits) if limits else 1
        others = (value + step, 1) if isinstance(value, int) else (0.5 * value, 2.0 * value, 0.5)
        other = next(x for x in others if x != value and all(x in limit for limit in limits))
    elif isinstance(value, str):
        other = value + "x"
    elif isinstance(value, tuple):
        other = (*value[:-1], value[-1] + 1)
    else:
        assert value is None, name
        limits = [limits for _, limits in numeric_parts(kind) if limits is not None]
        other = Path("file") if Path in typing.get_args(kind) else next(x for x in (0.5, 2.0) if x in limits[0])
    return replace(options, **{first: other})


def test_every_option_has_another_value():
    names = list(leaves(RunOptions()))
    assert len(names) > 60
    assert {"relight.direct", "adjust.solver.max_steps", "flow.patch_px"} <= set(names)
    for name in names:
        assert changed(BASE, name) != BASE, name


def recording(options, reads, now, prefix=""):
    """The options as an object of their own type that notes what is read of them while stage `now[0]` is at work."""
    kind = type(options)
    names = {field.name for field in fields(kind)}

    def read(self, name):
        if name in names and now:
            reads.setdefault(now[0], set()).add(prefix + name)
        return object.__getattribute__(self, name)

    values = {name: getattr(options, name) for name in names}
    for name, value in values.items():
        if is_dataclass(value):
            values[name] = recording(value, reads, now, f"{prefix}{name}.")
    watched = type(kind.__name__, (kind,), {"__getattribute__": read, "__qualname__": kind.__qualname__})
    return watched(**values)


@pytest.fixture(scope="module")
def recorded(site, mapped, tell_options, tmp_path_factory):
    """A run of BASE: the results of its stages, their keys, and the names of the options that each one read."""
    results, keys, reads, now = {}, {}, {}, []
    timed, done = RunFolder.timed, RunFolder.result_of

    @contextmanager
    def timed_and_watched(self, name):
        now.append(name)
        with timed(self, name) as cost:
            yield cost
        now.clear()

    def done_and_noted(self, stage):
        found = done(self, stage)
        results[stage.file_name], keys[stage.file_name] = found.value, found.key
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "write_products", lambda *_: None)
        patch.setattr(RunFolder, "timed", timed_and_watched)
        patch.setattr(RunFolder, "result_of", done_and_noted)
        run(site, tmp_path_factory.mktemp("recorded"), recording(BASE, reads, now))
    return results, keys, reads


@pytest.fixture
def keys_of(site, tmp_path, monkeypatch, recorded):
    """The keys of all stages for given options, whose results are those of the recorded run."""
    results = recorded[0]
    monkeypatch.setattr(pipeline, "write_products", lambda *_: None)

    def of(options):
        keys = {}

        def done(self, stage):
            keys[stage.file_name] = stage.key
            return Keyed(results[stage.file_name], stage.key)

        with monkeypatch.context() as patch:
            patch.setattr(RunFolder, "result_of", done)
            run(site, tmp_path / "run", options)
        return keys

    return of


def test_a_change_of_any_option_that_a_stage_reads_changes_its_key(recorded, keys_of):
    _, keys, reads = recorded
    assert keys_of(BASE) == keys
    assert {"sparse", "region", "dense", "first_estimate", "relighting_1", "last_estimate"} <= reads.keys()
    assert "sfm.max_features" in reads["sparse"]
    assert "flow.patch_px" in reads["dense"]
    assert "flow.patch_px" in reads["held_out"]
    for name in set().union(*reads.values()):
        if isinstance(_value(BASE, name), (bool, int, float, str, tuple, type(None))):
            found = keys_of(changed(BASE, name))
            for stage in reads:
                if name in reads[stage] and stage in keys.keys() & found.keys():
                    assert found[stage] != keys[stage], f"{stage} reads {name}"


def test_a_change_of_any_option_changes_what_the_run_ends_with(keys_of, monkeypatch):
    """Options of a matcher that is not chosen change nothing; chosen, they do. No view is left out by its check.

    With the other matcher, options of both are tried, and the choice: all others are as they were.
    """
    entry = replace(MATCHERS["roma"], make=lambda options: FlowMatcher(), fingerprint=lambda options: options)
    monkeypatch.setitem(MATCHERS, "roma", entry)
    names = list(leaves(BASE))
    of_matchers = [name for name in names if name.partition(".")[0] in ("matcher", "flow", "roma")]
    for options, tried in ((BASE, names), (replace(BASE, matcher="roma"), of_matchers)):
        end = keys_of(options)["held_out"]
        for name in tried:
            idle = name == "check_views" or (name.startswith("roma.") and options.matcher != "roma")
            assert (keys_of(changed(options, name))["held_out"] == end) == idle, name


def _value(options, name):
    for part in name.split("."):
        options = getattr(options, part)
    return options


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        ("sfm.seed", "sparse"),
        ("region.shadow_fraction", "region"),
        ("flow.patch_px", "dense"),
        ("densify.max_reprojection_px", "dense"),
        ("adjust.smooth_neighbours", "first_estimate"),
        ("relight.keypoint_sigma_factor", "relighting_1"),
        ("relight.settled_px", "relighting_1"),
        ("relight.direct", "last_estimate"),
    ],
)
def test_a_change_of_an_option_redoes_what_follows_from_it_and_no_more(recorded, keys_of, name, stage):
    keys, found = recorded[1], keys_of(changed(BASE, name))
    unchanged = [name for name, key in found.items() if key == keys[name]]
    assert unchanged == list(keys)[: list(keys).index(stage)]


# Runs in one folder, each with other options than the last, against runs in folders of their own.


ONE = RelightOptions(iterations=1)
CHANGES = {
    "none": RunOptions(relight=ONE),
    "relight.direct": RunOptions(relight=replace(ONE, direct=False)),
    "relight.iterations": RunOptions(relight=RelightOptions(iterations=2, settled_px=0.0)),
    "relight.keypoint_sigma_factor": RunOptions(
        relight=RelightOptions(iterations=2, settled_px=0.0, keypoint_sigma_factor=2.0)
    ),
    "adjust.smooth_sigma_rad": RunOptions(relight=ONE, adjust=AdjustOptions(smooth_sigma_rad=0.3)),
    "flow.min_correlation": RunOptions(relight=ONE, flow=FlowOptions(min_correlation=0.6)),
    "densify.min_views": RunOptions(relight=ONE, densify=DensifyOptions(min_views=5)),
    "region.stride": RunOptions(relight=ONE, region=RegionOptions(stride=2)),
    "sfm.max_features": RunOptions(relight=ONE, sfm=SfmOptions(threads=1, max_features=3000)),
    "matcher": RunOptions(matcher="flow"),
}


def test_a_run_in_the_folder_of_other_options_is_that_of_a_new_folder(mapped, tmp_path, monkeypatch):
    """One after the other, so that each run finds what the one before left. Products follow from what is compared."""
    monkeypatch.setattr(pipeline, "write_products", lambda folder, summary: summary)
    for name, options in CHANGES.items():
        if options.sfm == SfmOptions():
            (tmp_path / "one" / "stages" / "sparse.npz").unlink(missing_ok=True)
            for folder in (tmp_path / "one", tmp_path / name):
                adopt_stages(mapped.run, folder, ("sparse",))
        again, new = run(mapped.site, tmp_path / "one", options), run(mapped.site, tmp_path / name, options)
        assert again.adjustment.message == new.adjustment.message, name
        assert digest(again.adjustment) == digest(new.adjustment), name
        assert again.iterations == new.iterations, name


def test_a_last_estimate_by_matches_is_not_read_back_from_a_direct_one(mapped, tmp_path, adjust_nothing):
    folder = mapped.copy(tmp_path / "run")
    run(mapped.site, folder, RunOptions(relight=RelightOptions(direct=False)))
    assert [options.uncertainty for options in adjust_nothing] == [True]
