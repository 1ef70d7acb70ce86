"""The first screen of a report as HTML: verdict, map, mapped ground, quality, and reasons for distrust."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from photoclinometry.evaluate.verdict import CARE, SOUND, WRONG
from photoclinometry.output.report.facts import Fact, Overview, WorstPlace

STYLE = """
.verdict { border: 1px solid #8cbf9b; border-left-width: 6px; border-radius: 8px; background: #e9f5ec; color: #1d5b33;
           padding: 10px 16px; margin: 0 0 14px; }
.verdict.care { border-color: #e3c76b; background: #fdf6e0; color: var(--ink); }
.verdict.wrong { border-color: #b3261e; background: #fbe9e7; color: #8c1d18; }
.verdict ul { margin: 4px 0 0; padding-left: 20px; }
.glance { display: grid; grid-template-columns: minmax(0, 1fr) minmax(300px, 470px); gap: 16px; align-items: start; }
.facts { background: white; border: 1px solid var(--line); border-radius: 8px; padding: 10px 16px 12px; }
.facts h3 { font-size: 15px; font-weight: 600; margin: 12px 0 4px; }
.facts h3:first-child { margin-top: 0; }
.facts dl { display: grid; grid-template-columns: 112px minmax(0, 1fr); gap: 3px 12px; margin: 0; font-size: 14px;
            line-height: 1.4; }
.facts dt { color: var(--soft); }
.facts dd { margin: 0; font-variant-numeric: tabular-nums; }
.facts dd span { color: var(--soft); font-size: 13px; }
.facts ul, .facts ol { margin: 2px 0 0; padding-left: 20px; font-size: 14px; line-height: 1.4; }
@media (max-width: 860px) { .glance { grid-template-columns: minmax(0, 1fr); } }
"""
_VERDICTS = {
    SOUND: ("", "nothing in the images speaks against this map."),
    CARE: ("care", "read what follows before you rely on it."),
    WRONG: ("wrong", "this map is not to be trusted."),
}


def first_screen(found: Overview[WorstPlace], picture: str, caption: str) -> str:
    """The HTML. picture: file name of the map, with the worst places numbered; caption: what it shows."""
    figure = (
        f'<figure><a href="{escape(picture)}"><img src="{escape(picture)}" alt="{escape(caption)}"></a>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )
    facts = (
        f'<div class="facts"><h3>What was mapped</h3>{_facts(found.what)}'
        f"<h3>How good it is</h3>{_facts(found.quality)}"
        f"<h3>Worst places</h3>{_places(found)}</div>"
    )
    return f'{_verdict(found)}<div class="glance">{facts}{figure}</div>'


def _verdict(found: Overview[WorstPlace]) -> str:
    kind, words = _VERDICTS[found.verdict]
    listed = _list("ul", found.reasons)
    if found.warnings:
        count = len(found.warnings)
        listed += f"<b>{count} warning{'s' if count > 1 else ''}</b>{_list('ul', found.warnings)}"
    verdict = escape(found.verdict.capitalize())
    return f'<div class="{f"verdict {kind}".strip()}"><b>{verdict}:</b> {words}{listed}</div>'


def _facts(facts: Sequence[Fact]) -> str:
    lines = []
    for fact in facts:
        meaning = f" <span>{escape(fact.meaning)}</span>" if fact.meaning else ""
        lines.append(f"<dt>{escape(fact.name)}</dt><dd>{escape(fact.value)}{meaning}</dd>")
    return f"<dl>{''.join(lines)}</dl>"


def _places(found: Overview[WorstPlace]) -> str:
    if not found.places:
        return "<ul><li>None stands out: no part of the map is much worse than the rest.</li></ul>"
    return _list("ol", [f"{place.where}: {place.words}" for place in found.places])


def _list(kind: str, lines: Sequence[str]) -> str:
    return f"<{kind}>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</{kind}>" if lines else ""
