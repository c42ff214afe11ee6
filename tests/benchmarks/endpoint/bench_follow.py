"""Followers: how fast they take in commits, how old their answers are, what they cost the writer.

    .venv/bin/python tests/benchmarks/endpoint/bench_follow.py [--seconds 5] [--pairs 8]

Real servers on this machine. The catch-up is a follower that was down for 2,000 commits of ten
statements in 50 graphs, on disk; CPU is that of the follower's process while it catches up. Before,
the records of the same commits are applied to a store in memory. For the age, a client stores 50
commits a second at the writer, and each is timed from its acknowledgement until the follower
announces it. The cost is the CPU time of the writer's process for the same commits with three
followers and with none, in pairs one after the other, whose order alternates; the followers start
and catch up between the measurements. The interval is Student's, of the pairs.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import statistics
import tempfile
import threading
import time
from pathlib import Path

import httpx
import psutil
from scipy import stats

import rtask
from rtask.kb.durability.journal import JournalFile
from rtask.kb.durability.recovery import replay_all
from tests.following import make_writer
from tests.servers import RunningServer, bearer, running_server

RATE = 50.0
_BATCH = 500
"""Records that a follower stores in one step."""


def _catch_up(root: Path) -> None:
    folder, token_file = root / "writer", root / "token"
    make_writer(folder, token_file)
    with running_server(folder) as writer, _follow(writer, root / "late", token_file):
        pass
    commits, size = 2_000, 10
    with rtask.open(folder, ontologies=False, reason=False, flush="os") as kb:
        for number in range(commits):
            with kb.transaction(agent=f"nao-{number % 50}") as tx:
                for part in range(size):
                    tx.add(f"urn:o{number}", f"urn:p{part}", number)
        records = list(JournalFile(folder / "journal").records())
        whole = sum(len(r.added()) + len(r.removed()) for r in records)
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        before = time.process_time()
        for at in range(0, len(records), _BATCH):
            replay_all(kb.store, records[at : at + _BATCH], merged=True)
        applied = time.process_time() - before
    print(f"applied in memory: {whole / applied:,.0f} statements per CPU second", flush=True)
    with running_server(folder) as writer:
        started = time.perf_counter()
        with _follow(writer, root / "late", token_file) as follower:
            process = psutil.Process(follower.process.pid)
            before = sum(process.cpu_times()[:2])
            while _seq(follower) < commits:
                time.sleep(0.02)
            wall = time.perf_counter() - started
            cpu = sum(process.cpu_times()[:2])
    print(
        f"catching up: {commits} commits, {whole} statements in their records, "
        f"{cpu - before:.1f} to {cpu:.1f} s CPU (without and with starting), {wall:.1f} s wall: "
        f"{whole / cpu:,.0f} statements per CPU second or more",
        flush=True,
    )


def _seq(server: RunningServer) -> int:
    return int(httpx.get(server.url + "/health").json()["seq"])


def _follow(
    writer: RunningServer, folder: Path, token_file: Path
) -> contextlib.AbstractContextManager[RunningServer]:
    return running_server(folder, "--follow", writer.url, "--token-file", str(token_file))


def _load(writer: RunningServer, token: str, seconds: float) -> dict[int, float]:
    """Store commits at a steady rate; return when each was acknowledged, by its number."""
    acknowledged = {}
    with httpx.Client(base_url=writer.url, headers=bearer(token), timeout=30) as client:
        started = time.perf_counter()
        for number in range(int(seconds * RATE)):
            wait = started + number / RATE - time.perf_counter()
            if wait > 0:
                time.sleep(wait)
            text = f"INSERT DATA {{ <urn:n{number}-{started}> <urn:p> 1, 2, 3 }}"
            answer = client.post("/update", data={"update": text})
            answer.raise_for_status()
            seq = int(answer.headers["RTASK-Version"].rpartition(":")[2])
            acknowledged[seq] = time.perf_counter()
    return acknowledged


def _announced(
    server: RunningServer, token: str, heard: dict[int, float], ready: threading.Event
) -> None:
    with (
        httpx.Client(base_url=server.url, headers=bearer(token), timeout=None) as client,
        contextlib.suppress(httpx.TransportError),
        client.stream("GET", "/changes") as answer,
    ):
        for line in answer.iter_lines():
            ready.set()
            if line.startswith("id:"):
                heard[int(line.rpartition(":")[2])] = time.perf_counter()


def _age_and_cost(root: Path, seconds: float, pairs: int) -> None:
    folder, token_file = root / "writer2", root / "token2"
    token = make_writer(folder, token_file)
    late: list[float] = []
    alone: list[float] = []
    beside: list[float] = []
    with running_server(folder) as writer:
        process = psutil.Process(writer.process.pid)
        _load(writer, token, 2.0)
        for pair in range(pairs):
            for with_followers in (False, True) if pair % 2 else (True, False):
                if with_followers:
                    cost, ages = _beside(writer, process, root, token_file, token, seconds)
                    beside.append(cost)
                    late += ages
                else:
                    alone.append(_cpu(process, writer, token, seconds)[0])
    late.sort()
    print(
        f"age at {RATE:g} commits/s: median {statistics.median(late):.1f} ms, "
        f"p95 {late[int(0.95 * len(late))]:.1f} ms, of {len(late)} commits"
    )
    shares = [100 * (b - a) / b for a, b in zip(alone, beside, strict=True)]
    low, high = stats.t.interval(0.95, pairs - 1, statistics.mean(shares), stats.sem(shares))
    print(
        f"writer: {statistics.mean(alone):.2f} s CPU alone, {statistics.mean(beside):.2f} s with "
        f"three followers ({pairs} pairs of {seconds:g} s): {statistics.mean(shares):.1f} % of its "
        f"CPU is theirs (95 %: {low:.1f} to {high:.1f})"
    )


def _beside(
    writer: RunningServer, process: psutil.Process, root: Path, token_file: Path, token: str,
    seconds: float,
) -> tuple[float, list[float]]:  # fmt: skip
    """Return the writer's CPU time with three followers, and the ages of commits at one, in ms."""
    with contextlib.ExitStack() as stack:
        followers = [
            stack.enter_context(_follow(writer, root / f"f{n}", token_file)) for n in range(3)
        ]
        heard: dict[int, float] = {}
        ready = threading.Event()
        threading.Thread(
            target=_announced, args=(followers[0], token, heard, ready), daemon=True
        ).start()
        ready.wait(20)
        while min(map(_seq, followers)) < _seq(writer):
            time.sleep(0.1)
        cost, acknowledged = _cpu(process, writer, token, seconds)
        while min(map(_seq, followers)) < _seq(writer):
            time.sleep(0.1)
        time.sleep(0.5)
    return cost, [
        1e3 * max(0.0, heard[seq] - at) for seq, at in acknowledged.items() if seq in heard
    ]


def _cpu(
    process: psutil.Process, writer: RunningServer, token: str, seconds: float
) -> tuple[float, dict[int, float]]:
    before = sum(process.cpu_times()[:2])
    acknowledged = _load(writer, token, seconds)
    return sum(process.cpu_times()[:2]) - before, acknowledged


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--pairs", type=int, default=8)
    options = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as name:
        _catch_up(Path(name))
        _age_and_cost(Path(name), options.seconds, options.pairs)


if __name__ == "__main__":
    main()
