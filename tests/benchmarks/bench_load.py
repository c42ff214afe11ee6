"""How fast files are loaded, beside the store's own bulk loader; memory while it is done.

    python tests/benchmarks/bench_load.py
    python tests/benchmarks/bench_load.py --triples 1000000 --rounds 5

Each line is a process of its own on a fresh folder; rounds are interleaved and the median counts.
The peer writes the same N-Triples file into one named graph with `Store.bulk_load` and flushes.
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
from pathlib import Path

_RT = "https://w3id.org/rtask-kg/ns#"
_SIDES = ("raw", "view", "merged", "merged, closure")


def write_file(path: Path, triples: int) -> None:
    """Write objects with five statements each."""
    rng = random.Random(1)
    kind = "<http://www.w3.org/1999/02/22-rdf-syntax-ns#type>"
    double = "<http://www.w3.org/2001/XMLSchema#double>"
    count = triples // 5
    with path.open("w") as out:
        for number in range(count):
            thing = f"<https://example.org/lab/object/{number}>"
            near = f"<https://example.org/lab/object/{rng.randrange(count)}>"
            out.write(f"{thing} {kind} <https://example.org/lab/Mug> .\n")
            out.write(f'{thing} <{_RT}mass> "{rng.random():.6f}"^^{double} .\n')
            out.write(f'{thing} <{_RT}objectId> "lab/mug-{number}" .\n')
            out.write(f'{thing} <https://example.org/lab/name> "mug number {number}" .\n')
            out.write(f"{thing} <https://example.org/lab/near> {near} .\n")


def load(side: str, file: Path, folder: Path) -> dict[str, float]:
    """Load once; return seconds and megabytes."""
    if side == "raw":
        import pyoxigraph as ox

        store = ox.Store(folder)
        start = time.perf_counter()
        graph = ox.NamedNode("urn:g")
        store.bulk_load(path=str(file), format=ox.RdfFormat.N_TRIPLES, to_graph=graph)
        store.flush()
        seconds = time.perf_counter() - start
    else:
        import rtask

        union = side.partition(",")[0]
        reason = "closure" in side
        with rtask.open(folder, union=union, reason=reason, ontologies=False) as kb:
            start = time.perf_counter()
            kb.load(file)
            seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"seconds": seconds, "peak": peak}


def main() -> None:
    """Measure in processes of their own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triples", type=int, default=300_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--side", help=argparse.SUPPRESS)
    parser.add_argument("--file", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.side:
        print(json.dumps(load(options.side, options.file, options.folder)))
        return
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "objects.nt"
        write_file(file, options.triples)
        print(
            f"{options.triples} triples, {file.stat().st_size / 1e6:.0f} MB; "
            f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
        )
        found: dict[str, list[dict[str, float]]] = {side: [] for side in _SIDES}
        for number in range(options.rounds):
            for side in _SIDES:
                folder = Path(place) / f"{side} {number}"
                command = [sys.executable, __file__, "--side", side]
                command += ["--file", str(file), "--folder", str(folder)]
                answer = subprocess.run(command, capture_output=True, text=True, check=True)
                found[side].append(json.loads(answer.stdout))
    raw = statistics.median(run["seconds"] for run in found["raw"])
    print(f"{'':18s}{'seconds':>9s}{'triples/s':>11s}{'ratio':>7s}{'peak MB':>9s}")
    for side, runs in found.items():
        seconds = statistics.median(run["seconds"] for run in runs)
        peak = max(run["peak"] for run in runs)
        rate = options.triples / seconds
        print(f"{side:18s}{seconds:9.2f}{rate:11.0f}{raw / seconds:7.2f}{peak:9.0f}")


if __name__ == "__main__":
    main()
