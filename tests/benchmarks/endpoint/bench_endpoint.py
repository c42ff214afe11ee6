"""The endpoint beside rdflib-endpoint and oxigraph serve, on one machine, interleaved.

``python tests/benchmarks/endpoint/bench_endpoint.py`` starts three servers with the same 100,000
triples and asks them in turn. Ours runs as people run it: a token for every request, limits,
rates and the log on; the others have none of these. A peer that is not installed is left out and
named (``pip install rdflib-endpoint==0.6.3 oxrdflib oxigraph``).
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import importlib.metadata
import importlib.util
import json
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import httpx

import rtask
from endpoint.access.tokens import TokenStore
from tests.servers import RunningServer, running_server

SUBJECTS, EACH = 20_000, 5
CONNECTIONS, SECONDS, ROUNDS = 8, 2.0, 5
SOCKETS, ROBOTS = 1_000, 60
LOOKUP = "SELECT ?p ?o WHERE {{ <urn:bench:s{number}> ?p ?o }}"
JOIN = "SELECT ?o ?q WHERE {{ <urn:bench:s{number}> <urn:bench:p1> ?o . ?o <urn:bench:p2> ?q }}"
EVERYTHING = "SELECT ?s ?p ?o WHERE { ?s ?p ?o FILTER(STRSTARTS(STR(?s), 'urn:bench:')) }"
JSON_TYPE = "application/sparql-results+json"

RDFLIB_SERVER = """
import sys, rdflib, uvicorn
from rdflib_endpoint import SparqlEndpoint
graph = rdflib.Dataset(store="Oxigraph", default_union=True)
graph.parse(sys.argv[1], format="nt")
uvicorn.run(SparqlEndpoint(graph=graph, path="/query"), port=int(sys.argv[2]), log_level="error")
"""


@dataclass(frozen=True)
class Peer:
    """One server that answers ``/query``."""

    name: str
    port: int
    pid: int
    token: str = ""

    def cpu_s(self) -> float:
        """Return the processor time that the server has used, all its threads together."""
        fields = Path(f"/proc/{self.pid}/stat").read_text("ascii").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def request(self, query: str) -> bytes:
        """Return the bytes of one request."""
        who = f"Authorization: Bearer {self.token}\r\n" if self.token else ""
        return (
            f"GET /query?query={quote(query, safe='')} HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\n"
            f"Accept: {JSON_TYPE}\r\n{who}\r\n"
        ).encode()


class Asker(asyncio.Protocol):
    """A kept connection that asks the next question as soon as it has an answer."""

    def __init__(self, requests: list[bytes], start: int, done: asyncio.Event) -> None:
        self._requests, self._at, self._done = requests, start, done
        self._buffer = bytearray()
        self._sent = 0.0
        self.answered, self.faults = 0, 0
        self.times: list[float] = []

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._ask()

    def _ask(self) -> None:
        self._sent = time.perf_counter()
        self._transport.write(self._requests[self._at % len(self._requests)])
        self._at += CONNECTIONS

    def data_received(self, data: bytes) -> None:
        """Count an answer and ask again."""
        self._buffer += data
        end = self._buffer.find(b"\r\n\r\n")
        if end < 0:
            return
        head = bytes(self._buffer[:end]).lower()
        at = head.find(b"content-length: ")
        if at >= 0:
            length = int(head[at + 16 :].split(b"\r\n", 1)[0])
            whole = len(self._buffer) >= end + 4 + length
        else:
            whole = self._buffer.endswith(b"0\r\n\r\n")
        if not whole:
            return
        self.answered += 1
        self.faults += not head.startswith(b"http/1.1 200")
        self.times.append(time.perf_counter() - self._sent)
        self._buffer.clear()
        if not self._done.is_set():
            self._ask()


@dataclass(frozen=True)
class Rate:
    """Answers a second, 99th percentile of their times in ms, processor time of one in µs."""

    per_s: float
    p99_ms: float
    cpu_us: float


async def ask_for_a_while(peer: Peer, requests: list[bytes]) -> Rate:
    """Keep all connections busy for some seconds."""
    loop, done = asyncio.get_running_loop(), asyncio.Event()
    pairs = [
        await loop.create_connection(
            lambda start=start: Asker(requests, start, done), "127.0.0.1", peer.port
        )
        for start in range(CONNECTIONS)
    ]
    started, cpu_before = time.perf_counter(), peer.cpu_s()
    await asyncio.sleep(SECONDS)
    done.set()
    spent, cpu = time.perf_counter() - started, peer.cpu_s() - cpu_before
    askers = [asker for _, asker in pairs]
    for transport, _ in pairs:
        transport.close()
    faults = sum(asker.faults for asker in askers)
    if faults:
        raise SystemExit(f"{peer.name}: {faults} answers were no 200")
    times = sorted(time_ for asker in askers for time_ in asker.times)
    p99 = 1e3 * times[int(0.99 * len(times))]
    return Rate(len(times) / spent, p99, 1e6 * cpu / len(times))


def rates(peers: list[Peer], query: str) -> dict[str, list[Rate]]:
    """Ask all peers in turn, several rounds."""
    requests = {
        peer.name: [peer.request(query.format(number=i * 7 % SUBJECTS)) for i in range(SUBJECTS)]
        for peer in peers
    }
    found: dict[str, list[Rate]] = {peer.name: [] for peer in peers}
    for number in range(ROUNDS + 1):
        for peer in peers:
            result = asyncio.run(ask_for_a_while(peer, requests[peer.name]))
            if number:  # the first round warms up
                found[peer.name].append(result)
    return found


def download(peer: Peer) -> tuple[float, float, int]:
    """Return megabytes a second, milliseconds to the first byte of the body, rows."""
    with socket.create_connection(("127.0.0.1", peer.port)) as connection:
        connection.sendall(peer.request(EVERYTHING))
        started = time.perf_counter()
        pieces, first = [], 0.0
        while True:
            piece = connection.recv(1 << 20)
            if not piece:
                raise SystemExit(f"{peer.name}: cut off")
            pieces.append(piece)
            if not first and (len(pieces) > 1 or not piece.endswith(b"\r\n\r\n")):
                first = time.perf_counter() - started
            if piece.endswith(b"0\r\n\r\n"):
                break
        spent = time.perf_counter() - started
    body = unchunked(b"".join(pieces).partition(b"\r\n\r\n")[2])
    rows = len(json.loads(body)["results"]["bindings"])
    return len(body) / spent / 1e6, 1e3 * first, rows


def unchunked(data: bytes) -> bytes:
    """Return a body without the lengths between its pieces (RFC 9112, 7.1)."""
    pieces, at = [], 0
    while True:
        end = data.index(b"\r\n", at)
        length = int(data[at:end], 16)
        if not length:
            return b"".join(pieces)
        pieces.append(data[end + 2 : end + 2 + length])
        at = end + 4 + length


def idle_sockets(server: RunningServer, tokens: list[str]) -> tuple[int, list[float]]:
    """Open a thousand robots that say nothing; return how many stay, and times of /health."""
    key = base64.b64encode(os.urandom(16)).decode()
    hello = (
        f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nUpgrade: websocket\r\n"
        f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
    )
    with contextlib.ExitStack() as stack:
        open_ones = 0
        for number in range(SOCKETS):
            robot = stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            token = tokens[number % len(tokens)]
            robot.sendall(f"{hello}Authorization: Bearer {token}\r\n\r\n".encode())
            open_ones += robot.recv(4096).startswith(b"HTTP/1.1 101")
        with httpx.Client(base_url=server.url) as client:
            client.get("/health")
            times = []
            for _ in range(200):
                started = time.perf_counter()
                client.get("/health").raise_for_status()
                times.append(time.perf_counter() - started)
    return open_ones, sorted(1e3 * spent for spent in times)


@contextlib.contextmanager
def process(command: list[str], port: int, limit_s: float = 60) -> Iterator[int]:
    """Run a server until it listens, and end it at the end; gives its process id."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
        deadline = time.monotonic() + limit_s
        try:
            while True:
                with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
                    break
                if running.poll() is not None or time.monotonic() > deadline:
                    raise SystemExit(f"{command[0]} did not start")
                time.sleep(0.1)
            yield running.pid
        finally:
            running.terminate()


