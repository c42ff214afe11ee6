"""Kill followers and the writer behind nginx under load, and cut the link of a follower.

    .venv/bin/python tests/benchmarks/endpoint/stress_proxy.py [--kills 20] [--seed 0]

Readers ask by GET and POST through the configuration in docs/deploy while followers are killed, one
at a time: each read is answered, but for those whose answer had begun, which no proxy can send from
another server. While the writer is away, reads go on, and each refused write
tells so in the product's words. A follower whose link is cut lets a token in that the writer has
revoked for no longer than its lease.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import httpx

from tests.benchmarks.endpoint.bench_race import Link
from tests.benchmarks.endpoint.stress_follow import Side
from tests.following import make_writer
from tests.nginx import running_nginx
from tests.servers import bearer
from tests.sparql_servers import free_port

LEASE_S = 5.0
_CUT = "cut in the middle of its answer"
_ASK = {"query": "ASK { ?s <urn:p> ?o }"}


def _ask(client: httpx.Client, kind: str, number: int) -> httpx.Response:
    if kind == "update":
        text = f"INSERT DATA {{ <urn:n{number}> <urn:p> {number} }}"
        return client.post("/update", data={"update": text})
    if kind == "GET":
        return client.get("/query", params=_ASK)
    return client.post("/query", data=_ASK)


class _Load:
    """Readers and a writer in threads; counts the kinds of answers."""

    def __init__(self, front: str, token: str) -> None:
        self._front, self._token = front, token
        self.answers: Counter[str] = Counter()
        self._stop = threading.Event()
        self._threads = [
            threading.Thread(target=self._run, args=(kind,))
            for kind in ("GET", "POST", "POST", "update")
        ]
        for thread in self._threads:
            thread.start()

    def _run(self, kind: str) -> None:
        number = 0
        with httpx.Client(base_url=self._front, headers=bearer(self._token), timeout=30) as client:
            while not self._stop.is_set():
                number += 1
                try:
                    answer = _ask(client, kind, number)
                except httpx.RemoteProtocolError:
                    self.answers[f"{kind} {_CUT}"] += 1
                    continue
                media_type = answer.headers.get("content-type", "").partition(";")[0]
                words = f"{answer.status_code}"
                if answer.is_error:
                    words += f" {media_type}"
                    if "json" in media_type:
                        words += f" {answer.json()['type'].rpartition('/')[2]}"
                self.answers[f"{kind} {words}"] += 1

    def stop(self) -> Counter[str]:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        return self.answers


def main() -> None:
    """Kill, cut, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        root = Path(name)
        token = make_writer(root / "writer", root / "token")
        port = free_port()
        front = f"http://127.0.0.1:{port}"
        common = ("--behind-proxy", "--public-url", front, "--rate", "0", "--write-rate", "0")
        writer = _started(stack, Side(root / "writer", *common))
        link = Link(writer.server.port)
        stack.callback(link.close)
        follow = ("--token-file", str(root / "token"), "--lease", str(LEASE_S), *common)
        followers = [
            _started(stack, Side(root / f"f{n}", "--follow", url, *follow))
            for n, url in enumerate((writer.server.url, f"http://127.0.0.1:{link.port}"))
        ]
        ports = [side.server.port for side in (writer, *followers)]
        stack.enter_context(running_nginx(root, port, ports))

        load = _Load(front, token)
        for _ in range(options.kills):
            time.sleep(rng.uniform(0.2, 1.0))
            side = rng.choice(followers)
            side.kill()
            time.sleep(rng.uniform(0.0, 0.5))
            side.start()
        answers = load.stop()
        _show(f"{options.kills} followers killed", answers)
        reads = {kind for kind in answers if not kind.startswith("update")}
        assert reads <= {"GET 200", "POST 200", f"GET {_CUT}", f"POST {_CUT}"}
        assert sum(number for kind, number in answers.items() if _CUT in kind) < 4 * options.kills

        load = _Load(front, token)
        time.sleep(0.5)
        writer.kill()
        time.sleep(2.0)
        _show("writer killed", load.stop())
        assert not [kind for kind in load.answers if "html" in kind]
        writer.start()

        _cut(root, followers[1].server.url, link, writer.server.url, token)


def _started(stack: contextlib.ExitStack, side: Side) -> Side:
    side.start()
    stack.callback(side.stop)
    return side


def _show(situation: str, answers: Counter[str]) -> None:
    print(f"{situation}: " + ", ".join(f"{number} x {kind}" for kind, number in answers.items()))


def _cut(root: Path, follower: str, link: Link, writer: str, token: str) -> None:
    """Revoke a token whose follower does not hear of it, and time how long it is let in."""
    with httpx.Client(base_url=follower, headers=bearer(token), timeout=30) as client:
        _await_contact(client, writer, token)
        link.cut()
        began = time.monotonic()
        _revoke(root / "writer")
        while httpx.get(f"{writer}/query", params=_ASK, headers=bearer(token)).status_code != 401:
            time.sleep(0.05)
        at_writer = time.monotonic() - began
        while (answer := client.get("/query", params=_ASK)).status_code == 200:
            time.sleep(0.05)
        lapsed = time.monotonic() - began
        assert answer.status_code == 503, answer.text
        slug = answer.json()["type"].rpartition("/")[2]
        link.mend()
        while client.get("/query", params=_ASK).status_code != 401:
            time.sleep(0.05)
    print(
        f"link cut: the writer refused the token after {at_writer:.2f} s, the follower after "
        f"{lapsed:.2f} s by its lease of {LEASE_S:g} s ({slug}), and by 401 once in contact again"
    )


def _await_contact(follower: httpx.Client, writer: str, token: str) -> None:
    """Wait until a statement of the writer, which was just restarted, is at the follower."""
    text = "INSERT DATA { <urn:contact> <urn:p> 1 }"
    httpx.post(f"{writer}/update", data={"update": text}, headers=bearer(token)).raise_for_status()
    ask = {"query": "ASK { <urn:contact> <urn:p> 1 }", "format": "json"}
    end = time.monotonic() + 60
    while time.monotonic() < end:
        answer = follower.get("/query", params=ask)
        if answer.status_code == 200 and answer.json()["boolean"]:
            return
        time.sleep(0.05)
    raise AssertionError("the follower has not heard of the writer's return within 60 s")


def _revoke(folder: Path) -> None:
    command = [sys.executable, "-m", "rtask", "token"]
    listed = subprocess.run(
        [*command, "list", "-d", str(folder), "--json"], check=True, capture_output=True, text=True
    )
    tokens = json.loads(listed.stdout)
    rows = tokens if isinstance(tokens, list) else tokens["tokens"]
    robot = next(row["id"] for row in rows if row["agent"] == "nao-1")
    subprocess.run([*command, "revoke", robot, "-d", str(folder)], check=True)


if __name__ == "__main__":
    main()
