"""The page of a report: static HTML with its style inside and its figures beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from photoclinometry import __version__
from photoclinometry.evaluate.tables import metric_rows, number, split_unit, words
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.output.report.first_screen import STYLE as FIRST_SCREEN

STYLE = """
:root { --ink: #1c2430; --soft: #5b6675; --line: #dfe3e8; --back: #f6f7f9; --accent: #1f4e79; }
* { box-sizing: border-box; }
body { margin: 0; color: var(--ink); background: var(--back);
       font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
header { background: var(--ink); color: white; padding: 16px 0 14px; }
header h1 { margin: 0; font-size: 26px; font-weight: 600; }
header p { margin: 4px 0 0; color: #b9c3d0; }
nav { position: sticky; top: 0; z-index: 1; background: white; border-bottom: 1px solid var(--line); }
nav a { display: inline-block; padding: 10px 14px 10px 0; color: var(--accent); text-decoration: none; }
nav a:hover { text-decoration: underline; }
.wrap { max-width: 1240px; margin: 0 auto; padding: 0 24px; }
section { padding: 16px 0 6px; }
h2 { font-size: 19px; font-weight: 600; margin: 0 0 12px; }
h2 + p { margin-top: -6px; color: var(--soft); }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(380px, 1fr)); gap: 16px; }
.wide { grid-template-columns: 1fr; }
figure { margin: 0; background: white; border: 1px solid var(--line); border-radius: 8px; padding: 10px; }
figure img { width: 100%; height: auto; display: block; }
.half { max-width: 760px; }
figcaption { color: var(--soft); font-size: 13px; padding-top: 6px; }
.scroll { overflow-x: auto; background: white; border: 1px solid var(--line); border-radius: 8px; }
table { border-collapse: collapse; width: 100%; font-size: 13.5px; font-variant-numeric: tabular-nums; }
th, td { padding: 6px 12px; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th { color: var(--soft); font-weight: 600; background: #fafbfc; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
tr:last-child td { border-bottom: 0; }
tr.out td { color: #a33; }
.stack > * + * { margin-top: 16px; }
pre { margin: 0; padding: 12px 14px; font-size: 12.5px; line-height: 1.45; overflow-x: auto; }
.link a { display: inline-block; padding: 8px 14px; border: 1px solid var(--line); border-radius: 8px; }
footer { color: var(--soft); font-size: 13px; padding: 18px 0 40px; }
"""


def link(file: str, words: str) -> str:
    """A link to a page beside this one, as a line of its own."""
    return f'<p class="link"><a href="{escape(file)}">{escape(words)}</a></p>'


def figures(items: Sequence[tuple[str, str]], kind: str = "grid") -> str:
    """Pictures with captions; kind "grid" (side by side) or "grid wide" (one per row)."""
    body = "".join(
        f'<figure><a href="{escape(file)}"><img src="{escape(file)}" alt="{escape(caption)}" loading="lazy"></a>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for file, caption in items
    )
    return f'<div class="{kind}">{body}</div>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], marked: Sequence[bool] = ()) -> str:
    """A table of strings; `marked` rows are red. Columns with words are aligned left."""
    text = [any(ch.isalpha() for row in rows for ch in row[c]) for c in range(len(head))]

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f'<{tag} class="text">{escape(v)}</{tag}>' if is_text else f"<{tag}>{escape(v)}</{tag}>"
            for v, is_text in zip(row, text, strict=True)
        )

    flags = list(marked) or [False] * len(rows)
    opening = {True: '<tr class="out">', False: "<tr>"}
    body = "".join(f"{opening[flag]}{cells('td', row)}</tr>" for row, flag in zip(rows, flags, strict=True))
    return f'<div class="scroll"><table><thead><tr>{cells("th", head)}</tr></thead><tbody>{body}</tbody></table></div>'


def mapping_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """A table of mappings; units are taken from the keys; rows with used = False are red."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    head = []
    for key in keys:
        name, unit = split_unit(key)
        head.append(f"{words(name)} [{unit}]" if unit else words(name))
    return table(
        head, [[cell(row.get(key)) for key in keys] for row in rows], [row.get("used") is False for row in rows]
    )


def cell(value: Any) -> str:
    """A value of a table as text."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value) if value is None or isinstance(value, (int, float, str)) else str(value)


def metrics_tables(metrics: Mapping[str, Any]) -> str:
    """All metrics: statistics of distributions, then single numbers."""
    spreads, singles = metric_rows(metrics)
    parts = []
    if spreads:
        parts.append(table(("quantity", "unit", "mean", "median", "RMS", "90 %"), spreads))
    if singles:
        parts.append(table(("quantity", "value"), singles))
    return f'<div class="stack">{"".join(parts)}</div>'


def options_text(options: Mapping[str, Any], prefix: str = "") -> str:
    """Nested options as lines "group.name = value"."""
    lines = []
    for key, value in options.items():
        if isinstance(value, Mapping):
            lines.append(options_text(value, f"{prefix}{key}."))
        else:
            lines.append(f"{prefix}{key} = {value}")
    return "\n".join(line for line in lines if line)


def options_section(options: Mapping[str, Any]) -> tuple[str, str, str]:
    """The section of a page that lists the options."""
    return "Options", "", f'<div class="scroll"><pre>{escape(options_text(options))}</pre></div>'


def made_of(reflectance: Reflectance | None, brightness: str) -> tuple[str, str]:
    """The reflectance model and the kind of brightness of a map, in words."""
    model = "geometry alone" if reflectance is None else f"{reflectance.name} reflectance"
    return model, "radiance factor I/F" if brightness == "iof" else "uncalibrated brightness"


def page(title: str, subtitle: str, sections: Sequence[tuple[str, str, str]]) -> str:
    """The whole document; sections are (heading, one line below it or "", HTML)."""
    anchors = [heading.lower().replace(" ", "-") for heading, _, _ in sections]
    links = "".join(f'<a href="#{a}">{escape(s[0])}</a>' for a, s in zip(anchors, sections, strict=True))
    body = "".join(
        f'<section id="{anchor}"><h2>{escape(heading)}</h2>{_note(note)}{html}</section>'
        for anchor, (heading, note, html) in zip(anchors, sections, strict=True)
    )
    footer = f"Written by photoclinometry {__version__}."
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
        f"<style>{STYLE}{FIRST_SCREEN}</style></head><body>"
        f'<header><div class="wrap"><h1>{escape(title)}</h1><p>{escape(subtitle)}</p></div></header>'
        f'<nav><div class="wrap">{links}</div></nav>'
        f'<main class="wrap">{body}</main><footer class="wrap">{escape(footer)}</footer></body></html>\n'
    )


def _note(text: str) -> str:
    return f"<p>{escape(text)}</p>" if text else ""
