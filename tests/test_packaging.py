"""What the package says of itself: versions agree, the text for the package index stands alone, nothing is missing."""

import re
import tomllib
from pathlib import Path

import pytest

import photoclinometry

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CONDA_NAMES = {"opencv-python-headless": "py-opencv", "matplotlib": "matplotlib-base", "astropy": "astropy-base"}
"""Names of packages in conda-forge that differ from those of PyPI."""
SYSTEMS = {"ubuntu": "POSIX :: Linux", "macos": "MacOS", "windows": "Microsoft :: Windows"}
"""Of the runners of the public CI, as the package index calls them."""


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_version_is_one():
    """pyproject.toml, the package, CITATION.cff, the conda recipe, and the topmost version of the changelog."""
    version = PROJECT["version"]
    assert photoclinometry.__version__ == version
    assert re.findall(r"^version: (.+)$", text("CITATION.cff"), re.M) == [version]
    assert re.findall(r'set version = "(.+)"', text("recipe/meta.yaml")) == [version]
    headings = re.findall(r"^## (.+)$", text("CHANGELOG.md"), re.M)
    numbers = [heading.split()[0] for heading in headings if heading[0].isdigit()]
    assert numbers[0] == version
    assert headings[0] in ("Unreleased", *(h for h in headings if h.startswith(version)))


def test_every_version_of_the_changelog_names_its_tag():
    for heading in re.findall(r"^## (\d.*)$", text("CHANGELOG.md"), re.M):
        assert f"`v{heading.split()[0]}`" in heading


def test_the_citation_has_the_date_of_the_newest_version_once_it_has_one():
    newest = next(heading for heading in re.findall(r"^## (.+)$", text("CHANGELOG.md"), re.M) if heading[0].isdigit())
    dates = re.findall(r"\d{4}-\d{2}-\d{2}", newest)
    assert dates or "not yet tagged" in newest
    assert re.findall(r"^date-released: [\"']?([\d-]+)", text("CITATION.cff"), re.M) == dates


def test_licence_and_authors_are_the_same_everywhere():
    assert PROJECT["license"] == "Apache-2.0"
    assert text("LICENSE").lstrip().startswith("Apache License")
    assert re.findall(r"^license: (.+)$", text("CITATION.cff"), re.M) == ["Apache-2.0"]
    assert "license: Apache-2.0" in text("recipe/meta.yaml")
    assert [author["name"] for author in PROJECT["authors"]] == ["The photoclinometry authors"]
    assert '- name: "The photoclinometry authors"' in text("CITATION.cff")


def test_the_text_for_the_package_index_needs_no_repository():
    """An index shows it without the files beside it: links and pictures are whole addresses."""
    targets = re.findall(r"\]\(([^)]+)\)", text(PROJECT["readme"]))
    assert targets
    assert all(target.startswith("https://") for target in targets)
    assert all(url.startswith("https://") for url in PROJECT["urls"].values())


def test_types_are_shipped():
    assert (ROOT / "src" / "photoclinometry" / "py.typed").is_file()
    settings = tomllib.loads(text("pyproject.toml"))["tool"]["setuptools"]["package-data"]
    assert "py.typed" in settings["photoclinometry"]
    assert "Typing :: Typed" in PROJECT["classifiers"]


def test_the_source_distribution_has_what_a_checkout_has():
    stated = text("MANIFEST.in")
    for name in ("constraints.txt", "CHANGELOG.md", "CITATION.cff", "DESIGN.md", "Makefile"):
        assert name in stated
    for folder in ("docs", "examples", "tests", "benchmarks", ".ci", ".github", "recipe"):
        assert f"graft {folder}\n" in stated
        assert (ROOT / folder).is_dir()


def test_the_conda_recipe_asks_for_what_the_package_does():
    recipe = text("recipe/meta.yaml")
    for requirement in PROJECT["dependencies"]:
        name, least = requirement.split(">=")
        assert f"    - {CONDA_NAMES.get(name, name)} >={least}\n" in recipe
    for program, entry in PROJECT["scripts"].items():
        assert f"- {program} = {entry}" in recipe


@pytest.mark.parametrize("system", ["ubuntu", "macos", "windows"])
def test_public_ci_runs_what_ours_runs_on_every_system_and_python(system):
    workflow = text(".github/workflows/ci.yml")
    assert f"{system}-" in workflow
    assert any(f"Operating System :: {SYSTEMS[system]}" in name for name in PROJECT["classifiers"])
    named = {name.rpartition(" ")[2] for name in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", name)}
    assert set(re.search(r"python: \[(.*)\]", workflow)[1].replace('"', "").split(", ")) == named
    assert "run: .ci/run\n" in workflow
    commands = ("ruff check .", "ruff format --check .", "basedpyright", "pytest")
    assert all(
        command in workflow and f"/{command}" in text("Makefile").replace("/python -m ", "/") for command in commands
    )
    assert not re.search(r"index-url|https?://", workflow)
