"""Hostile updates against a live server: when each ends, and what others notice meanwhile.

``python -m tests.benchmarks.endpoint.stress_updates [COUNT [ATTACKERS]]`` sends updates that grow
literals or the graph without bound, join everything with everything, walk paths or mint
identifiers, each after some harmless ones, by one client or by several at once. Meanwhile another
client asks ``/health/live`` and inserts one statement, again and again. Targets: each update ends
within its limit and .5 s, health and insert answer within 250 ms, the memory returns, SIGTERM
ends the server within 5 s.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import httpx
import psutil

from tests.processor_waits import Wait, timed
from tests.servers import RunningServer, running_server

LIMIT_S = 5.0
UPDATE = {"Content-Type": "application/sparql-update"}
GROW = "INSERT { <urn:s> <urn:p> ?z } WHERE { <urn:s> <urn:p> ?x BIND(CONCAT(?x, ?x) AS ?z) }"


def hostile(rng: random.Random) -> tuple[str, str]:
    """Return the kind and the text of an update that would not end by itself, or not small."""
    pairs = " . ".join(f"?a{i} <urn:b> ?b{i}" for i in range(rng.randint(4, 6)))
    steps = " ".join(f"BIND(CONCAT(?x{i}, ?x{i}) AS ?x{i + 1})" for i in range(40))
    kinds = {
        "doubling, chained": " ;\n".join([GROW] * rng.randint(30, 60)),
        "self-join": f"INSERT {{ ?a0 <urn:c> ?b1 }} WHERE {{ {pairs} }}",
        "doubling in one WHERE": f"INSERT {{ <urn:s> <urn:c> ?x40 }} "
        f"WHERE {{ <urn:s> <urn:p> ?x0 {steps} }}",
        "paths": "INSERT { ?a <urn:reach> ?c } WHERE { ?a (!<urn:none>|^!<urn:none>)* ?c . "
        "?d (!<urn:none>|^!<urn:none>)* ?e }",
        "UUID of a cross product": "INSERT { ?s <urn:u> ?u } WHERE { ?s <urn:b> ?o . "
        "?t <urn:b> ?q . ?v <urn:b> ?w BIND(UUID() AS ?u) }",
        "doubling the graph": " ;\n".join(
            ["INSERT { ?s ?p _:n . _:n <urn:b> ?o } WHERE { ?s ?p ?o }"] * rng.randint(15, 30)
        ),
        "count of a nested cross product": "INSERT { <urn:s> <urn:n> ?n } WHERE { { SELECT "
        f"(COUNT(*) AS ?n) {{ {{ SELECT * {{ {pairs} }} }} }} }} }}",
    }
    kind = rng.choice(list(kinds))
    harmless = [
        f"INSERT DATA {{ <urn:h{rng.randrange(99)}> <urn:b> {rng.randrange(9)} }}"
        for _ in range(rng.randrange(4))
    ]
    return kind, " ;\n".join([*harmless, kinds[kind]])


def resident(server: RunningServer) -> int:
    """Return the memory of the server and all its children, in bytes."""
    own = psutil.Process(server.process.pid)
    total = 0
    for process in (own, *own.children(recursive=True)):
        try:
            total += process.memory_info().rss
        except psutil.NoSuchProcess:
            continue
    return total


def beside(
    server: RunningServer, texts: list[str], number: int
) -> tuple[list[tuple[float, int]], list[Wait]]:
    """Send updates at once.

    Returns
    -------
    The time in s and the status of each, and the times of what another client asks meanwhile.
    """
    ended: list[tuple[float, int]] = []

    def attack(text: str) -> None:
        started = time.perf_counter()
        answer = httpx.post(f"{server.url}/update", content=text, headers=UPDATE, timeout=120)
        ended.append((time.perf_counter() - started, answer.status_code))

    attackers = [threading.Thread(target=attack, args=(text,)) for text in texts]
    for attacker in attackers:
        attacker.start()
    waits = []
    with httpx.Client(base_url=server.url, timeout=60) as client:
        while any(attacker.is_alive() for attacker in attackers):
            for method, path, body in (
                ("GET", "/health/live", ""),
                ("POST", "/update", f"INSERT DATA {{ <urn:robot> <urn:saw> {number} }}"),
            ):
                headers = UPDATE if body else {}
                with timed(server.process.pid) as wait:
                    client.request(method, path, content=body, headers=headers).raise_for_status()
                waits.append(wait)
                number += 1
            time.sleep(0.02)
    return ended, waits


def told(waits: list[Wait]) -> str:
    """Return the median, the 99th percentile and the longest of some waits, in words."""
    lines = []
    for what, values in (
        ("by the clock", [wait.clock_s for wait in waits]),
        ("without waits for a processor", [wait.own_s for wait in waits]),
    ):
        values.sort()
        median, p99, longest = (1e3 * values[int(q * (len(values) - 1))] for q in (0.5, 0.99, 1.0))
        above = sum(value > 0.25 for value in values)
        lines.append(
            f"  {what}: median {median:.0f} ms, p99 {p99:.0f}, longest {longest:.0f}, "
            f"{above} above 250"
        )
    return f"{len(waits)} answers of /health/live and inserts beside them\n" + "\n".join(lines)


def main() -> None:
    """Attack, measure and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    at_once = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    load = os.getloadavg()[0]
    print(f"{count} times {at_once} hostile updates, limit {LIMIT_S:g} s; load average {load:.1f}")
    rng = random.Random(12)
    longest: Counter[str] = Counter()
    statuses: Counter[int] = Counter()
    late, others = 0, []
    with tempfile.TemporaryDirectory() as folder, running_server(Path(folder) / "kb") as server:
        data = " . ".join(f"<urn:a{i}> <urn:b> {i % 7}" for i in range(400))
        start = f"INSERT DATA {{ {data} . <urn:s> <urn:p> 'xxxxxxxxxx' }}"
        httpx.post(f"{server.url}/update", content=start, headers=UPDATE).raise_for_status()
        beside(server, ["DELETE WHERE { <urn:nothing> ?p ?o }"], 0)
        before = resident(server)
        for number in range(count):
            kinds, texts = zip(*(hostile(rng) for _ in range(at_once)), strict=True)
            ended, times = beside(server, list(texts), 1_000 * (number + 1))
            for seconds, status in ended:
                statuses[status] += 1
                late += seconds > LIMIT_S + 0.5
            if at_once == 1:
                longest[kinds[0]] = max(longest[kinds[0]], round(ended[0][0], 2))  # type: ignore[assignment]
            others += times
        time.sleep(1.0)
        grown = resident(server) - before
        started = time.perf_counter()
        server.process.terminate()
        server.process.wait(60)
        stopped = time.perf_counter() - started
    for kind, seconds in longest.most_common():
        print(f"  {kind:32} longest {seconds:5.2f} s")
    print(f"answers {dict(statuses)}; {late} of {count * at_once} later than {LIMIT_S + 0.5:g} s")
    print(told(others))
    print(
        f"memory afterwards {grown / 2**20:+.0f} MiB; SIGTERM ended it in {stopped:.1f} s "
        "(target 5)"
    )
    print(f"load average after {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
