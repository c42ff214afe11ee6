"""Messages of agents (Model Context Protocol): one JSON-RPC 2.0 message in, at most one out.

Nothing is remembered between messages, so that any server can answer any of them. Two versions are
spoken: 2025-06-18 and 2025-03-26.
"""

from __future__ import annotations

from importlib.metadata import version as version_of_package
from typing import TYPE_CHECKING, Any

from rtask.asking.tools import resources
from rtask.asking.tools.toolbox import INSTRUCTIONS, Toolbox
from rtask.errors import RtaskError

if TYPE_CHECKING:
    from rtask.asking.tools.declaration import Work
    from rtask.kb.commit.access import Access

__all__ = [
    "BAD_PARAMS",
    "INVALID",
    "NO_METHOD",
    "VERSIONS",
    "answer",
    "fault",
    "greeting",
    "problem_of",
    "reply",
]

JsonObject = dict[str, Any]
VERSIONS = ("2025-06-18", "2025-03-26")
"""Versions of the protocol, the newest first."""

INVALID, NO_METHOD, BAD_PARAMS, NOT_FOUND = -32600, -32601, -32602, -32002
_METHODS = "initialize, ping, tools/list, tools/call, resources/list, resources/read"


def reply(message: JsonObject, members: JsonObject) -> JsonObject:
    """Return the answer to a message."""
    return {"jsonrpc": "2.0", "id": message.get("id"), **members}


def fault(code: int, words: str) -> JsonObject:
    """Return an error of the protocol; its words are fixed, and quote nothing that is stored."""
    return {"error": {"code": code, "message": words}}


def problem_of(message: JsonObject) -> JsonObject | None:
    """Return what is wrong with a request as the protocol has it, or None."""
    if not isinstance(message.get("id"), str | int | None) or isinstance(message.get("id"), bool):
        message["id"] = None
        return fault(INVALID, "id: expected a text or a whole number")
    if message.get("jsonrpc") != "2.0" or not isinstance(message.get("method"), str):
        return fault(INVALID, "expected a JSON-RPC 2.0 request")
    if not isinstance(message.get("params", {}), dict):
        return fault(BAD_PARAMS, "params: expected an object")
    if not isinstance(message.get("params", {}).get("arguments", {}), dict):
        return fault(BAD_PARAMS, "arguments: expected an object")
    return None


def greeting(params: JsonObject, instructions: str, *, has_resources: bool) -> JsonObject:
    """Return the answer to ``initialize``: the version asked for, if it is spoken."""
    asked = params.get("protocolVersion")
    kinds: JsonObject = {"tools": {}}
    if has_resources:
        kinds["resources"] = {}
    return {
        "protocolVersion": asked if asked in VERSIONS else VERSIONS[0],
        "capabilities": kinds,
        "serverInfo": {"name": "rtask", "version": version_of_package("rtask-kg")},
        "instructions": instructions,
    }


def answer(
    toolbox: Toolbox, message: JsonObject, access: Access, site: str, work: Work, more: str = ""
) -> JsonObject:
    """Return the answer to a request.

    Parameters
    ----------
    site
        Beginning of the addresses of proofs.
    more
        What the instructions say besides.
    """
    problem = problem_of(message)
    if problem is not None:
        return reply(message, problem)
    params: JsonObject = message.get("params", {})
    match message["method"]:
        case "initialize":
            result = greeting(params, INSTRUCTIONS + more, has_resources=True)
        case "ping":
            result = {}
        case "tools/list":
            result = {"tools": toolbox.listed(access)}
        case "tools/call":
            name = params.get("name")
            if not isinstance(name, str) or name not in toolbox.names(access):
                return reply(message, fault(BAD_PARAMS, "there is no such tool; ask tools/list"))
            result = toolbox.call(name, params.get("arguments", {}), access, site, work)
        case "resources/list":
            result = {"resources": resources.listed()}
        case "resources/templates/list":
            result = {"resourceTemplates": resources.templates()}
        case "resources/read":
            try:
                read = toolbox.resource(str(params.get("uri")), access, site, work)
            except RtaskError:
                words = "there is no such resource; ask resources/list"
                return reply(message, fault(NOT_FOUND, words))
            result = {"contents": [read]}
        case _:
            return reply(message, fault(NO_METHOD, f"no such method; known: {_METHODS}"))
    return reply(message, {"result": result})
