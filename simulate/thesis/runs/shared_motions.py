"""Trajectories that one robot stored and others follow (Kehoe 2014, 1.2)."""

from __future__ import annotations

from simulate.study.declaration import Study
from simulate.study.paths.command import summary_of
from simulate.study.paths.shared import PAIRS
from simulate.thesis.result import Compared, Result, Setting, share_of

__all__ = ["motions"]


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
        stored, offered = (sum(one[name] for one in mine) for name in ("stored", "offered"))
        rows += [
            share_of(f"{pair}: stored movements that were offered", offered, stored),
            share_of(f"{pair}: of these, ways that are free where they were made",
                     sum(one["free"] for one in mine), offered),
            Compared(f"{pair}: hand off the recorded way, or off its mirror image, at most",
                     1e3 * max(one["astray_m"] for one in mine), unit="mm"),
        ]  # fmt: skip
        row = summary[pair]
        if row["searched"]:
            low, high = row["of_first"]["interval95"]
            rows.append(Compared(f"{pair}: postures checked until the first way at a fresh table, "
                                 "with the movements over anew", row["of_first"]["ratio"],
                                 interval=(low, high)))  # fmt: skip
    strange, stored = (sum(result[name] for result in results) for name in ("strange", "stored"))
    rows.append(share_of("another body: movements offered to it as they are", strange, stored))
    said = sorted({reason for result in results for reason in result["said"]})
    return Result(
        tuple(rows),
        (
            "the thesis names the sharing of trajectories as a use of the cloud, without a figure",
            "what another body is told: " + "; ".join(said),
            "a recalled movement is a guess: the robot checks all of it where it stands",
            *setting.shrunk("fresh tables for each pair", 30, tables),
            *setting.shrunk("tables at which the first robot plans", 10, before),
        ),
    )
