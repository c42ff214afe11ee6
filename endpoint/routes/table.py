"""The addresses for programs, one a line.

What a caller needs, what a request does to the graph, who answers it, and what it carries.
Dispatch, OPTIONS, 405 with ``Allow``, the check of rights, OpenAPI, what a follower passes on, and
pages that share an address all follow from this table.
"""

from __future__ import annotations

import re
from collections import defaultdict
from functools import lru_cache

from werkzeug.exceptions import MethodNotAllowed, NotFound
from werkzeug.routing import Map, Rule

from endpoint.routes import addresses as at
from endpoint.routes import asking, branches, hosting, reasoning
from endpoint.routes.route import Declared, Match, Route

__all__ = ["ROUTES", "find", "serves"]

_GET, _POST, _PUT, _DELETE = ("GET", "HEAD"), ("POST",), ("PUT",), ("DELETE",)
_BOTH, _CHANGE = ("GET", "HEAD", "POST"), ("PUT", "POST", "DELETE")
_READ_ONLY = "this is read with GET; robots write by /engine/"
_JSON_RPC = "send JSON-RPC by POST"
_DECLARED: Declared = "declared"
_SERVICE = at.SERVICES + "/<namespace>/<name>"
_DATASET = at.DATASETS + "/<namespace>/<name>"
_FILE = _DATASET + "/files/<path:path>"
_RULE = at.RULES + "/<path:name>"
_PROPOSAL = at.PROPOSALS + "/<number>"
_BRANCH = at.BRANCHES + "/<name>"

