"""Push grasps: speed, bounds and peers. The thesis's tables and figures are `rtask thesis`.

Run it without arguments for all, or with names to get some:

    python tests/benchmarks/push/bench_push.py speed box2d

The thesis's outlines are not published: ours are stand-ins (``grasp.push.parts``). Times are
processor seconds of one core, which a loaded machine changes little.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable

from tests.benchmarks.push.push_checks import bound, box2d, sobol, soft, speed
from tests.benchmarks.push.push_curves import curves
from tests.benchmarks.push.push_silhouettes import outlines, silhouettes

ALL: dict[str, Callable[[], None]] = {
    "speed": speed,
    "bound": bound,
    "soft": soft,
    "box2d": box2d,
    "sobol": sobol,
    "silhouettes": silhouettes,
    "outlines": outlines,
    "curves": curves,
}


def main() -> None:
    """Run what was asked for."""
    names = sys.argv[1:]
    unknown = [name for name in names if name not in ALL]
    if unknown:
        sys.exit(f"{', '.join(unknown)}: expected some of {', '.join(ALL)}")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for name in names or ALL:
        began = time.perf_counter()
        work = ALL[name]
        print(f"\n{name}: {(work.__doc__ or '').strip()}")
        work()
        print(f"[{time.perf_counter() - began:.1f} s]")


if __name__ == "__main__":
    main()
