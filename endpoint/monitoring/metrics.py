"""Counts and times for monitoring, in the text format that Prometheus reads (version 0.0.4).

No label carries what a client chose: an address becomes one of the known routes, a method one of
the known methods, so nobody can fill the memory with names.
"""

from __future__ import annotations

import resource
import threading
import time
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
BUCKETS_S = (
    0.001,
    0.0025,
    0.005,
    0.01,
    0.025,
    0.05,
    0.1,
    0.25,
    0.5,
    1.0,
    2.5,
    5.0,
    10.0,
    30.0,
    60.0,
)
_METHODS = frozenset(("GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"))
_ROUTES = (
    "/sparql",
    "/query",
    "/update",
    "/store",
    "/engine",
    "/api",
    "/health",
    "/metrics",
    "/queries",
    "/changes",
    "/admin",
    "/static",
)
_HELP = {
    "rtask_http_requests_total": "Requests answered.",
    "rtask_query_total": "Queries by form and outcome.",
    "rtask_query_aborted_total": "Queries that did not reach their end.",
    "rtask_rate_limited_total": "Requests refused because a caller sent too many.",
    "rtask_denied_total": "Requests refused for want of rights.",
    "rtask_commits_total": "Commits stored.",
    "rtask_commit_quads_total": "Statements that commits added, removed or derived.",
    "rtask_log_lines_dropped_total": "Log lines that nobody read in time.",
}


def route_of(path: str) -> str:
    """Return the route that a path belongs to; `page` for everything else.

    Examples
    --------
    >>> route_of("/store/person/1.ttl"), route_of("/sparql/"), route_of("/storehouse")
    ('/store', '/sparql', 'page')
    """
    for route in _ROUTES:
        if path == route or path.startswith(route + "/"):
            return route
    return "page"


class Metrics:
    """What a server counts; safe to use from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[tuple[str, tuple[tuple[str, str], ...]]] = Counter()
        self._requests: Counter[tuple[str, str, int]] = Counter()
        self._times: dict[str, list[int]] = {}
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._started = time.time()

    def request(self, path: str, method: str, status: int, seconds: float) -> None:
        """Count a request and how long it took."""
        route = route_of(path)
        method = method if method in _METHODS else "other"
        with self._lock:
            self._requests[route, method, status] += 1
            times = self._times.get(route)
            if times is None:
                times = self._times[route] = [0] * (len(BUCKETS_S) + 1)
            times[bisect_left(BUCKETS_S, seconds)] += 1
            self._seconds[route] += seconds

    def count(self, name: str, amount: int = 1, **labels: str) -> None:
        """Add to a counter; `labels` hold words of the program, never of a client."""
        with self._lock:
            self._counts[name, tuple(sorted(labels.items()))] += amount

    def total(self, name: str) -> int:
        """Return the sum of a counter over its labels."""
        with self._lock:
            return sum(count for (known, _), count in self._counts.items() if known == name)

    def text(self, gauges: dict[str, float]) -> bytes:
        """Write everything, with values that were measured just now.

        Parameters
        ----------
        gauges
            Name, with labels where it has some, to value.
        """
        with self._lock:
            lines = [*self._request_lines(), *self._count_lines(), *self._time_lines()]
        usage = resource.getrusage(resource.RUSAGE_SELF)
        process = {
            "process_cpu_seconds_total": usage.ru_utime + usage.ru_stime,
            "process_resident_memory_bytes": _resident_bytes(),
            "process_start_time_seconds": self._started,
        }
        for name, value in {**gauges, **process}.items():
            plain = name.partition("{")[0]
            kind = "counter" if plain.endswith("_total") else "gauge"
            lines += [f"# TYPE {plain} {kind}", f"{name} {value:g}"]
        return ("\n".join(_once(lines)) + "\n").encode()

    def _request_lines(self) -> Iterable[str]:
        yield from _head("rtask_http_requests_total", "counter")
        for (route, method, status), count in sorted(self._requests.items()):
            labels = f'route="{route}",method="{method}",status="{status}"'
            yield f"rtask_http_requests_total{{{labels}}} {count}"

    def _count_lines(self) -> Iterable[str]:
        for (name, labels), count in sorted(self._counts.items()):
            yield from _head(name, "counter")
            inside = ",".join(f'{key}="{value}"' for key, value in labels)
            yield f"{name}{{{inside}}} {count}" if inside else f"{name} {count}"

    def _time_lines(self) -> Iterable[str]:
        name = "rtask_http_request_seconds"
        yield f"# HELP {name} From the first byte of a request to the last of its answer."
        yield f"# TYPE {name} histogram"
        for route, times in sorted(self._times.items()):
            below = 0
            for bound, count in zip(BUCKETS_S, times, strict=False):
                below += count
                yield f'{name}_bucket{{route="{route}",le="{bound:g}"}} {below}'
            total = sum(times)
            yield f'{name}_bucket{{route="{route}",le="+Inf"}} {total}'
            yield f'{name}_sum{{route="{route}"}} {self._seconds[route]:.6f}'
            yield f'{name}_count{{route="{route}"}} {total}'


def _head(name: str, kind: str) -> list[str]:
    return [f"# HELP {name} {_HELP.get(name, name)}", f"# TYPE {name} {kind}"]


def _once(lines: list[str]) -> list[str]:
    """Leave out comments that are there already: a metric is introduced once."""
    seen: set[str] = set()
    kept = []
    for line in lines:
        if line.startswith("# ") and line in seen:
            continue
        seen.add(line)
        kept.append(line)
    return kept


def _resident_bytes() -> float:
    """Return the memory in use now; the most ever used where the system does not say."""
    try:
        pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
        return int(pages) * float(resource.getpagesize())
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0
