"""`import photoclinometry as pcm`: light, complete, typed, documented; and each function does what its command does."""

import ast
import inspect
import json
import subprocess
import sys
import typing
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photoclinometry as pcm
from photoclinometry.adjust.solve.solver import SolverOptions
from photoclinometry.photometry.render import render_view
from photoclinometry.simulate.truth_file import read_truth
from scenes import synthetic_scene

HEAVY = ("numpy", "numba", "scipy", "cv2", "pycolmap", "matplotlib", "h5py", "astropy", "tyro", "rich")
FUNCTIONS = [name for name in pcm.__all__ if inspect.isfunction(getattr(pcm, name))]
CLASSES = [name for name in pcm.__all__ if inspect.isclass(getattr(pcm, name))]


def python(code: str) -> str:
    """What a fresh interpreter prints."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def test_the_import_is_light():
    """Modules are counted, not seconds: none of the slow ones, and none of the package's own."""
    code = "import sys, photoclinometry; dir(photoclinometry); print(' '.join(sys.modules))"
    loaded = python(code).split()
    assert not {name.split(".")[0] for name in loaded} & set(HEAVY)
    assert [name for name in loaded if name.startswith("photoclinometry")] == ["photoclinometry"]


def test_errors_can_be_named_without_loading_anything_slow():
    loaded = python("import sys, photoclinometry; photoclinometry.InputError; print(' '.join(sys.modules))").split()
    assert not {name.split(".")[0] for name in loaded} & {"numba", "scipy", "h5py", "pycolmap", "matplotlib"}


def test_functions_are_not_hidden_by_packages_of_the_same_name():
    """Importing a subpackage sets it as an attribute of its parent: `adjust`, `evaluate` and `simulate` must stay."""
    code = """
import photoclinometry.adjust.options, photoclinometry.evaluate.tables, photoclinometry.simulate.presets
import photoclinometry as pcm
from photoclinometry import adjust
from photoclinometry.adjust import AdjustOptions
from photoclinometry.simulate import presets
assert adjust is pcm.adjust
print(*(type(f).__name__ for f in (pcm.adjust, pcm.evaluate, pcm.simulate)), pcm.io.__name__)
"""
    assert python(code) == "function function function photoclinometry.io"


def test_names_are_all_there_and_no_others():
    assert set(pcm.__all__) <= set(dir(pcm))
    assert sorted(pcm.__all__) == sorted({*FUNCTIONS, *CLASSES})
    with pytest.raises(AttributeError, match="no attribute 'fly'"):
        _ = pcm.fly  # type: ignore[attr-defined]


def test_checkers_see_the_names_that_users_get():
    """The imports under TYPE_CHECKING name `__all__`, each from where it comes at run time."""
    tree = ast.parse(Path(pcm.__file__).read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {a.name: str(n.module) for n in guarded.body if isinstance(n, ast.ImportFrom) for a in n.names}
    assert sorted(seen) == sorted(pcm.__all__)
    for name, module in seen.items():
        assert getattr(sys.modules[module], name) is getattr(pcm, name)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_signatures_are_annotated_and_optional_arguments_go_by_keyword(name):
    function = getattr(pcm, name)
    hints = typing.get_type_hints(function)
    parameters = inspect.signature(function).parameters.values()
    assert set(hints) == {p.name for p in parameters} | {"return"}
    for p in parameters:
        assert p.default is p.empty or p.kind is p.KEYWORD_ONLY, p
        if any(word in p.name for word in ("path", "out", "site", "truth", "cameras")):
            assert {str, Path} <= set(typing.get_args(hints[p.name])), p


@pytest.mark.parametrize("name", FUNCTIONS)
def test_docstrings_name_every_argument_the_result_and_the_errors(name):
    function = getattr(pcm, name)
    text = inspect.getdoc(function)
    assert text is not None
    summary, *_ = text.splitlines()
    assert summary.endswith(".")
    parameters = inspect.signature(function).parameters.values()
    stars = {inspect.Parameter.VAR_KEYWORD: "**"}
    if parameters:
        described = text.split("\nArgs:\n")[1]
        assert all(f"    {stars.get(p.kind, '')}{p.name}: " in described for p in parameters)
    assert ("\nReturns:\n" in text) == (function.__annotations__["return"] != "None")
    assert "\nRaises:\n" in text or not parameters


@pytest.mark.parametrize("name", CLASSES)
def test_classes_are_documented_and_options_go_by_keyword(name):
    cls = getattr(pcm, name)
    assert cls.__doc__
    assert not cls.__doc__.startswith(f"{name}(")  # what dataclasses write where there is none
    if is_dataclass(cls):
        assert set(typing.get_type_hints(cls)) >= {f.name for f in fields(cls)}
        assert all(f.kw_only for f in fields(cls)) or not name.endswith("Options")


def test_errors_are_one_tree_and_built_ins():
    for error, builtin in ((pcm.InputError, ValueError), (pcm.ReconstructionError, RuntimeError)):
        assert {pcm.PhotoclinometryError, builtin} <= set(error.__mro__)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reflectence": "mcewen"}, "RunOptions has no option 'reflectence'; the nearest is 'reflectance'"),
        ({"reflectance": "lambert"}, "reflectance='lambert': must be one of 'auto'"),
        ({"matcher": "flo"}, "no matcher 'flo'; known: relight, flow, roma"),
        ({"reflectance": "mcewan"}, "reflectance='mcewan': must be one of"),
        ({"options": pcm.RunOptions(reflectance="mcewan")}, "reflectance='mcewan': must be one of"),  # type: ignore[arg-type]
    ],
)
def test_options_that_there_are_not_are_refused_before_anything_is_done(tmp_path, changes, message):
    with pytest.raises(pcm.InputError, match=message):
        pcm.run(tmp_path / "site.toml", tmp_path / "run", **changes)
    assert not (tmp_path / "run").exists()


