"""Messages of agents over HTTP: one POST holds one, or several for agents of an older protocol.

A session is a name alone (:func:`program_of`), of which nothing is kept. A request is answered with
JSON; where a call names a progress token and the agent accepts events, its progress and its answer
come as a stream of them.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable
from concurrent.futures import wait
from typing import Any

from endpoint.access.auth import Authenticator, Caller
from endpoint.api.operations import json_value
from endpoint.http.agent_calls import SESSION, AgentCall, AgentCalls, program_of
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response
from endpoint.http.plan import Plan
from rtask.asking.tools.protocol import VERSIONS
from rtask.errors import UsageError

__all__ = ["cancelled", "messages_in", "plan_messages", "response_of", "tool_called"]

JsonObject = dict[str, Any]
PlanMessage = Callable[[JsonObject, AgentCall], Plan]
MAX_BATCH = 20
_EVENT_STREAM = "text/event-stream"
_CANCELLED = "notifications/cancelled"


def response_of(message: JsonObject) -> Response:
    """Return the response that carries a message; a greeting also hands out a session id."""
    body = json.dumps(message, ensure_ascii=False, separators=(",", ":")).encode()
    response = Response(200, body, JSON_TYPE)
    # Only the answer to initialize has it (MCP, Lifecycle).
    if "protocolVersion" in (message.get("result") or {}):
        return response.with_headers((SESSION, secrets.token_hex(16)))
    return response


def plan_messages(
    auth: Authenticator,
    request: Request,
    caller: Caller,
    calls: AgentCalls,
    plan_message: PlanMessage,
) -> Plan:
    """Plan the answer to the messages in a request.

    Parameters
    ----------
    calls
        The calls under way.
    plan_message
        Plans the answer to one request of an agent.

    Raises
    ------
    RefusedError
        400 for a version of the protocol that is not spoken, 415.
    ForbiddenError
        A page of another origin asks.
    UsageError
        The body is not JSON, or holds no message.
    """
    # Before anything is read: a page in somebody's browser must not reach a server on his machine
    # (MCP, Transports: DNS rebinding).
    auth.check_origin(request, caller)
    version = request.header("mcp-protocol-version")
    if version and version not in VERSIONS:
        raise RefusedError(
            400, "usage", f"MCP-Protocol-Version: expected one of {', '.join(VERSIONS)}"
        )
    sent = json_value(request)
    program = program_of(caller.key, request)
    # Later protocols have no batches; an agent that names none is of the oldest one.
    if isinstance(sent, list) and version in ("", VERSIONS[-1]):
        return _plan_batch(program, calls, sent, plan_message)
    if not isinstance(sent, dict):
        raise UsageError("expected one JSON object")
    if _is_notification(sent):
        _take_note(program, calls, sent)
        return Plan.ready(Response(202))
    wants_events = _EVENT_STREAM in request.header("accept")
    # Without a stream there is nothing to tell progress on.
    token = _progress_token(sent) if wants_events else None
    return plan_message(sent, AgentCall(sent["id"], token))


def messages_in(request: Request) -> list[JsonObject]:
    """Return the messages that a request holds; none if it is one that is refused."""
    try:
        sent = json.loads(request.body)
    except (ValueError, RecursionError):
        return []
    messages = sent if isinstance(sent, list) else [sent]
    if len(messages) > MAX_BATCH or not all(isinstance(message, dict) for message in messages):
        return []
    return messages


def tool_called(message: JsonObject) -> str | None:
    """Return the name of the tool that a message calls, or None if it calls none."""
    params = message.get("params")
    if message.get("method") != "tools/call" or not isinstance(params, dict):
        return None
    name = params.get("name")
    return name if isinstance(name, str) else ""


def cancelled(message: JsonObject) -> tuple[object, ...]:
    """Return the id of the request that a message gives up, alone in a tuple, or an empty one."""
    params = message.get("params")
    if message.get("method") != _CANCELLED or not isinstance(params, dict):
        return ()
    return (params.get("requestId"),)


def _is_notification(message: JsonObject) -> bool:
    """Whether a message is not to be answered: a notification, or an answer of the agent."""
    return "id" not in message or ("method" not in message and "jsonrpc" in message
                                   and ("result" in message or "error" in message))  # fmt: skip


def _take_note(program: str, calls: AgentCalls, message: JsonObject) -> None:
    for request_id in cancelled(message):
        calls.cancel(program, request_id)


def _progress_token(message: JsonObject) -> str | int | None:
    params = message.get("params")
    meta = params.get("_meta") if isinstance(params, dict) else None
    token = meta.get("progressToken") if isinstance(meta, dict) else None
    return token if isinstance(token, str | int) and message.get("method") == "tools/call" else None


def _plan_batch(
    program: str, calls: AgentCalls, sent: list[Any], plan_message: PlanMessage
) -> Plan:
    """Plan the answers to several messages, which are carried out one after the other."""
    if not sent or len(sent) > MAX_BATCH or not all(isinstance(message, dict) for message in sent):
        raise UsageError(f"expected one JSON object, or a list of 1 to {MAX_BATCH}")
    for message in sent:
        # Before the requests: one that a later message of the same batch gives up is not begun.
        if _is_notification(message):
            _take_note(program, calls, message)
    requests = [message for message in sent if not _is_notification(message)]
    if not requests:
        return Plan.ready(Response(202))

    def run() -> Response:
        bodies = [_carried_out(plan_message(message, AgentCall())).body for message in requests]
        return Response(200, b"[" + b",".join(bodies) + b"]", JSON_TYPE)

    return Plan(run)


def _carried_out(plan: Plan) -> Response:
    """Return the response of a plan, in this thread."""
    if plan.elsewhere is not None:
        done = wait([plan.elsewhere.start()], plan.timeout_s).done
        if not done and plan.elsewhere.late is not None:
            plan.elsewhere.late()
    return plan.run()
