"""Study of requests: the share that a robot fulfils, by class of object (Gatto 2016, chapter 5).

The thesis tried pens, balls, bottles and cylinders and states how long a grasp took (Table 5), not
how often it succeeded; the shares here stand beside these times.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import share

__all__ = [
    "COLUMNS", "request_rows", "request_study", "request_trial", "summarise_requests",
]  # fmt: skip

COLUMNS = (
    "asked for", "brought", "of", "95 % interval", "robot was right", "Gatto 2016, Table 5",
)  # fmt: skip
_TABLE_5_S = {"pen": 10.501, "ball": 15.285, "bottle": 18.235, "can": 12.101}
"""Generation and execution time of a grasp, s; the can is the cylinder of the thesis."""


def request_study(
    trials: int, objects: int, seed: int, robot: str, preset: str, kinds: Sequence[str] = ()
) -> Study:
    """Return the study; trials ask for the classes in turn, each at a table of its own.

    Parameters
    ----------
    kinds
        Classes to ask for; empty = all.
    """
    settings: dict[str, Any] = {
        "seed": seed, "objects": objects, "robot": robot, "preset": preset,
    }  # fmt: skip
    if kinds:
        settings["kinds"] = sorted(kinds)
    return Study("requests by class", "simulate.fleet.requests:request_trial", settings, trials,
                 _describe)  # fmt: skip


def request_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Carry out one request; return it as JSON data.

    ``brought`` is the truth: a product of the class that was asked for is in a box. ``says`` is
    what the robot judged.
    """
    from simulate.fleet.request import WORDS, Request, carry_out

    kinds = settings.get("kinds") or sorted(WORDS)
    kind = kinds[number % len(kinds)]
    done = carry_out(
        Request(
            WORDS[kind], seed=settings["seed"] + number, objects=settings["objects"],
            robot=settings["robot"], preset=settings["preset"],
        )
    )  # fmt: skip
    brought = str(done["took"]).startswith(f"{kind}-")
    if done["placed"]:
        why = "ok" if brought else "another thing"
    else:
        why = done["tried"][-1]["reason"] if done["tried"] else "nothing fits"
    return {"kind": kind, "brought": brought, "says": bool(done["placed"]), "took": done["took"],
            "why": why, "tried": len(done["tried"])}  # fmt: skip


def summarise_requests(results: Results) -> dict[str, Any]:
    """Return shares by class and over all, with reasons of those that failed, as JSON data."""
    kinds = sorted({str(trial["kind"]) for trial in results})
    parts = {kind: [trial for trial in results if trial["kind"] == kind] for kind in kinds}
    return {
        "classes": {
            kind: {
                **share(sum(trial["brought"] for trial in mine), len(mine)),
                "robot_was_right": share(
                    sum(trial["says"] == trial["brought"] for trial in mine), len(mine)
                ),
                "failed": dict(Counter(o["why"] for o in mine if not o["brought"]).most_common()),
                "thesis_table_5_s": _TABLE_5_S.get(kind),
            }
            for kind, mine in {**parts, "all": list(results)}.items()
        },
        "trials": len(results),
    }


def request_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """Return the rows of the table for people."""
    rows = []
    for kind, figures in summary["classes"].items():
        low, high = figures["interval95"]
        seconds = figures["thesis_table_5_s"]
        rows.append([
            kind, str(figures["hits"]), str(figures["n"]), f"{low:.2f} to {high:.2f}",
            f"{figures['robot_was_right']['hits']} of {figures['n']}",
            "-" if seconds is None else f"{seconds:.1f} s a grasp, no share",
        ])  # fmt: skip
    return rows


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = summarise_requests(results)
    return Report(
        summary,
        [Table("Requests by class", COLUMNS, request_rows(summary))],
        [
            f"{kind} failed: {json.dumps(figures['failed'])}"
            for kind, figures in summary["classes"].items()
            if figures["failed"] and kind != "all"
        ],
        {"settings": dict(settings), "results": list(results)},
    )
