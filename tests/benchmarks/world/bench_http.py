"""A million sightings by the public way: `where_is` over HTTP, of any thing at any instant.

python tests/benchmarks/world/bench_http.py --sightings 1000000 --moved 0.05

The graph is what that many sightings leave: a placement for each time that a thing was moved, which
was confirmed until then. It is loaded in bulk, since reporting it takes half an hour, into a folder
that a server serves. Times are of the server's processor, all threads, for each request: first
while the server copies the graph to its readers, which takes the longer the larger the graph, then
once it has.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import httpx
import numpy as np
from bench_world import BASE, FRAME, STAY_S, placements

import rtask
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode, Quad, object_term
from rtask.world.statements import confirmed, ended, placed
from tests.servers import RunningServer, running_server

_THINGS = 300
_WHILE_FILLING = 100
_QUIET_S, _QUIET_SHARE = 2.0, 0.02


def write(path: Path, count: int) -> int:
    """Write the statements of so many placements as N-Quads; return their number."""
    graph, lines = NamedNode(f"{BASE}graph/agent/nao-1"), 0
    with path.open("w", encoding="utf-8") as file:
        for place in placements(count, _THINGS, np.random.default_rng(1)):
            statements = [*placed(place), confirmed(place.iri, place.confirmed)]
            statements += ended(place.iri, place.end) if place.end is not None else ()
            for subject, predicate, value in statements:
                file.write(f"{Quad(subject, predicate, object_term(value), graph)} .\n")
            lines += len(statements)
    return lines


def processor_s(pid: int) -> float:
    """Return the time that all threads of a process have run, s."""
    tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(task.read_text("ascii").split()[0]) for task in tasks) / 1e9


def settle(pid: int) -> float:
    """Wait until a process is idle but for what it is asked; return the time it ran meanwhile, s.

    A server that has just started fills its readers beside the questions, and what that takes of
    the processor cannot be told from what an answer takes.
    """
    start = latest = processor_s(pid)
    while True:
        time.sleep(_QUIET_S)
        before, latest = latest, processor_s(pid)
        if latest - before < _QUIET_SHARE * _QUIET_S:
            return latest - start


def ask(server: RunningServer, count: int, questions: int, seed: int) -> None:
    """Print the time of the first question, and the median and 95 % of so many more."""
    rng, pid = np.random.default_rng(seed), server.process.pid
    took = []
    with httpx.Client(base_url=server.url, timeout=900.0) as client:
        for _ in range(questions + 1):
            thing = int(rng.integers(_THINGS))
            instant = float(rng.uniform(_THINGS, STAY_S * (count // _THINGS)))
            start = processor_s(pid)
            question = {"name": f"{BASE}thing/{thing}", "stamp": instant}
            answer = client.post("/engine/where_is", json=question)
            took.append(1e3 * (processor_s(pid) - start))
            assert answer.json()["known"], answer.text
    print(f"first {took[0]:.0f} ms; then p50 {np.median(took[1:]):.2f} ms, p95 "
          f"{np.percentile(took[1:], 95):.2f} ms of {questions}", flush=True)  # fmt: skip


def main() -> None:
    """Print how long loading and asking take."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sightings", type=int, default=1_000_000)
    parser.add_argument("--moved", type=float, default=0.05)
    parser.add_argument("--questions", type=int, default=1_000)
    asked = parser.parse_args()
    count = round(asked.sightings * asked.moved)
    with tempfile.TemporaryDirectory() as folder:
        data, file = Path(folder) / "kb", Path(folder) / "places.nq"
        lines, start = write(file, count), time.process_time()
        with rtask.open(data, base=BASE) as kb:
            kb.load(file)
            products = " ".join(
                f'<{BASE}object/{k}> a rt:Mug ; rt:objectId "lab/{k}" . '
                f"<{BASE}thing/{k}> a rt:Exemplar ; rt:exemplarOf <{BASE}object/{k}> ."
                for k in range(_THINGS)
            )
            shared = f"GRAPH <{BASE}graph/shared>"
            kb.update(
                f"{PREFIXES} INSERT DATA {{ {shared} {{ <{FRAME}> a rt:Frame . {products} }} }}"
            )
        print(f"{asked.sightings} sightings, {count} places, {lines} statements, loaded in "
              f"{time.process_time() - start:.0f} s", flush=True)  # fmt: skip
        with running_server(data) as server:
            ask(server, count, min(asked.questions, _WHILE_FILLING), 2)
            print(f"readers filled after {settle(server.process.pid):.1f} s more", flush=True)
            ask(server, count, asked.questions, 3)


if __name__ == "__main__":
    main()
