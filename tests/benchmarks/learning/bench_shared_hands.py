"""Two Pandas with hands of one kind and one graph: the second is served what the first one held.

    python tests/benchmarks/learning/bench_shared_hands.py --hand suction:0.012
    python tests/benchmarks/learning/bench_shared_hands.py --hand three:0.1 --products 8 --seed 3

Printed products of the kitchen, one at a time on the table. The agent sees them through its noisy
camera, asks the graph, grasps and reports; then another one, for which the same products stand
elsewhere. Both start with the graph as it is then: the first with an empty one. Wilson intervals.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, cast

import rtask
from simulate.agent.agent import Agent, AgentConfig, Server
from simulate.agent.encounter import Encounter
from simulate.agent.simulated_body import RobotAtTable
from simulate.grasping.executor import Workcell
from simulate.robots import describe
from simulate.study.intervals import wilson
from simulate.world.eyes import Eyes
from simulate.world.noise import SensorNoise
from simulate.world.objects import KINDS, ObjectSpec, product
from simulate.world.scene import arrange, lay
from simulate.world.seeds import stream

_PRODUCT, _PLACE, _NOISE = 80, 81, 82


def handled(
    kb: Any, name: str, hand: str, spec: ObjectSpec, at: tuple[int, ...], preset: str
) -> Encounter | None:
    """Let a robot clear a table with one product on it; return its encounter."""
    options = {} if hand == "panda" else {"hand": hand}
    with (
        tempfile.TemporaryDirectory(prefix="rtask-hands-") as assets,
        Workcell(describe("panda", **options), preset) as cell,
    ):
        where = arrange([spec], stream(*at, _PLACE), [-1], cell.description.workplace)
        lay(cell.world, where, Path(assets))
        cell.executor.eyes = Eyes(cell.robot, noise=SensorNoise(), noise_seed=(*at, _NOISE))
        body = RobotAtTable(cell.executor)
        with rtask.connect(kb, agent=name) as client:
            client.call("register_robot", **body.robot.describe(name))
            config = AgentConfig(max_attempts=2, seed=at[0])
            met = Agent(body, cast(Server, client), config).clear_table()
    return met[0] if met else None


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ask.add_argument("--hand", default="suction:0.012", help="suction:RADIUS, three:OPENING, panda")
    ask.add_argument("--products", type=int, default=8)
    ask.add_argument("--seed", type=int, default=3)
    ask.add_argument("--preset", default="fast")
    told = ask.parse_args()
    rng = stream(told.seed, _PRODUCT)
    specs = [product(KINDS[k % len(KINDS)], int(rng.integers(200))) for k in range(told.products)]
    first: dict[str, list[bool]] = {"one": [], "two": []}
    ends: dict[str, Counter[str]] = {"one": Counter(), "two": Counter()}
    served = []
    with rtask.open(":memory:", reason=False) as kb:
        for turn, name in enumerate(first):
            for number, spec in enumerate(specs):
                met = handled(kb, name, told.hand, spec, (told.seed, turn, number), told.preset)
                tried = met.attempts[0] if met is not None and met.attempts else None
                first[name].append(tried is not None and tried.held)
                ends[name][tried.reason if tried is not None else "not seen"] += 1
                if name == "two":
                    held = first["one"][number]
                    from_memory = tried is not None and tried.source == "memory"
                    served.append((held, from_memory, first[name][-1]))
                said = "-" if tried is None else f"{tried.source}, {tried.reason}"
                print(f"  {name} {spec.name}: {said}", flush=True)
    for name, held in first.items():
        low, high = wilson(sum(held), len(held))
        print(f"{told.hand}: robot {name} held {sum(held)} of {len(held)} at the first try "
              f"({100 * low:.0f} to {100 * high:.0f} %) {dict(ends[name])}")  # fmt: skip
    known = [one for one in served if one[0]]
    print(
        f"of the {len(known)} that robot one held, robot two was served {sum(k[1] for k in known)} "
        f"from memory and held {sum(k[1] and k[2] for k in known)} of these; "
        f"load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