def test_a_site_is_simulated_and_read(tmp_path):
    told = []
    site = pcm.simulate(
        "demo", str(tmp_path / "site"), views=3, image_size=48, progress=lambda *said: told.append(said)
    )
    assert site == tmp_path / "site" / "site.toml"
    assert len(pcm.read_site(str(site)).views) == 3
    assert ("images", 1, 3) in told
    with pytest.raises(pcm.InputError, match="no preset"):
        pcm.simulate("moon", tmp_path / "moon")


def test_run_takes_strings_and_fields_of_its_options(monkeypatch, tmp_path):
    """Fields given by name replace those of the options; everything arrives at the pipeline as it expects it."""
    given = []
    monkeypatch.setattr("photoclinometry.api.maps._run", lambda *arguments: given.extend(arguments))
    options = pcm.RunOptions(matcher="flow", hold_out=("a",))
    pcm.run(str(tmp_path / "site.toml"), str(tmp_path / "run"), options=options, reflectance="mcewen")
    assert given[:2] == [tmp_path / "site.toml", tmp_path / "run"]
    assert given[2] == replace(options, reflectance="mcewen")


def test_a_scene_is_written_and_read(tmp_path):
    scene = synthetic_scene(size=8, views=3)
    pcm.write_scene(str(tmp_path / "run" / "scene.h5"), scene)
    for path in (tmp_path / "run", str(tmp_path / "run" / "scene.h5")):
        np.testing.assert_array_equal(pcm.read_scene(path).landmarks.position, scene.landmarks.position)
    with pytest.raises(pcm.InputError, match="no such folder"):
        pcm.read_scene(tmp_path / "nowhere")


def test_adjust_takes_options_by_name():
    scene = synthetic_scene(size=8, views=4)
    adjustment = pcm.adjust(scene, uncertainty=False, max_reweightings=1)
    assert adjustment.converged
    assert not adjustment.scene.uncertainty
    with pytest.raises(pcm.InputError, match="AdjustOptions has no option 'max_round'"):
        pcm.adjust(scene, max_round=1)


def test_render_is_the_view_under_any_sun():
    scene = synthetic_scene(size=16, views=3)
    image = pcm.render(scene, view="002")
    expected, there = render_view(scene, 2)
    assert image.name == "images/002.fits"
    np.testing.assert_array_equal(image.valid, there)
    np.testing.assert_allclose(image.brightness, expected, rtol=1e-6)
    relit = pcm.render(scene, view="002", sun=[0, 0, 2])
    overhead = pcm.render(scene, view="002", sun=scene.views.sun[2] * 0 + [0, 0, 1])
    np.testing.assert_array_equal(relit.brightness, overhead.brightness)
    assert pcm.render(scene, geometry="reference").valid.shape == (16, 16)
    mistakes: list[dict[str, Any]]
    mistakes = [{"geometry": "map"}, {"sun": [1.0, 0.0]}, {"sun_azimuth_deg": 10.0}, {"view": "9"}]
    for wrong in mistakes:
        with pytest.raises(pcm.InputError):
            pcm.render(scene, **wrong)


