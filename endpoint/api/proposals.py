"""The addresses of proposals: changes that wait until somebody with the right decides."""

from __future__ import annotations

import json

from endpoint.access.auth import Authenticator, Caller
from endpoint.api.operations import json_object
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response
from endpoint.http.plan import Plan
from rtask.errors import AuthenticationError, ForbiddenError, UsageError
from rtask.kb.proposals.proposal import STATES
from rtask.knowledge_base import KnowledgeBase

PROPOSALS = "/reasoner/proposals"
DECISIONS = ("adopt", "refuse")
_MAX_DIGITS = 9
_MAX_LISTED = 1_000


def proposal_methods(address: str) -> tuple[str, ...]:
    """Return the methods that an address of proposals takes."""
    return ("GET", "HEAD") if address == PROPOSALS else ("GET", "HEAD", "POST")


def plan_proposals(
    kb: KnowledgeBase, auth: Authenticator, request: Request, caller: Caller, address: str
) -> Plan:
    """Plan the answer to a request about proposals.

    Raises
    ------
    RefusedError
        404.
    AuthenticationError, ForbiddenError
        The caller may not decide.
    """
    name = address.removeprefix(PROPOSALS).removeprefix("/")
    if not name:
        states = request.values("state")
        state = states[-1] if states else None
        if state is not None and state not in STATES:
            raise UsageError(f"unknown state {state!r}; one of {', '.join(STATES)}")
        return Plan(lambda: _list(kb, state))
    if not (name.isascii() and name.isdecimal() and len(name) <= _MAX_DIGITS):
        raise RefusedError(404, "not-found", f"proposals are named by numbers, not {name[:100]!r}")
    number = int(name)
    if request.method != "POST":
        return Plan(lambda: _json(kb.proposals.get(number).to_dict()))
    _require_right(auth, request, caller)
    decision, remark = _decision(request)
    return Plan(lambda: _decide(kb, number, decision, remark, caller))


def _require_right(auth: Authenticator, request: Request, caller: Caller) -> None:
    auth.check_origin(request, caller)
    if caller.access.role == "admin" or "schema" in caller.access.rights:
        return
    if caller.token is None:
        raise AuthenticationError("deciding needs a token; send Authorization: Bearer <token>")
    raise ForbiddenError("deciding about a proposal needs the right schema", right="schema")


def _decision(request: Request) -> tuple[str, str]:
    sent = json_object(request)
    decision, remark = sent.get("decision"), sent.get("remark", "")
    unknown = sent.keys() - {"decision", "remark"}
    if decision not in DECISIONS or not isinstance(remark, str) or unknown:
        raise UsageError('send {"decision": "adopt" or "refuse", "remark": "why"}')
    return str(decision), remark


def _list(kb: KnowledgeBase, state: str | None) -> Response:
    found = [one for one in kb.proposals.find() if state is None or one.state == state]
    listed = [one.to_dict() for one in found[-_MAX_LISTED:]]
    return _json({"proposals": listed, "total": len(found)})


def _decide(kb: KnowledgeBase, number: int, decision: str, remark: str, caller: Caller) -> Response:
    if decision == "adopt":
        kb.adopt(number, access=caller.access)
    else:
        kb.proposals.refuse(number, caller.name, remark)
    return _json(kb.proposals.get(number).to_dict())


def _json(members: object) -> Response:
    return Response(200, json.dumps(members, ensure_ascii=False).encode(), JSON_TYPE)
