"""All addresses that programs use, free of any server: one request in, one response out.

Flask and the asynchronous front both hand their requests to :class:`Gateway`; pages for people are
Flask's alone.
"""

from __future__ import annotations

import difflib
import itertools
import json
import re
import secrets
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from endpoint import graph_store
from endpoint.auth import (
    Authenticator,
    Caller,
    cors_headers,
    preflight_headers,
    require_scope,
)
from endpoint.config import Config
from endpoint.exchange import JSON_TYPE, RefusedError, Request, Response
from endpoint.health import health
from endpoint.problems import problem
from endpoint.protocol import run as protocol
from endpoint.protocol.request import (
    METHODS,
    QUERY,
    UPDATE,
    DescriptionRequest,
    UpdateRequest,
    parse_operation,
)
from endpoint.protocol.run import Plan
from endpoint.resources.blobs import plan_blob
from endpoint.rosbridge.services import Engine
from endpoint.tokens import TokenStore
from rtask.errors import UsageError
from rtask.kb.knowledge_base import KnowledgeBase

Route = Callable[[Request, Caller], Plan]

_REQUEST_ID = re.compile(r"[A-Za-z0-9_-]{8,64}")
_PROTOCOL = {
    "/sparql": (QUERY, UPDATE),
    "/query": (QUERY,),
    "/update": (UPDATE,),
}
THREADS = 32
MAX_ABANDONED = 16
PREFIXES = (graph_store.ADDRESS + "/", "/engine/", "/api/blobs/", "/health/")


