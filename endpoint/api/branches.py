"""The addresses of branches: list, make, compare, merge and drop."""

from __future__ import annotations

import datetime as dt
from typing import Any

from endpoint.access.auth import Caller
from endpoint.api.operations import json_object
from endpoint.http.messages import Request, Response, json_response
from endpoint.http.plan import Plan
from endpoint.monitoring.audit import Audit
from endpoint.routes.addresses import BRANCHES
from endpoint.sparql.branches import open_named
from rtask.errors import UsageError
from rtask.knowledge_base import KnowledgeBase

__all__ = ["plan_branches"]

_FIELDS = ("name", "at", "hours", "note")


def plan_branches(
    kb: KnowledgeBase, audit: Audit, request: Request, caller: Caller, address: str
) -> Plan:
    """Plan the answer to a request about branches.

    Raises
    ------
    RefusedError
        404 or 415.
    UsageError
        A part of the request is not what is expected.
    """
    name, _, action = address.removeprefix(BRANCHES).removeprefix("/").partition("/")
    if request.method in ("GET", "HEAD"):
        return Plan(lambda: json_response(_compared(kb, caller, name) if name else _listed(kb)))
    if request.method == "DELETE":
        return Plan(lambda: _dropped(kb, audit, caller, name))
    if action:
        note = str(json_object(request, ("note",)).get("note", "")) if request.body.strip() else ""
        return Plan(lambda: _merged(kb, audit, caller, name, note))
    fields = json_object(request, _FIELDS)
    return Plan(lambda: _made(kb, caller, fields))


def _listed(kb: KnowledgeBase) -> dict[str, Any]:
    return {"branches": [record.to_dict() for record in kb.branches()]}


def _compared(kb: KnowledgeBase, caller: Caller, name: str) -> dict[str, Any]:
    return open_named(kb, name).compare(access=caller.access).to_dict()


def _made(kb: KnowledgeBase, caller: Caller, fields: dict[str, Any]) -> Response:
    name, at, hours = fields.get("name"), fields.get("at"), fields.get("hours", 24)
    if not isinstance(name, str):
        raise UsageError("`name` is the name of the branch", field="name")
    if at is not None and (isinstance(at, bool) or not isinstance(at, (int, str))):
        raise UsageError("`at` is the number of a commit, or a time", field="at")
    if isinstance(hours, bool) or not isinstance(hours, (int, float)) or not 0 < hours <= 24:
        raise UsageError("`hours` is a number above 0, at most 24", field="hours")
    branch = kb.branch(
        name,
        at=at,
        access=caller.access,
        lifetime=dt.timedelta(hours=hours),
        note=str(fields.get("note", "")),
    )
    return json_response(branch.to_dict(), 201, (("Location", f"{BRANCHES}/{branch.name}"),))


def _merged(kb: KnowledgeBase, audit: Audit, caller: Caller, name: str, note: str) -> Response:
    commit = open_named(kb, name).merge(access=caller.access, note=note or None)
    audit.event("branch-merge", branch=name, by=caller.name)
    counts = {"seq": commit.seq, "added": commit.added, "removed": commit.removed}
    return json_response(counts | {"derived": commit.derived, "withdrawn": commit.withdrawn})


def _dropped(kb: KnowledgeBase, audit: Audit, caller: Caller, name: str) -> Response:
    open_named(kb, name)
    record = kb.drop_branch(name, access=caller.access)
    audit.event("branch-drop", branch=name, by=caller.name)
    return json_response(record.to_dict())
