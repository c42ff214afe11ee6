"""Open the knowledge base of a command: a folder on this machine, or a server."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtask.client import Client
    from rtask.client.reasoner import ReasonerClient
    from rtask.graph import Graph
    from rtask.knowledge_base import KnowledgeBase

__all__ = [
    "base_of",
    "connection",
    "open_branch",
    "open_graph",
    "open_to_change",
    "open_to_read",
    "read_address",
    "reasoner_of",
]


def open_to_read(data: Path) -> KnowledgeBase:
    """Open a folder for reading; one that was not closed is recovered first."""
    import rtask
    from rtask.errors import StoreError

    try:
        return rtask.open(data, mode="r")
    except StoreError as error:
        if not error.details.get("recover"):
            raise
    rtask.open(data, ontologies=False, reason=False).close()
    return rtask.open(data, mode="r")


def open_to_change(data: Path, **options: Any) -> KnowledgeBase:
    """Open a folder for writing that is a knowledge base already, with options of `rtask.open`.

    A misspelt name is an error, rather than a new and empty knowledge base.
    """
    import rtask
    from rtask.kb.durability.settings import Settings

    Settings.load(data)
    return rtask.open(data, **options)


@contextmanager
def open_branch(data: Path, server: str | None, name: str) -> Iterator[KnowledgeBase]:
    """Open a branch of a folder.

    Raises
    ------
    UsageError
        A server is named.
    """
    from rtask.errors import UsageError

    if server:
        raise UsageError(
            "--branch needs a folder; a server answers at "
            f"{server.rstrip('/')}/sparql?branch={name}"
        )
    with open_to_change(data) as kb:
        yield kb.open_branch(name).graph


def open_graph(data: Path, server: str | None) -> Graph:
    """Open a folder for reading, or the SPARQL endpoint of a server if one is given.

    The server's token is read from the environment variable RTASK_TOKEN.
    """
    if not server:
        return open_to_read(data)
    import rtask
    from rtask.client.calling.messages import addresses

    address, _ = addresses(server)
    return rtask.open(f"{address}/sparql", token=os.environ.get("RTASK_TOKEN"))


def base_of(graph: Graph) -> str:
    """Return the IRI that starts every instance; empty where a server does not say it."""
    from rtask.errors import ForbiddenError, UnsupportedError

    try:
        return str(getattr(graph, "base", ""))
    except (ForbiddenError, UnsupportedError):  # a caller limited to some graphs, a bare dataset
        return ""


@contextmanager
def connection(
    data: Path, server: str | None, agent: str | None = None, *, creates: bool = False
) -> Iterator[Client]:
    """Yield a client of the server, or of an engine over the folder.

    Parameters
    ----------
    agent
        With a folder: the robot or person on whose behalf calls are made. A server knows it from
        the token.
    creates
        Make the folder if it does not exist; see `open_or_make`.
    """
    import rtask
    from rtask.cli.changing.new_folder import open_or_make

    if server:
        with rtask.connect(server, token=os.environ.get("RTASK_TOKEN")) as client:
            yield client
        return
    with (
        open_or_make(data) if creates else open_to_change(data) as kb,
        rtask.connect(kb, agent=agent) as client,
    ):
        yield client


def read_address(
    server: str,
    path: str,
    parameters: dict[str, str],
    headers: dict[str, str] | None = None,
    timeout_s: float = 60.0,
) -> bytes:
    """Return what a server has at an address; its token is read from RTASK_TOKEN.

    Raises
    ------
    RemoteUnavailableError
        Nobody answers there.
    RtaskError
        The server's refusal.
    """
    import httpx

    from rtask.client.calling.messages import addresses
    from rtask.client.failures import failure_of
    from rtask.errors import RemoteUnavailableError
    from rtask.wire.address import authorization

    address, _ = addresses(server)
    sent = {**(headers or {}), **authorization(os.environ.get("RTASK_TOKEN"))}
    try:
        answer = httpx.get(f"{address}{path}", params=parameters, headers=sent, timeout=timeout_s)
    except httpx.TransportError as error:
        raise RemoteUnavailableError(f"{address} does not answer ({error})") from error
    if not answer.is_success:
        raise failure_of(answer)
    return answer.content


def reasoner_of(server: str) -> ReasonerClient:
    """Return a connection to the reasoner of a server; its token is read from RTASK_TOKEN."""
    from rtask.client.reasoner import ReasonerClient

    return ReasonerClient(server, os.environ.get("RTASK_TOKEN"))
