"""Cost of a call through a worker on another machine, as JSON and in binary frames.

``python -m tests.benchmarks.endpoint.bench_workers [--repeats 60]``: a server, two workers in
processes of their own, one that is sent JSON and one that is sent CBOR, and a client that does
the same. The two take turns, so that the load of the machine hits both alike.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

import httpx
import numpy as np

from rtask.services.outward.frames import pack, unpack
from tests.servers import running_server

SERVICE = '''
from rtask.services import Service, method
from rtask.wire.types import Array
class Echo(Service):
    """Sends back what came."""
    name, version, max_workers = "bench/{name}", "1.0.0", 1
    @method(output="data")
    def bytes_(self, data: bytes) -> bytes:
        """Bytes."""
        return data
    @method(output="numbers")
    def numbers(self, numbers: Array) -> Array:
        """Numbers."""
        return numbers
    @method
    def nothing(self) -> None:
        """Nothing."""
'''
CBOR = {"Content-Type": "application/cbor", "Accept": "application/cbor"}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=60)
    repeats = parser.parse_args().repeats
    data = np.random.default_rng(0).bytes(360_000)
    numbers = np.random.default_rng(0).normal(size=45_000)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        server = stack.enter_context(running_server(None))
        for name, option in (("Text", ["--text"]), ("Binary", [])):
            file = folder / f"{name}.py"
            file.write_text(SERVICE.replace("{name}", name), "utf-8")
            command = [sys.executable, "-m", "rtask", "worker", str(file), "--server", server.url]
            worker = subprocess.Popen(
                [*command, *option], stdout=subprocess.PIPE, text=True,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )  # fmt: skip
            stack.callback(worker.wait)
            stack.callback(worker.kill)
            assert worker.stdout is not None
            while not worker.stdout.readline().startswith("serving"):
                pass
        client = stack.enter_context(httpx.Client(base_url=server.url, timeout=60))

        def text(method: str, args: Callable[[], dict[str, Any]]) -> Any:
            return (
                client.post(f"/services/bench/Text/{method}", json=args()).raise_for_status().json()
            )

        def binary(method: str, args: Callable[[], dict[str, Any]]) -> Any:
            path = f"/services/bench/Binary/{method}"
            answer = client.post(path, content=pack(args()), headers=CBOR).raise_for_status()
            return unpack(answer.content)

        def check() -> None:
            assert base64.b64decode(text("bytes_", as_base64)["data"]) == data
            assert binary("bytes_", as_bytes)["data"] == data
            np.testing.assert_array_equal(text("numbers", as_list)["numbers"], numbers)
            np.testing.assert_array_equal(binary("numbers", as_array)["numbers"], numbers)

        def as_base64() -> dict[str, Any]:
            return {"data": base64.b64encode(data).decode()}

        def as_bytes() -> dict[str, Any]:
            return {"data": data}

        def as_list() -> dict[str, Any]:
            return {"numbers": numbers.tolist()}

        def as_array() -> dict[str, Any]:
            return {"numbers": numbers}

        check()
        pairs = {
            "360 kB of bytes": (
                lambda: text("bytes_", as_base64),
                lambda: binary("bytes_", as_bytes),
            ),
            "45,000 numbers (360 kB)": (
                lambda: text("numbers", as_list),
                lambda: binary("numbers", as_array),
            ),
            "nothing, against GET /health/live": (
                lambda: client.get("/health/live").raise_for_status(),
                lambda: text("nothing", dict),
            ),
        }
        found = {}
        for name, (one, other) in pairs.items():
            times: tuple[list[float], list[float]] = ([], [])
            for _ in range(repeats):
                for call, into in zip((one, other), times, strict=True):
                    began = time.perf_counter()
                    call()
                    into.append(1e3 * (time.perf_counter() - began))
            first, second = map(median, times)
            paired = median(b / a for a, b in zip(*times, strict=True))
            found[name] = {"first_ms": first, "second_ms": second, "ratio": paired}
            print(f"{name}: {first:.1f} ms, {second:.1f} ms, ratio {paired:.2f}", file=sys.stderr)
        print(json.dumps({"load": os.getloadavg(), "repeats": repeats, **found}))


if __name__ == "__main__":
    main()
