"""The client for robot programs: one interface to the shared graph, local or remote."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtask.client.base import Client
from rtask.errors import RemoteUnavailableError, UsageError

if TYPE_CHECKING:
    from rtask.engine.engine import Engine
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["Client", "connect"]


def connect(
    target: str | KnowledgeBase | Engine,
    token: str | None = None,
    timeout_s: float = 30.0,
    *,
    agent: str | None = None,
    outbox: Path | str | None = None,
) -> Client:
    """Connect a robot program to the shared graph.

    Parameters
    ----------
    target
        Address of a server (``http://host:port``), or an open knowledge base or engine of this
        process. Several clients in one process share one engine.
    token
        Of the robot, for a server that asks for one.
    timeout_s
        For each call to a server.
    agent
        In process: the robot on whose behalf calls are made.
    outbox
        File that keeps what could not be told; sent again now and at every later occasion.

    Raises
    ------
    AuthenticationError
        The server wants another token.

    Examples
    --------
    >>> import rtask
    >>> with rtask.open(":memory:", reason=False) as kb, rtask.connect(kb) as client:
    ...     client.ask("ASK { ?s ?p ?o }")
    True
    """
    client = _made(target, token, timeout_s, agent, outbox)
    try:
        client.deliver()
    except RemoteUnavailableError:
        # Nobody answers yet: what waits stays in the outbox, and the first call will say so.
        pass
    except BaseException:
        client.close()
        raise
    return client


def _made(
    target: Any,
    token: str | None,
    timeout_s: float,
    agent: str | None,
    outbox: Path | str | None,
) -> Client:
    if isinstance(target, str):
        from rtask.client.remote import RemoteClient

        if agent is not None:
            raise UsageError("agent is for clients in process; a server knows it from the token")
        return RemoteClient(target, token, timeout_s, outbox)
    from rtask.client.local import LocalClient
    from rtask.engine.engine import Engine

    if token is not None:
        raise UsageError("token is for servers; in process, name the agent")
    if isinstance(target, Engine):
        return LocalClient(target, agent, outbox)
    return LocalClient(Engine(target), agent, outbox, owns_engine=True)
