"""Routes the addresses for programs to the parts of the server that answer them."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping

from endpoint.access.auth import Caller, limited_refusal, plan_ticket, preflight_headers
from endpoint.admin import AdminRoutes
from endpoint.api.agent_messages import cancelled, messages_in, tool_called
from endpoint.api.agents import plan_agents
from endpoint.api.blobs import plan_blob
from endpoint.api.branches import plan_branches
from endpoint.api.collections import COLLECTIONS
from endpoint.api.datasets import plan_dataset
from endpoint.api.listing import plan_listing
from endpoint.api.openapi import plan_openapi
from endpoint.api.operations import plan_operation
from endpoint.api.proposals import plan_proposals
from endpoint.api.reasoner import (
    plan_contradictions,
    plan_entails,
    plan_explain,
    plan_rules,
)
from endpoint.api.services import plan_service
from endpoint.api.tools import effect_of_tool, plan_tools, tools_named
from endpoint.context import ServerContext
from endpoint.follow.asked_records import plan_asked_records
from endpoint.follow.replication import snapshot
from endpoint.http.agent_calls import AgentCalls, program_of
from endpoint.http.idempotency import IdempotencyKeys
from endpoint.http.messages import RefusedError, Request, Response, require_method
from endpoint.http.plan import Plan
from endpoint.rosbridge.hosted import source_of
from endpoint.routes import Match, Route, find
from endpoint.routes.addresses import API, BLOBS, CONTEXT, ENGINE, JOBS, SERVICES
from endpoint.served import embedded
from endpoint.sparql import check, graph_store, protocol, questions, terms
from endpoint.sparql.answer_cache import AnswerCache
from endpoint.sparql.answers import Answers
from endpoint.sparql.branches import BranchStates
from endpoint.sparql.lookups import Lookups
from endpoint.sparql.negotiation import prefers_html
from endpoint.sparql.past_states import PastStates
from endpoint.sparql.readable import limit_query
from endpoint.sparql.request import (
    QUERY,
    UPDATE,
    DescriptionRequest,
    UpdateRequest,
    is_update,
    parse_operation,
)
from rtask.asking.tools.toolbox import Toolbox
from rtask.engine.context import SCOPES
from rtask.errors import RtaskError
from rtask.knowledge_base import KnowledgeBase
from rtask.services.definition import Definition
from rtask.sparql.slow_shapes import SlowShapes
from rtask.wire.effect import Effect, Source, strongest

Handler = Callable[[Request, Caller, str], Plan]

_KINDS = {"reads": (QUERY,), "writes": (UPDATE,), "declared": (QUERY, UPDATE)}
"""Kinds of SPARQL that an address takes, by its effect."""


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
        self._store = graph_store.GraphStore(kb, config, context.versions, answers)
        cache = AnswerCache(kb, context.metrics, config.cache)
        context.gauges["rtask_answer_cache_bytes"] = lambda: cache.bytes
        past = PastStates(kb, config)
        context.at_close.append(past.close)
        branches = BranchStates(kb, config)
        self.asked = protocol.Asked(
            answers, Lookups(kb), cache, context.versions, past, branches, SlowShapes()
        )
        self._admin = AdminRoutes(context)
        self._keys = IdempotencyKeys()
        self._calls = AgentCalls()
        self._handlers = self._made_handlers()

    def _made_handlers(self) -> Mapping[str, Handler]:
        """Return what answers, by the names in the table of addresses."""
        context, auth = self._context, self._context.auth
        kb, engine, services = context.kb, context.engine, context.services
        return {
            "protocol": self._protocol,
            "check": lambda request, caller, address: check.plan_check(context.kb, request),
            "question": self._question,
            "terms": self._terms,
            "ticket": lambda request, caller, address: plan_ticket(auth, caller),
            "store": lambda request, caller, address: self._store.plan(request, caller),
            "operation": lambda request, caller, address: plan_operation(
                engine, auth, request, caller, self._keys
            ),
            "service": lambda request, caller, address: plan_service(
                services, auth, request, caller, address
            ),
            "agents": self._agents,
            "tools": lambda request, caller, address: plan_tools(
                services, auth, request, caller, self._calls
            ),
            "dataset": lambda request, caller, address: plan_dataset(
                services.datasets, request, caller, address
            ),
            **self._reasoner_handlers(),
            "branches": lambda request, caller, address: plan_branches(
                embedded(kb, "branches"), context.audit, request, caller, address
            ),
            "proposals": lambda request, caller, address: plan_proposals(
                embedded(kb, "proposals"), context.audit, request, caller, address
            ),
            "asked_records": lambda request, caller, address: plan_asked_records(
                engine, context.tokens, request
            ),
            "snapshot": self._snapshot,
            "openapi": lambda request, caller, address: plan_openapi(
                engine, services.registry, request
            ),
            "history": lambda request, caller, address: self._admin.plan_history(),
            "metrics": lambda request, caller, address: self._admin.plan_metrics(),
            "backup": lambda request, caller, address: self._admin.plan_backup(caller),
            "queries": self._admin.plan_queries,
            "listing": self._listing,
            "blob": lambda request, caller, address: plan_blob(
                kb, request, request.path.removeprefix(f"{BLOBS}/")
            ),
        }

    def _reasoner_handlers(self) -> dict[str, Handler]:
        kb = self._context.kb

        def own() -> KnowledgeBase:
            return embedded(kb, "the reasoner")

        return {
            "rules": lambda request, caller, address: plan_rules(own(), request, caller),
            "explain": lambda request, caller, address: plan_explain(own(), request),
            "entails": lambda request, caller, address: plan_entails(own(), request),
            "contradictions": lambda request, caller, address: plan_contradictions(own()),
        }

    def plan_public(self, request: Request, address: str) -> Plan:
        """Plan the answer to a request that anybody may send."""
        return self._context.health.plan(find(address).routes[0].handler)

    def plan(self, request: Request, caller: Caller, address: str) -> Plan:
        """Plan the answer to a request.

        Parameters
        ----------
        address
            Its path without a trailing slash.
        """
        match = find(address)
        if not match.routes:
            raise self._nothing_at(address)
        first = match.routes[0]
        # A caller of some graphs only may not even learn what an address takes that reads all.
        if caller.access.reads is not None and not first.limited:
            raise limited_refusal(address)
        if first.handler == "operation" and _opens_form(request):
            return self._handlers[first.handler](request, caller, address)
        route = match.by(request.method)
        if route is None:
            require_method(request, match.allow, first.advice)
            raise self._nothing_at(address)
        effects = self._effects(request, address)
        # Before the right is looked at: a flood of refused calls costs as much as one of answered.
        changes = sum(effect != "reads" for effect in effects)
        self._context.limiter.admit_calls(caller, len(effects), changes)
        self._context.rights.require(route.right, request, caller)
        handler = self._handlers.get(route.handler)
        # Its handler lives in another part of the server: a stream, which does not come through
        # here.
        if handler is None:  # a stream, which does not come through here
            raise self._nothing_at(address)
        return handler(request, caller, address)

    def effect(self, request: Request, address: str) -> Effect:
        """Return what a request does to the graph; one that is refused does nothing."""
        return strongest(*self._effects(request, address))

    def _effects(self, request: Request, address: str) -> list[Effect]:
        """Return the effect of each call in a request; only messages of agents hold several."""
        route = find(address).by(request.method)
        if route is None:
            # A refused method does nothing to the graph.
            return ["reads"]
        if route.effect != "declared":
            return [route.effect]
        if route.handler == "protocol":
            return ["writes" if is_update(request) else "reads"]
        if route.handler == "operation":
            operation = self._context.engine.operations.get(address.removeprefix(f"{ENGINE}/"))
            return ["reads" if operation is None else operation.effect]
        if route.handler in ("agents", "tools"):
            effect_of = self._effect_of_tool(route.handler)
            called = [tool_called(message) for message in messages_in(request)]
            return ["reads" if name is None else effect_of(name) for name in called]
        try:
            # An unknown service is refused later, with its name; that does nothing either.
            definition, method = self._called(address)
        except RtaskError:
            return ["reads"]
        return [definition.methods[method].effect]

    def _effect_of_tool(self, handler: str) -> Callable[[str], Effect]:
        if handler == "agents":
            return self._toolbox().effect_of
        return lambda name: effect_of_tool(self._context.services, name)

    def is_for_writer(self, request: Request, caller: Caller, address: str) -> bool:
        """Return whether a follower passes a request on.

        These are all that write, and those whose answer is made from what it has not.
        """
        route = find(address).by(request.method)
        if route is None:
            return False
        if self.effect(request, address) == "writes":
            return True
        return not all(map(self._has, self._sources(route, request, caller, address)))

    def _has(self, source: Source) -> bool:
        """Return whether answers can be made here from a source."""
        if source == "reasoner":
            return bool(getattr(self._context.kb, "reasons", False))
        return source == "graph"

    def _sources(
        self, route: Route, request: Request, caller: Caller, address: str
    ) -> Iterator[Source]:
        """Yield what the answer to each call in a request is made from."""
        if route.source != "declared":
            yield route.source
        elif route.handler in ("agents", "tools"):
            program = program_of(caller.key, request)
            for message in messages_in(request):
                # Only where the call is under way can it be cancelled, and that is known here
                # alone.
                if any(not self._calls.has(program, call) for call in cancelled(message)):
                    yield "writer"  # the call is under way there
                name = tool_called(message)
                if name is not None:
                    yield self._source_of_tool(route.handler, name)
        elif address.startswith(f"{JOBS}/"):
            name = address.removeprefix(f"{JOBS}/")
            has_job = self._context.services.jobs.has(name, caller.key)
            yield "graph" if has_job else "writer"
        else:
            try:
                definition, method = self._called(address)
            except RtaskError:  # the other server may offer it
                yield "writer"
            else:
                yield source_of(definition, definition.methods[method])

    def _source_of_tool(self, handler: str, name: str) -> Source:
        if handler == "agents":
            return self._toolbox().source_of(name)
        named = tools_named(self._context.services, name)
        sources = [source_of(*pair) for pair in named]
        return "writer" if not sources or "writer" in sources else "graph"

    def _called(self, address: str) -> tuple[Definition, str]:
        """Return the service and the method at ``/services/<ns>/<name>/<method>``.

        Raises
        ------
        UnknownTermError
            There is none.
        """
        service, _, method = address.removeprefix(SERVICES).strip("/").rpartition("/")
        definition, declared = self._context.services.find(service, method)
        return definition, declared.name

    def _nothing_at(self, address: str) -> RefusedError:
        """Return the refusal that names the address that is likely to be meant."""
        last = address.rpartition("/")[2]
        near = difflib.get_close_matches(address, [f"{API}/{name}" for name in COLLECTIONS], n=1)
        hint = f"did you mean {near[0]}?" if near else "see /openapi"
        if last in self._context.engine.operations:
            hint = f"did you mean {ENGINE}/{last}?"
        return RefusedError(404, "not-found", f"there is nothing at {address}; {hint}")

    def options(self, request: Request, address: str) -> Plan:
        """Return the methods of an address, and what a page of another origin may send."""
        allow = ("Allow", ", ".join(find(address).allow))
        headers = (allow, *preflight_headers(request, self._context.config))
        return Plan.ready(Response(204, headers=headers))

    def _toolbox(self) -> Toolbox:
        context = self._context
        own = embedded(context.kb, "the graph for agents")
        config = context.config
        return Toolbox(own, context.engine, lambda access: SCOPES[access.role], config.timeout_s)

    def _agents(self, request: Request, caller: Caller, address: str) -> Plan:
        context = self._context
        context.queries.check_room()
        return plan_agents(
            self._toolbox(), context.auth, request, caller, self._calls, context.config.timeout_s
        )

    def _question(self, request: Request, caller: Caller, address: str) -> Plan:
        context = self._context
        context.queries.check_room()
        return questions.plan_question(context.kb, request, caller, context.config.timeout_s)

    def _terms(self, request: Request, caller: Caller, address: str) -> Plan:
        context = self._context
        context.queries.check_room()
        return terms.plan_terms(context.kb, request, caller, context.config.timeout_s)

    def _listing(self, request: Request, caller: Caller, address: str) -> Plan:
        context = self._context
        name = address.removeprefix(f"{API}/").partition("/")[0]
        if name not in COLLECTIONS and address != CONTEXT:
            raise self._nothing_at(address)
        return plan_listing(context.kb, context.versions, request, context.config.timeout_s)

    def _snapshot(self, request: Request, caller: Caller, address: str) -> Plan:
        own = embedded(self._context.kb, "a snapshot")
        return Plan(lambda: snapshot(own))

    def _protocol(self, request: Request, caller: Caller, address: str) -> Plan:
        context, kinds = self._context, _kinds(find(address))
        # Before anything is parsed: a repeated question costs a look into a dictionary.
        cached = self.asked.cache.find(request, caller.access)
        if cached is not None:
            return cached
        operation = parse_operation(request, kinds)
        if isinstance(operation, DescriptionRequest):
            if caller.access.reads is not None:
                raise limited_refusal("the description of the service")
            return protocol.plan_description(
                context.kb, request, context.config, updates=UPDATE in kinds
            )
        if isinstance(operation, UpdateRequest):
            context.rights.require("write", request, caller)  # of a text that declares itself
            return protocol.plan_update(context.kb, operation, request, caller, context.config)
        context.queries.check_room()
        operation = limit_query(operation, caller.access, context.kb)
        return protocol.plan_query(operation, request, caller, context.config, self.asked)


def _kinds(match: Match) -> tuple[str, ...]:
    """Return the kinds of SPARQL that an address takes."""
    # An address that takes both kinds has a line for each; the widest decides what is parsed.
    return max((_KINDS[route.effect] for route in match.routes if route.effect in _KINDS), key=len)


def _opens_form(request: Request) -> bool:
    """Whether a person opens an operation, who is sent to its form."""
    return request.method in ("GET", "HEAD") and prefers_html(request.header("accept"))
