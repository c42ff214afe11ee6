"""Metrics in the text format of Prometheus; labels hold words of the program, never of a client."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

from prometheus_client import (
    CONTENT_TYPE_PLAIN_0_0_4,
    CollectorRegistry,
    Counter,
    Histogram,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from endpoint.routes import ROUTES

__all__ = ["CONTENT_TYPE", "Metrics", "route_of"]

CONTENT_TYPE = CONTENT_TYPE_PLAIN_0_0_4
BUCKETS_S = (
    *(0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5),
    *(1.0, 2.5, 5.0, 10.0, 30.0, 60.0),
)
_METHODS = frozenset(("GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"))
_ROUTES = (
    *dict.fromkeys("/" + route.pattern.split("/")[1] for route in ROUTES),
    "/admin",
    "/static",
)
_COUNTERS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("rtask_query", "Queries by form and outcome.", ("form", "outcome")),
    ("rtask_query_aborted", "Queries that did not reach their end.", ("reason",)),
    ("rtask_answer_cache", "Queries that the answer cache was asked for.", ("outcome",)),
    ("rtask_rate_limited", "Requests refused because a caller sent too many.", ()),
    ("rtask_denied", "Requests refused for lack of rights.", ("status",)),
    ("rtask_commits", "Commits stored.", ()),
    ("rtask_commit_quads", "Statements that commits added, removed or derived.", ("kind",)),
)
_GAUGE_HELP = {
    "rtask_answer_cache_bytes": "Size of the answers kept until the next commit.",
    "rtask_store_seq": "Number of the last commit.",
    "rtask_quads": "Statements in the store, counted at most once a minute.",
    "rtask_queries_running": "Queries that run or wait.",
    "rtask_service_dropped_total": "Results of services that came after their calls had ended.",
    "rtask_ready": "Whether the server is ready for requests.",
    "rtask_writers_waiting": "Changes that wait for another one to be stored.",
    "rtask_writer_wait_seconds": "Time for which the first of these has waited.",
    "rtask_journal_bytes": "Size of the journal.",
    "rtask_disk_free_bytes": "Free disk space for the data folder.",
    "rtask_subscribers": "Followers of changes.",
    "rtask_robots_connected": "Open websocket connections of robots.",
    "rtask_upload_bytes_held": "Bytes of request bodies that are being received.",
    "rtask_follower_records_waiting": "Records of what robots asked that wait for the writer.",
    "rtask_follower_records_dropped_total": "Such records that were dropped: too many, or refused.",
    "rtask_log_lines_dropped_total": "Log lines dropped because nobody read them in time.",
}
# The creation time of each counter would double the number of samples.
disable_created_metrics()  # type: ignore[no-untyped-call]


@lru_cache(maxsize=256)
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
    """The counters of one server; may be used from any thread.

    Examples
    --------
    >>> metrics = Metrics()
    >>> metrics.count("rtask_commit_quads_total", 1_000_001, kind="added")
    >>> metrics.total("rtask_commit_quads_total")
    1000001
    """

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        self._requests = Counter(
            "rtask_http_requests",
            "Requests answered.",
            ("route", "method", "status"),
            registry=self._registry,
        )
        self._seconds = Histogram(
            "rtask_http_request_seconds",
            "Time from the first byte of a request to the last of its answer.",
            ("route",),
            buckets=BUCKETS_S,
            registry=self._registry,
        )
        self._counters = {
            f"{name}_total": Counter(name, text, labels, registry=self._registry)
            for name, text, labels in _COUNTERS
        }
        ProcessCollector(registry=self._registry)
        # Finding the series of some labels takes longer than adding to it.
        self._request_series: dict[
            tuple[str, str, int, str, str], tuple[Counter, Histogram, Counter | None]
        ] = {}
        self._counter_series: dict[tuple[str, ...], Counter] = {}

    def request(
        self, path: str, method: str, status: int, seconds: float, form: str = "", how: str = ""
    ) -> None:
        """Count a request and the time it took.

        Parameters
        ----------
        form, how
            Of a query that succeeded: its form and outcome.
        """
        key = (route_of(path), method if method in _METHODS else "other", status, form, how)
        series = self._request_series.get(key)
        if series is None:
            series = self._request_series[key] = self._series(*key)
        requests, times, queries = series
        requests.inc()
        times.observe(seconds)
        if queries is not None:
            queries.inc()

    def _series(
        self, route: str, method: str, status: int, form: str, how: str
    ) -> tuple[Counter, Histogram, Counter | None]:
        queries = None
        if form:
            queries = self._counters["rtask_query_total"].labels(form=form, outcome=how)
        return self._requests.labels(route, method, status), self._seconds.labels(route), queries

    def count(self, name: str, amount: int = 1, **labels: str) -> None:
        """Add to a counter; all its labels must be given."""
        key = (name, *labels.values())
        if (counter := self._counter_series.get(key)) is None:
            family = self._counters[name]
            counter = family.labels(**labels) if labels else family
            self._counter_series[key] = counter
        counter.inc(amount)

    def total(self, name: str) -> int:
        """Return the sum of a counter over its labels."""
        samples = (sample for family in self._counters[name].collect() for sample in family.samples)
        return int(sum(sample.value for sample in samples if sample.name == name))

    def text(self, gauges: Mapping[str, float]) -> bytes:
        """Write all metrics in the text format of Prometheus.

        Parameters
        ----------
        gauges
            Name to value, measured just now; a name that ends in ``_total`` is a counter.
        """
        return generate_latest(self._registry) + generate_latest(_Measured(gauges))


class _Measured(Collector):
    """Values that somebody else measured."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self._values = values

    def collect(self) -> Iterable[CounterMetricFamily | GaugeMetricFamily]:
        """Yield one family for each value."""
        for name, value in self._values.items():
            kind = CounterMetricFamily if name.endswith("_total") else GaugeMetricFamily
            yield kind(name, _GAUGE_HELP.get(name, name), value=value)