def free_port() -> int:
    """Return a port that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def peers_of(
    stack: contextlib.ExitStack, folder: Path
) -> tuple[list[Peer], RunningServer, list[str]]:
    """Start all servers with the same triples; returns also the tokens of some robots."""
    triples = "".join(
        f"<urn:bench:s{i}> <urn:bench:p{p}> <urn:bench:s{(i * 31 + p) % SUBJECTS}> .\n"
        for i in range(SUBJECTS)
        for p in range(EACH)
    )
    file = folder / "data.nt"
    file.write_text(triples, encoding="utf-8")
    data = folder / "store"
    rtask.open(data).close()
    with contextlib.closing(TokenStore(data)) as store:
        token = store.create("admin")[0]
        robots = [store.create("robot", agent=f"robot-{i}")[0] for i in range(ROBOTS)]
    # The rate is above what one machine can ask, so that the limiter works and does not bite.
    ours = stack.enter_context(running_server(data, "--rate", "1e6", "--write-rate", "1e6"))
    load = httpx.put(
        f"{ours.url}/store?graph=urn:benchmark",
        content=triples,
        headers={"Authorization": f"Bearer {token}", "Content-Type": "application/n-triples"},
        timeout=120,
    )
    load.raise_for_status()
    peers = [Peer("rtask", ours.port, ours.process.pid, token)]
    if shutil.which("oxigraph", path=str(Path(sys.executable).parent)):
        port, binary = free_port(), str(Path(sys.executable).parent / "oxigraph")
        serve = [binary, "serve", "--bind", f"127.0.0.1:{port}"]
        pid = stack.enter_context(process(serve, port))
        headers = {"Content-Type": "application/n-triples"}
        httpx.post(f"http://127.0.0.1:{port}/store?default", content=triples, headers=headers)
        peers.append(Peer("oxigraph serve", port, pid))
    if importlib.util.find_spec("rdflib_endpoint") and importlib.util.find_spec("oxrdflib"):
        port = free_port()
        command = [sys.executable, "-W", "ignore", "-c", RDFLIB_SERVER, str(file), str(port)]
        pid = stack.enter_context(process(command, port))
        peers.append(Peer("rdflib-endpoint", port, pid))
    return peers, ours, robots


def median_of(values: Iterator[float] | list[float]) -> float:
    """Return the median."""
    return statistics.median(values)


def report(title: str, found: dict[str, list[Rate]]) -> None:
    """Print rates, and our ratio to each peer: by the clock, and by processor time used."""
    print(f"\n{title}, {CONNECTIONS} connections, {ROUNDS} rounds of {SECONDS:g} s")
    rate = median_of([one.per_s for one in found["rtask"]])
    cost = median_of([one.cpu_us for one in found["rtask"]])
    for name, results in found.items():
        rates_found = [one.per_s for one in results]
        middle, cpu = median_of(rates_found), median_of([one.cpu_us for one in results])
        p99 = median_of([one.p99_ms for one in results])
        spread = f"{min(rates_found):.0f}-{max(rates_found):.0f}"
        line = f"  {name:16} {middle:8.0f}/s ({spread}), p99 {p99:6.1f} ms, {cpu:6.0f} µs each"
        if name != "rtask":
            line += f"   ours / theirs {rate / middle:.2f} by the clock, {cpu / cost:.2f} by cost"
        print(line)


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        peers, ours, robots = peers_of(stack, Path(folder))
        missing = {"oxigraph serve", "rdflib-endpoint"} - {peer.name for peer in peers}
        for name in missing:
            print(f"{name} is not installed and left out")
        versions = ("pyoxigraph", "uvicorn", "rdflib-endpoint", "oxrdflib", "oxigraph")
        for name in versions:
            with contextlib.suppress(importlib.metadata.PackageNotFoundError):
                print(name, importlib.metadata.version(name), end="; ")
        print(f"load average before {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
        report("small SELECT, 5 rows about one subject", rates(peers, LOOKUP))
        report("small SELECT, two patterns joined", rates(peers, JOIN))
        both = [peer for peer in peers if peer.name != "rdflib-endpoint"]
        runs: dict[str, list[tuple[float, float, int]]] = {peer.name: [] for peer in both}
        for _ in range(ROUNDS + 1):
            for peer in both:
                runs[peer.name].append(download(peer))
        print(f"\n{SUBJECTS * EACH:,} rows as JSON")
        speed = {name: median_of([run[0] for run in found[1:]]) for name, found in runs.items()}
        for name, found in runs.items():
            first = median_of([run[1] for run in found[1:]])
            ratio = (
                "" if name == "rtask" else f"   ours / theirs {speed['rtask'] / speed[name]:.2f}"
            )
            print(
                f"  {name:16} {speed[name]:6.0f} MB/s, first byte {first:5.1f} ms, "
                f"{found[-1][2]} rows{ratio}"
            )
        held, times = idle_sockets(ours, robots)
        print(f"\n{held} of {SOCKETS} idle websockets held")
        middle, late = times[len(times) // 2], times[int(0.99 * len(times))]
        print(f"/health beside them: median {middle:.1f} ms, 99th percentile {late:.1f} ms")
        print(f"load average after {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
