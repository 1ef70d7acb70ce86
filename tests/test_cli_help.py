"""What `phomo` says of itself: short and full help, version, completion, presets, and hints at what was misspelt."""

import contextlib
import functools
import io
import re
import subprocess
from dataclasses import replace

import pytest

import photoclinometry as pcm
from commands import phomo
from photoclinometry.cli.arguments import COMMANDS, command_named, first_clause, option_fields
from photoclinometry.cli.first_options import FIRST
from photoclinometry.cli.run import prepared
from photoclinometry.cli.site_path import site_file
from photoclinometry.model.errors import InputError
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.presets import PRESETS, preset


def said(capsys, *arguments) -> str:
    """What a command prints on standard output, with exit code 0."""
    assert phomo(*arguments) == 0
    return capsys.readouterr().out


@pytest.fixture(autouse=True)
def narrow(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")


@pytest.fixture(scope="module")
def help_of():
    """The help of a command by its name and "--help" or "--help-all", in 80 columns, drawn once."""

    @functools.cache
    def of(command: str, option: str = "--help") -> str:
        with contextlib.redirect_stdout(io.StringIO()) as text:
            assert phomo(command, option) == 0
        return text.getvalue()

    return of


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command_fits_a_screen(command, help_of):
    lines = help_of(command).splitlines()
    assert 5 < len(lines) <= 60
    if command in FIRST:
        assert f"`phomo {command} --help-all`" in " ".join(lines)


@pytest.mark.parametrize("command", FIRST)
def test_help_shows_the_first_options_and_help_all_shows_every_one(command, help_of):
    options = {f"--{name.replace('_', '-')}" for name, _, _ in option_fields(command_named(command))}
    first = {f"--{name.replace('_', '-')}" for name in FIRST[command]}

    def shown(text: str) -> set[str]:
        return options & set(re.findall(r"^[│| ]{1,4}(--[\w.-]+)", text, flags=re.MULTILINE))

    assert shown(help_of(command)) == first <= options
    assert shown(help_of(command, "--help-all")) == options


def test_the_list_of_commands_has_one_line_each(capsys):
    text = said(capsys, "--help")
    for name, about in COMMANDS.items():
        assert re.search(rf"^\W*{name} +{re.escape(about)}\W*$", text, flags=re.MULTILINE)
    assert len(text.splitlines()) < 40


@pytest.mark.parametrize("option", ["--help", "--help-all"])
@pytest.mark.parametrize("command", COMMANDS)
def test_sentences_of_help_are_whole(command, option, help_of):
    text = " ".join(help_of(command, option).replace("│", " ").split())
    assert not re.search(r"[;,:] (Range: [^.]*\. )?\((default|required)", text)
    assert not re.search(r"[;,:(] Range:", text)
    open_brackets = 0
    for part in re.split(r"(?=╭─)|(?<=\))", text):
        open_brackets += part.count("(") - part.count(")")
        assert 0 <= open_brackets <= 2, part
    assert open_brackets == 0


def test_a_clause_ends_outside_of_brackets():
    assert first_clause("Range [degrees]: moderate (25; 30 to 60. Or so), strong. More.") == (
        "Range [degrees]: moderate (25; 30 to 60. Or so), strong."
    )
    assert first_clause("Size [px]; by\n   default the preset's.") == "Size [px]."
    assert first_clause("Sigma 0.1 px") == "Sigma 0.1 px"
    assert first_clause("") == ""


def test_help_says_the_range_of_a_number(help_of):
    assert "Range: 1 to 65535. (default: 1)" in " ".join(help_of("run").replace("│", " ").split())
    full = " ".join(help_of("run", "--help-all").replace("│", " ").split())
    assert "inf for least squares. Range: above 0, or inf. (default: 3.0)" in full


@pytest.mark.parametrize("command", COMMANDS)
def test_help_says_the_range_of_every_number(command, help_of):
    """Of options of a command's own, too, which are no fields of options."""
    text = "\n".join(line.strip("│| ") for line in help_of(command, "--help-all").splitlines())
    options = re.split(r"\n(?=--)", text)[1:]
    numbers = [option for option in options if re.match(r"--[\w.-]+ .*\b(INT|FLOAT|LON)\b", option)]
    assert numbers or command in {"evaluate", "info", "view", "fetch"}
    assert [option for option in numbers if "Range:" not in option] == []


def test_the_version_is_printed(capsys):
    assert said(capsys, "--version") == f"phomo {pcm.__version__}\n"


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion_is_a_script_that_knows_commands_and_options(shell, capsys):
    script = said(capsys, "--tyro-print-completion", shell)
    assert "simulate" in script
    assert "smooth-sigma-rad" in script


def test_the_script_for_bash_is_one_that_bash_takes(capsys, tmp_path):
    file = tmp_path / "phomo"
    file.write_text(said(capsys, "--tyro-print-completion", "bash"))
    subprocess.run(["bash", "-n", str(file)], check=True)


def test_presets_set_what_they_say_and_other_options_go_before_them(monkeypatch, mapped, tmp_path):
    quick = preset("quick")
    assert (quick.region.stride, quick.relight.iterations, quick.adjust.uncertainty) == (2, 1, False)
    assert quick.sfm == RunOptions().sfm
    seen = {}

    def library(site, out, options, *rest):
        seen.update(site=site, out=out, options=options)
        raise InputError("seen")

    monkeypatch.setattr("photoclinometry.pipeline.run.run", library)
    assert phomo("run", mapped.site, "--preset", "quick", "--region.stride", 3, "--out", tmp_path / "run") == 2
    assert seen["options"] == replace(quick, region=replace(quick.region, stride=3))
    assert prepared(["a.toml", "--preset=best"]).__signature__.parameters["options"].default == preset("best")  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_changes_options_that_exist(name):
    assert preset(name) != RunOptions()
    known = {option for option, _, _ in option_fields(command_named("run"))}
    assert set(PRESETS[name].values) <= known


def test_a_preset_that_is_none_is_answered_by_the_nearest():
    with pytest.raises(InputError, match="known: few-views, uncalibrated, quick, best; nearest: best"):
        pcm.preset("bset")


def test_run_takes_a_folder_with_a_site(tmp_path):
    (tmp_path / "site.toml").write_text("")
    assert site_file(tmp_path) == tmp_path / "site.toml" == site_file(tmp_path / "site.toml")
