"""One page for each command of `phomo`, generated from the commands' own parsers."""

from __future__ import annotations

import importlib
import pkgutil
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "reference" / "cli"
ORDER = ["simulate", "info", "run", "body", "view", "evaluate", "render", "figure", "export"]
ORDER += ["ingest", "calibrate", "views", "plan", "refine", "fetch", "study", "rivals"]


def commands() -> dict[str, Callable[..., Any]]:
    """Every command by its name: a module of `photoclinometry.cli` with a function of the same name is one."""
    import photoclinometry.cli as cli

    found = {}
    for module in pkgutil.iter_modules(cli.__path__):
        function = getattr(importlib.import_module(f"photoclinometry.cli.{module.name}"), module.name, None)
        if callable(function):
            found[module.name] = function
    return dict(sorted(found.items(), key=lambda item: ORDER.index(item[0]) if item[0] in ORDER else len(ORDER)))


def page(name: str, command: Callable[..., Any]) -> str:
    """A command's page in Markdown: what it does, and every option with its values and its default."""
    import tyro

    from photoclinometry.cli.arguments import registry_with

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        parser = tyro.extras.get_parser(command, prog=f"phomo {name}", registry=registry_with())
    lines = [f"# phomo {name}", "", _escaped(parser.description or ""), ""]
    for group in parser._action_groups:
        actions = [action for action in group._group_actions if action.dest != "help"]
        if not actions:
            continue
        lines += [f"## {_heading(group.title or 'options')}", ""]
        if group.description:
            lines += [_escaped(group.description), ""]
        for action in actions:
            lines += _definition(action)
    return "\n".join(lines) + "\n"


def _heading(title: str) -> str:
    """A heading for a group of options: nested ones share a prefix."""
    plain = {"options": "Options", "positional arguments": "Arguments"}
    return plain.get(title) or f"`--{title.removesuffix(' options')}`"


def _definition(action: Any) -> list[str]:
    """An option as an item of a definition list."""
    values = re.sub(r"\{None\}\|", "", str(action.metavar or ""))
    names = [f"{option} {values}".strip() for option in action.option_strings] or [values]
    parts = re.fullmatch(r"(.*?)\s*(?:\((required|default: .*)\))?", action.help or "", flags=re.DOTALL)
    text, default = parts.groups() if parts else ("", None)
    about = " ".join(_escaped(text).split())
    closing = {None: "", "required": " *Required.*"}.get(default, f" Default: `{(default or '')[9:] or 'none'}`.")
    return [", ".join(f"`{each}`" for each in names), f": {about}{closing}", ""]


def _escaped(text: str) -> str:
    """Text for Markdown: what stands between backticks as it is, other marks as themselves."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([\\*_<>\[\]#|])", r"\\\1", part) for part in parts)


def write_pages(app: Any = None) -> None:
    """Writes reference/cli/, which is not kept in the repository."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = commands()
    intro = "Each page is generated from the command itself; `phomo COMMAND --help-all` prints the same."
    table = [f"- [`phomo {name}`]({name}.md): {_first_line(command)}" for name, command in found.items()]
    tree = ["```{toctree}", ":hidden:", "", *found, "faults", "```"]  # faults_reference.py writes the last
    pages = {"index": "\n".join(["# Commands", "", intro, "", *table, "", *tree]) + "\n"}
    pages |= {name: page(name, command) for name, command in found.items()}
    for name, text in pages.items():
        file = FOLDER / f"{name}.md"
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def _first_line(command: Callable[..., Any]) -> str:
    return " ".join((command.__doc__ or "").split("\n\n")[0].split())


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
