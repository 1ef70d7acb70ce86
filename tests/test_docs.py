"""Commands in the documentation parse, links resolve, named files exist, examples compile."""

import functools
import re
import shlex
from pathlib import Path

import pytest

from photoclinometry.cli.arguments import command_named
from photoclinometry.model.errors import InputError
from run_documents import code_blocks

ROOT = Path(__file__).parents[1]
ROOT_PAGES = [ROOT / name for name in ("README.md", "PACKAGE.md", "DESIGN.md", "CONTRIBUTING.md")]
GENERATED = ("about", "gallery", "generated", "cli", "modules")
PAGES = ROOT_PAGES + [
    page
    for page in sorted((ROOT / "docs").rglob("*.md"))
    if not set(page.relative_to(ROOT / "docs").parent.parts) & set(GENERATED)
]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def commands_of(page: Path) -> list[str]:
    """Lines of code blocks that call `phomo`, continued lines joined, comments taken off."""
    lines = "\n".join(block for _, block in code_blocks(page)).replace("\\\n", " ").splitlines()
    return [re.split(r" [#>|]", line)[0].strip() for line in lines if line.startswith("phomo ")]


def parse(name: str, *words: str) -> None:
    """Parses the words after `phomo NAME` as that command does, and does nothing.

    Raises InputError where there is no such command; SystemExit where it does not take the words.
    """
    import tyro

    command = command_named(name)
    tyro.cli(functools.wraps(command)(lambda *_, **__: None), prog=f"phomo {name}", args=words)


COMMANDS = sorted({(name_of(page), command) for page in PAGES for command in commands_of(page)})


def test_there_are_commands_to_check():
    assert len(COMMANDS) > 50


@pytest.mark.parametrize("page", sorted({page for page, _ in COMMANDS}))
def test_commands_in_the_pages_parse(page):
    """Options exist and have values that they take. What stands for something (NAME, ...) is left as it is."""
    for command in (command for where, command in COMMANDS if where == page):
        if "..." in command or "COMMAND" in command or "[--" in command or "--tyro-print-completion" in command:
            continue
        try:
            parse(*shlex.split(command)[1:])
        except SystemExit as stop:
            pytest.fail(f"{page}: `{command}` is refused with exit code {stop.code}")


@pytest.mark.parametrize("words", ["--no-such-option 1", "--matcher nobody", "--region.stride many", ""])
def test_words_that_a_command_does_not_take_are_refused(words):
    """As misspelt in a page: an option that there is not, values that it does not take, and no site."""
    parse("run", "site.toml", "--out", "run", "--matcher", "flow")
    site = ["site.toml"] if words else []
    with pytest.raises((SystemExit, InputError)):
        parse("run", *site, "--out", "run", *words.split())


def test_a_command_that_there_is_not_is_refused():
    with pytest.raises(InputError, match="there is no command 'rum'"):
        parse("rum", "site.toml")


