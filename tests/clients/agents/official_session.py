"""A session of an agent with the official SDK of the Model Context Protocol.

Run by an interpreter that has the SDK (``pip install mcp``), for its dependencies are heavy:
``python official_session.py URL`` with RTASK_TOKEN, or ``python official_session.py -- COMMAND...``
over standard input and output. Prints what the client saw as one JSON object.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import anyio
import httpx2
from mcp import Client, StdioServerParameters
from mcp.client import session
from mcp.client.stdio import stdio_client
from mcp.client.streamable_http import streamable_http_client

SLOW = "SELECT (COUNT(*) AS ?n) WHERE { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
QUESTION = "which robot fails at cartons, and why?"
MUG = "https://w3id.org/rtask-kg/kb/sample/mug"


@asynccontextmanager
async def connected(arguments: list[str], mode: str) -> AsyncIterator[Client]:
    """Yield a client of a server at an address, or of a command."""
    if arguments[0] == "--":
        command = StdioServerParameters(
            command=arguments[1], args=arguments[2:], env=dict(os.environ)
        )
        async with Client(stdio_client(command), mode=mode) as client:
            yield client
        return
    token = os.environ.get("RTASK_TOKEN")
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=60) as http,
        Client(streamable_http_client(arguments[0], http_client=http), mode=mode) as client,
    ):
        yield client


async def converse(client: Client) -> dict[str, Any]:
    """Use each part of the protocol once, and return what was seen."""
    seen: dict[str, Any] = {"version": client.protocol_version, "calls": []}
    listed = await client.list_tools()
    seen["tools"] = [tool.name for tool in listed.tools]
    seen["size"] = len(listed.model_dump_json(by_alias=True))
    seen["resources"] = [str(part.uri) for part in (await client.list_resources()).resources]
    templates = await client.list_resource_templates()
    seen["templates"] = [part.uri_template for part in templates.resource_templates]
    (card,) = (await client.read_resource("rtask:/ontology")).contents
    seen["ontology"] = len(card.text)
    progress: list[float] = []

    async def note(share: float, _total: float | None, _words: str | None) -> None:
        progress.append(share)

    for name, values in (
        ("ask", {"text": QUESTION}),
        ("ask_sparql", {"query": "SELECT ?mug { ?mug a rt:Mug } LIMIT 1"}),
        ("search", {"words": "mug"}),
        ("describe", {"term": MUG}),
        ("explain", {"s": MUG, "p": "a", "o": "rt:ManipulableObject"}),
        ("ask_sparql", {"query": "SELECT ?m { ?m a rt:Mugg }"}),
    ):
        answer = await client.call_tool(name, values, progress_callback=note)
        seen["calls"].append(
            {"tool": name, "error": answer.is_error, "answer": answer.structured_content}
        )
    seen["progress"] = progress
    with anyio.move_on_after(1.0) as scope:
        await client.call_tool("ask_sparql", {"query": SLOW})
    seen["cancelled"] = scope.cancelled_caught
    after = await client.call_tool("search", {"words": "mug"})
    seen["after"] = not after.is_error
    return seen


async def main() -> None:
    """Hold a session; VERSION is the newest version of the protocol that the client speaks."""
    version = os.environ.get("VERSION")
    if version:
        session.LATEST_HANDSHAKE_VERSION = version
    async with connected(sys.argv[1:], "legacy" if version else "auto") as client:
        json.dump(await converse(client), sys.stdout, indent=1)


if __name__ == "__main__":
    anyio.run(main)
