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
    race: bool = False,
    local: KnowledgeBase | Engine | None = None,
    patience_s: float = 0.05,
    deadline_s: float = 1.0,
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
        File that keeps what could not be sent; it is sent again now and on every later call.
    race
        Ask ``local``, a slice of the graph of this process, and the server at once, and take the
        best answer that is there in time; see :class:`rtask.client.racing.RacingClient`.
    local
        The slice, for ``race`` only.
    patience_s, deadline_s
        Of a race: how long an answer of the slice waits for that of the server, and when an
        answer is given in any case.

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
    if race:
        client: Client = _racing(
            target, token, timeout_s, agent, outbox, local, (patience_s, deadline_s)
        )
    elif local is not None:
        raise UsageError("local is the slice of a race: give race=True as well")
    else:
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


def _racing(
    target: Any,
    token: str | None,
    timeout_s: float,
    agent: str | None,
    outbox: Path | str | None,
    local: Any,
    times_s: tuple[float, float],
) -> Client:
    from rtask.client.local import LocalClient
    from rtask.client.racing import RacingClient

    if not isinstance(target, str) or local is None or isinstance(local, str):
        raise UsageError(
            "race=True needs the address of a server, and local= a graph of this process"
        )
    near = _made(local, None, timeout_s, agent, None)
    assert isinstance(near, LocalClient)
    patience_s, deadline_s = times_s
    try:
        return RacingClient(
            target, near, token, timeout_s, outbox, patience_s=patience_s, deadline_s=deadline_s
        )
    except BaseException:
        near.close()
        raise
