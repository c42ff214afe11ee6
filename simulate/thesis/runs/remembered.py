"""Paths from experience (Kehoe 2014, 2.4 and Figure 2.8): recalled and planned anew by turns."""

from __future__ import annotations

from simulate.study.declaration import Study
from simulate.study.paths.command import summary_of
from simulate.thesis.result import Compared, Result, Setting, share_of

__all__ = ["paths"]

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
