"""The Berlin SPARQL Benchmark's explore mix over HTTP, beside `oxigraph serve` and rdflib-endpoint.

    python bench_bsbm.py
    python bench_bsbm.py --products 2550 --mixes 20 --rdflib-python VENV/bin/python

Each server holds the same shop (390 statements a product). Ours runs as people run it: the bundled
ontology, its rules and the closure, a folder on disk, a token for every request, limits, rates and
the log on; `oxigraph serve` has its folder on disk and none of these, rdflib-endpoint its data in
memory. One client asks one query after the other; each mix goes to every server in turn, in an
order that rotates, with the same parameters, after mixes that warm up and are not counted. All
answers are compared. CPU is that of a server with all its child processes. A server that is not
installed is skipped; for rdflib-endpoint name a Python that has it (`pip install
rdflib-endpoint==0.6.3 oxrdflib`).
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import http.client
import itertools
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import psutil
from pyoxigraph import RdfFormat, parse

from endpoint.access.tokens import TokenStore
from tests.benchmarks.endpoint.bench_endpoint import (
    JSON_TYPE,
    RDFLIB_SERVER,
    Peer,
    free_port,
    process,
)
from tests.benchmarks.endpoint.bench_http import Side
from tests.benchmarks.kb.bsbm import Shop
from tests.benchmarks.kb.bsbm_queries import MIX, Question, mixes
from tests.servers import running_server

GRAPH = "urn:bsbm"
_STRING = "http://www.w3.org/2001/XMLSchema#string"
Answer = list[Any]


@dataclass
class Server:
    """A server under test and what was measured of it.

    Attributes
    ----------
    load_cpu_s : float
        CPU time of loading, its program's start included.
    times_s : dict
        Clock times of single answers, by number of the query.
    mix_s, mix_cpu_s : list of float
        Clock time and server's CPU time of whole mixes.
    """

    peer: Peer
    load_cpu_s: float
    times_s: dict[int, list[float]] = field(default_factory=lambda: collections.defaultdict(list))
    mix_s: list[float] = field(default_factory=list)
    mix_cpu_s: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._side = Side(self.peer)
        self._connection = http.client.HTTPConnection("127.0.0.1", self.peer.port, timeout=300)

    def ask(self, mix: list[Question], counted: bool) -> list[tuple[str, bytes]]:
        """Ask the queries of a mix one after the other; return media types and bodies."""
        answers = []
        self._connection.close()  # it may have been idle for too long
        self._connection.connect()
        cpu, spent = self._side.cpu_s(), 0.0
        for question in mix:
            accept = "text/turtle" if question.is_graph else JSON_TYPE
            headers = {"Accept": accept}
            if self.peer.token:
                headers["Authorization"] = f"Bearer {self.peer.token}"
            address = "/query?" + urlencode({"query": question.text})
            started = time.perf_counter()
            self._connection.request("GET", address, headers=headers)
            answer = self._connection.getresponse()
            body = answer.read()
            taken = time.perf_counter() - started
            spent += taken
            if answer.status != http.HTTPStatus.OK:
                raise SystemExit(f"{self.peer.name}: {answer.status} {body[:500]!r}")
            answers.append((answer.getheader("Content-Type", "").partition(";")[0], body))
            if counted:
                self.times_s[question.number].append(taken)
        if counted:
            self.mix_s.append(spent)
            self.mix_cpu_s.append(self._side.cpu_s() - cpu)
        return answers

    def memory_mb(self) -> float:
        """Return the memory of the server and its child processes, shared pages divided."""
        server = psutil.Process(self.peer.pid)
        family = [server, *server.children(recursive=True)]
        return sum(one.memory_full_info().pss for one in family) / 1e6


def content(question: Question, media_type: str, body: bytes) -> Answer:
    """Return the rows or statements of an answer, sorted, in a form that can be compared."""
    if question.is_graph:
        # rdflib-endpoint 0.6.3 sends a DESCRIBE's RDF/XML as "application/sparql-results+xml".
        form = RdfFormat.from_media_type(media_type) or RdfFormat.RDF_XML
        return sorted({str(quad.triple) for quad in parse(body, format=form)})
    return sorted(
        sorted((name, *_term(term)) for name, term in row.items())
        for row in json.loads(body)["results"]["bindings"]
    )


def _term(term: dict[str, str]) -> tuple[str, ...]:
    datatype = term.get("datatype", "")
    is_plain = datatype == _STRING
    return term["type"], term["value"], "" if is_plain else datatype, term.get("xml:lang", "")


def _cpu_of(command: list[str]) -> float:
    """Run a command to its end; return the CPU time that it took with its children."""
    before = os.times()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )


def servers(
    stack: contextlib.ExitStack, folder: Path, file: Path, rdflib_python: str
) -> Iterator[Server]:
    """Load the file and start the servers, one after the other."""
    data = folder / "rtask"
    rtask_program = [sys.executable, "-m", "rtask"]
    _cpu_of([*rtask_program, "load", "-d", str(data)])
    cpu = _cpu_of([*rtask_program, "load", str(file), "--graph", GRAPH, "-d", str(data)])
    with contextlib.closing(TokenStore(data)) as store:
        token = store.create("admin")[0]
    server = stack.enter_context(running_server(data))
    yield Server(Peer("rtask", server.port, server.process.pid, token), cpu)
    binary = shutil.which("oxigraph", path=str(Path(sys.executable).parent))
    if binary is None:
        print("oxigraph serve: skipped: pip install oxigraph")
    else:
        place = ["-l", str(folder / "oxigraph")]
        cpu = _cpu_of([binary, "load", *place, "-f", str(file)])
        port = free_port()
        pid = stack.enter_context(
            process([binary, "serve", *place, "-b", f"127.0.0.1:{port}"], port)
        )
        yield Server(Peer("oxigraph serve", port, pid), cpu)
    probe = [rdflib_python, "-W", "ignore", "-c", "import rdflib_endpoint, oxrdflib"]
    if subprocess.run(probe, check=False, capture_output=True).returncode:
        print("rdflib-endpoint: skipped: pip install rdflib-endpoint oxrdflib (--rdflib-python)")
    else:
        port = free_port()
        command = [rdflib_python, "-W", "ignore", "-c", RDFLIB_SERVER, str(file), str(port)]
        peer = Peer("rdflib-endpoint", port, stack.enter_context(process(command, port, 1_200)))
        yield Server(peer, Side(peer).cpu_s())


def compare(shop: Shop, all_servers: list[Server], warm_up: int, counted: int) -> dict[int, int]:
    """Ask all mixes; return how many answers of each query differed, of the counted mixes."""
    differing = dict.fromkeys(sorted(set(MIX)), 0)
    for number, mix in enumerate(itertools.islice(mixes(shop), warm_up + counted)):
        at = number % len(all_servers)
        answers = {
            server.peer.name: server.ask(mix, number >= warm_up)
            for server in [*all_servers[at:], *all_servers[:at]]
        }
        if number < warm_up:
            continue
        for position, question in enumerate(mix):
            contents = [content(question, *answers[s.peer.name][position]) for s in all_servers]
            differing[question.number] += any(one != contents[0] for one in contents)
    return differing


def report(all_servers: list[Server], differing: dict[int, int]) -> None:
    """Print what was measured."""
    names = "".join(f"{server.peer.name:>18s}" for server in all_servers)
    print(f"{'':28s}{names}")
    rows: list[tuple[str, list[str]]] = [
        ("load, s CPU", [f"{s.load_cpu_s:.1f}" for s in all_servers]),
        ("memory while serving, MB", [f"{s.memory_mb():.0f}" for s in all_servers]),
        ("mix, ms (median)", [f"{1e3 * statistics.median(s.mix_s):.1f}" for s in all_servers]),
        ("mixes an hour (mean)", [f"{3600 / statistics.mean(s.mix_s):.0f}" for s in all_servers]),
        ("mix, ms CPU (mean)", [f"{1e3 * statistics.mean(s.mix_cpu_s):.1f}" for s in all_servers]),
    ]
    for number in differing:
        medians = [f"{1e3 * statistics.median(s.times_s[number]):.2f}" for s in all_servers]
        rows.append((f"query {number}, ms (median)", medians))
    for title, values in rows:
        print(f"{title:28s}" + "".join(f"{value:>18s}" for value in values))
    first, *others = all_servers
    for other in others:
        clock = statistics.median(
            ours / theirs for ours, theirs in zip(first.mix_s, other.mix_s, strict=True)
        )
        cpu = sum(first.mix_cpu_s) / sum(other.mix_cpu_s)
        name = other.peer.name
        print(f"ours / {name}: {clock:.2f} by the clock (median of pairs), {cpu:.2f} by CPU")
    wrong = {number: count for number, count in differing.items() if count}
    print(f"answers that differ: {wrong or 'none'}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--products", type=int, default=255, help="255: 100,000 statements")
    parser.add_argument("--mixes", type=int, default=50)
    parser.add_argument("--warm-up", type=int, default=10, metavar="MIXES")
    parser.add_argument("--rdflib-python", default=sys.executable, metavar="PROGRAM")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        folder, shop = Path(place), Shop(options.products)
        file = folder / "shop.nt"
        with file.open("w", encoding="utf-8") as out:
            out.writelines(shop.lines())
        statements = sum(1 for _ in file.open("rb"))
        size = f"{options.products} products, {statements:,} statements"
        size += f", {file.stat().st_size / 1e6:.0f} MB"
        print(f"{size}; load average {os.getloadavg()[0]:.1f}", flush=True)
        all_servers = list(servers(stack, folder, file, options.rdflib_python))
        differing = compare(shop, all_servers, options.warm_up, options.mixes)
        report(all_servers, differing)
        print(f"load average after {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