# fmt: off
ROUTES: tuple[Route, ...] = (
    Route(at.SPARQL, _GET, "read", "reads", "protocol", asking.SPARQL, limited=True, pages=_GET),
    Route(at.SPARQL, _POST, _DECLARED, _DECLARED, "protocol", limited=True),
    Route("/query", _BOTH, "read", "reads", "protocol", limited=True),
    Route("/update", _POST, "write", "writes", "protocol", limited=True),
    Route(at.ASK, _GET, "read", "reads", "question", asking.ASK, pages=_GET),
    Route(at.TERMS, _GET, "read", "reads", "terms", asking.TERMS, pages=_GET),
    Route("/sparql/check", _POST, "read", "reads", "check"),
    Route(at.STORE, _GET, "read", "reads", "store", limited=True),
    Route(at.STORE, _CHANGE, "write", "writes", "store", limited=True),
    Route(at.STORE + "/<path:rest>", _GET, "read", "reads", "store", limited=True),
    Route(at.STORE + "/<path:rest>", _CHANGE, "write", "writes", "store", limited=True),
    Route(at.ENGINE + "/<path:name>", _POST, _DECLARED, _DECLARED, "operation", _DECLARED),
    Route(at.SERVICES, _GET, "read", "reads", "service", hosting.SERVICES, pages=_BOTH),
    Route(_SERVICE, _GET, "read", "reads", "service", hosting.SERVICE, pages=_BOTH),
    Route(_SERVICE + "/<method>", _POST, _DECLARED, _DECLARED, "service", _DECLARED, _DECLARED),
    Route(at.SERVICES + "/<path:rest>", _GET, "read", "reads", "service"),
    Route(at.JOBS, _GET, "read", "reads", "service", hosting.JOBS, pages=_BOTH),
    Route(at.JOBS + "/<path:id>", _GET, "read", "reads", "service", hosting.JOB, _DECLARED,
          pages=_BOTH),
    Route(at.JOBS + "/<path:id>", _DELETE, "read", "reads", "service", hosting.JOB_CANCELLED,
          _DECLARED),
    Route(at.DATASETS, _GET, "read", "reads", "dataset", hosting.DATASETS, pages=_BOTH),
    Route(_DATASET, _GET, "read", "reads", "dataset", hosting.DATASET, pages=_BOTH),
    Route(_DATASET, _PUT, "write", "writes", "dataset", hosting.DATASET_CREATED),
    Route(_DATASET + "/diff", _GET, "read", "reads", "dataset", hosting.DATASET_DIFF),
    Route(_DATASET + "/snapshot", _POST, "write", "writes", "dataset", hosting.DATASET_SNAPSHOT),
    Route(_DATASET + "/prune", _POST, "write", "writes", "dataset", hosting.DATASET_PRUNED),
    Route(_DATASET + "/merge", _POST, "write", "writes", "dataset", hosting.DATASET_MERGED),
    Route(_DATASET + "/files", _POST, "write", "writes", "dataset"),
    Route(_FILE, _GET, "read", "reads", "dataset", hosting.FILE),
    Route(_FILE, _PUT, "write", "writes", "dataset", hosting.FILE_WRITTEN),
    Route(_FILE, _DELETE, "write", "writes", "dataset", hosting.FILE_REMOVED),
    Route(at.DATASETS + "/<path:rest>", _GET, "read", "reads", "dataset"),
    Route(at.MCP, _POST, _DECLARED, _DECLARED, "agents", source=_DECLARED, advice=_JSON_RPC),
    Route(at.MCP_SERVICES, _POST, _DECLARED, _DECLARED, "tools", source=_DECLARED,
          advice=_JSON_RPC),
    Route(at.RULES, _GET, "read", "reads", "rules", reasoning.RULES, "reasoner"),
    Route(at.RULES, _POST, "rules", "writes", "rules", reasoning.RULES_ADDED, "reasoner"),
    Route(at.RULES, _DELETE, "rules", "writes", "rules", reasoning.RULES_REMOVED, "reasoner"),
    Route(_RULE, _GET, "read", "reads", "rules", reasoning.RULE, "reasoner"),
    Route(_RULE, _DELETE, "rules", "writes", "rules", reasoning.RULE_REMOVED, "reasoner"),
    Route(at.REASONER + "/explain", _GET, "read", "reads", "explain", reasoning.EXPLAIN,
          "reasoner"),
    Route(at.REASONER + "/entails", _GET, "read", "reads", "entails", reasoning.ENTAILS,
          "reasoner"),
    Route(at.REASONER + "/entails", _POST, "read", "reads", "entails", reasoning.ENTAILS_ALL,
          "reasoner"),
    Route(at.REASONER + "/contradictions", _GET, "read", "reads", "contradictions",
          reasoning.CONTRADICTIONS, "reasoner"),
    Route(at.BRANCHES, _GET, "read", "reads", "branches", branches.BRANCHES),
    Route(at.BRANCHES, _POST, "write", "writes", "branches", branches.MADE, "writer"),
    Route(_BRANCH, _GET, "read", "reads", "branches", branches.BRANCH, "writer"),
    Route(_BRANCH, _DELETE, "write", "writes", "branches", branches.DROPPED, "writer"),
    Route(_BRANCH + "/merge", _POST, "write", "writes", "branches", branches.MERGED, "writer"),
    Route(at.PROPOSALS, _GET, "read", "reads", "proposals", reasoning.PROPOSALS, "writer"),
    Route(at.PROPOSALS, _POST, "write", "writes", "proposals", reasoning.PROPOSED, "writer"),
    Route(_PROPOSAL, _GET, "read", "reads", "proposals", reasoning.PROPOSAL, "writer"),
    Route(_PROPOSAL + "/adopt", _POST, "schema", "writes", "proposals", reasoning.ADOPTED,
          "writer"),
    Route(_PROPOSAL + "/refuse", _POST, "schema", "writes", "proposals", reasoning.REFUSED,
          "writer"),
    Route("/api/history", _GET, "admin", "reads", "history"),
    Route(at.BLOBS + "/<path:sha256>", _GET, "read", "reads", "blob", asking.BLOB),
    Route(at.CONTEXT, _GET, "read", "reads", "listing", asking.CONTEXT, advice=_READ_ONLY),
    Route(at.API + "/<collection>", _GET, "read", "reads", "listing", _DECLARED,
          advice=_READ_ONLY),
    Route(at.API + "/<collection>/<path:id>", _GET, "read", "reads", "listing", _DECLARED,
          advice=_READ_ONLY),
    Route(at.CHANGES, _GET, "read", "reads", "changes", asking.CHANGES, lane="stream"),
    Route(at.CHANGES, _POST, "read", "reads", "changes", lane="stream"),
    Route(at.CHANGES + "/<path:commit>", _BOTH, "read", "reads", "changes", lane="stream"),
    Route(at.ACTIVITY, _BOTH, "read", "reads", "activity", lane="stream"),
    Route(at.RECORDS, _BOTH, "replicate", "reads", "records", lane="stream"),
    Route(at.SNAPSHOT, _GET, "replicate", "reads", "snapshot"),
    Route(at.ASKED, _POST, "replicate", "writes", "asked_records"),
    Route("/tokens/ticket", _POST, "token", "reads", "ticket", asking.TICKET),
    Route("/openapi", _GET, "read", "reads", "openapi"),
    Route("/openapi.json", _GET, "read", "reads", "openapi", asking.OPENAPI),
    Route(at.HEALTH, _GET, "public", "reads", "ready", asking.HEALTH),
    Route(at.HEALTH + "/live", _GET, "public", "reads", "live", asking.LIVE),
    Route(at.HEALTH + "/ready", _GET, "public", "reads", "ready", asking.READY),
    Route(at.HEALTH + "/<path:check>", _GET, "public", "reads", "unknown_check"),
    Route("/metrics", _GET, "monitor", "reads", "metrics"),
    Route(at.QUERIES, _GET, "read", "reads", "queries"),
    Route(at.QUERIES + "/<path:id>", _DELETE, "read", "reads", "queries"),
    Route("/backup", _POST, "admin", "writes", "backup"),
)
"""The table."""
# fmt: on

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
