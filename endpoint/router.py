"""Routes the addresses for programs to the parts of the server that answer them."""

from __future__ import annotations

import difflib

from endpoint.access.auth import Caller, limited_refusal, plan_ticket, preflight_headers
from endpoint.admin import AdminRoutes
from endpoint.api.blobs import plan_blob
from endpoint.api.collections import COLLECTIONS
from endpoint.api.datasets import is_dataset_address, plan_dataset
from endpoint.api.datasets import methods_of as dataset_methods
from endpoint.api.listing import ADDRESS as API
from endpoint.api.listing import is_listing, plan_listing
from endpoint.api.openapi import ADDRESSES as DESCRIPTIONS
from endpoint.api.openapi import plan_openapi
from endpoint.api.operations import plan_operation
from endpoint.api.reasoner import ADDRESS as REASONER
from endpoint.api.reasoner import methods_of, plan_reasoner
from endpoint.api.services import is_service_address, plan_service
from endpoint.api.services import methods_of as service_methods
from endpoint.api.tools import ADDRESS as TOOLS
from endpoint.api.tools import plan_tools
from endpoint.context import ServerContext
from endpoint.follow.asked_records import plan_asked_records
from endpoint.follow.replication import ASKED, SNAPSHOT, require_replicate, snapshot
from endpoint.http.idempotency import IdempotencyKeys
from endpoint.http.messages import RefusedError, Request, Response
from endpoint.http.plan import Plan
from endpoint.served import embedded
from endpoint.sparql import check, graph_store, protocol
from endpoint.sparql.answer_cache import AnswerCache
from endpoint.sparql.answers import Answers
from endpoint.sparql.lookups import Lookups
from endpoint.sparql.readable import limit_query
from endpoint.sparql.request import (
    METHODS,
    QUERY,
    UPDATE,
    DescriptionRequest,
    UpdateRequest,
    parse_operation,
)

TICKET = "/tokens/ticket"
_PROTOCOL = {
    "/sparql": (QUERY, UPDATE),
    "/query": (QUERY,),
    "/update": (UPDATE,),
}
_ADMIN = ("/metrics", "/queries", "/api/history", "/backup")
_EXACT = frozenset(
    (
        *_PROTOCOL,
        check.ADDRESS,
        graph_store.ADDRESS,
        "/health",
        *_ADMIN,
        *DESCRIPTIONS,
        TICKET,
        TOOLS,
        SNAPSHOT,
        ASKED,
    )
)
_PREFIXES = (graph_store.ADDRESS + "/", "/engine/", "/api/", "/health/", "/queries/", REASONER)
_SAFE_METHODS = frozenset(("GET", "HEAD", "OPTIONS"))
_BLOBS = "/api/blobs/"


def serves(path: str) -> bool:
    """Tell whether an address is for programs; all others are pages.

    Examples
    --------
    >>> [serves(path) for path in ("/sparql/", "/engine/x", "/api/robots", "/robots")]
    [True, True, True, False]
    """
    address = path.rstrip("/") or "/"
    if is_service_address(address) or is_dataset_address(address):
        return True
    return address in _EXACT or path.startswith(_PREFIXES)


