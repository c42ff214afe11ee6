"""The addresses for programs, one a line: what each takes, does to the graph, and who answers it.

Dispatch, OPTIONS, 405 with ``Allow``, the effects in OpenAPI, what a follower passes on, and pages
that share an address all follow from this table.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from werkzeug.exceptions import MethodNotAllowed, NotFound
from werkzeug.routing import Map, Rule

from rtask.wire.effect import Effect

__all__ = ["ROUTES", "Lane", "Match", "Route", "find", "serves"]

Lane = Literal["stream", "work"]
"""``stream``: by an open connection; ``work``: at once, by a reader, or by a thread."""


@dataclass(frozen=True)
class Route:
    """One address with some of its methods.

    Parameters
    ----------
    pattern
        As werkzeug reads it.
    methods
        HTTP methods; HEAD comes with GET, and OPTIONS with every address.
    effect
        What a request does to the graph; None = what the operation, method of a service or text in
        the request declares.
    handler
        The part of the server that answers; a name in the router.
    lane
        How it is answered.
    limited
        Whether callers may use it that may read some graphs only; it then reads these alone.
    pages
        Methods by which a browser gets a page at this address instead.
    advice
        What to do instead of another method.
    """

    pattern: str
    methods: tuple[str, ...]
    effect: Effect | None
    handler: str
    lane: Lane = "work"
    limited: bool = False
    pages: tuple[str, ...] = ()
    advice: str = ""


_GET, _POST, _BOTH = ("GET", "HEAD"), ("POST",), ("GET", "HEAD", "POST")
_CHANGE = ("PUT", "POST", "DELETE")
_READ_ONLY = "this is read with GET; robots write by /engine/"
_SERVICE, _DATASET = "/services/<ns>/<name>", "/datasets/<ns>/<name>"

ROUTES: tuple[Route, ...] = (
    Route("/sparql", _BOTH, None, "protocol", limited=True, pages=_GET),
    Route("/query", _BOTH, "reads", "protocol", limited=True),
    Route("/update", _POST, "writes", "protocol", limited=True),
    Route("/ask", _GET, "reads", "question", pages=_GET),
    Route("/terms", _GET, "reads", "terms", pages=_GET),
    Route("/sparql/check", _POST, "reads", "check"),
    Route("/store", _GET, "reads", "store", limited=True),
    Route("/store", _CHANGE, "writes", "store", limited=True),
    Route("/store/<path:rest>", _GET, "reads", "store", limited=True),
    Route("/store/<path:rest>", _CHANGE, "writes", "store", limited=True),
    Route("/engine/<path:name>", _POST, None, "operation"),
    Route("/services", _GET, "reads", "service", pages=_BOTH),
    Route(_SERVICE, _GET, "reads", "service", pages=_BOTH),
    Route(_SERVICE + "/<method>", _POST, None, "service"),
    Route("/services/<path:rest>", _GET, "reads", "service"),
    Route("/jobs", _GET, "reads", "service", pages=_BOTH),
    Route("/jobs/<path:id>", _GET, "reads", "service", pages=_BOTH),
    Route("/jobs/<path:id>", ("DELETE",), "reads", "service"),
    Route("/datasets", _GET, "reads", "dataset", pages=_BOTH),
    Route(_DATASET, _GET, "reads", "dataset", pages=_BOTH),
    Route(_DATASET, ("PUT",), "writes", "dataset"),
    Route(_DATASET + "/diff", _GET, "reads", "dataset"),
    Route(_DATASET + "/snapshot", _POST, "writes", "dataset"),
    Route(_DATASET + "/prune", _POST, "writes", "dataset"),
    Route(_DATASET + "/merge", _POST, "writes", "dataset"),
    Route(_DATASET + "/files", _POST, "writes", "dataset"),
    Route(_DATASET + "/files/<path:path>", _GET, "reads", "dataset"),
    Route(_DATASET + "/files/<path:path>", ("PUT", "DELETE"), "writes", "dataset"),
    Route("/datasets/<path:rest>", _GET, "reads", "dataset"),
    Route("/mcp", _POST, None, "agents", advice="send JSON-RPC by POST"),
    Route("/mcp/services", _POST, None, "tools", advice="send JSON-RPC by POST"),
    Route("/reasoner/rules", _GET, "reads", "reasoner"),
    Route("/reasoner/rules", ("POST", "DELETE"), "writes", "reasoner"),
    Route("/reasoner/rules/<path:name>", _GET, "reads", "reasoner"),
    Route("/reasoner/rules/<path:name>", ("DELETE",), "writes", "reasoner"),
    Route("/reasoner/explain", _GET, "reads", "reasoner"),
    Route("/reasoner/entails", _BOTH, "reads", "reasoner"),
    Route("/reasoner/contradictions", _GET, "reads", "reasoner"),
    Route("/proposals", _GET, "reads", "proposals"),
    Route("/proposals", _POST, "writes", "proposals"),
    Route("/proposals/<number>", _GET, "reads", "proposals"),
    Route("/proposals/<number>/adopt", _POST, "writes", "proposals"),
    Route("/proposals/<number>/refuse", _POST, "writes", "proposals"),
    Route("/api/history", _GET, "reads", "admin"),
    Route("/api/blobs/<path:digest>", _GET, "reads", "blob"),
    Route("/api/context.jsonld", _GET, "reads", "listing", advice=_READ_ONLY),
    Route("/api/<collection>", _GET, "reads", "listing", advice=_READ_ONLY),
    Route("/api/<collection>/<path:id>", _GET, "reads", "listing", advice=_READ_ONLY),
    Route("/changes", _BOTH, "reads", "changes", "stream"),
    Route("/changes/<path:commit>", _BOTH, "reads", "changes", "stream"),
    Route("/activity/events", _BOTH, "reads", "changes", "stream"),
    Route("/replicate/records", _BOTH, "reads", "changes", "stream"),
    Route("/replicate/snapshot", _GET, "reads", "snapshot"),
    Route("/replicate/asked", _POST, "writes", "asked_records"),
    Route("/tokens/ticket", _POST, "reads", "ticket"),
    Route("/openapi", _GET, "reads", "openapi"),
    Route("/openapi.json", _GET, "reads", "openapi"),
    Route("/health", _GET, "reads", "health"),
    Route("/health/<path:check>", _GET, "reads", "health"),
    Route("/metrics", _GET, "reads", "admin"),
    Route("/queries", _GET, "reads", "admin"),
    Route("/queries/<path:id>", ("DELETE",), "reads", "admin"),
    Route("/backup", _POST, "writes", "admin"),
)
"""The table."""

_MAX_CACHED_LENGTH = 256
"""Length of addresses whose match is remembered, in characters."""

_BY_PATTERN: dict[str, list[Route]] = defaultdict(list)
for _route in ROUTES:
    _BY_PATTERN[_route.pattern].append(_route)
# An address is taken as it was sent, so that werkzeug neither joins slashes nor redirects.
_MAP = Map(
    [Rule(pattern, endpoint=pattern) for pattern in _BY_PATTERN],
    strict_slashes=False,
    merge_slashes=False,
).bind("")


@dataclass(frozen=True)
class Match:
    """What the table says of an address.

    Parameters
    ----------
    routes
        All routes of its pattern; none where there is nothing.
    """

    routes: tuple[Route, ...]

    @property
    def allow(self) -> tuple[str, ...]:
        """Methods of the address, as ``Allow`` lists them."""
        methods = dict.fromkeys(method for route in self.routes for method in route.methods)
        return (*methods, "OPTIONS")

    def by(self, method: str) -> Route | None:
        """Return the route for a method, or None if the address does not take it."""
        return next((route for route in self.routes if method in route.methods), None)


_NOTHING = Match(())
_FIXED = {
    pattern: Match(tuple(routes)) for pattern, routes in _BY_PATTERN.items() if "<" not in pattern
}


def find(address: str) -> Match:
    """Return what is at an address, given as a path without a trailing slash.

    Examples
    --------
    >>> find("/services/example/Kinematics/forward").by("POST").handler
    'service'
    >>> find("/datasets/robots/NAO").allow, find("/robots").routes
    (('GET', 'HEAD', 'PUT', 'OPTIONS'), ())
    """
    fixed = _FIXED.get(address)
    if fixed is not None:
        return fixed
    return (
        _matched(address) if len(address) <= _MAX_CACHED_LENGTH else _matched.__wrapped__(address)
    )


@lru_cache(maxsize=4_096)
def _matched(address: str) -> Match:
    try:
        # Slashes count as one here; the handler gets the address as it was sent.
        pattern, _ = _MAP.match(re.sub("//+", "/", address))
    except (NotFound, MethodNotAllowed):
        return _NOTHING
    return Match(tuple(_BY_PATTERN[pattern]))


def serves(path: str) -> bool:
    """Return whether an address is for programs; all others are pages.

    Examples
    --------
    >>> [serves(path) for path in ("/sparql/", "/engine/x", "/api/robots", "/robots")]
    [True, True, True, False]
    """
    return bool(find(path.rstrip("/") or "/").routes)
