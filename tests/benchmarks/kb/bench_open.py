"""Time until a knowledge base can be written again after it was opened.

    python tests/benchmarks/kb/bench_open.py
    python tests/benchmarks/kb/bench_open.py --triples 1000000 --rounds 3

A folder with the ontology, its rules and a robot's attempts is opened by a process of its own,
which commits three statements: once with the closure that the folder keeps, once without it. Both
sides are interleaved; the median of CPU seconds counts, the imports that the first commit needs
included. Then a writer is killed with SIGKILL after a while of commits, and the folder is opened
and written to again.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_RT = "https://w3id.org/rtask-kg/ns#"


def _statements(number: int) -> str:
    return (
        f"INSERT DATA {{ <urn:grasp{number}> a <{_RT}SpatialGrasp> ; "
        f"<{_RT}graspOf> <https://example.org/lab/object0> ; <{_RT}graspPose> <urn:pose{number}> }}"
    )


def prepare(folder: Path, triples: int) -> None:
    """Make the knowledge base."""
    import rtask
    from tests.benchmarks.kb.bench_load import write_robot_file

    file = folder.parent / "robot.nt"
    write_robot_file(file, triples)
    with rtask.open(folder) as kb:
        kb.load(file)


def first_write(folder: Path) -> dict[str, float]:
    """Open, commit once, and end without closing."""
    import rtask

    clock, cpu = time.perf_counter(), time.process_time()
    kb = rtask.open(folder)
    opened = time.process_time()
    number = kb.seq
    kb.update(_statements(number), agent="nao-1")
    written = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "open": opened - cpu,
        "first write": written - opened,
        "clock": time.perf_counter() - clock,
        "peak": peak,
    }


def write(folder: Path) -> None:
    """Commit until killed."""
    import rtask

    with rtask.open(folder) as kb:
        for number in range(10_000_000):
            kb.update(_statements(number), agent="nao-1")
            print(kb.seq, flush=True)


def _run(folder: Path, what: str, triples: int = 0) -> str:
    command = [sys.executable, __file__, "--do", what, "--folder", str(folder)]
    command += ["--triples", str(triples)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def after_a_kill(folder: Path, seconds: float) -> tuple[int, dict[str, float]]:
    """Return how many commits were killed in the middle, and what opening took then."""
    command = [sys.executable, __file__, "--do", "write", "--folder", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        first = int(child.stdout.readline())
        os.set_blocking(child.stdout.fileno(), True)
        time.sleep(seconds)
        child.send_signal(signal.SIGKILL)
        lines = child.stdout.read().splitlines()
    return int(lines[-2]) - first, json.loads(_run(folder, "first"))


def main() -> None:
    """Measure in processes of their own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triples", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=50.0, help="of commits before the kill")
    parser.add_argument("--do", choices=("prepare", "first", "write"), help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.do == "prepare":
        prepare(options.folder, options.triples)
    elif options.do == "write":
        write(options.folder)
    elif options.do == "first":
        print(json.dumps(first_write(options.folder)), flush=True)
        os._exit(0)
    if options.do:
        return
    with tempfile.TemporaryDirectory() as place:
        folder, bare = Path(place) / "kb", Path(place) / "bare"
        _run(folder, "prepare", options.triples)
        load = os.getloadavg()[0]
        print(f"{options.triples} triples; load average {load:.1f} on {os.cpu_count()} cores")
        found: dict[str, list[dict[str, float]]] = {"saved closure": [], "rebuilt": []}
        for _ in range(options.rounds):
            for side, runs in found.items():
                shutil.rmtree(bare, ignore_errors=True)
                shutil.copytree(folder, bare)
                if side == "rebuilt":
                    for path in bare.glob("closure-*"):
                        shutil.rmtree(path)
                runs.append(json.loads(_run(bare, "first")))
        print(f"{'':16s}{'open':>8s}{'first write':>13s}{'peak MB':>9s}   CPU seconds")
        for side, runs in found.items():
            middle = {key: statistics.median(run[key] for run in runs) for key in runs[0]}
            print(
                f"{side:16s}{middle['open']:8.2f}{middle['first write']:13.2f}{middle['peak']:9.0f}"
            )
        commits, opened = after_a_kill(folder, options.seconds)
        print(
            f"killed after {commits} commits in {options.seconds:.0f} s: written again after "
            f"{opened['open'] + opened['first write']:.2f} s of CPU, {opened['clock']:.2f} s"
        )


if __name__ == "__main__":
    main()
