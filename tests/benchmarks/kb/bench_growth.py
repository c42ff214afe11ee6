"""Growth of costs with the graph on one machine, with the ontology, its rules and the closure.

    python -m tests.benchmarks.kb.bench_growth
    python -m tests.benchmarks.kb.bench_growth --sizes 10000 100000 1000000 --plot growth.png

Each stage is a process of its own: the load of a robot's grasps, poses, attempts and outcomes; the
opening of that folder and the first commit; then commits of one outcome each, and the query that
recalls the grasps of one object with what came of them. Memory is the peak of the process; disk is
the folder after the load. The exponent is the slope of a straight line through the logarithms: 1
grows with the graph, 0 does not grow. A stage that needs more memory than ``--gib`` is ended, and
said to be.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

import rtask
from tests.benchmarks.kb.bench_load import write_robot_file

_RT = "https://w3id.org/rtask-kg/ns#"
_LAB = "https://example.org/lab/"
_COMMITS, _RECALLS = 50, 50
_PER_OBJECT = 20 * 21 + 4
"""Statements that the file has for one object: twenty grasps with all that belongs to them."""

Figures = dict[str, float]


@dataclass(frozen=True)
class Row:
    """One figure: its name, its unit and how it is shown."""

    key: str
    text: str
    shown: str = "{:.2f}"


ROWS = (
    Row("load_s", "load, s CPU"),
    Row("load_mb", "load, peak MB", "{:.0f}"),
    Row("disk_mb", "on disk, MB", "{:.0f}"),
    Row("open_s", "opening, s CPU"),
    Row("first_s", "first commit after it, s CPU"),
    Row("open_mb", "opened and written to, peak MB", "{:.0f}"),
    Row("commit_ms", "commit of an outcome, ms CPU"),
    Row("recall_ms", "recall of an object's grasps, ms CPU"),
)


def load(folder: Path, triples: int) -> Figures:
    """Load the file beside the folder."""
    file = folder.with_suffix(".nt")
    write_robot_file(file, triples)
    start = time.process_time()
    with rtask.open(folder) as kb:
        kb.load(file)
    spent = time.process_time() - start
    disk = sum(one.stat().st_size for one in folder.rglob("*") if one.is_file())
    return {"load_s": spent, "load_mb": _peak_mb(), "disk_mb": disk / 1e6}


def use(folder: Path, triples: int) -> Figures:
    """Open the folder, commit outcomes one by one, recall grasps."""
    rng = random.Random(2)
    start = time.process_time()
    kb = rtask.open(folder)
    opened = time.process_time()
    kb.update(_outcome(0, rng), agent="nao-1")
    first = time.process_time()
    peak = _peak_mb()
    commits = [
        _cpu_ms(lambda number=number: kb.update(_outcome(number, rng), agent="nao-1"))
        for number in range(1, _COMMITS + 1)
    ]
    count = max(triples // _PER_OBJECT, 1)
    recalls = [
        _cpu_ms(lambda: list(kb.select(_recall(rng.randrange(count))))) for _ in range(_RECALLS)
    ]
    figures = {
        "open_s": opened - start,
        "first_s": first - opened,
        "open_mb": peak,
        "commit_ms": statistics.median(commits),
        "recall_ms": statistics.median(recalls),
    }
    kb.close()
    return figures


def _cpu_ms(action: Callable[[], object]) -> float:
    start = time.process_time()
    action()
    return (time.process_time() - start) * 1e3


def _outcome(number: int, rng: random.Random) -> str:
    """Return an update that reports one attempt at a grasp that is known."""
    held = "true" if rng.random() < 0.6 else "false"
    attempt, outcome = f"<{_LAB}new-attempt{number}>", f"<{_LAB}new-outcome{number}>"
    return (
        f"INSERT DATA {{ {attempt} a <{_RT}GraspAttempt> ; <{_RT}performedBy> <{_LAB}robot0> ; "
        f"<{_RT}executesGrasp> <{_LAB}grasp{rng.randrange(20)}> ; <{_RT}hasOutcome> {outcome} . "
        f"{outcome} a <{_RT}GraspOutcome> ; <{_RT}success> {held} }}"
    )


def _recall(number: int) -> str:
    """Return the query for the grasps of one object and how often each held."""
    return (
        f"SELECT ?grasp (SUM(IF(?held, 1, 0)) AS ?successes) (COUNT(?outcome) AS ?tried) WHERE {{ "
        f"?grasp <{_RT}graspOf> <{_LAB}object{number}> . ?attempt <{_RT}executesGrasp> ?grasp ; "
        f"<{_RT}hasOutcome> ?outcome . ?outcome <{_RT}success> ?held }} GROUP BY ?grasp"
    )


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


class OutOfMemoryError(RuntimeError):
    """A stage needed more than it was given."""


def run(stage: str, folder: Path, triples: int, limit_mb: float) -> Figures:
    """Carry out a stage in a process of its own, ended when it needs too much memory."""
    command = [sys.executable, "-m", "tests.benchmarks.kb.bench_growth", "--stage", stage]
    command += ["--folder", str(folder), "--sizes", str(triples)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        held = 0.0
        while True:
            try:
                told, _ = child.communicate(timeout=0.2)
                break
            except subprocess.TimeoutExpired:
                held = max(held, psutil.Process(child.pid).memory_info().rss / 2**20)
                if held > limit_mb:
                    child.kill()
                    raise OutOfMemoryError(f"{stage} held {held:.0f} MB") from None
    if child.returncode:
        raise OutOfMemoryError(f"{stage} ended with code {child.returncode}, at {held:.0f} MB")
    figures: Figures = json.loads(told)
    return figures


def exponent(sizes: list[int], values: list[float]) -> float:
    """Return the slope of log(value) over log(size)."""
    return float(np.polyfit(np.log(sizes), np.log(np.maximum(values, 1e-6)), 1)[0])


def plot(path: Path, found: Mapping[int, Figures]) -> None:
    """Draw all figures over the size, both axes logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(2, 4, figsize=(12, 5.2), sharex=True, layout="constrained")
    for panel, row in zip(panels.flat, ROWS, strict=True):
        values = [one[row.key] for one in found.values()]
        panel.loglog(list(found), values, "o-")
        panel.set_ylim(min(values) / 3, max(values) * 3)  # what does not grow looks flat
        panel.set_title(f"{row.text}\nexponent {exponent(list(found), values):.2f}", fontsize=9)
        panel.grid(visible=True, which="both", alpha=0.2)
    figure.supxlabel("triples of a robot")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure the sizes one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--gib", type=float, default=8.0, help="memory for one stage")
    parser.add_argument("--plot", type=Path, help="picture to write")
    parser.add_argument("--stage", choices=("load", "use"), help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.stage:
        stage = load if options.stage == "load" else use
        print(json.dumps(stage(options.folder, options.sizes[0])))
        return
    found: dict[int, Figures] = {}
    for size in sorted(options.sizes):
        print(f"{size} triples at load {os.getloadavg()[0]:.1f}", file=sys.stderr)
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "kb"
            try:
                found[size] = run("load", folder, size, options.gib * 1024)
                found[size] |= run("use", folder, size, options.gib * 1024)
            except OutOfMemoryError as error:
                print(f"{size} triples: {error}; the limit is {options.gib:g} GiB")
                found.pop(size, None)
                break
    print(f"{'':38s}" + "".join(f"{size:>12,}" for size in found) + f"{'exponent':>10s}")
    for row in ROWS:
        values = [one[row.key] for one in found.values()]
        slope = f"{exponent(list(found), values):10.2f}" if len(found) > 1 else ""
        print(f"{row.text:38s}" + "".join(f"{row.shown.format(v):>12s}" for v in values) + slope)
    if options.plot and len(found) > 1:
        plot(options.plot, found)


if __name__ == "__main__":
    main()
