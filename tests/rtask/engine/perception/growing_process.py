"""Processes that let an object's model grow until they are killed.

Run as ``python growing_process.py REQUESTS``, a file of JSON requests, one a line: a view each.
Each line on standard input is a JSON order::

    {"folder": ..., "view": 1, "calls": 57}

A child is forked for each, opens the folder and inserts the view, and is killed with SIGKILL right
before (even) or behind (odd) the ``calls // 2``-th operation on a file or the store since then. The
answer is one line when it is dead: ``killed``, or ``stored`` when there were not so many.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import rtask
from rtask.engine import Engine
from rtask.kb.commit.access import Access
from tests.rtask.kb.writer_process import die_at

ROBOT = Access("nao-1", "robot")


def insert(folder: str, request: dict[str, Any], calls: int) -> None:
    """Insert a view; do not come back when the call is among those that it takes."""
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        die_at(calls)
        engine.call("insert_object", request, ROBOT)


def main() -> None:
    """Take orders until the input ends; modules and kernels are loaded once."""
    from features.modelling import warm_up

    warm_up()
    requests = [json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines()]
    for line in sys.stdin:
        order = json.loads(line)
        child = os.fork()
        if child == 0:
            try:
                insert(order["folder"], requests[order["view"]], order["calls"])
                os._exit(0)
            finally:
                os._exit(1)
        status = os.waitpid(child, 0)[1]
        said = {0: "stored"}.get(status, "killed" if os.WIFSIGNALED(status) else "failed")
        print(said, flush=True)  # noqa: T201 - this is its report


if __name__ == "__main__":
    main()
