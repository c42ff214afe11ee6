"""Processor time of one small SELECT over HTTP, beside ``oxigraph serve`` with the same statements.

``python tests/benchmarks/endpoint/bench_http.py`` starts both servers and asks them in turn, so
that what else the machine does burdens both. Ours runs as people run it: a data folder, a token
for every request, limits, rates and the log on. The time counts the server and all its child
processes.

Queries: ``star``, the 24 statements about one thing (3 kB); ``two``, two patterns joined from a
constant subject; ``rev``, two patterns joined from a constant object; ``optional``, ``path``
(three steps) and ``closure`` (one or more steps, fourteen things) from a constant subject;
``counts`` and ``group``, aggregates over all statements and over those about some things. ``post``,
``header`` and ``new`` ask ``two`` by POST, with a header that changes, and with a connection of its
own for each request. All of these ask about another thing each time and run without the answer
cache, which serves ``repeated``: fifty texts of the first three kinds again and again. ``commits``
inserts three statements at a time. Last, the time of a point query beside four long ones.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import importlib.metadata
import os
import shutil
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import httpx
import psutil

import rtask
from endpoint.access.tokens import TokenStore
from tests.benchmarks.endpoint.bench_endpoint import (
    JSON_TYPE,
    Asker,
    Peer,
    free_port,
    process,
)
from tests.servers import RTASK, running_server

THINGS, EACH = 2_000, 24
CONNECTIONS, SECONDS, ROUNDS = 8, 2.0, 3
LONG_ONES, POINTS = 4, 400
INDIRECT = (sys.executable, "-m", "tests.benchmarks.endpoint.without_direct")
KINDS = {
    "star": "SELECT ?p ?o WHERE {{ <urn:bench:s{n}> ?p ?o }}",
    "two": "SELECT ?o ?q WHERE {{ <urn:bench:s{n}> <urn:bench:p1> ?o . ?o <urn:bench:p2> ?q }}",
    "rev": "SELECT ?s ?q WHERE {{ ?s <urn:bench:p1> <urn:bench:s{n}> . ?s <urn:bench:p3> ?q }}",
    "optional": "SELECT ?o ?q WHERE {{ <urn:bench:s{n}> <urn:bench:p1> ?o "
    "OPTIONAL {{ ?o <urn:bench:p2> ?q }} }}",
    "path": "SELECT ?o WHERE {{ <urn:bench:s{n}> <urn:bench:p1>/<urn:bench:p2>/"
    "<urn:bench:p3> ?o }}",
    "closure": "SELECT ?o WHERE {{ <urn:bench:s{n}> <urn:bench:in>+ ?o }}",
    "counts": "SELECT ?p (COUNT(?o) AS ?n) WHERE {{ ?s ?p ?o }} GROUP BY ?p ORDER BY ?p OFFSET {n}",
    "group": "SELECT ?p (COUNT(*) AS ?n) WHERE {{ ?s <urn:bench:p1> <urn:bench:s{n}> . ?s ?q ?o . "
    "?o ?p ?z }} GROUP BY ?p",
}
MANNERS = ("post", "header", "new")
LONG = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f FILTER(?c != ?f && STRLEN(STR(?a)) > 3) }"
TARGETS = {
    **dict.fromkeys((*KINDS, *MANNERS), 1.5),
    "path": 2.0,
    "closure": 2.0,
    "counts": 1.0,
    "group": 1.0,
    "repeated": 0.8,
}
_CHAIN = 15


@dataclass(frozen=True)
class Side:
    """One server under test."""

    peer: Peer
    tokens: tuple[str, ...] = ("",)
    """Of several callers, as the server limits how many requests of one are in progress."""

    def cpu_s(self) -> float:
        """Return the processor time of the server and all its children, ended ones included."""
        total = 0.0
        server = psutil.Process(self.peer.pid)
        for one in (server, *server.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):
                times = one.cpu_times()
                total += times.user + times.system
                total += times.children_user + times.children_system
        return total


def texts(kind: str) -> list[str]:
    """Return the queries of one kind."""
    if kind == "repeated":
        return [list(KINDS.values())[i % 3].format(n=i) for i in range(50)]
    text = KINDS["two" if kind in MANNERS else kind]
    return [text.format(n=i * 7 % THINGS) for i in range(THINGS)]


def requests_of(kind: str, side: Side) -> list[bytes]:
    """Return the requests of one kind."""
    return [
        request_of(kind, replace(side.peer, token=side.tokens[n % len(side.tokens)]), text, n)
        for n, text in enumerate(texts(kind))
    ]


def request_of(kind: str, peer: Peer, text: str, n: int) -> bytes:
    """Return the bytes of the n-th request of a kind."""
    if kind != "post":
        more = f"X-Step: {n}\r\n\r\n" if kind == "header" else "\r\n"
        more = "Connection: close\r\n\r\n" if kind == "new" else more
        return peer.request(text)[:-2] + more.encode()
    who = f"Authorization: Bearer {peer.token}\r\n" if peer.token else ""
    return (
        f"POST /query HTTP/1.1\r\nHost: 127.0.0.1:{peer.port}\r\nAccept: {JSON_TYPE}\r\n{who}"
        f"Content-Type: application/sparql-query\r\nContent-Length: {len(text)}\r\n\r\n{text}"
    ).encode()


async def _ask_anew(peer: Peer, requests: list[bytes], seconds: float) -> list[float]:
    """Ask with a connection for each request."""
    times: list[float] = []
    until = time.perf_counter() + seconds

    async def ask(start: int) -> None:
        at = start
        while time.perf_counter() < until:
            started = time.perf_counter()
            reader, writer = await asyncio.open_connection("127.0.0.1", peer.port)
            writer.write(requests[at % len(requests)])
            answer = await reader.read()
            writer.close()
            if not answer.startswith(b"HTTP/1.1 200"):
                raise SystemExit(f"{peer.name}: an answer was not 200")
            times.append(time.perf_counter() - started)
            at += CONNECTIONS

    await asyncio.gather(*(ask(start) for start in range(CONNECTIONS)))
    return times


async def _ask(peer: Peer, requests: list[bytes], seconds: float, clients: int) -> list[float]:
    if b"\r\nConnection: close\r\n" in requests[0]:
        return await _ask_anew(peer, requests, seconds)
    loop, done = asyncio.get_running_loop(), asyncio.Event()
    pairs = [
        await loop.create_connection(
            lambda start=start: Asker(requests, start, done), "127.0.0.1", peer.port
        )
        for start in range(clients)
    ]
    await asyncio.sleep(seconds)
    done.set()
    await asyncio.sleep(0.05)
    for transport, _ in pairs:
        transport.close()
    faults = sum(asker.faults for _, asker in pairs)
    if faults:
        raise SystemExit(f"{peer.name}: {faults} answers were not 200")
    return [spent for _, asker in pairs for spent in asker.times]


def cost_us(side: Side, requests: list[bytes], clients: int = CONNECTIONS) -> float:
    """Return the processor time of one request, µs, while all connections are kept busy."""
    before = side.cpu_s()
    times = asyncio.run(_ask(side.peer, requests, SECONDS, clients))
    return 1e6 * (side.cpu_s() - before) / len(times)


def commits_us(sides: list[Side]) -> dict[str, float]:
    """Insert three statements at a time, in turns; return the median cost of a commit, µs."""
    found: dict[str, list[float]] = {side.peer.name: [] for side in sides}
    for number in range(ROUNDS + 1):
        for side in sides:
            before, count = side.cpu_s(), 0
            until = time.perf_counter() + SECONDS
            base = f"http://127.0.0.1:{side.peer.port}"
            headers = {"Content-Type": "application/sparql-update"}
            if side.peer.token:
                headers["Authorization"] = f"Bearer {side.peer.token}"
            with httpx.Client(base_url=base, headers=headers, timeout=60) as client:
                while time.perf_counter() < until:
                    thing = f"<urn:bench:new{number}-{count}>"
                    text = f"INSERT DATA {{ {thing} <urn:a> 1 ; <urn:b> 'x' ; <urn:c> <urn:d> }}"
                    client.post("/update", content=text).raise_for_status()
                    count += 1
            if number:
                found[side.peer.name].append(1e6 * (side.cpu_s() - before) / count)
    return {name: statistics.median(costs) for name, costs in found.items()}


def compare(kind: str, sides: list[Side], clients: int = CONNECTIONS) -> dict[str, float]:
    """Ask all servers in turn, several rounds; return the median cost of each, µs."""
    requests = {side.peer.name: requests_of(kind, side) for side in sides}
    found: dict[str, list[float]] = {side.peer.name: [] for side in sides}
    for number in range(ROUNDS + 1):
        for side in sides:
            cost = cost_us(side, requests[side.peer.name], clients)
            if number:  # the first round warms up
                found[side.peer.name].append(cost)
    return {name: statistics.median(costs) for name, costs in found.items()}


def point_times(url: str, token: str, first: int) -> list[float]:
    """Return the sorted times of point queries that are asked one after another, ms."""
    times = []
    with httpx.Client(base_url=url, headers={"Authorization": f"Bearer {token}"}) as client:
        for number in range(POINTS):
            text = KINDS["two"].format(n=first + number)
            started = time.perf_counter()
            client.get("/query", params={"query": text}).raise_for_status()
            times.append(1e3 * (time.perf_counter() - started))
    return sorted(times)


@contextlib.contextmanager
def long_queries(url: str, token: str) -> Iterator[None]:
    """Keep some long queries running."""
    ended = threading.Event()

    def ask() -> None:
        headers = {"Authorization": f"Bearer {token}"}
        while not ended.is_set():
            with contextlib.suppress(httpx.HTTPError):
                params = {"query": LONG, "timeout": "3"}
                httpx.get(f"{url}/query", params=params, headers=headers, timeout=30)

    threads = [threading.Thread(target=ask) for _ in range(LONG_ONES)]
    for thread in threads:
        thread.start()
    time.sleep(1.0)
    try:
        yield
    finally:
        ended.set()
        for thread in threads:
            thread.join()


def start(
    stack: contextlib.ExitStack, folder: Path, with_indirect: bool
) -> tuple[list[Side], list[Side], str, str]:
    """Start the servers; return those without answer cache, those with it, an address, a token."""
    triples = "".join(
        f"<urn:bench:s{i}> <urn:bench:p{p}> <urn:bench:s{(i * 31 + p) % THINGS}> .\n"
        for i in range(THINGS)
        for p in range(EACH)
    ) + "".join(
        f"<urn:bench:s{i}> <urn:bench:in> <urn:bench:s{i + 1}> .\n"
        for i in range(THINGS)
        if i % _CHAIN != _CHAIN - 1
    )
    ours, tokens, url = [], [], ""
    setups: list[tuple[str, list[str], tuple[str, ...]]] = [
        ("rtask", ["--no-cache"], RTASK), ("rtask, cache", [], RTASK),
    ]  # fmt: skip
    if with_indirect:
        setups.append(("rtask, indirect", ["--no-cache"], INDIRECT))
    for name, options, command in setups:
        data = folder / name.replace(", ", "-")
        rtask.open(data).close()
        with contextlib.closing(TokenStore(data)) as store:
            token, *more = (store.create("admin")[0] for _ in range(CONNECTIONS))
        # The rate is above what one machine can ask, so that the limiter works and does not bite.
        rates = ["--rate", "1e6", "--write-rate", "1e6"]
        server = stack.enter_context(running_server(data, *rates, *options, command=command))
        httpx.put(
            f"{server.url}/store?graph=urn:benchmark",
            content=triples,
            headers={"Authorization": f"Bearer {token}", "Content-Type": "application/n-triples"},
            timeout=300,
        ).raise_for_status()
        ours.append(Side(Peer(name, server.port, server.process.pid, token), (token, *more)))
        tokens.append(token)
        url = url or server.url
    others = []
    binary = Path(sys.executable).parent / "oxigraph"
    if shutil.which(str(binary)):
        port = free_port()
        serve = [str(binary), "serve", "-l", str(folder / "other"), "--bind", f"127.0.0.1:{port}"]
        pid = stack.enter_context(process(serve, port))
        headers = {"Content-Type": "application/n-triples"}
        httpx.post(
            f"http://127.0.0.1:{port}/store?default", content=triples, headers=headers, timeout=300
        )
        others.append(Side(Peer("oxigraph serve", port, pid)))
    return [ours[0], *others, *ours[2:]], [ours[1], *others], url, tokens[0]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    every = [*KINDS, *MANNERS, "repeated", "commits", "beside"]
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(every)}")
    parser.add_argument("--clients", type=int, default=CONNECTIONS, help="default: %(default)s")
    help_ = "also ask a server that answers nothing in its protocol, as without endpoint/direct"
    parser.add_argument("--indirect", action="store_true", help=help_)
    options = parser.parse_args()
    kinds = options.kinds or every
    if unknown := set(kinds) - set(every):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; choose from {', '.join(every)}")
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        plain, cached, url, token = start(stack, Path(folder), options.indirect)
        for name in ("pyoxigraph", "oxigraph", "uvicorn", "uvloop", "httptools"):
            with contextlib.suppress(importlib.metadata.PackageNotFoundError):
                print(name, importlib.metadata.version(name), end="; ")
        print(f"load average before {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
        clients = options.clients
        print(f"CPU of one request, {clients} connections, {ROUNDS} rounds of {SECONDS:g} s:")
        for kind in kinds:
            if kind == "beside":
                continue
            if kind == "commits":
                costs = commits_us(plain)
            else:
                costs = compare(kind, cached if kind == "repeated" else plain, clients)
            line = ", ".join(f"{name} {cost:5.0f} µs" for name, cost in costs.items())
            own, *rest = costs.values()
            ratio = f"; ours / theirs {own / rest[0]:.2f}" if rest else ""
            target = f" (target {TARGETS[kind]:g})" if kind in TARGETS else ""
            print(f"  {kind:9} {line}{ratio}{target}", flush=True)
        if "beside" in kinds:
            point_times(url, token, 0)
            alone = point_times(url, token, POINTS)
            with long_queries(url, token):
                beside = point_times(url, token, 2 * POINTS)
            at = int(0.99 * POINTS)
            print(
                f"point query: median {alone[POINTS // 2]:.1f} ms, p99 {alone[at]:.1f} ms; beside "
                f"{LONG_ONES} long ones: median {beside[POINTS // 2]:.1f} ms, "
                f"p99 {beside[at]:.1f} ms ({beside[at] / alone[at]:.1f} times; target 3)"
            )
        print(f"load average after {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
