"""The writer's side of records that followers pass on: ``POST /replicate/asked``.

What a follower still had when it was promoted is stored here as well. A follower answers robots
from its copy and sends what is to be stored of that, with the name and role of each robot, whose
token it has checked. A record of a robot whose tokens were revoked meanwhile is refused.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import partial
from typing import Any, cast

from endpoint.access.tokens import TokenStore
from endpoint.api.operations import json_object
from endpoint.follow.record_spool import FILE, RecordSpool
from endpoint.http.messages import JSON_TYPE, Request, Response
from endpoint.http.plan import Plan
from rtask.engine.context import SCOPES
from rtask.engine.engine import Engine
from rtask.engine.records.asked import record_of
from rtask.errors import ForbiddenError, RtaskError, UnsupportedError, UsageError
from rtask.kb.commit.access import Access, Role

__all__ = ["plan_asked_records", "store_waiting"]

_MAX_RECORDS = 1_000


def plan_asked_records(engine: object, tokens: TokenStore, request: Request) -> Plan:
    """Prepare to store the records of a follower.

    The answer lists those that were refused, each with ``id`` and ``reason``; the others are
    stored, or were before.

    Raises
    ------
    UsageError
        The body is not ``{"records": [...]}``.
    """
    if not isinstance(engine, Engine):
        raise UnsupportedError("there is no engine here that stores what robots asked")
    entries = json_object(request).get("records")
    if not isinstance(entries, list) or len(entries) > _MAX_RECORDS:
        raise UsageError(f"records: expected a list of at most {_MAX_RECORDS}")

    def run() -> Response:
        refused = _store_all(engine, tokens, entries)
        text = json.dumps({"stored": len(entries) - len(refused), "refused": refused})
        return Response(200, text.encode(), JSON_TYPE)

    return Plan(run)


def store_waiting(engine: Engine, tokens: TokenStore) -> None:
    """Store the records that a follower could not pass on before it was promoted.

    They stay in its folder until a server that takes writes is started there; those of robots
    whose tokens were revoked are dropped, with a line in the log.
    """
    folder = engine.context.kb.folder
    if folder is None or not (folder / FILE).exists():
        return
    with closing(RecordSpool(folder / FILE, partial(_store_all, engine, tokens))) as waiting:
        waiting.send_all()


def _store_all(
    engine: Engine, tokens: TokenStore, entries: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Store records, and return those that were refused, each with ``id`` and ``reason``."""
    refused = []
    for entry in entries:
        try:
            _store(engine, tokens, entry)
        except RtaskError as error:
            name = entry.get("id") if isinstance(entry, dict) else None
            refused.append({"id": name, "reason": str(error)})
    return refused


def _store(engine: Engine, tokens: TokenStore, entry: Any) -> None:
    """Store one record in the name of its robot."""
    if not isinstance(entry, dict) or not isinstance(entry.get("record"), dict):
        raise UsageError("expected an object with agent, role and record")
    record_of(entry["record"]).store(engine.context, _author(tokens, entry))


def _author(tokens: TokenStore, entry: Mapping[str, Any]) -> Access:
    """Return the rights under which a record is stored.

    Raises
    ------
    ForbiddenError
        Its author may not write, or has no valid token any longer.
    """
    agent, role = entry.get("agent"), entry.get("role")
    if not isinstance(agent, str | None) or not isinstance(role, str) or role not in SCOPES:
        raise UsageError("expected the agent and the role of a caller")
    author = Access(agent, cast(Role, role))
    if "write" not in SCOPES[role]:
        raise ForbiddenError(f"a {role} stores nothing")
    own = [token for token in tokens.all() if agent is not None and token.agent == agent]
    now = time.time()
    if own and not any(token.is_valid(now) and token.role == role for token in own):
        raise ForbiddenError(f"no token of {agent} as a {role} is valid any longer")
    return author
