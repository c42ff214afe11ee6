"""The report of a proof as one page: the runs side by side, and what was shown."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from simulate.demo.products import by_product
from simulate.demo.proof_words import clock
from simulate.demo.report_attempts import robot_cell
from simulate.demo.report_hand import HATCH

__all__ = ["proof_page", "write_proof"]

_HERE = Path(__file__).parent


def write_proof(folder: Path, result: Mapping[str, Any]) -> None:
    """Write ``report.json`` and ``proof.html``."""
    (folder / "report.json").write_text(json.dumps(result, indent=1) + "\n", "utf-8")
    (folder / "proof.html").write_text(proof_page(folder, result), "utf-8")


def proof_page(folder: Path, result: Mapping[str, Any]) -> str:
    """Return the page; pictures are named relative to the folder.

    Parameters
    ----------
    result
        What ``rtask demo --proof --json`` prints.
    """
    titles = list(result["runs"])
    teachers, three, later = titles[:2], titles[2:5], titles[5:]
    style = (_HERE / "report.css").read_text("utf-8")
    parts = [
        f"<p>{escape(result['carton'])} looks like a plain box; its {escape(result['weak'])} end, "
        "as the robot sees it, breaks when it is pressed. No robot was told.</p>",
        _points(result["points"]),
        f"<h2>{escape(result['robot'])} at one table, three times</h2>",
        _row(folder, result, three),
        "<h2>What the robot with the graph relied on</h2>",
        *(_evidence(row) for row in result["relied_on"]),
        f"<h2>{escape(result['teacher'])} is withdrawn, and comes back</h2>",
        _row(folder, result, later),
        "<h2>The teachers</h2>",
        _row(folder, result, teachers),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<link rel="icon" href="data:,">'
        f"<title>One carton, three robots</title><style>\n{style}</style></head><body>\n"
        f"{HATCH}<main><h1>One carton, three robots</h1>\n" + "\n".join(parts)
        + "</main></body></html>\n"
    )  # fmt: skip


def _points(points: Sequence[Mapping[str, Any]]) -> str:
    items = (
        f'<li><b class="{"good" if p["shown"] else "bad"}">{"yes" if p["shown"] else "no"}</b> '
        f"{escape(p['text'])}</li>"
        for p in points
    )
    return f"<ul>{''.join(items)}</ul>"


def _row(folder: Path, result: Mapping[str, Any], titles: Sequence[str]) -> str:
    cells = (
        robot_cell(folder, title, None, next(iter(by_product(result["runs"][title])), None))[0]
        for title in titles
    )
    return f'<div class="row"><div class="cells">{"".join(cells)}</div></div>'


def _evidence(row: Mapping[str, Any]) -> str:
    what = "held" if row["held"] else "failed"
    same = ", with the grasp that was repeated" if row["same_grasp"] else ""
    text = f"{row['robot']}, {clock(row['time'])}: {what}{same}"
    picture = (
        f'<img src="{escape(row["file"])}" alt="{escape(text)}" style="max-width: 20rem">'
        if row.get("file") else ""
    )  # fmt: skip
    return (
        f"<figure>{picture}<figcaption>{escape(text)}<br>{escape(row['attempt'])}</figcaption>"
        "</figure>"
    )
