"""Hostile writes against a live server: when each ends, and what others notice meanwhile.

``python -m tests.benchmarks.endpoint.stress_hostile_writes [COUNT [SIZE]]`` sends writes of a few
to SIZE statements from which much follows, or which change the vocabulary, each after some harmless
ones. The caller may state axioms, since most of them are refused before otherwise. Meanwhile
another client asks ``/health/live`` and inserts one statement, again and again. Targets: each write
ends within the limit of its derivation and .5 s, none with 500; health and insert answer within
250 ms (by the clock, and without the time that the server's threads wait for a processor); the
memory returns to 1.3 times; SIGTERM ends the server within 5 s, also beside a write.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path

import httpx

from rtask.kb.commit.budget import OF_ROBOTS
from tests.benchmarks.endpoint.stress_updates import UPDATE, beside, resident, told
from tests.hostile_writes import KINDS, hostile_write
from tests.servers import RunningServer, running_server

_RETURNS_S = 60.0


def warm_up(server: RunningServer, count: int, size: int) -> None:
    """Write and remove as many statements as the hostile writes have, of no consequence."""
    for number in range(count):
        links = " ".join(f"<urn:h:{i}> <urn:h:{number}> {i} ." for i in range(2 * size))
        for verb in ("INSERT", "DELETE"):
            text = f"{verb} DATA {{ {links} }}"
            httpx.post(f"{server.url}/update", content=text, headers=UPDATE, timeout=120)


def idle(server: RunningServer, count: int = 100) -> float:
    """Return the median time in s of an insert while nobody else writes."""
    times = []
    with httpx.Client(base_url=server.url, headers=UPDATE) as client:
        for number in range(count):
            text = f"INSERT DATA {{ <urn:robot> <urn:idle> {number} }}"
            started = time.perf_counter()
            client.post("/update", content=text).raise_for_status()
            times.append(time.perf_counter() - started)
    return sorted(times)[count // 2]


def settled(server: RunningServer, allowed: float) -> tuple[int, float]:
    """Wait for the memory to return; return it and the time in s that it took."""
    started = time.monotonic()
    while (memory := resident(server)) > allowed and time.monotonic() - started < _RETURNS_S:
        time.sleep(1.0)
    return memory, time.monotonic() - started


def stop_beside_a_write(server: RunningServer, text: str) -> float:
    """Send SIGTERM while a write is derived; return the time in s until the server ends."""

    def write() -> None:
        try:
            httpx.post(f"{server.url}/update", content=text, headers=UPDATE, timeout=60)
        except httpx.HTTPError:
            return  # the server ended first

    writer = threading.Thread(target=write)
    writer.start()
    time.sleep(0.15)
    started = time.perf_counter()
    server.process.terminate()
    server.process.wait(60)
    writer.join()
    return time.perf_counter() - started


def main() -> None:
    """Attack, measure and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 36
    size = int(sys.argv[2]) if len(sys.argv) > 2 else 1_500
    rng = random.Random(33)
    rows: dict[str, list[tuple[float, int, float, float]]] = defaultdict(list)
    print(f"{count} hostile writes of up to {size} statements; load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder, running_server(Path(folder) / "kb") as server:
        beside(server, ["INSERT DATA { <urn:a> a <urn:B> }"], 0)
        warm_up(server, count, size)
        alone = idle(server)
        before, others = resident(server), []
        for number in range(count):
            kind = list(KINDS)[number % len(KINDS)]
            for harmless in range(rng.randrange(4)):
                text = f"INSERT DATA {{ <urn:h{number}> <urn:p> {harmless} }}"
                httpx.post(f"{server.url}/update", content=text, headers=UPDATE, timeout=60)
            text = hostile_write(kind, rng, rng.randint(size // 3, size))
            ended, waits = beside(server, [text], 1_000 * (number + 1))
            longest = max((wait.clock_s for wait in waits), default=0.0)
            rows[kind].append((*ended[0], longest, max((w.own_s for w in waits), default=0.0)))
            others += waits
            if ended[0][1] < 300:
                undo = text.replace("INSERT", "DELETE", 1)
                httpx.post(f"{server.url}/update", content=undo, headers=UPDATE, timeout=120)
        memory, took = settled(server, 1.3 * before)
        stopped = stop_beside_a_write(server, hostile_write("chain of classes", rng, size))
    print(f"{'kind':22} statuses        longest s   others' longest ms, and on processors alone")
    for kind, runs in sorted(rows.items(), key=lambda row: -max(own for *_, own in row[1])):
        seconds, wait, own = (max(run[k] for run in runs) for k in (0, 2, 3))
        statuses = " ".join(str(run[1]) for run in runs)
        print(f"{kind:22} {statuses:15} {seconds:6.2f} {1e3 * wait:12.0f} {1e3 * own:8.0f}")
    late = sum(
        seconds > (OF_ROBOTS.seconds or 0.0) + 0.5 for runs in rows.values() for seconds, *_ in runs
    )
    errors = sum(status >= 500 for runs in rows.values() for _, status, *_ in runs)
    print(f"{late} later than the limit and .5 s, {errors} answers of 5xx; {told(others)}")
    print(
        f"an insert alone takes {1e3 * alone:.1f} ms (median, before); memory {memory / before:.2f}"
        f" times after {took:.0f} s; SIGTERM ended it in {stopped:.1f} s; load "
        f"{os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
