"""Kill a writer and its follower at random while commits are stored; both must end up equal.

    .venv/bin/python tests/benchmarks/endpoint/stress_follow.py [--kills 20] [--seed 0]

Every acknowledged commit must be there at the end, on both sides.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import signal
import tempfile
import threading
import time
from pathlib import Path

import httpx

from tests.following import digest, make_writer
from tests.servers import RunningServer, bearer, running_server
from tests.sparql_servers import free_port


class Side:
    """A server that is started again at the same port whenever it was killed."""

    def __init__(self, folder: Path, *options: str) -> None:
        self._folder = folder
        self._options = ("-p", str(free_port()), *options)
        self._stack = contextlib.ExitStack()
        self.server: RunningServer

    def start(self) -> None:
        self.server = self._stack.enter_context(running_server(self._folder, *self._options))

    def kill(self) -> None:
        self.server.process.send_signal(signal.SIGKILL)
        self._stack.close()

    def stop(self) -> None:
        self._stack.close()


def main() -> None:
    """Kill, start, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        token = make_writer(root / "writer", root / "token")
        writer = Side(root / "writer")
        writer.start()
        url = writer.server.url
        follower = Side(root / "copy", "--follow", url, "--token-file", str(root / "token"))
        follower.start()
        stop, acknowledged = threading.Event(), []

        def write() -> None:
            with httpx.Client(base_url=url, headers=bearer(token), timeout=10) as client:
                for number in range(1_000_000):
                    if stop.is_set():
                        return
                    text = f"INSERT DATA {{ <urn:n{number}> <urn:p> 1, 2, 3 }}"
                    with contextlib.suppress(httpx.TransportError):
                        answer = client.post("/update", data={"update": text})
                        if answer.status_code < 300:
                            acknowledged.append(number)

        thread = threading.Thread(target=write)
        thread.start()
        for _ in range(options.kills):
            time.sleep(rng.uniform(0.1, 1.5))
            side = rng.choice((writer, follower))
            side.kill()
            time.sleep(rng.uniform(0.0, 0.5))
            side.start()
        time.sleep(1.0)
        stop.set()
        thread.join()
        _wait_until_equal(writer.server, follower.server)
        follower.stop()
        writer.stop()
        first, second = digest(root / "writer"), digest(root / "copy")
        assert first == second, (first, second)
        print(
            f"{options.kills} kills, {len(acknowledged)} commits acknowledged, {first[0]} stored: "
            "writer and follower are equal"
        )
        assert len(acknowledged) <= first[0]


def _wait_until_equal(one: RunningServer, two: RunningServer) -> None:
    end = time.monotonic() + 60
    while True:
        seqs = [httpx.get(side.url + "/health").json()["seq"] for side in (one, two)]
        if seqs[0] == seqs[1]:
            return
        assert time.monotonic() < end, f"the follower stays behind: {seqs}"
        time.sleep(0.1)


if __name__ == "__main__":
    main()
