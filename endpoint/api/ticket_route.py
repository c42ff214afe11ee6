"""`POST /tokens/ticket`: what a page asks before it opens a websocket."""

from __future__ import annotations

import json

from endpoint.access.auth import Authenticator, Caller
from endpoint.access.tickets import LIFETIME_S
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response
from endpoint.sparql.deferred import Plan
from rtask.errors import AuthenticationError

ADDRESS = "/tokens/ticket"


def plan_ticket(auth: Authenticator, request: Request, caller: Caller) -> Plan:
    """Prepare a ticket for who shows a token, or a session of one of our pages.

    Raises
    ------
    RefusedError
        405.
    AuthenticationError
        There is no token that it could stand for.
    ForbiddenError
        A page from elsewhere asks.
    """
    if request.method != "POST":
        allow = (("Allow", "POST, OPTIONS"),)
        raise RefusedError(405, "method-not-allowed", "a ticket is made by POST", headers=allow)
    auth.check_origin(request, caller)
    if caller.token is None:
        raise AuthenticationError("a ticket stands for a token: sign in, or send a bearer token")
    body = {"ticket": auth.tickets.issue(caller.token.id), "expires_in": int(LIFETIME_S)}
    headers = (("Cache-Control", "no-store"),)
    return Plan.ready(Response(201, json.dumps(body).encode(), JSON_TYPE, headers))
