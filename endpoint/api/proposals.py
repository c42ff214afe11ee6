"""The addresses of proposals: list, propose, adopt and refuse.

Who may decide sees all of them; a robot or person sees its own, and so learns what became of them.
"""

from __future__ import annotations

from typing import Any, Literal, cast

from pyoxigraph import DefaultGraph, Quad, RdfFormat

from endpoint.access.auth import Caller
from endpoint.access.rights import require_schema
from endpoint.api.operations import json_object
from endpoint.http.messages import RefusedError, Request, Response, json_response
from endpoint.http.plan import Plan
from endpoint.monitoring.audit import Audit
from endpoint.routes.addresses import PROPOSALS
from rtask.errors import AuthenticationError, UnknownTermError, UsageError
from rtask.kb.proposals.proposal import STATES, Proposal, State
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.formats import read_document
from rtask.rdf.terms import stored_quad

__all__ = ["Decision", "decide", "plan_proposals", "visible"]

Decision = Literal["adopt", "refuse"]
_FIELDS = ("added", "removed", "reason", "rests_on")


def plan_proposals(
    kb: KnowledgeBase, audit: Audit, request: Request, caller: Caller, address: str
) -> Plan:
    """Plan the answer to a request about proposals.

    Raises
    ------
    RefusedError
        404 or 415.
    UsageError
        A part of the request is not what is expected.
    """
    name, _, action = address.removeprefix(PROPOSALS).removeprefix("/").partition("/")
    if request.method in ("GET", "HEAD"):
        if name:
            number = _number(name)
            return Plan(lambda: json_response(_one(kb, caller, number).to_dict()))
        state, author = _state(request), next(iter(request.values("author")), None)
        return Plan(lambda: json_response({"proposals": _listed(kb, caller, state, author)}))
    if not name:
        fields = json_object(request, _FIELDS)
        return Plan(lambda: _proposed(kb, caller, fields))
    number, decision = _number(name), cast("Decision", action)
    remark = (
        str(json_object(request, ("remark",)).get("remark", "")) if request.body.strip() else ""
    )
    return Plan(
        lambda: json_response(decide(kb, audit, caller, number, decision, remark).to_dict())
    )


def visible(
    kb: KnowledgeBase, caller: Caller, state: State | None = None, author: str | None = None
) -> list[Proposal]:
    """Return the proposals that a caller may see, the oldest first.

    Raises
    ------
    AuthenticationError
        The caller has no name of its own, and may not decide.
    """
    access = caller.access
    if access.may_decide:
        return kb.proposals.find(state, author)
    if not access.agent:
        raise AuthenticationError("proposals need a token; send Authorization: Bearer <token>")
    return [
        proposal
        for proposal in kb.proposals.find(state, access.agent)
        if author in (None, proposal.author)
    ]


def decide(
    kb: KnowledgeBase, audit: Audit, caller: Caller, number: int, decision: Decision, remark: str
) -> Proposal:
    """Adopt or refuse a proposal in the name of a caller, and note it in the audit trail.

    Raises
    ------
    ForbiddenError
        The caller has no right `schema`.
    RefusedError
        404: there is no such proposal.
    ConflictError
        It was decided before.
    RtaskError
        The change cannot be stored as things are; the proposal stays open.
    """
    require_schema(caller)
    _get(kb, number)
    if decision == "adopt":
        kb.adopt(number, access=caller.access)
    else:
        kb.proposals.refuse(number, caller.name, remark)
    audit.event(f"proposal-{decision}", proposal=number, by=caller.name)
    return kb.proposals.get(number)


def _one(kb: KnowledgeBase, caller: Caller, number: int) -> Proposal:
    proposal = _get(kb, number)
    if not (caller.access.may_decide or proposal.author == caller.access.agent):
        # As if it were not there: others' proposals are none of the caller's business.
        raise RefusedError(404, "not-found", f"there is no proposal {number} of yours")
    return proposal


def _get(kb: KnowledgeBase, number: int) -> Proposal:
    try:
        return kb.proposals.get(number)
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", f"there is no proposal {number}") from error


def _listed(
    kb: KnowledgeBase, caller: Caller, state: State | None, author: str | None
) -> list[dict[str, Any]]:
    return [proposal.to_dict() for proposal in visible(kb, caller, state, author)]


def _proposed(kb: KnowledgeBase, caller: Caller, fields: dict[str, Any]) -> Response:
    home = kb.access(access=caller.access).home()
    rests_on = fields.get("rests_on")
    if rests_on is not None and (isinstance(rests_on, bool) or not isinstance(rests_on, int)):
        raise UsageError("`rests_on` is the number of a commit", field="rests_on")
    made = kb.propose(
        _quads(fields, "added", home),
        _quads(fields, "removed", home),
        author=caller.access.agent,
        reason=str(fields.get("reason", "")),
        rests_on=rests_on,
    )
    location = f"{PROPOSALS}/{made.number}"
    return json_response(made.to_dict(), 201, (("Location", location),))


def _quads(fields: dict[str, Any], field: str, home: Any) -> list[Quad]:
    """Return statements sent as lines of N-Quads; those without a graph are the caller's own."""
    lines = fields.get(field, [])
    if not (isinstance(lines, list) and all(isinstance(line, str) for line in lines)):
        raise UsageError(f"`{field}` is a list of statements, each a line of N-Quads", field=field)
    quads = read_document("\n".join(lines), RdfFormat.N_QUADS) if lines else []
    return [
        stored_quad(Quad(q.subject, q.predicate, q.object, home))
        if isinstance(q.graph_name, DefaultGraph)
        else stored_quad(q)
        for q in quads
    ]


def _state(request: Request) -> State | None:
    values = request.values("state")
    if not values:
        return None
    if values[0] not in STATES:
        raise UsageError(f"unknown state {values[0]!r}; one of {', '.join(STATES)}", field="state")
    return values[0]


def _number(text: str) -> int:
    if not text.isdecimal() or len(text) > 17:
        raise RefusedError(404, "not-found", f"{text!r} is no number of a proposal")
    return int(text)
