"""The graph for agents at ``POST /mcp``: queries, proofs, history and proposals as tools."""

from __future__ import annotations

from typing import Any

from endpoint.access.auth import Authenticator, Caller
from endpoint.api.agent_messages import plan_messages, response_of
from endpoint.http.agent_calls import AgentCall, AgentCalls, program_of
from endpoint.http.messages import Request, Response
from endpoint.http.plan import Plan, RunningQuery
from endpoint.routes.addresses import MCP_SERVICES
from rtask.asking.tools.protocol import answer
from rtask.asking.tools.toolbox import Toolbox

__all__ = ["plan_agents"]

_QUERIES = frozenset(("ask", "ask_sparql", "where_is"))
_SPARE_S = 5.0
"""Time beyond that of its query until a call is given up, s."""


def plan_agents(
    toolbox: Toolbox,
    auth: Authenticator,
    request: Request,
    caller: Caller,
    calls: AgentCalls,
    timeout_s: float,
) -> Plan:
    """Plan the answer to the messages of an agent; errors as :func:`plan_messages`.

    Parameters
    ----------
    timeout_s
        Time limit of a query.
    """
    more = f"Methods of services are tools at {request.site}{MCP_SERVICES}."

    def plan_message(message: dict[str, Any], call: AgentCall) -> Plan:
        remove = calls.add(program_of(caller.key, request), message.get("id"), call)

        def run() -> Response:
            try:
                access = caller.access
                return response_of(answer(toolbox, message, access, request.site, call, more))
            finally:
                remove()

        params = message.get("params")
        if message.get("method") != "tools/call" or not isinstance(params, dict):
            return Plan(run)
        name = params.get("name")
        if toolbox.effect_of(name) == "writes":
            return Plan(run, progress=call.progress)
        running = RunningQuery(
            request.id, caller.key, caller.name, _text(params), timeout_s + _SPARE_S
        )
        running.on_stop(call.stop)
        return Plan(
            run,
            timeout_s=timeout_s + _SPARE_S,
            lane="query" if name in _QUERIES else "work",
            form="TOOL",
            text=running.text,
            running=running,
            progress=call.progress,
        )

    return plan_messages(auth, request, caller, calls, plan_message)


def _text(params: dict[str, Any]) -> str:
    """Return what lists of running queries show of a call."""
    arguments = params.get("arguments")
    query = arguments.get("query") if isinstance(arguments, dict) else None
    return query if isinstance(query, str) else f"tool {params.get('name')}"