class Gateway:
    """Answers requests from programs.

    Parameters
    ----------
    kb
        The knowledge base.
    engine
        Behind ``/engine/<operation>``.
    tokens
        Who may do what.
    config
        Settings of the server.
    """

    def __init__(
        self, kb: KnowledgeBase, engine: Engine, tokens: TokenStore, config: Config
    ) -> None:
        self.kb = kb
        self.engine = engine
        self.config = config
        self.auth = Authenticator(tokens, config)
        self._store = graph_store.GraphStore(kb, self.auth, config)
        self.pool = ThreadPoolExecutor(THREADS, thread_name_prefix="query")
        self._run_id = secrets.token_hex(4)
        self._numbers = itertools.count(1)
        self._abandoned: set[Future[Response]] = set()

    def serves(self, path: str) -> bool:
        """Tell whether an address is one of programs; the others are pages."""
        exact = path.rstrip("/") or "/"
        return (
            exact in _PROTOCOL
            or exact in (graph_store.ADDRESS, "/health")
            or path.startswith(PREFIXES)
        )

    def handle(self, request: Request) -> Response:
        """Answer a request in the calling thread; queries are given up at their time-out."""
        plan = self.plan(request)
        if plan.timeout_s is None:
            return plan.run()
        work = self.pool.submit(plan.run)
        try:
            return work.result(plan.timeout_s)
        except TimeoutError:
            return self.give_up(work, request, plan.timeout_s)

    def plan(self, request: Request) -> Plan:
        """Understand a request; the plan never raises, errors are answers."""
        request_id = request.header("rtask-request-id")
        if not _REQUEST_ID.fullmatch(request_id):
            request_id = f"{self._run_id}-{next(self._numbers)}"
        try:
            plan = self._route(request)
        except Exception as error:  # noqa: BLE001 - every error is an answer
            return Plan.ready(self._finish(problem(error, request_id), request, request_id))

        def run() -> Response:
            try:
                response = plan.run()
            except Exception as error:  # noqa: BLE001 - every error is an answer
                response = problem(error, request_id)
            return self._finish(response, request, request_id)

        return Plan(run, plan.timeout_s)

    def give_up(self, work: Future[Response], request: Request, seconds: float) -> Response:
        """Answer for a query that took too long; its thread cannot be stopped and is counted."""
        self._abandoned.add(work)
        work.add_done_callback(self._abandoned.discard)
        error = RefusedError(
            504,
            "query-timeout",
            f"no answer within {seconds:g} s; ask for more with `timeout=<seconds>`, "
            f"at most {self.config.max_timeout_s:g}, or for fewer rows with LIMIT",
            limit=seconds,
        )
        return self._finish(problem(error), request, "")

    def close(self) -> bool:
        """Take no more work and wait for what runs; tell whether all of it ended.

        Queries that were given up are not waited for: they may run for hours.
        """
        stuck = any(not work.done() for work in self._abandoned)
        self.pool.shutdown(wait=not stuck, cancel_futures=True)
        return not stuck

    def _finish(self, response: Response, request: Request, request_id: str) -> Response:
        headers = [
            ("Vary", "Accept, Authorization, Origin"),
            ("RTASK-Version", f"{self.kb.settings.epoch}:{self.kb.seq}"),
            *cors_headers(request, self.config),
        ]
        if request_id:
            headers.append(("RTASK-Request-Id", request_id))
        if request.method in ("GET", "HEAD"):
            headers.append(("Cache-Control", "no-cache"))
        return response.with_headers(*headers)

    def _route(self, request: Request) -> Plan:
        address = request.raw_path.rstrip("/") or "/"
        if request.method == "OPTIONS":
            return self._options(request, address)
        if address == "/health" or request.raw_path.startswith("/health/"):
            return health(self.kb, address)
        caller = self.auth.identify(request)
        if address in _PROTOCOL:
            return self._protocol(request, caller, _PROTOCOL[address])
        if address == graph_store.ADDRESS or address.startswith(graph_store.ADDRESS + "/"):
            return self._store.plan(request, caller)
        if address.startswith("/engine/"):
            return self._engine(request, caller, address.removeprefix("/engine/"))
        return plan_blob(self.kb, request, request.path.removeprefix("/api/blobs/"))

    def _options(self, request: Request, address: str) -> Plan:
        if address in _PROTOCOL:
            methods = METHODS[_PROTOCOL[address]]
        elif address.startswith("/engine/"):
            methods = ("POST", "OPTIONS")
        elif address.startswith(graph_store.ADDRESS):
            methods = graph_store.METHODS
        else:
            methods = ("GET", "HEAD", "OPTIONS")
        allow = ("Allow", ", ".join(methods))
        return Plan.ready(Response(204, headers=(allow, *preflight_headers(request, self.config))))

    def _protocol(self, request: Request, caller: Caller, kinds: tuple[str, ...]) -> Plan:
        operation = parse_operation(request, kinds)
        if isinstance(operation, DescriptionRequest):
            return protocol.plan_description(self.kb, request, self.config, updates=UPDATE in kinds)
        if isinstance(operation, UpdateRequest):
            self.auth.require_write(request, caller)
            return protocol.plan_update(self.kb, operation, request, caller.access, self.config)
        if len(self._abandoned) >= MAX_ABANDONED:
            raise RefusedError(
                503,
                "busy",
                f"{MAX_ABANDONED} queries that took too long still run; try again later",
                headers=(("Retry-After", "30"),),
            )
        return protocol.plan_query(self.kb, operation, request, self.config)

    def _engine(self, request: Request, caller: Caller, name: str) -> Plan:
        """Carry out an operation of the engine: the same objects as over the websocket."""
        operation = self.engine.operations.get(name)
        if operation is None:
            near = difflib.get_close_matches(name, self.engine.operations, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise RefusedError(404, "not-found", f"no operation {name}{hint}")
        if request.method != "POST":
            raise RefusedError(
                405, "method-not-allowed", "operations take POST", headers=(("Allow", "POST"),)
            )
        self.auth.check_origin(request, caller)
        require_scope(caller.access, operation.scope)
        args = _json_object(request)

        def run() -> Response:
            answer = self.engine.call(name, args, caller.access)
            return Response(200, json.dumps(answer, allow_nan=False).encode(), JSON_TYPE)

        return Plan(run)


def _json_object(request: Request) -> dict[str, object]:
    media_type, _ = request.content_type
    if media_type != JSON_TYPE:
        raise RefusedError(
            415,
            "unsupported-media-type",
            f"send the arguments as {JSON_TYPE}",
            headers=(("Accept-Post", JSON_TYPE),),
        )
    try:
        args = json.loads(request.body or b"{}")
    except json.JSONDecodeError as error:
        raise UsageError(
            f"not JSON: {error.msg} at line {error.lineno}, column {error.colno}",
            line=error.lineno,
            column=error.colno,
        ) from None
    except (ValueError, RecursionError):
        raise UsageError("not JSON that can be read") from None
    if not isinstance(args, dict):
        raise UsageError("the arguments are one JSON object")
    return args
