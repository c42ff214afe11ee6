"""Methods of services as tools of agents, at ``POST /mcp/services`` (Model Context Protocol).

An agent gets the tools that its token may call.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any

from endpoint.access.auth import Authenticator, Caller
from endpoint.access.rights import authorise
from endpoint.api.agent_messages import plan_messages, response_of
from endpoint.http.agent_calls import AgentCall, AgentCalls, program_of
from endpoint.http.messages import Request
from endpoint.http.plan import Elsewhere, Plan
from endpoint.http.problems import details_of
from rtask.asking.tools.protocol import BAD_PARAMS, NO_METHOD, fault, greeting, problem_of, reply
from rtask.engine.context import SCOPES
from rtask.errors import RtaskError
from rtask.services import ServiceHost
from rtask.services.call import Invocation
from rtask.services.definition import Definition, Method
from rtask.services.description import answer_schema, request_schema
from rtask.services.task import Task
from rtask.wire.effect import Effect, strongest

_DATA = "data_resources"
_INSTRUCTIONS = (
    "Perception, grasp planning and motion for robots. Lengths are in m, angles in rad. The graph "
    "itself is at /mcp."
)


def plan_tools(
    host: ServiceHost, auth: Authenticator, request: Request, caller: Caller, calls: AgentCalls
) -> Plan:
    """Plan the answer to the messages of an agent; errors as :func:`plan_messages`."""

    def plan_message(message: dict[str, Any], call: AgentCall) -> Plan:
        problem = problem_of(message)
        if problem is not None:
            return Plan.ready(response_of(reply(message, problem)))
        params = message.get("params", {})
        if message["method"] == "tools/call":
            return _plan_call(host, auth, request, caller, message, call, calls)
        answered = _answer(host, caller, message["method"], params)
        return Plan(lambda: response_of(reply(message, answered)))

    return plan_messages(auth, request, caller, calls, plan_message)


def tools_named(host: ServiceHost, name: str) -> list[tuple[Definition, Method]]:
    """Return the methods that a tool of this name may mean: one at most, but for odd names."""
    return [
        (definition, method)
        for definition in host.registry
        for method in definition.methods.values()
        if _name(definition, method) == name
    ]


def effect_of_tool(host: ServiceHost, name: str) -> Effect:
    """Return what a call of a tool does to the graph; one that is refused does nothing."""
    return strongest(*(method.effect for _, method in tools_named(host, name)))


def _answer(
    host: ServiceHost, caller: Caller, method: str, params: dict[str, Any]
) -> dict[str, Any]:
    match method:
        case "initialize":
            return {"result": greeting(params, _INSTRUCTIONS, has_resources=False)}
        case "ping":
            return {"result": {}}
        case "tools/list":
            return {"result": {"tools": [_tool(*pair) for pair in _tools(host, caller)]}}
        case _:
            return fault(NO_METHOD, "no such method; known: initialize, ping, tools/list, "
                         "tools/call")  # fmt: skip


def _tools(host: ServiceHost, caller: Caller) -> Iterator[tuple[Definition, Method]]:
    """Yield the methods that a caller may call, of the newest version of each service."""
    scopes = SCOPES[caller.access.role]
    for definition in host.registry:
        for method in definition.methods.values():
            if method.scope in scopes:
                yield definition, method


def _name(definition: Definition, method: Method) -> str:
    return f"{definition.name.replace('/', '_')}_{method.name}"


def _tool(definition: Definition, method: Method) -> dict[str, Any]:
    schema = request_schema(method)
    files = {name: need for name, need in definition.resources.items() if need.type == "binary"}
    if files:
        schema["properties"] = {**schema.get("properties", {}), _DATA: {
            "type": "object",
            "description": "names of the datasets to use, <namespace>/<name>",
            "properties": {
                name: {"type": "string", "description": need.summary}
                for name, need in files.items()
            },
        }}  # fmt: skip
    schema.pop("description", None)  # the tool says it
    return {
        "name": _name(definition, method),
        "title": method.summary,
        "description": f"{method.summary}. {method.description}".strip(),
        "inputSchema": {"type": "object", **_for_agents(schema)},
        "outputSchema": {"type": "object", **answer_schema(method)},
        "annotations": {"readOnlyHint": method.effect == "reads"},
    }


def _for_agents(schema: Any) -> Any:
    """Return a schema without what only ROS and forms read; its descriptions have the units.

    That is a fifth of the list of tools, which an agent pays for at each session.
    """
    if isinstance(schema, dict):
        return {
            name: _for_agents(part) for name, part in schema.items() if not name.startswith("x-")
        }
    return [_for_agents(part) for part in schema] if isinstance(schema, list) else schema


def _plan_call(
    host: ServiceHost,
    auth: Authenticator,
    request: Request,
    caller: Caller,
    message: dict[str, Any],
    call: AgentCall,
    calls: AgentCalls,
) -> Plan:
    name, given = message["params"].get("name"), message["params"].get("arguments", {})
    offered = {_name(*pair): pair for pair in _tools(host, caller)}
    if not isinstance(name, str) or name not in offered:
        words = "there is no such tool; ask tools/list"
        return Plan.ready(response_of(reply(message, fault(BAD_PARAMS, words))))
    definition, method = offered[name]
    args = dict(given)
    data = args.pop(_DATA, None)
    authorise(auth, request, caller, method.scope, name)
    try:
        asked = Invocation(
            definition.exact, method.name, args, caller.access, data, data_form=_DATA
        )
        task = host.prepare(asked)
    except RtaskError as error:
        return Plan.ready(response_of(reply(message, _refused(error))))
    task.call.on_progress(call.report)
    call.on_stop(task.cancel)

    def start() -> Future[Any]:
        task.done.add_done_callback(lambda _: remove())
        try:
            host.start(task)
        except RtaskError as error:  # such as a full queue
            task.fail(error)
        return task.done

    remove = calls.add(program_of(caller.key, request), message.get("id"), call)
    return Plan(
        lambda: response_of(reply(message, _result(task))),
        timeout_s=task.call.timeout_s,
        elsewhere=Elsewhere(start, task.expire, task.cancel),
        progress=call.progress,
    )


def _result(task: Task) -> dict[str, Any]:
    """Return what a call that has ended, or whose time is up, brought."""
    try:
        text = task.result().to_json().decode()
    except RtaskError as error:
        return _refused(error)
    content = [{"type": "text", "text": text}]
    return {"result": {"content": content, "structuredContent": json.loads(text), "isError": False}}


def _refused(error: RtaskError) -> dict[str, Any]:
    """Return an error as the result of a tool: the agent reads what was wrong and tries again."""
    words = details_of(error)["detail"]
    return {"result": {"content": [{"type": "text", "text": words}], "isError": True}}
