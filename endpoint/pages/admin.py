"""Pages for operators: tokens, proposals, running queries, audit trail.

They require a token of role admin.
The first token is created on the command line by the owner of the data folder.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import cast

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import Caller, require_scope
from endpoint.access.lifetimes import parse_lifetime
from endpoint.access.tokens import ROLES
from endpoint.api.proposals import Decision, decide, visible
from endpoint.http.messages import RefusedError
from endpoint.pages.render import (
    Model,
    blueprint,
    context,
    current_request,
    embedded_graph,
    page,
)
from endpoint.pages.signin import require_form
from rtask.errors import AuthenticationError, ForbiddenError, UsageError

_EVENTS = 200
_DECIDED = 100
"""Decided proposals on the page; the address for programs lists all."""


def _operator() -> Caller:
    """Return the caller if it is an admin.

    Raises
    ------
    AuthenticationError
        The caller has not signed in.
    ForbiddenError
        The caller is not an admin.
    """
    caller = context().auth.identify(current_request())
    if caller.token is None:
        first = (
            ""
            if context().tokens.ever_issued()
            else "; create the first one with rtask token create"
        )
        raise AuthenticationError(f"sign in with a token of role admin{first}")
    require_scope(caller.access, "admin")
    return caller


@page("/admin/tokens", "tokens.html")
def tokens() -> Model:
    """Return all tokens, without their secrets."""
    _operator()
    return {"tokens": [asdict(token) for token in context().tokens.all()], "roles": ROLES}


@page("/admin/audit", "audit.html")
def audit() -> Model:
    """Return the last events of the audit trail."""
    _operator()
    return {"events": context().audit.recent(_EVENTS)}


@page("/admin/proposals", "proposals.html")
def proposals() -> Model:
    """Return the proposals, those to decide first; at a follower, where they are."""
    caller = _operator()
    following = context().following
    if following is not None:
        return {"writer": following.url}
    found = visible(embedded_graph(), caller)
    decided = [proposal for proposal in reversed(found) if not proposal.is_open]
    return {
        "open": [proposal for proposal in found if proposal.is_open],
        "decided": decided[:_DECIDED],
        "decided_before": max(0, len(decided) - _DECIDED),
    }


@page("/admin/queries", "queries.html")
def queries() -> Model:
    """Return the running queries."""
    running = context().queries.visible_to(_operator())
    return {"queries": [query.facts() for query in running]}


@blueprint.route("/admin/tokens", methods=["POST"])
def make_token() -> flask.Response:
    """Create a token; the answer shows it, this once."""
    by = _operator()
    require_form()
    form, server = flask.request.form, context()
    lifetime = parse_lifetime(form["lifetime"]) if form.get("lifetime") else None
    name = form.get("name", "").strip() or None
    text, made = server.tokens.create(form.get("role", ""), agent=name, lifetime=lifetime)
    server.audit.event(
        "token-created", token=made.id, role=made.role, agent=made.agent, by=_named(by)
    )
    all_of_them = [asdict(token) for token in server.tokens.all()]
    shown = flask.render_template("tokens.html", tokens=all_of_them, roles=ROLES, made=text)
    return flask.make_response(shown, 201)


@blueprint.route("/admin/tokens/<token_id>/<action>", methods=["POST"])
def change_token(token_id: str, action: str) -> WerkzeugResponse:
    """Revoke a token, or set its lifetime."""
    by = _operator()
    require_form()
    server = context()
    if action == "revoke":
        done = server.tokens.revoke(token_id)
    elif action == "expire":
        done = server.tokens.expire(
            token_id, parse_lifetime(flask.request.form.get("lifetime", ""))
        )
    else:
        raise UsageError("expected revoke or expire")
    if not done:
        raise RefusedError(404, "not-found", f"no token {token_id} to {action}")
    server.audit.event(f"token-{action}", token=token_id, by=_named(by))
    return flask.redirect("/admin/tokens", 303)


@blueprint.route("/admin/proposals/<int:number>/<action>", methods=["POST"])
def decide_proposal(number: int, action: str) -> WerkzeugResponse:
    """Adopt or refuse a proposal."""
    by = _operator()
    require_form()
    if action not in ("adopt", "refuse"):
        raise UsageError("expected adopt or refuse")
    following = context().following
    if following is not None:
        raise ForbiddenError(
            f"this server follows {following.url}; decide on proposals there", operation="decide"
        )
    remark = flask.request.form.get("remark", "")
    decide(embedded_graph(), context().audit, by, number, cast("Decision", action), remark)
    return flask.redirect("/admin/proposals", 303)


@blueprint.route("/admin/queries/<query_id>/stop", methods=["POST"])
def stop_query(query_id: str) -> WerkzeugResponse:
    """Stop a query."""
    by = _operator()
    require_form()
    for query in context().queries.visible_to(by):
        if query.id == query_id:
            query.stop()
    return flask.redirect("/admin/queries", 303)


def _named(caller: Caller) -> str:
    return caller.token.id if caller.token else caller.name


@blueprint.after_request
def _keep_nothing(response: flask.Response) -> flask.Response:
    """Keep pages of operators and new tokens out of all caches."""
    if flask.request.path.startswith(("/admin/", "/login")):
        response.headers["Cache-Control"] = "no-store"
    return response