OPTION_NAMES = set(
    re.findall(
        r"\b(\w+):",
        "".join(file.read_text(encoding="utf-8") for file in (ROOT / "src" / "photoclinometry").rglob("*.py")),
    )
)
OF_OTHER_PROGRAMS = {"--sshlogin", "--tyro-print-completion"}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_options_that_sentences_name_exist(page):
    """`--plan.max-views` in backticks ends in a field or parameter of the package; `no-` turns one off."""
    text = re.sub(r"^```.*?^```|^    .*$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    named = set(re.findall(r"`(--[a-z][\w.-]*\w)", text)) - OF_OTHER_PROGRAMS
    last = {option: option.removeprefix("--").rpartition(".")[2].replace("-", "_") for option in named}
    assert {o for o, name in last.items() if not {name, name.removeprefix("no_")} & OPTION_NAMES} == set()


def test_the_page_of_the_python_interface_has_every_name():
    import photoclinometry as pcm

    page = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    named = re.findall(r"^\.\. auto(?:function|class|exception):: (\w+)$", page, flags=re.MULTILINE)
    assert sorted(named) == sorted(pcm.__all__)


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and MyST make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.replace("`", "")).lower().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_between_pages_resolve(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(
        r"\]\(([^)\s]+)\)", re.sub(r"^```.*?^```|^    .*$", "", text, flags=re.MULTILINE | re.DOTALL)
    ):
        if re.match(r"https?:", target):
            continue
        path, _, anchor = target.partition("#")
        if set(path.split("/")) & {"gallery", "cli", "modules"}:
            continue  # made by `make docs`, which checks these links
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{name_of(page)}: {target} is not there"
        if anchor:
            assert anchor in anchors(file), f"{name_of(page)}: {target} has no such heading"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_that_pages_name_exist(page):
    """`package/file.py` in backticks is a file of the package, of the tests, or of the benchmarks."""
    named = re.findall(r"`(?:python )?([\w/]+/\w+\.py)\b", page.read_text(encoding="utf-8"))
    missing = [n for n in named if not ((ROOT / n).is_file() or (ROOT / "src" / "photoclinometry" / n).is_file())]
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_tests_that_pages_name_exist(page):
    named = set(re.findall(r"`(test_\w+)`", page.read_text(encoding="utf-8")))
    suite = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "tests").glob("test_*.py"))
    assert {name for name in named if f"def {name}(" not in suite} == set()


def test_every_page_is_in_a_table_of_contents():
    listed = set()
    for index in (ROOT / "docs").rglob("*.md"):
        for tree in re.findall(
            r"^```\{toctree\}\n(.*?)^```", index.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
        ):
            entries = [line for line in tree.splitlines() if line and not line.startswith(":")]
            listed |= {page for entry in entries for page in index.parent.glob(f"{entry}.md") if "*" in entry}
            listed |= {(index.parent / f"{entry}.md").resolve() for entry in entries}
    assert set(PAGES) - set(ROOT_PAGES) - listed == {ROOT / "docs" / "index.md"}


@pytest.mark.parametrize("example", EXAMPLES, ids=name_of)
def test_examples_compile_and_tell_a_story(example):
    """`make docs` runs them."""
    text = example.read_text(encoding="utf-8")
    compile(text, str(example), "exec")
    title, underline, *_ = text.removeprefix('"""\n').splitlines()
    assert underline == "=" * len(title)
    assert len(text.splitlines()) <= 80


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_python_in_the_pages_compiles(page):
    for block in re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL):
        compile(block, name_of(page), "exec")


def test_site_toml_in_the_pages_is_read(tmp_path):
    """Every whole site.toml of the pages is one."""
    from photoclinometry.io.site import read_site

    blocks = [block for page in PAGES for block in re.findall(r"^```toml\n(.*?)^```", page.read_text(), re.M | re.S)]
    sites = [block for block in blocks if "[[views]]" in block]
    assert len(sites) >= 2
    for number, site in enumerate(sites):
        file = tmp_path / f"{number}.toml"
        file.write_text(site, encoding="utf-8")
        assert len(read_site(file).views) >= 3


def test_readme_and_design_are_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 200
    assert len((ROOT / "DESIGN.md").read_text(encoding="utf-8").split()) <= 2500


def test_the_cost_of_the_readmes_maps_is_stated_once():
    """The table has it; what is said beside a command must agree, and other pages link."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    times = re.search(r"^\| CPU time \[s\].*\| ([\d,]+); [\d.]+ \| ([\d,]+); [\d.]+ \|$", readme, re.MULTILINE)
    assert times
    assert set(re.findall(r"([\d,]+) CPU seconds", readme)) <= set(times.groups())
    assert "CPU seconds" not in (ROOT / "PACKAGE.md").read_text(encoding="utf-8")
    for page in ("docs/howto/symptoms.md", "docs/tutorial/first-map.md", "docs/reference/index.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        assert not re.search(r"\| 25,600|compiles? [^.]*\bminutes|\b\d+ (faults|messages)\b", text), page
