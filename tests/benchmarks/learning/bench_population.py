"""What it costs to learn from all objects what hides in the next one.

    python -m tests.benchmarks.learning.bench_population [--attempts 1000 5000 20000] [--each 5]

A store in memory holds the attempts, as many at each object. Three times are of the processor: to
read the population again, which happens once more than a fiftieth of the outcomes have changed;
to take what was read; and to work out the prior of one object.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PROV, RT, reason
from tests.rtask.engine import conftest as bench

_LAB = "https://example.org/kb/"
_REAL = "<http://www.w3.org/2001/XMLSchema#double>"
_TIME = "<http://www.w3.org/2001/XMLSchema#dateTime>"
_BOOL = "<http://www.w3.org/2001/XMLSchema#boolean>"


def write_attempts(file: Path, attempts: int, each: int, robot: str, hand: str) -> None:
    """Write so many attempts as N-Triples, ``each`` of them at one object."""
    rng = np.random.default_rng(0)
    with file.open("w", encoding="utf-8") as lines:
        for number in range(attempts):
            thing = f"<{_LAB}object/t{number // each}>"
            if number % each == 0:
                for side, m in zip("XYZ", rng.uniform(0.02, 0.12, 3), strict=True):
                    lines.write(f'{thing} <{RT.x.value[:-1]}extent{side}> "{m:.4f}"^^{_REAL} .\n')
            of = {what: f"<{_LAB}{what}/t{number}>" for what in ("attempt", "grasp", "pose", "out")}
            held = bool(rng.random() < 0.6)
            facts = [
                (thing, RT.hasGrasp, of["grasp"]),
                (of["grasp"], RT.graspPose, of["pose"]),
                (of["pose"], RT.theta, f'"1.57"^^{_REAL}'),
                (of["pose"], RT.x, f'"{rng.uniform(-0.03, 0.03):.4f}"^^{_REAL}'),
                (of["attempt"], RT.executesGrasp, of["grasp"]),
                (of["attempt"], RT.performedBy, f"<{robot}>"),
                (of["attempt"], RT.activates, f"<{hand}>"),
                (of["attempt"], PROV.endedAtTime, f'"{_moment(number)}"^^{_TIME}'),
                (of["attempt"], RT.hasOutcome, of["out"]),
                (of["out"], RT.success, f'"{str(held).lower()}"^^{_BOOL}'),
                (of["out"], RT.hasReason, str(reason("ok" if held else "slip_lift"))),
            ]
            lines.writelines(f"{s} {p} {o} .\n" for s, p, o in facts)


def _moment(number: int) -> str:
    minutes, seconds = divmod(number, 60)
    hours, minutes = divmod(minutes, 60)
    return f"2026-01-{1 + hours // 24:02}T{hours % 24:02}:{minutes:02}:{seconds:02}Z"


def measured(attempts: int, each: int, repeats: int) -> tuple[int, dict[str, float]]:
    """Return the number of objects of the population, and median CPU by what is done, ms."""
    with (
        tempfile.TemporaryDirectory() as folder,
        rtask.open(":memory:", base=_LAB, reason=False) as kb,
        Engine(kb) as engine,
    ):
        robot = bench.Robot("nao-1", engine)
        robot.register()
        [hand] = [stored.iri.value for stored in engine.context.grippers.all()]
        file = Path(folder) / "attempts.nt"
        write_attempts(file, attempts, each, f"{_LAB}robot/nao-1", hand)
        kb.load(file)
        population = engine.context.population

        def again() -> None:
            population._cached = None
            population.now()

        size = (0.08, 0.05, 0.04)
        took = {
            "read again": _cpu_ms(again, repeats),
            "take": _cpu_ms(population.now, repeats),
            "prior": _cpu_ms(lambda: population.now().prior_of(size), repeats),
        }
        return len(population.now()), took


def _cpu_ms(action: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.process_time()
        action()
        times.append(1e3 * (time.process_time() - start))
    return statistics.median(times)


def main() -> None:
    """Print a row for each number of attempts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--attempts", type=int, nargs="+", default=[1_000, 5_000, 20_000])
    parser.add_argument("--each", type=int, default=5, help="attempts at one object")
    parser.add_argument("--repeats", type=int, default=5)
    asked = parser.parse_args()
    print("attempts\tobjects\tread_again_ms\ttake_ms\tprior_ms")
    for attempts in asked.attempts:
        objects, took = measured(attempts, asked.each, asked.repeats)
        row = "\t".join(f"{value:.1f}" for value in took.values())
        print(f"{attempts}\t{objects}\t{row}", flush=True)


if __name__ == "__main__":
    main()
