"""One-time values for browsers' websockets: short-lived, worth no more than their token."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

import rtask
from endpoint.access.auth import Authenticator, plan_ticket
from endpoint.access.rights import Rights
from endpoint.access.sessions import Tickets
from endpoint.access.tokens import TokenStore
from endpoint.http.messages import Request
from endpoint.settings import Config
from rtask.errors import AuthenticationError, ForbiddenError


@pytest.fixture
def tokens() -> Iterator[TokenStore]:
    with closing(TokenStore(None)) as made:
        yield made


def socket_request(ticket: str) -> Request:
    return Request("GET", "/", f"token={ticket}", {"host": "lab:1"}, b"", "http://lab:1", "x")


def test_a_ticket_is_good_for_half_a_minute_and_once() -> None:
    now = [0.0]
    tickets = Tickets(lambda: now[0])
    used, late = tickets.issue("a"), tickets.issue("b")
    assert tickets.redeem(used) == "a"
    assert tickets.redeem(used) is None
    now[0] = 30.1
    assert tickets.redeem(late) is None
    assert tickets.redeem("rtt_0") is None


def test_a_ticket_is_worth_what_its_token_is(tokens: TokenStore) -> None:
    auth = Authenticator(tokens, Config(host="0.0.0.0"))
    _, token = tokens.create("robot", agent="nao-1")
    ticket = auth.tickets.issue(token.id)
    with pytest.raises(AuthenticationError):  # not outside websockets
        auth.identify(socket_request(ticket))
    caller = auth.identify(socket_request(ticket), ticket_in_url=True)
    assert (caller.name, caller.access.role) == ("nao-1", "robot")
    another = auth.tickets.issue(token.id)
    tokens.revoke(token.id)
    with pytest.raises(AuthenticationError, match="request another"):
        auth.identify(socket_request(another), ticket_in_url=True)


def test_a_page_from_elsewhere_gets_none_by_a_cookie(tokens: TokenStore) -> None:
    config = Config(host="0.0.0.0")
    auth = Authenticator(tokens, config)
    _, token = tokens.create("teacher", agent="ann")
    cookie = {"host": "lab:1", "cookie": f"rtask_session={auth.sessions.begin(token.id)}"}

    def ask(origin: str) -> int:
        headers = {**cookie, "origin": origin}
        request = Request("POST", "/tokens/ticket", "", headers, b"", "http://lab:1", "x")
        caller = auth.identify(request)
        rights.require("token", request, caller)
        return plan_ticket(auth, caller).run().status

    with rtask.open(":memory:", ontologies=False) as kb:
        rights = Rights(auth, kb, config)
        assert ask("http://lab:1") == 201
        with pytest.raises(ForbiddenError):
            ask("https://evil.example")
