"""Push grasps: the tables and figures of Kehoe 2014, chapter 3, our numbers beside the thesis's.

Run it without arguments for all (under three minutes), or with names to get some:

    python tests/benchmarks/push/bench_push.py table-3.1 fig-3.23

``--drawings FOLDER`` writes the figures as SVG. The thesis's outlines are not published: ours are
stand-ins (``grasp.push.parts``), so that qualities compare in kind and times in order of size.
Times are processor seconds of one core, which a loaded machine changes little.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tests.benchmarks.push.push_checks import bound, box2d, sobol
from tests.benchmarks.push.push_curves import curves
from tests.benchmarks.push.push_figures import (
    belief,
    fig_3_8,
    fig_3_11,
    fig_3_13,
    fig_3_15,
    fig_3_23,
)
from tests.benchmarks.push.push_nodes import fig_3_17
from tests.benchmarks.push.push_settings import Drawings
from tests.benchmarks.push.push_silhouettes import outlines, silhouettes
from tests.benchmarks.push.push_tables import grid, nominal, speed, table_3_1, table_3_2

ALL: dict[str, Callable[[], None]] = {
    "speed": speed,
    "table-3.1": table_3_1,
    "table-3.2": table_3_2,
    "nominal": nominal,
    "grid": grid,
    "fig-3.8": fig_3_8,
    "fig-3.11": fig_3_11,
    "fig-3.13": fig_3_13,
    "fig-3.15": fig_3_15,
    "fig-3.17": fig_3_17,
    "fig-3.23": fig_3_23,
    "bound": bound,
    "box2d": box2d,
    "sobol": sobol,
    "belief": belief,
    "silhouettes": silhouettes,
    "outlines": outlines,
    "curves": curves,
}
ALSO = {
    "fig-3.9": "fig-3.8",
    "fig-3.10": "fig-3.8",
    "fig-3.12": "fig-3.13",
    "fig-3.14": "fig-3.8",
    "fig-3.16": "fig-3.15",
    "fig-3.18": "fig-3.17",
    "fig-3.19": "fig-3.17",
}
"""Figures that are drawn together with another."""


def main() -> None:
    names = sys.argv[1:]
    if "--drawings" in names:
        at = names.index("--drawings")
        Drawings.folder = Path(names[at + 1])
        del names[at : at + 2]
    unknown = [name for name in names if ALSO.get(name, name) not in ALL]
    if unknown:
        sys.exit(f"{', '.join(unknown)}: expected some of {', '.join([*ALL, *ALSO])}")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for name in names or ALL:
        began = time.perf_counter()
        work = ALL[ALSO.get(name, name)]
        print(f"\n{name}: {(work.__doc__ or '').strip()}")
        if name == "grid" and not names:
            grid(("A", "D"))
        else:
            work()
        print(f"[{time.perf_counter() - began:.1f} s]")


if __name__ == "__main__":
    main()
