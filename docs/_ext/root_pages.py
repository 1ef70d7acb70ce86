"""README, DESIGN and CONTRIBUTING as pages, with links to and from the pages in docs/."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
PAGES = {"README": "readme", "DESIGN": "design", "CONTRIBUTING": "contributing"}


def write_pages(app: Any = None) -> None:
    """Writes about/, which is not kept in the repository."""
    folder = DOCS / "about"
    folder.mkdir(exist_ok=True)
    for name, page in PAGES.items():
        text = from_root((ROOT / f"{name}.md").read_text(encoding="utf-8"))
        file = folder / f"{page}.md"
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def from_root(text: str) -> str:
    """Links of a file in the repository's root as links of a page in about/."""
    for name, page in PAGES.items():
        text = text.replace(f"]({name}.md", f"]({page}.md")
    text = text.replace("](examples)", "](../gallery/index.rst)")
    text = re.sub(r"\]\(docs/([^)#]*/)?(\w+)\)", r"](../\1\2/index.md)", text)
    text = text.replace("](docs/", "](../")
    return re.sub(r"\[([^\]]*)\]\((?:LICENSE|CITATION\.cff)\)", r"\1", text)


def to_about(app: Any, name: str, content: list[str]) -> None:
    """Links of a page to a file in the repository's root, or to an example, lead to its page."""
    names = "|".join(PAGES)
    link = rf"\]\(((?:\.\./)*)\.\./({names})\.md"
    text = re.sub(link, lambda m: f"]({m[1]}about/{PAGES[m[2]]}.md", content[0])
    text = re.sub(r"\]\(((?:\.\./)*)\.\./examples/(\w+)\.py\)", r"](\1gallery/\2.rst)", text)
    content[0] = re.sub(r"\]\(((?:\.\./)*)\.\./examples\)", r"](\1gallery/index.rst)", text)


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write_pages)
    app.connect("source-read", to_about)
    return {"parallel_read_safe": True}
