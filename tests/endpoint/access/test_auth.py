"""Host, Origin, token: who may do what."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from endpoint.access.auth import Authenticator, cors_headers, preflight_headers, require_scope
from endpoint.access.tokens import TokenStore
from endpoint.http.messages import Request
from endpoint.settings import Config
from rtask.errors import AuthenticationError, ForbiddenError
from rtask.kb.commit.access import Access


@pytest.fixture
def tokens() -> Iterator[TokenStore]:
    with closing(TokenStore(None)) as store:
        yield store


def request(url_query: str = "", **headers: str) -> Request:
    named = {"host": "127.0.0.1:8765", **headers}
    return Request("POST", "/update", url_query, named)


def bearer(text: str) -> dict[str, str]:
    return {"authorization": f"Bearer {text}"}


def test_on_loopback_without_tokens_everybody_is_anonymous(tokens: TokenStore) -> None:
    caller = Authenticator(tokens, Config()).identify(request())
    assert caller.access == Access(None, "anonymous")


def test_once_a_token_exists_who_has_none_only_reads(tokens: TokenStore) -> None:
    tokens.create("robot", agent="nao-1")
    auth = Authenticator(tokens, Config())
    caller = auth.identify(request())
    assert caller.access.role == "reader"
    with pytest.raises(AuthenticationError, match="writing needs a token"):
        auth.require_write(request(), caller)


def test_elsewhere_nothing_opens_without_a_token(tokens: TokenStore) -> None:
    text, _ = tokens.create("reader")
    auth = Authenticator(tokens, Config(host="0.0.0.0"))
    with pytest.raises(AuthenticationError):
        auth.identify(request())
    assert auth.identify(request(**bearer(text))).access.role == "reader"


def test_a_token_names_its_robot(tokens: TokenStore) -> None:
    text, _ = tokens.create("robot", agent="nao-1")
    caller = Authenticator(tokens, Config()).identify(request(**bearer(text)))
    assert caller.access == Access("nao-1", "robot")
    assert caller.name == "nao-1"


@pytest.mark.parametrize("value", ["Basic eDp5", "Bearer", "Bearer ", "rtk_x_y"])
def test_another_scheme_is_refused_even_where_none_is_needed(
    tokens: TokenStore, value: str
) -> None:
    with pytest.raises(AuthenticationError) as caught:
        Authenticator(tokens, Config()).identify(request(authorization=value))
    assert caught.value.details["token_sent"]


def test_a_token_in_the_url_is_refused_and_a_ticket_counts_for_websockets_only(
    tokens: TokenStore,
) -> None:
    text, token = tokens.create("robot", agent="nao-1")
    auth = Authenticator(tokens, Config())
    assert auth.identify(request(f"token={text}")).access.role == "reader"
    with pytest.raises(AuthenticationError, match="POST /tokens/ticket"):
        auth.identify(request(f"token={text}"), ticket_in_url=True)
    ticket = auth.tickets.issue(token.id)
    assert auth.identify(request(f"token={ticket}"), ticket_in_url=True).access.agent == "nao-1"


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8765", "127.0.0.1.evil.example"])
def test_a_foreign_host_is_refused_on_loopback(tokens: TokenStore, host: str) -> None:
    with pytest.raises(ForbiddenError, match="is not a name of this server"):
        Authenticator(tokens, Config()).identify(request(host=host))


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:99", "[::1]:8765", "robots.lab"])
def test_own_and_allowed_hosts_pass(tokens: TokenStore, host: str) -> None:
    config = Config(allowed_hosts=("robots.lab",))
    Authenticator(tokens, config).identify(request(host=host))


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:9", "https://localhost"]
)
def test_a_foreign_origin_changes_nothing(tokens: TokenStore, origin: str) -> None:
    auth = Authenticator(tokens, Config())
    asked = request(origin=origin)
    with pytest.raises(ForbiddenError, match="Origin"):
        auth.require_write(asked, auth.identify(asked))


def test_the_own_page_a_robot_and_a_bearer_may_write(tokens: TokenStore) -> None:
    auth = Authenticator(tokens, Config())
    own = request(origin="http://127.0.0.1:8765")
    auth.require_write(own, auth.identify(own))
    auth.require_write(request(), auth.identify(request()))
    text, _ = tokens.create("robot", agent="nao-1")
    foreign = request(origin="http://evil.example", **bearer(text))
    auth.require_write(foreign, auth.identify(foreign))


def test_a_star_lets_pages_read_but_not_write(tokens: TokenStore) -> None:
    auth = Authenticator(tokens, Config(cors=("*",)))
    asked = request(origin="http://evil.example")
    with pytest.raises(ForbiddenError):
        auth.require_write(asked, auth.identify(asked))


def test_cors_answers_only_to_whom_it_was_opened() -> None:
    page = request(origin="http://lab.example")
    assert cors_headers(page, Config()) == ()
    assert cors_headers(page, Config(cors=("http://other.example",))) == ()
    named = dict(cors_headers(page, Config(cors=("http://lab.example",))))
    assert named["Access-Control-Allow-Origin"] == "http://lab.example"
    assert "Access-Control-Allow-Credentials" not in named
    assert preflight_headers(page, Config()) == ()
    assert dict(preflight_headers(page, Config(cors=("*",))))["Access-Control-Max-Age"] == "600"


@pytest.mark.parametrize(
    ("role", "may", "may_not"),
    [
        ("reader", ["read"], ["call", "write", "teach", "admin"]),
        ("robot", ["read", "call", "write"], ["teach", "admin"]),
        ("teacher", ["read", "call", "write", "teach"], ["admin"]),
        ("anonymous", ["read", "call", "write", "teach"], ["admin"]),
        ("admin", ["read", "call", "write", "teach", "admin"], []),
    ],
)
def test_roles_are_bundles_of_scopes(role: str, may: list[str], may_not: list[str]) -> None:
    access = Access("x", role)  # type: ignore[arg-type]
    for scope in may:
        require_scope(access, scope)
    for scope in may_not:
        with pytest.raises(ForbiddenError, match=f"needs scope {scope}"):
            require_scope(access, scope)