class Router:
    """Parses the requests of identified callers and plans their answers.

    Parameters
    ----------
    context
        The parts of the server.

    Attributes
    ----------
    asked
        The parts that answer queries.
    """

    def __init__(self, context: ServerContext) -> None:
        self._context = context
        kb, config = context.kb, context.config
        answers = Answers(kb, config)
        self._store = graph_store.GraphStore(kb, context.auth, config, context.versions, answers)
        cache = AnswerCache(kb, context.metrics, config.cache)
        context.gauges["rtask_answer_cache_bytes"] = lambda: cache.bytes
        self.asked = protocol.Asked(answers, Lookups(kb), cache, context.versions)
        self._admin = AdminRoutes(context)
        self._keys = IdempotencyKeys()

    def plan(self, request: Request, caller: Caller, address: str) -> Plan:
        """Plan the answer to a request.

        Parameters
        ----------
        address
            Its path without a trailing slash.
        """
        context = self._context
        if address in _PROTOCOL:
            return self._protocol(request, caller, _PROTOCOL[address])
        if caller.access.reads is not None and not _is_graph_store(address):
            raise limited_refusal(address)
        if address == check.ADDRESS:
            return check.plan_check(context.kb, request)
        if address == TICKET:
            return plan_ticket(context.auth, request, caller)
        if request.method not in _SAFE_METHODS:
            context.limiter.admit_write(caller)
        if _is_graph_store(address):
            return self._store.plan(request, caller)
        if address.startswith("/engine/"):
            return plan_operation(context.engine, context.auth, request, caller, self._keys)
        if is_service_address(address):
            return plan_service(context.services, context.auth, request, caller, address)
        if address == TOOLS:
            return plan_tools(context.services, context.auth, request, caller)
        if is_dataset_address(address):
            datasets = context.services.datasets
            return plan_dataset(datasets, context.auth, request, caller, address)
        if address.startswith(REASONER):
            kb = embedded(context.kb, "the reasoner")
            return plan_reasoner(kb, context.auth, request, caller)
        if address == ASKED:
            return plan_asked_records(context.engine, context.tokens, request, caller)
        if address == SNAPSHOT:
            require_replicate(caller)
            own = embedded(context.kb, "a snapshot")
            return Plan(lambda: snapshot(own, caller))
        if address in DESCRIPTIONS:
            return plan_openapi(context.engine, context.services.registry, request)
        if address in _ADMIN or address.startswith("/queries/"):
            return self._admin.plan(request, caller, address)
        if is_listing(address):
            timeout_s = context.config.timeout_s
            return plan_listing(context.kb, context.versions, request, timeout_s)
        if request.raw_path.startswith(_BLOBS):
            return plan_blob(context.kb, request, request.path.removeprefix(_BLOBS))
        hint = self._nearest(address)
        raise RefusedError(404, "not-found", f"there is nothing at {address}; {hint}")

    def _nearest(self, address: str) -> str:
        """Return a hint that names the address that is likely to be meant."""
        last = address.rpartition("/")[2]
        if last in self._context.engine.operations:
            return f"did you mean /engine/{last}?"
        near = difflib.get_close_matches(address, [f"{API}{name}" for name in COLLECTIONS], n=1)
        return f"did you mean {near[0]}?" if near else "see /openapi"

    def options(self, request: Request, address: str) -> Plan:
        """Return the methods of an address, and what a page of another origin may send."""
        if address in _PROTOCOL:
            methods = METHODS[_PROTOCOL[address]]
        elif address.startswith("/engine/") or address in (TICKET, check.ADDRESS, TOOLS):
            methods = ("POST", "OPTIONS")
        elif is_service_address(address):
            methods = (*service_methods(address), "OPTIONS")
        elif is_dataset_address(address):
            methods = (*dataset_methods(address), "OPTIONS")
        elif address.startswith(REASONER):
            methods = (*methods_of(address), "OPTIONS")
        elif address.startswith(graph_store.ADDRESS):
            methods = graph_store.METHODS
        else:
            methods = ("GET", "HEAD", "OPTIONS")
        allow = ("Allow", ", ".join(methods))
        headers = (allow, *preflight_headers(request, self._context.config))
        return Plan.ready(Response(204, headers=headers))

    def _protocol(self, request: Request, caller: Caller, kinds: tuple[str, ...]) -> Plan:
        context = self._context
        kept = self.asked.cache.find(request, caller.access)
        if kept is not None:
            return kept
        operation = parse_operation(request, kinds)
        if isinstance(operation, DescriptionRequest):
            if caller.access.reads is not None:
                raise limited_refusal("the description of the service")
            return protocol.plan_description(
                context.kb, request, context.config, updates=UPDATE in kinds
            )
        if isinstance(operation, UpdateRequest):
            context.auth.require_write(request, caller)
            context.limiter.admit_write(caller)
            return protocol.plan_update(context.kb, operation, request, caller, context.config)
        context.queries.check_room()
        operation = limit_query(operation, caller.access, context.kb)
        return protocol.plan_query(operation, request, caller, context.config, self.asked)


def _is_graph_store(address: str) -> bool:
    return address == graph_store.ADDRESS or address.startswith(graph_store.ADDRESS + "/")
