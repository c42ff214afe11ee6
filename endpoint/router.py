"""Which part of the server answers which address of programs."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

from endpoint.access.auth import Caller, preflight_headers
from endpoint.admin import Operators
from endpoint.api.blobs import plan_blob
from endpoint.api.collections import COLLECTIONS
from endpoint.api.listing import ADDRESS as API
from endpoint.api.listing import is_listing, plan_listing
from endpoint.api.openapi import ADDRESSES as DESCRIPTIONS
from endpoint.api.openapi import plan_openapi
from endpoint.api.operations import plan_operation
from endpoint.api.ticket_route import ADDRESS as TICKET
from endpoint.api.ticket_route import plan_ticket
from endpoint.http.idempotency import IdempotencyKeys
from endpoint.http.messages import RefusedError, Request, Response
from endpoint.sparql import graph_store, protocol
from endpoint.sparql.answers import Answers
from endpoint.sparql.deferred import Plan
from endpoint.sparql.lookups import Lookups
from endpoint.sparql.request import (
    METHODS,
    QUERY,
    UPDATE,
    DescriptionRequest,
    UpdateRequest,
    parse_operation,
)

if TYPE_CHECKING:
    from endpoint.application import Gateway

_PROTOCOL = {
    "/sparql": (QUERY, UPDATE),
    "/query": (QUERY,),
    "/update": (UPDATE,),
}
_OPERATORS = ("/metrics", "/queries", "/api/history", "/backup")
_EXACT = frozenset((*_PROTOCOL, graph_store.ADDRESS, "/health", *_OPERATORS, *DESCRIPTIONS, TICKET))
_PREFIXES = (graph_store.ADDRESS + "/", "/engine/", "/api/", "/health/", "/queries/")
_SAFE_METHODS = frozenset(("GET", "HEAD", "OPTIONS"))
_BLOBS = "/api/blobs/"


def serves(path: str) -> bool:
    """Tell whether an address is one of programs; the others are pages.

    Examples
    --------
    >>> [serves(path) for path in ("/sparql/", "/engine/x", "/api/robots", "/robots")]
    [True, True, True, False]
    """
    return (path.rstrip("/") or "/") in _EXACT or path.startswith(_PREFIXES)


class Addresses:
    """Understands the requests of callers that were let in.

    Parameters
    ----------
    gateway
        Whose addresses these are.
    answers
        Where queries meet their readers.
    """

    def __init__(self, gateway: Gateway, answers: Answers) -> None:
        self._gateway = gateway
        kb, config = gateway.kb, gateway.config
        self._store = graph_store.GraphStore(kb, gateway.auth, config, gateway.versions, answers)
        self._asked = protocol.Asked(answers, Lookups(kb), gateway.versions)
        self._operators = Operators(gateway)
        self._keys = IdempotencyKeys()

    def plan(self, request: Request, caller: Caller, address: str) -> Plan:
        """Return what is to be done for a request.

        Parameters
        ----------
        address
            Its path without a trailing slash.
        """
        gateway = self._gateway
        if address in _PROTOCOL:
            return self._protocol(request, caller, _PROTOCOL[address])
        if address == TICKET:
            return plan_ticket(gateway.auth, request, caller)
        if request.method not in _SAFE_METHODS:
            gateway.admit_write(caller)
        if address == graph_store.ADDRESS or address.startswith(graph_store.ADDRESS + "/"):
            return self._store.plan(request, caller)
        if address.startswith("/engine/"):
            return plan_operation(gateway.engine, gateway.auth, request, caller, self._keys)
        if address in DESCRIPTIONS:
            return plan_openapi(gateway.engine, request)
        if address.startswith(_OPERATORS):
            return self._operators.plan(request, caller, address)
        if is_listing(address):
            timeout_s = gateway.config.timeout_s
            return plan_listing(gateway.kb, gateway.versions, request, timeout_s)
        if request.raw_path.startswith(_BLOBS):
            return plan_blob(gateway.kb, request, request.path.removeprefix(_BLOBS))
        near = difflib.get_close_matches(address, [f"{API}{name}" for name in COLLECTIONS], n=1)
        hint = f"did you mean {near[0]}?" if near else "see /openapi"
        raise RefusedError(404, "not-found", f"there is nothing at {address}; {hint}")

    def options(self, request: Request, address: str) -> Plan:
        """Return which methods an address takes, and what a page of another origin may send."""
        if address in _PROTOCOL:
            methods = METHODS[_PROTOCOL[address]]
        elif address.startswith("/engine/") or address == TICKET:
            methods = ("POST", "OPTIONS")
        elif address.startswith(graph_store.ADDRESS):
            methods = graph_store.METHODS
        else:
            methods = ("GET", "HEAD", "OPTIONS")
        allow = ("Allow", ", ".join(methods))
        headers = (allow, *preflight_headers(request, self._gateway.config))
        return Plan.ready(Response(204, headers=headers))

    def _protocol(self, request: Request, caller: Caller, kinds: tuple[str, ...]) -> Plan:
        gateway = self._gateway
        operation = parse_operation(request, kinds)
        if isinstance(operation, DescriptionRequest):
            return protocol.plan_description(
                gateway.kb, request, gateway.config, updates=UPDATE in kinds
            )
        if isinstance(operation, UpdateRequest):
            gateway.auth.require_write(request, caller)
            gateway.admit_write(caller)
            return protocol.plan_update(gateway.kb, operation, request, caller, gateway.config)
        gateway.check_room()
        return protocol.plan_query(operation, request, caller, gateway.config, self._asked)
