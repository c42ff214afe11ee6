"""Success over trials with a Nao: what Gatto 2016, 2 and 5, announces and gives no figures of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from simulate.fleet.requests import request_study, summarise_requests
from simulate.study.clutter.report import clear_study, summarise_tables
from simulate.study.grasping_report import grasping_study, summarise_grasping
from simulate.thesis.result import Compared, Result, Setting

__all__ = ["success"]


def success(setting: Setting) -> Result:
    """Single objects, clutter and requests by class, each by a Nao with perception in the loop."""
    singles, tables, asked = setting.size(100, 4), setting.size(50, 1), setting.size(50, 2)
    on_table = setting.size(6, 3)
    preset = "fast" if setting.fast else "faithful"
    held = summarise_grasping(
        setting.trials(grasping_study(singles, setting.seed, preset=preset, robot="nao"))
    )["groups"]["all"]
    cleared = summarise_tables(
        setting.trials(clear_study(tables, on_table, setting.seed, preset, agent=True, robot="nao"))
    )["shares"]
    brought = summarise_requests(
        setting.trials(request_study(asked, 5, setting.seed, "nao", preset))
    )["classes"]["all"]
    return Result(
        (
            _share("single objects: held at the first attempt", held["held_first"]),
            _share("single objects: held within three attempts", held["held"]),
            _share("single objects: of those held, put into the box", held["placed_of_held"]),
            _share("clutter: things cleared into boxes", cleared["things cleared"]),
            _share("requests by class of known objects: brought", brought),
        ),
        (
            "the thesis announces these trials and prints times alone (Table 5)",
            "things that touch lie before either hand; classes are asked for in turn, of five "
            "products on a table that the graph knows; objects that another hand has taught: "
            "beyond-lessons",
            *setting.shrunk("single objects", 100, singles),
            *setting.shrunk("tables with clutter", 50, tables),
            *setting.shrunk("requests", 50, asked),
        ),
    )


def _share(what: str, part: Mapping[str, Any]) -> Compared:
    interval: Sequence[float] = part["interval95"] or ()
    is_known = len(set(interval)) == 2  # of a single table there is none
    known = (interval[0], interval[1]) if is_known else None
    return Compared(what, part["hits"] / part["n"] if part["n"] else None, interval=known)
