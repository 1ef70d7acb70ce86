"""One page for each package, generated from the docstrings of its modules.

Docstrings here are plain text: paragraphs, indented blocks that are shown as they are, `code` between single backticks.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.ext.napoleon import Config, GoogleDocstring

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "photoclinometry"
FOLDER = Path(__file__).parents[1] / "reference" / "modules"


def packages() -> list[tuple[str, str]]:
    """Packages in the order of DESIGN.md's table, with what each holds."""
    layout = (ROOT / "DESIGN.md").read_text(encoding="utf-8").split("## Layout\n")[1].split("\n## ")[0]
    return re.findall(r"^\| `(\w+)` \| (.*?) \|$", layout, flags=re.MULTILINE)


def write_pages(app: Any = None) -> None:
    """Writes reference/modules/, which is not kept in the repository."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = packages()
    lines = ["# Modules", "", "By package, from the one that imports no other down.", ""]
    lines += [f"- [`{name}`]({name}.md): {holds}" for name, holds in found]
    pages = {"index": "\n".join([*lines, "", "```{toctree}", ":hidden:", "", *(name for name, _ in found), "```", ""])}
    for name, holds in found:
        pages[name] = "\n".join([f"# `{name}`", "", f"{holds[0].upper()}{holds[1:]}.", "", *_modules(name)])
    for name, text in pages.items():
        file = FOLDER / f"{name}.md"
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def _modules(package: str) -> list[str]:
    lines = []
    for file in sorted((SOURCE / package).rglob("*.py")):
        if file.name == "__init__.py" or file.name == "__main__.py":
            continue
        dotted = ".".join(file.relative_to(SOURCE.parent).with_suffix("").parts)
        lines += [f"## `{dotted.removeprefix('photoclinometry.')}`", "", "```{eval-rst}"]
        lines += [f".. automodule:: {dotted}", "   :members:", "```", ""]
    return lines


def as_rst(lines: list[str]) -> list[str]:
    """A plain docstring as reStructuredText that shows it as it is: no mark in it is taken for markup."""
    out: list[str] = []
    block = False
    for line in lines:
        indented = line.startswith("    ")
        if indented and not block:
            out += ["", "::", ""]
        elif block and line.strip() and not indented:
            out.append("")
        block = indented or (block and not line.strip())
        out.append(line if indented or not line.strip() else _inline(line))
    return out


def _inline(line: str) -> str:
    """A line of text: `code` as code, a hyphen that begins a list stays, other marks are escaped."""
    parts = re.split(r"(`[^`]+`)", line)
    return "".join(_code(p) if p.startswith("`") and p.strip("` ") else _escaped(p) for p in parts)


def _code(text: str) -> str:
    return f"``{text.strip('`').strip()}``"


def _escaped(text: str) -> str:
    return re.sub(r"([\\*`|_])", r"\\\1", text)


def process(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings with sections (Args, Returns, Raises) become field lists; all others are plain text."""
    if "Args:" not in lines and "Raises:" not in lines:
        lines[:] = as_rst(lines)
        return
    sections = GoogleDocstring(lines, Config(napoleon_numpy_docstring=False), app, what, name, obj, options)
    text = "\n".join(sections.lines())
    # "Returns: The scene: every value" is a sentence here; napoleon takes what precedes a colon for a type.
    text = re.sub(r":returns: (.*?)\n:rtype: ([^\n]*)$", r":returns: \2: \1", text, flags=re.MULTILINE | re.DOTALL)
    lines[:] = re.sub(r"(?<![`:\w])`([^`]+)`(?!`)", r"``\1``", text).split("\n")


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write_pages)
    app.connect("autodoc-process-docstring", process, priority=900)
    return {"parallel_read_safe": True}