def test_evaluate_a_result_its_folder_and_its_scene(mapped):
    """The same figures from each; those of images only where a site is known."""
    kinds = (mapped.result, str(mapped.run), mapped.run / "scene.h5", mapped.result.scene)
    of_result, of_folder, of_file, of_scene = (pcm.evaluate(kind, truth=mapped.truth) for kind in kinds)
    assert of_result.metrics == of_folder.metrics == of_file.metrics
    assert of_result.metrics["surface_distance_mean_gsd"] < 0.2
    assert of_result.metrics["psnr_mean_db"] == pytest.approx(mapped.result.metrics["psnr_mean_db"])
    assert "psnr_mean_db" not in of_scene.metrics
    shared = of_scene.metrics.keys() & of_result.metrics.keys()
    assert {k: of_scene.metrics[k] for k in shared} == {k: of_result.metrics[k] for k in shared}
    assert "PSNR" in str(of_result)
    assert of_result.comparison is not None
    assert len(of_result.comparison.errors["normal_error_deg"]) == len(mapped.result.scene.landmarks)


def test_a_run_is_rendered_exported_and_estimated_by_its_folder(mapped, tmp_path):
    given = pcm.render(mapped.run)
    np.testing.assert_array_equal(given.brightness, pcm.render(mapped.result.scene).brightness)
    assert "landmarks.ply" in pcm.export(mapped.result, tmp_path / "ply", products="ply")
    found = pcm.adjust(mapped.run, max_reweightings=1, uncertainty=False, solver=SolverOptions(max_steps=1))
    assert len(found.scene.landmarks) == len(mapped.result.scene.landmarks)


def test_evaluate_against_a_scene_finds_no_difference_from_itself():
    scene = synthetic_scene(size=12, views=4)
    found = pcm.evaluate(scene, reference=scene)
    assert found.metrics["surface_distance_rms_m"] < 1e-6
    assert found.metres_from_scene is not None
    np.testing.assert_allclose(found.metres_from_scene.scale, 1.0, rtol=1e-9)


def test_evaluate_compares_with_one_thing_at_a_time(mapped):
    with pytest.raises(pcm.InputError, match="one at a time"):
        pcm.evaluate(mapped.run, truth=mapped.truth, reference=mapped.run)
    with pytest.raises(pcm.InputError, match="give the reference too"):
        pcm.evaluate(mapped.run, cameras=mapped.run / "sparse")


def test_export_writes_the_products_asked_for(tmp_path):
    scene = synthetic_scene(size=8, views=3)
    assert "landmarks.ply" in pcm.export(scene, str(tmp_path / "one"), products="ply")
    pcm.export(scene, tmp_path / "two", products=["ply", "csv"], unit_m=1.0)
    about = json.loads((tmp_path / "two" / "export.json").read_text())
    assert about["options"]["unit_m"] == 1.0
    assert "landmarks.csv" in about["files"]
    assert b"comment unit of length: m\n" in (tmp_path / "two" / "landmarks.ply").read_bytes()
    assert b"comment unit of length: as the scene\n" in (tmp_path / "one" / "landmarks.ply").read_bytes()
    with pytest.raises(pcm.InputError, match="products='dxf': must be one of 'dtm'"):
        pcm.export(scene, tmp_path / "three", products="dxf")


def test_every_named_reflectance_model_is_found(mapped):
    assert "mcewen" in pcm.reflectance_models()
    for name in pcm.reflectance_models():
        rho = pcm.reflectance(name, body="vesta")(np.ones(1), np.ones(1), np.zeros(1))
        np.testing.assert_allclose(rho, 1.0)
    with pytest.raises(pcm.InputError, match="no reflectance model"):
        pcm.reflectance("lambert")


def test_truth_is_read_from_a_string(mapped):
    assert read_truth(str(mapped.truth)).name == "demo"
