"""The report of a demo as one page with the robots side by side, for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from rtask.engine.words import phase_words, reason_words

__all__ = ["GRASP_WORDS", "report_page"]

_STYLE = """
:root { color-scheme: light dark; --line: #8884; --good: #1a7f43; --bad: #b3123f; }
body { font: 16px/1.5 system-ui, sans-serif; margin: 0 auto; max-width: 72rem; padding: 1rem; }
h1 { font-size: 1.7rem; margin: .5rem 0; }
.row { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(20rem, 100%), 1fr));
  gap: 1rem; margin: 0 0 1.5rem; }
.row > div { border: 1px solid var(--line); border-radius: 12px; padding: .8rem 1rem; }
.shots { display: grid; grid-template-columns: repeat(4, minmax(0, 1fr)); gap: .5rem; }
@media (max-width: 30rem) { .shots { grid-template-columns: repeat(2, minmax(0, 1fr)); } }
figure { margin: .4rem 0; }
img { width: 100%; border-radius: 8px; display: block; }
figcaption, small { opacity: .75; font-size: .85rem; }
h2 { font-size: 1.15rem; margin: 1.2rem 0 .4rem; }
h3 { font-size: 1rem; margin: 0; }
p { margin: .2rem 0; overflow-wrap: anywhere; }
.good { color: var(--good); } .bad { color: var(--bad); }
@media (prefers-color-scheme: dark) { :root { --good: #86efac; --bad: #fda4af; } }
"""
GRASP_WORDS = {
    "memory": "remembered grasp",
    "candidate": "grasp proposed from its shape",
    "scene": "grasp planned on the whole view",
    "none": "no grasp",
}


def report_page(folder: Path, result: Mapping[str, Any]) -> str:
    """Return the page; pictures are named relative to the folder.

    Parameters
    ----------
    folder
        Folder of the report, with one folder of pictures for each robot.
    result
        What ``rtask demo --json`` prints.
    """
    robots = [str(robot["name"]) for robot in result["robots"]]
    products = list(dict.fromkeys(encounter["product"] for encounter in result.get("objects", ())))
    alone = result.get("alone")
    totals = [*result["robots"], *([alone] if alone else [])]
    beside = f" {alone['name']} worked without the graph, for comparison." if alone else ""
    parts = [_row([_totals(robot) for robot in totals])]
    if result.get("lessons"):
        parts.insert(0, f"<p>{escape(result['lessons']['sentence'])}</p>")
    if result.get("gain"):
        parts.insert(0, f"<p><b>{escape(result['gain']['sentence'])}</b></p>")
    every = [*result.get("objects", ()), *result.get("alone_objects", ())]
    names = [*robots, *([str(alone["name"])] if alone else [])]
    for product in products:
        met = [encounter for encounter in every if encounter["product"] == product]
        cells = [
            _cell(folder, name, [encounter for encounter in met if encounter["robot"] == name])
            for name in names
        ]
        parts.append(f"<h2>{escape(product or 'not on any list')}</h2>\n{_row(cells)}")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>What the robots did</title><style>{_STYLE}</style></head><body>\n"
        "<h1>What the robots did</h1>\n<p>Every robot faced the same products, one robot after "
        f"the other; what one learned, the next was told.{escape(beside)} Held and placed are the "
        "robots' own judgements.</p>\n" + "\n".join(parts) + "\n</body></html>\n"
    )


def _row(cells: Sequence[str]) -> str:
    return '<div class="row">' + "".join(f"<div>{cell}</div>" for cell in cells) + "</div>"


def _totals(robot: Mapping[str, Any]) -> str:
    mean = robot["mean_attempts_to_first_success"]
    tries = "none held" if mean is None else f"{mean:.2f} attempts until the first success"
    return (
        f"<h3>{escape(robot['name'])}</h3><p>held {robot['held']} and placed {robot['placed']} of "
        f"{robot['objects_in_reach']} objects in reach; {tries}</p>"
        f"<p>{robot['from_memory']} grasps from memory; {robot['seconds']:.0f} s</p>"
    )


def _cell(folder: Path, robot: str, encounters: Sequence[Mapping[str, Any]]) -> str:
    """Return what one robot did with one product."""
    parts = [f"<h3>{escape(robot)}</h3>"]
    if not encounters:
        parts.append("<p>did not see it</p>")
    for encounter in encounters:
        status = (
            f"known as {encounter['label'] or 'an object'}"
            if encounter["recognised"]
            else "new to it"
        )
        parts.append(
            f"<p>{escape(status)} <small>(confidence {encounter['confidence']:.2f})</small></p>"
        )
        for attempt in encounter["attempts"]:
            parts.append(_attempt(folder, robot, attempt))
    return "".join(parts)


def _attempt(folder: Path, robot: str, attempt: Mapping[str, Any]) -> str:
    done = "held and placed" if attempt["placed"] else "held" if attempt["held"] else "not held"
    why = attempt["place_reason"] if attempt["held"] else attempt["reason"]
    reason = "" if why in ("ok", "") else f": {reason_words(why)}"
    grasp = GRASP_WORDS.get(attempt["source"], f"grasp from {attempt['source']}")
    mark = "good" if attempt["held"] else "bad"
    line = f'<p>{escape(grasp)}: <b class="{mark}">{escape(done + reason)}</b></p>'
    if attempt.get("alone"):
        line += f"<p><small>{escape(attempt['alone'])}</small></p>"
    run = attempt.get("run", 0)
    paths = sorted((folder / robot).glob(f"{run:02d}-*-*.*")) if run else []
    shots = "".join(
        f'<figure><img src="{escape(robot)}/{escape(path.name)}" alt="{escape(words)}">'
        f"<figcaption>{escape(words)}</figcaption></figure>"
        for path in paths
        for words in [phase_words(path.stem.split("-")[-1])]
    )
    return f'{line}<div class="shots">{shots}</div>' if shots else line
