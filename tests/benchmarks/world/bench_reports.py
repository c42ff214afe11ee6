"""Places by the public way: how long `report_sightings` takes over so many of them, by growth.

python tests/benchmarks/world/bench_reports.py --reports 2000 10000

A robot looks at 20 of 300 things each minute, three in ten of which were moved, and names them. The
reasoner runs. Times are of the processor, in memory.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES

BASE = "https://example.org/lab/"
_NAO, _ANN = Access("nao-1", "robot"), Access("ann", "teacher")
_A_LOOK, _MOVED, _SIGMA_M, _START_S = 20, 0.3, 0.004, 1e9
_HAND = {
    "name": "hand", "gripper_type": "nao_hand", "kind": "Hand", "min_opening": 0.0,
    "max_opening": 0.08, "jaw_width": 0.02, "finger_length": 0.05, "max_force": 3.0,
    "max_payload": 0.5, "parent_link": "wrist", "planning_group": "arm",
}  # fmt: skip


def _pose(x: float, y: float) -> dict[str, Any]:
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    return {"position": {"x": float(x), "y": float(y), "z": 0.0}, "orientation": turn}


def furnish(engine: Engine, things: int) -> None:
    """State products, frames and the robot."""
    products = " ".join(
        f'<{BASE}object/{k}> a rt:Mug ; rt:objectId "lab/{k}" ; rt:name "cup {k}" ; '
        "rt:extentX 0.06e0 ; rt:extentY 0.06e0 ."
        for k in range(things)
    )
    graph = f"<{BASE}graph/shared>"
    engine.context.kb.update(f"{PREFIXES} INSERT DATA {{ GRAPH {graph} {{ {products} }} }}")
    engine.call("state_frame", {"frame": "map", "stamp": _START_S}, _ANN)
    robot = {"name": "nao-1", "model": "nao", "simulated": True, "end_effectors": [_HAND],
             "frames": ["base"]}  # fmt: skip
    engine.call("register_robot", robot, _NAO)
    stands = {"frame": "base", "parent": "map", "pose": _pose(0.0, 0.0), "stamp": _START_S}
    engine.call("state_frame", stands, _NAO)


def report(engine: Engine, reports: int, things: int) -> None:
    """Report so many sightings, and print what a fifth of them took."""
    rng, named = np.random.default_rng(1), dict[int, str]()
    spots = rng.uniform(-5.0, 5.0, (things, 2))
    start, fifth = time.process_time(), max(reports // 5 // _A_LOOK, 1)
    for look in range(reports // _A_LOOK):
        chosen = rng.choice(things, _A_LOOK, replace=False)
        moved = chosen[rng.random(_A_LOOK) < _MOVED]
        spots[moved] = rng.uniform(-5.0, 5.0, (len(moved), 2))
        seen = [
            {"object": f"{BASE}object/{k}", "sigma": _SIGMA_M,
             "pose": _pose(*(spots[k] + rng.normal(0.0, _SIGMA_M, 2))),
             **({"thing": named[k]} if k in named else {})}
            for k in map(int, chosen)
        ]  # fmt: skip
        args = {"frame": "base", "seen": seen, "stamp": _START_S + 61.0 * (look + 1)}
        answer = engine.call("report_sightings", args, _NAO)
        named.update(zip(map(int, chosen), answer["things"], strict=True))
        if (look + 1) % fifth == 0:
            now = time.process_time()
            took = 1e3 * (now - start) / (fifth * _A_LOOK)
            places = len(engine.context.world.index)
            print(f"{(look + 1) * _A_LOOK}\t{places}\t{took:.2f}", flush=True)
            start = now


def main() -> None:
    """Print a row for each fifth of each number of reports."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reports", type=int, nargs="+", default=[2_000, 10_000])
    parser.add_argument("--things", type=int, default=300)
    asked = parser.parse_args()
    print("reports\tplaces\tms_a_report")
    for count in asked.reports:
        with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
            furnish(engine, asked.things)
            report(engine, count, asked.things)


if __name__ == "__main__":
    main()
