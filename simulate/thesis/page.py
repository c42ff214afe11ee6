"""The report of a run as one HTML file, and as Markdown with pictures beside it."""

from __future__ import annotations

import base64
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from simulate.thesis.charts import pictures_of
from simulate.thesis.result import Setting
from simulate.thesis.running import Outcome
from simulate.thesis.words import COLUMNS, VERDICTS, cells, distinct, tolerances, worse_rows

__all__ = ["to_html", "write_markdown"]

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;max-width:62rem;padding:1rem;color:#1c2024}
h1{font-size:1.5rem}h2{font-size:1.15rem;margin:2rem 0 .2rem}p{margin:.3rem 0}
table{border-collapse:collapse;width:100%;margin:.5rem 0;display:block;overflow-x:auto}
th,td{text-align:left;padding:.25rem .6rem;border-bottom:1px solid #d8dde2;vertical-align:top}
td:nth-child(n+2){white-space:nowrap}.note{color:#4a5560;font-size:.9rem}
img,svg{max-width:100%;height:auto;max-height:28rem}figure{margin:.6rem 0;display:inline-block}
figcaption{font-size:.85rem;color:#4a5560}
.v{font-size:.8rem;padding:.1rem .5rem;border-radius:.6rem;background:#e5e9ed;white-space:nowrap}
.reproduced,.better{background:#cfead6}.worse,.failed{background:#f6d3cf}.different{background:#f7e6bd}
"""
_LARGEST_PICTURE = 60_000
"""Bytes of a picture that goes beside the Markdown; larger ones are in the HTML report only."""


def _heading(setting: Setting, machine: Mapping[str, Any], outcomes: Sequence[Outcome]) -> str:
    counts = Counter(outcome.verdict for outcome in outcomes)
    verdicts = ", ".join(f"{counts[v]} {v}" for v in VERDICTS if counts[v])
    rows = (row for o in distinct(outcomes) for row in (o.result.rows if o.result else ()))
    figures: Counter[str] = Counter(row.verdict for row in rows)
    compared = ", ".join(
        f"{figures[v]} {v}" for v in VERDICTS if figures[v] and v != "not compared"
    )
    spent = sum(outcome.seconds for outcome in distinct(outcomes))
    sizes = "smaller sizes (--fast), named in each entry" if setting.fast else "full sizes"
    return (
        f"{len(outcomes)} entries, each with the gravest verdict of its figures: {verdicts}. "
        f"Figures that the theses give: {compared}. Seed {setting.seed}, {sizes}; {spent / 60:.0f} "
        f"minutes by the clock on {machine['cores']} cores of {machine['processor']}, load "
        f"{machine['load']} at the end, Python {machine['python']}."
    )


def _worse(outcomes: Sequence[Outcome]) -> list[tuple[str, ...]]:
    """Return name, what, ours, thesis and reason of each figure that is worse."""
    by_entry = {outcome.entry: outcome for outcome in outcomes}
    return [
        (entry.name, *cells(row, by_entry[entry])[:3], row.because or "not known")
        for entry, row in worse_rows(outcomes)
    ]


_WORSE = ("entry", *COLUMNS[:3], "why")


def to_html(setting: Setting, machine: Mapping[str, Any], outcomes: Sequence[Outcome]) -> str:
    """Return the report as one document without links to other files."""
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width,initial-scale=1">',
        f"<title>Two theses, and ours</title><style>{_STYLE}</style>",
        "<h1>The tables and figures of two theses, and ours</h1>",
        f"<p>{escape(_heading(setting, machine, outcomes))}</p>",
        "<ul>",
        *(f"<li><b>{escape(v)}</b>: {escape(words)}" for v, words in VERDICTS.items()),
        "</ul>",
        "<h2>Worse than the theses</h2>",
        *_html_table(_WORSE, _worse(outcomes)),
    ]
    for outcome in outcomes:
        entry, verdict = outcome.entry, outcome.verdict
        parts.append(
            f'<h2 id="{escape(entry.name)}">{escape(entry.title)}: {escape(entry.shows)} '
            f'<span class="v {escape(verdict)}">{escape(verdict)}</span></h2>'
            f'<p class="note">{escape(_about(outcome))}</p>'
        )
        if outcome.result is not None:
            parts += _html_result(outcome)
    return "\n".join(parts) + "\n"


def _about(outcome: Outcome) -> str:
    entry = outcome.entry
    words = f"Section {entry.section}, {entry.name}." if entry.section else f"{entry.name}."
    if entry.run:
        words += f" {outcome.seconds:.1f} s by the clock, {outcome.cpu_s:.1f} s of the processor."
    if entry.why:
        words += f" {entry.why[0].upper()}{entry.why[1:]}."
    return words + (f" {outcome.error}" if outcome.error else "")


def _html_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        "<table><tr>" + "".join(f"<th>{escape(column)}" for column in columns),
        *("<tr>" + "".join(f"<td>{escape(cell)}" for cell in row) for row in rows),
        "</table>",
    ]


def _html_result(outcome: Outcome) -> list[str]:
    result = outcome.result
    assert result is not None  # checked by the caller
    parts = []
    if result.rows:
        parts += _html_table(COLUMNS, [cells(row, outcome) for row in result.rows])
    notes = (*result.notes, *tolerances(result.rows))
    parts += [f'<p class="note">{escape(note)}</p>' for note in notes]
    for caption, picture in pictures_of(outcome.entry, result).items():
        if isinstance(picture, bytes):
            data = base64.b64encode(picture).decode("ascii")
            drawn = f'<img alt="{escape(caption)}" src="data:image/png;base64,{data}">'
        else:
            drawn = picture[picture.index("<svg") :]
        parts.append(f"<figure>{drawn}<figcaption>{escape(caption)}</figcaption></figure>")
    return parts


def write_markdown(
    folder: Path, setting: Setting, machine: Mapping[str, Any], outcomes: Sequence[Outcome]
) -> Path:
    """Write ``theses.md`` and ``images/theses/``; return the file.

    One picture of each run is written, unless it is large; the HTML report has all, and charts of
    the figures of runs that draw none.
    """
    pictures = folder / "images" / "theses"
    pictures.mkdir(parents=True, exist_ok=True)
    for old in pictures.iterdir():
        old.unlink()
    lines = [
        "# The tables and figures of two theses, and ours",
        "",
        "Written by `rtask thesis all --markdown docs`; every figure below is of that run.",
        "`rtask thesis show NAME` runs one entry again, in full size. The figures that are worse",
        "stand first; each entry bears the gravest verdict of its own.",
        "",
        _heading(setting, machine, outcomes),
        "",
        *(f"- **{verdict}**: {words}" for verdict, words in VERDICTS.items()),
        "",
        "## Worse than the theses",
        "",
        *_markdown_table(_WORSE, _worse(outcomes)),
    ]
    drawn: set[str] = set()
    for outcome in outcomes:
        entry = outcome.entry
        lines += ["", f"## {entry.title}: {entry.shows}", "", f"**{outcome.verdict}.** "
                  f"{_about(outcome)}"]  # fmt: skip
        if outcome.result is None:
            continue
        if entry.run in drawn:
            first = next(o.entry for o in outcomes if o.entry.run == entry.run)
            lines += ["", f"The same run as {first.title}, above."]
            continue
        drawn.add(entry.run)
        lines += _markdown_result(outcome, pictures)
    path = folder / "theses.md"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        "| " + " | ".join(columns) + " |",
        "|" + "---|" * len(columns),
        *("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows),
    ]


def _markdown_result(outcome: Outcome, pictures: Path) -> list[str]:
    result = outcome.result
    assert result is not None  # checked by the caller
    lines = []
    if result.rows:
        lines += ["", *_markdown_table(COLUMNS, [cells(row, outcome) for row in result.rows])]
    lines += ["", *(f"- {note}" for note in (*result.notes, *tolerances(result.rows)))]
    for caption, picture in result.pictures.items():
        data = picture if isinstance(picture, bytes) else picture.encode("utf-8")
        if len(data) <= _LARGEST_PICTURE:
            suffix = "png" if isinstance(picture, bytes) else "svg"
            name = re.sub(r"[^a-z0-9.]+", "-", outcome.entry.name) + f".{suffix}"
            (pictures / name).write_bytes(data)
            lines += ["", f"![{caption}](images/theses/{name})"]
            break
    return lines
