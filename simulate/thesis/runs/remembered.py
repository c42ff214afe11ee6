"""Paths from experience (Kehoe 2014, 2.4 and Figure 2.8), and trajectories of others (1.2)."""

from __future__ import annotations

from simulate.study.declaration import Study
from simulate.study.paths.command import summary_of
from simulate.study.paths.shared import PAIRS
from simulate.thesis.result import Compared, Result, Setting, share_of

__all__ = ["motions", "paths"]

_FEWEST = 8
"""Tables below which a ratio has no interval."""
_FIGURES = (
    ("work", "postures checked in whole plans"),
    ("of_first", "postures checked until the first way"),
    ("way_s", "time under way"),
)


def paths(setting: Setting) -> Result:
    """Ways of a Panda on fresh tables, with paths remembered from other tables and without."""
    tables, before = setting.size(40, 6), setting.size(30, 6)
    settings = {"seed": setting.seed, "robot": "panda", "things": 4, "before": before}
    trial = "simulate.study.paths.trial:run_trial"
    results = setting.trials(Study("paths", trial, settings, tables))
    rows, verdicts = [], []
    for kind, row in summary_of(results)["tables"].items():
        verdicts.append(f"{kind}: {row['verdict']}")
        if not row["searched"]:
            continue
        anew, recalled = row["reached"]
        rows += [
            share_of(f"{kind}: things reached, all planned anew", anew, row["searched"]),
            share_of(f"{kind}: things reached, with paths remembered", recalled, row["searched"]),
        ]
        for name, what in _FIGURES:
            low, high = row[name]["interval95"]
            rows.append(Compared(f"{kind}: {what}, remembered over anew", row[name]["ratio"],
                                 interval=(low, high)))  # fmt: skip
    return Result(
        tuple(rows),
        (
            "the thesis describes the system of others, and gives no figures; ours remembers the "
            "paths of one robot",
            "medians of things of which a way is not straight; open tables, and such with boards "
            "around which the arm has to go",
            *verdicts,
            *setting.shrunk("tables", 40, tables),
            *setting.shrunk("tables of each kind to remember", 30, before),
        ),
    )


def motions(setting: Setting) -> Result:
    """Movements that a robot reported, asked for by others of its body, its other arm, and none."""
    tables, before = setting.size(30, 2), setting.size(10, 2)
    settings = {"seed": setting.seed, "before": before, "things": 4}
    trial = "simulate.study.paths.shared:run_trial"
    results = setting.trials(Study("shared motions", trial, settings, tables * len(PAIRS)))
    summary = summary_of(results)["tables"]
    rows = []
    for pair in PAIRS:
        mine = [result for result in results if result["kind"] == pair]
        stored, offered = (sum(result[name] for result in mine) for name in ("stored", "offered"))
        rows += [
            share_of(f"{pair}: stored movements that were offered", offered, stored),
            share_of(f"{pair}: of these, ways that are free where they were made",
                     sum(result["free"] for result in mine), offered),
            Compared(f"{pair}: hand off the recorded way, or off its mirror image, at most",
                     1e3 * max(result["astray_m"] for result in mine), unit="mm"),
        ]  # fmt: skip
        row = summary[pair]
        if row["searched"]:
            low, high = row["of_first"]["interval95"]
            # Few tables drawn anew are nearly always the same ones, whatever others would show.
            interval = (low, high) if tables >= _FEWEST else None
            rows.append(Compared(f"{pair}: postures checked until the first way at a fresh table, "
                                 "with the movements over anew", row["of_first"]["ratio"],
                                 interval=interval))  # fmt: skip
    strange, stored = (sum(result[name] for result in results) for name in ("strange", "stored"))
    rows.append(share_of("another body: movements offered to it as they are", strange, stored))
    reasons = sorted({reason for result in results for reason in result["said"]})
    return Result(
        tuple(rows),
        (
            "the thesis names the sharing of trajectories as a use of the cloud, without a figure",
            "what another body is told: " + "; ".join(reasons),
            "a recalled movement is a guess: the robot checks all of it where it stands",
            *setting.shrunk("fresh tables for each pair", 30, tables),
            *setting.shrunk("tables at which the first robot plans", 10, before),
        ),
    )
