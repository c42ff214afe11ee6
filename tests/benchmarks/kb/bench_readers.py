"""Queries through a reader, in this process, and by `oxigraph serve`, interleaved.

    python tests/benchmarks/kb/bench_readers.py
    python tests/benchmarks/kb/bench_readers.py --size 1000000 --rounds 5

All three hold the same triples in memory. `oxigraph serve` is left out where it is not installed
(`pip install oxigraph`). The rate of commits with and without readers shows what following costs.
"""

from __future__ import annotations

import argparse
import http.client
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from pyoxigraph import DefaultGraph, Literal, NamedNode, Quad, QueryResultsFormat, RdfFormat

import rtask
from rtask.errors import QueryTimeout
from rtask.kb.commit.commit import Request
from rtask.knowledge_base import KnowledgeBase

JSON = "application/sparql-results+json"
EVERYTHING = "SELECT * { ?s ?p ?o }"
POINT = "SELECT ?p ?o { <urn:thing:%d> ?p ?o }"
ENDLESS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"


def quads(size: int) -> Iterator[Quad]:
    """Yield statements, five of each thing."""
    for number in range(size // 5):
        thing = NamedNode(f"urn:thing:{number}")
        for at in range(5):
            value = Literal(f"the value {at} of thing {number}")
            yield Quad(thing, NamedNode(f"urn:property:{at}"), value, DefaultGraph())


class Sink:
    """Counts what is written; notes when the first byte came."""

    def __init__(self) -> None:
        self.size = 0
        self.first = 0.0

    def write(self, data: bytes) -> int:
        """Take bytes."""
        self.first = self.first or time.perf_counter()
        self.size += len(data)
        return len(data)

    def flush(self) -> None:
        """Nothing."""


def in_process(kb: KnowledgeBase, text: str) -> Sink:
    """Evaluate and serialise in this thread."""
    sink: Any = Sink()
    kb.store.query(text).serialize(sink, QueryResultsFormat.JSON)
    return sink  # type: ignore[no-any-return]


def through_reader(kb: KnowledgeBase, text: str) -> Sink:
    """Let a reader do it."""
    sink = Sink()
    with kb.stream(text, JSON, timeout_s=120.0) as stream:
        for piece in stream:
            sink.write(piece)
    return sink


class Server:
    """`oxigraph serve` with a store in memory."""

    def __init__(self, program: str, data: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.process = subprocess.Popen(
            [program, "serve", "--bind", f"127.0.0.1:{self.port}"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for _ in range(100):
            with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1.0):
                break
            time.sleep(0.1)
        self.http = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        self.http.request(
            "POST", "/store?default", data.read_bytes(), {"Content-Type": "application/n-triples"}
        )
        answer = self.http.getresponse()
        answer.read()
        assert answer.status < 300, answer.status

    def ask(self, text: str) -> Sink:
        """Send a query over a connection that stays open."""
        sink = Sink()
        self.http.request("GET", "/query?" + urlencode({"query": text}), headers={"Accept": JSON})
        answer = self.http.getresponse()
        while piece := answer.read(256 << 10):
            sink.write(piece)
        return sink

    def close(self) -> None:
        """End it."""
        self.http.close()
        self.process.kill()
        self.process.wait()


@contextmanager
def knowledge_base(size: int) -> Iterator[KnowledgeBase]:
    """Open a plain store in memory that holds the data."""
    with rtask.open(":memory:", plain=True) as kb:
        kb.bulk_add(quads(size), DefaultGraph(), Request(kb.access()))
        yield kb


Ask = Callable[[str], Sink]


def points(sides: dict[str, Ask], size: int, rounds: int) -> None:
    """Time queries for one thing."""
    times: dict[str, list[float]] = {name: [] for name in sides}
    for number in range(60 * rounds):
        for name, ask in sides.items():
            text = POINT % (number * 7 % (size // 5))
            started = time.perf_counter()
            ask(text)
            times[name].append(time.perf_counter() - started)
    base = statistics.median(
        times["oxigraph serve"] if "oxigraph serve" in times else times["here"]
    )
    print("\npoint query, median and 99th percentile, ms; ratio to the peer")
    for name, found in times.items():
        found.sort()
        middle, late = statistics.median(found), found[int(len(found) * 0.99)]
        print(f"  {name:16s} {middle * 1e3:8.3f} {late * 1e3:8.3f} {middle / base:8.2f}")


def streams(sides: dict[str, Ask], rounds: int) -> None:
    """Time the answer that holds everything."""
    rates: dict[str, list[float]] = {name: [] for name in sides}
    firsts: dict[str, list[float]] = {name: [] for name in sides}
    size = 0
    for _ in range(rounds):
        for name, ask in sides.items():
            started = time.perf_counter()
            sink = ask(EVERYTHING)
            size = sink.size
            rates[name].append(size / (time.perf_counter() - started) / 1e6)
            firsts[name].append(sink.first - started)
    peer = "oxigraph serve" if "oxigraph serve" in sides else "here"
    base = statistics.median(rates[peer])
    print(f"\nanswer of {size / 1e6:.0f} MB: MB/s, first byte in ms; ratio of rates to the peer")
    for name in sides:
        rate, first = statistics.median(rates[name]), statistics.median(firsts[name])
        print(f"  {name:16s} {rate:8.1f} {first * 1e3:8.2f} {rate / base:8.2f}")


def deadlines(kb: KnowledgeBase, rounds: int) -> None:
    """Time the end of a query that has no end, and the next one."""
    late, following = [], []
    for _ in range(rounds):
        started = time.perf_counter()
        with suppress(QueryTimeout):
            kb.query(ENDLESS, timeout_s=0.5)
        late.append(time.perf_counter() - started - 0.5)
        started = time.perf_counter()
        kb.query("ASK { ?s ?p ?o }", timeout_s=60.0)
        following.append(time.perf_counter() - started)
    print(f"\nkilled after its deadline: {statistics.median(late) * 1e3:.1f} ms (median)")
    print(f"the query after it:        {statistics.median(following) * 1e3:.1f} ms (median)")


def commits(rounds: int) -> None:
    """Count commits of three statements with no reader and with one that follows."""
    rates: dict[str, list[float]] = {"alone": [], "followed": []}
    with ExitStack() as stack:
        kbs = {n: stack.enter_context(rtask.open(":memory:", plain=True)) for n in rates}
        kbs["followed"].query("ASK {}", timeout_s=60.0)
        for turn in range(rounds):
            for name, kb in kbs.items():
                started = time.perf_counter()
                for number in range(1_000):
                    with kb.transaction() as tx:
                        for at in range(3):
                            tx.add(f"urn:{turn}:{number}", "urn:p", at)
                rates[name].append(1_000 / (time.perf_counter() - started))
    alone, followed = (statistics.median(rates[name]) for name in rates)
    print(
        f"\ncommits a second: {alone:.0f} alone, {followed:.0f} followed ({followed / alone:.2f})"
    )


def resident() -> int:
    """Return the bytes of this process."""
    with suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")
    return 0


def main() -> None:
    """Run everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--size", type=int, default=200_000, help="triples")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    print(f"{options.size} triples, {options.rounds} rounds, load {os.getloadavg()[0]:.1f}")
    with ExitStack() as stack:
        kb = stack.enter_context(knowledge_base(options.size))
        started = time.perf_counter()
        kb.query("ASK {}", timeout_s=600.0)
        print(f"replica ready after {time.perf_counter() - started:.2f} s")
        sides: dict[str, Ask] = {
            "here": lambda text: in_process(kb, text),
            "reader": lambda text: through_reader(kb, text),
        }
        beside = Path(sys.executable).with_name("oxigraph")
        program = str(beside) if beside.exists() else shutil.which("oxigraph")
        if program:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            kb.store.raw.dump(
                str(folder / "data.nt"), RdfFormat.N_TRIPLES, from_graph=DefaultGraph()
            )
            server = Server(program, folder / "data.nt")
            stack.callback(server.close)
            sides["oxigraph serve"] = server.ask
        points(sides, options.size, options.rounds)
        before = resident()
        streams(sides, options.rounds)
        print(f"this process grew by {(resident() - before) / 1e6:.0f} MB meanwhile")
        deadlines(kb, options.rounds)
    commits(options.rounds)
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
