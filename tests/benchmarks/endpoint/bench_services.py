"""Cost of a call of a service: beside ``GET /health/live``, and in its parts.

::

    python -m tests.benchmarks.endpoint.bench_services [--calls 2000]

Both kinds of request go to one server over one kept-alive connection, in turns, so that a load on
the machine hurts both alike. The service does nothing: the time is the framework's own.
"""

from __future__ import annotations

import argparse
import socket
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from rtask.services import ServiceHost
from rtask.services.registry import load
from tests.servers import running_server

_SERVICE = '''
from rtask.services import Service, method
from rtask.wire.types import Bytes


class Nothing(Service):
    """Does nothing."""

    name = "bench/Nothing"

    @method
    def go(self, number: int) -> int:
        """Return a number."""
        return number

    @method
    def measure(self, image: Bytes) -> int:
        """Return a size."""
        return len(image)


class Apart(Nothing):
    """The same in a process."""

    name = "bench/Apart"
    executor = "processes"
'''


def _exchange(connection: socket.socket, request: bytes) -> float:
    """Return the ms that a request took, until the whole answer was there."""
    began = time.perf_counter()
    connection.sendall(request)
    answer = b""
    while b"\r\n\r\n" not in answer:
        answer += connection.recv(65536)
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200"), head
    length = next(
        int(line.split(b":")[1])
        for line in head.split(b"\r\n")
        if line.lower().startswith(b"content-length")
    )
    while len(body) < length:
        body += connection.recv(65536)
    return 1e3 * (time.perf_counter() - began)


def _post(path: str, body: bytes) -> bytes:
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body


def main() -> None:
    """Print one row for each comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=2000)
    calls = parser.parse_args().calls
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "nothing.py"
        file.write_text(_SERVICE, "utf-8")
        with running_server(None, "--service", str(file)) as server:
            _over_http(server.port, calls)
        with ServiceHost(load(str(file))) as host:
            for name in ("bench/Nothing", "bench/Apart"):
                _in_process(host, name, calls)


def _over_http(port: int, calls: int) -> None:
    live = b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n\r\n"
    small = _post("/services/bench/Nothing/go", b'{"number":1}')
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(100):
            _exchange(connection, live), _exchange(connection, small)
        pairs = [(_exchange(connection, live), _exchange(connection, small)) for _ in range(calls)]
    alive, called = (statistics.median(times) for times in zip(*pairs, strict=True))
    print(f"GET /health/live              p50 {alive:7.3f} ms")
    print(f"call of a service, threads    p50 {called:7.3f} ms   ratio {called / alive:.2f}")


def _in_process(host: ServiceHost, name: str, calls: int) -> None:
    image = np.random.default_rng(0).bytes(360_000)
    for method, args in (("go", {"number": 1}), ("measure", {"image": image})):
        host.call(name, method, args)
        times = []
        for _ in range(calls):
            began = time.perf_counter()
            host.call(name, method, args)
            times.append(1e3 * (time.perf_counter() - began))
        size = "360 kB" if method == "measure" else "small"
        where = "threads" if name.endswith("Nothing") else "processes"
        print(f"{where:9s} in process, {size:6s}     p50 {statistics.median(times):7.3f} ms")


if __name__ == "__main__":
    main()
