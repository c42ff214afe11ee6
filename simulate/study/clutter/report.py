"""Report of the trials with piles and cluttered tables: shares with intervals."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import bootstrap, share

__all__ = [
    "COLUMNS",
    "clear_study",
    "clutter_rows",
    "pile_study",
    "summarise_piles",
    "summarise_tables",
]

COLUMNS = ("figure", "share", "of", "95 % interval")


def pile_study(
    trials: int, objects: int, seed: int, preset: str, pictures: str = "", hand: str = ""
) -> Study:
    """Return the study of first picks from piles; ``pictures`` is a folder for views of them.

    ``hand`` is what the Panda carries instead of its own, as its description takes it.
    """
    settings: dict[str, Any] = {"seed": seed, "objects": objects, "preset": preset}
    if hand:
        settings["hand"] = hand
    if pictures:
        settings["pictures"] = pictures
    return Study("first picks from piles", "simulate.study.clutter.trial:pile_trial", settings,
                 trials, _describe_piles)  # fmt: skip


def clear_study(
    trials: int,
    objects: int,
    seed: int,
    preset: str,
    agent: bool = False,
    pushes: bool = True,
    hand: str = "",
    robot: str = "",
) -> Study:
    """Return the study of cluttered tables that are cleared, by the robot's ``agent`` if asked.

    ``robot`` is one whose arms take no full poses, in place of the Panda.
    """
    settings: dict[str, Any] = {"seed": seed, "objects": objects, "preset": preset}
    if robot:
        settings["robot"] = robot
    if hand:
        settings["hand"] = hand
    if agent:
        settings["agent"] = True
    if not pushes:
        settings["pushes"] = False
    return Study("cluttered tables cleared", "simulate.study.clutter.trial:clear_trial", settings,
                 trials, _describe_tables)  # fmt: skip


def summarise_piles(results: Results) -> dict[str, Any]:
    """Return the figures of first picks as JSON data; a pile without a pick counts as missed."""
    n = len(results)
    return {
        "piles": n,
        "touching pairs, mean": round(float(np.mean([r["touching"] for r in results])), 2),
        "shares": {
            "first pick lifts": share(sum(r["lifted"] for r in results), n),
            "robot says it holds": share(sum(r["reason"] == "ok" for r in results), n),
            "arrives in the box": share(sum(r["placed"] for r in results), n),
            "lifts more than one": share(sum(bool(r.get("several")) for r in results), n),
            "moves others by over 1 cm": share(sum(r["moved"] > 0 for r in results), n),
        },
        "reasons": dict(Counter(r["reason"] for r in results).most_common()),
        "refused by the arm": dict(
            Counter(reason for r in results for reason in r.get("refused", ())).most_common()
        ),
    }


def summarise_tables(results: Results) -> dict[str, Any]:
    """Return the figures of cleared tables as JSON data.

    The interval of the share of things comes from resampling tables, whose things share a fate.
    """
    counts = np.array([r["objects"] for r in results], dtype=np.float64)
    cleared = np.array([r["cleared"] for r in results], dtype=np.float64)
    low, high = bootstrap(lambda i: float(cleared[i].sum() / counts[i].sum()), len(results))
    picks = [move for r in results for move in r["moves"] if move["kind"] == "pick"]
    return {
        "tables": len(results),
        "touching pairs, mean": round(float(np.mean([r["touching"] for r in results])), 2),
        "shares": {
            "things cleared": {
                "hits": int(cleared.sum()), "n": int(counts.sum()),
                "share": float(cleared.sum() / counts.sum()),
                "interval95": [round(low, 4), round(high, 4)],
            },
            "tables wholly cleared": share(int((cleared == counts).sum()), len(results)),
            "picks that lift": share(sum(move["lifted"] for move in picks), len(picks)),
            "things off the table": share(
                int(sum(r["off_table"] for r in results)), int(counts.sum())
            ),
        },
        "pushes": int(sum(r["pushes"] for r in results)),
        "reasons": dict(Counter(move["reason"] for move in picks).most_common()),
        "last at things left": dict(
            Counter(why for r in results for why in r.get("why_left", ())).most_common()
        ),
        "ends": dict(
            Counter(r["moves"][-1]["reason"] if r["moves"] else "nothing" for r in results)
            .most_common()
        ),
    }  # fmt: skip


def clutter_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    rows: list[tuple[str, ...]] = []
    for name, part in summary["shares"].items():
        low, high = part["interval95"]
        middle = "-" if part["share"] is None else f"{part['share']:.3f}"
        rows.append((name, middle, f"{part['hits']} of {part['n']}", f"{low:.3f} to {high:.3f}"))
    return rows


def _describe_piles(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    return _report("First picks from piles", summarise_piles(results), results, settings)


def _describe_tables(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    return _report("Cluttered tables cleared", summarise_tables(results), results, settings)


def _report(
    title: str, summary: Mapping[str, Any], results: Results, settings: Mapping[str, Any]
) -> Report:
    whole = {"seed": settings["seed"], **summary}
    return Report(
        whole,
        [Table(title, COLUMNS, clutter_rows(summary))],
        [f"{name}: {json.dumps(part)}" for name, part in whole.items() if name != "shares"],
        {"results": list(results)},
    )
