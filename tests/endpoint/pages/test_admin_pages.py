"""Signing in, and the pages for operators."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pyoxigraph
import pytest
from flask.testing import FlaskClient

import rtask
from endpoint.access.sessions import COOKIE
from endpoint.access.tokens import TokenStore
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.wsgi import create_app
from tests.servers import new_application

ELSEWHERE = "http://robots.lab:8765"
OWN = {"Origin": ELSEWHERE}


class Site:
    """A server that other machines reach, with two tokens."""

    def __init__(self, tokens: TokenStore) -> None:
        self.tokens = tokens
        self.admin, self.admin_token = tokens.create("admin")
        self.robot, self.robot_token = tokens.create("robot", agent="nao-1")
        self.kb = rtask.open(":memory:", ontologies=False)
        self.app = create_app(
            new_application(self.kb, NoEngine(), tokens, Config(host="0.0.0.0", write_rate=1e6))
        )

    def browser(self) -> FlaskClient:
        """Return a browser that nobody has signed in with."""
        return self.app.test_client()

    def signed_in(self, token: str) -> FlaskClient:
        """Return the browser of somebody who signed in."""
        browser = self.browser()
        answer = browser.post("/login", data={"token": token}, base_url=ELSEWHERE, headers=OWN)
        assert answer.status_code == 303
        return browser


@pytest.fixture
def site() -> Iterator[Site]:
    with closing(TokenStore(None)) as tokens:
        made = Site(tokens)
        yield made
        made.app.extensions["rtask"].close()
        made.kb.close()


def secret_of(page: str) -> str:
    found = re.search(r'name="secret" value="([^"]+)"', page)
    assert found
    return found.group(1)


def open_page(browser: FlaskClient, path: str) -> Any:
    return browser.get(path, base_url=ELSEWHERE, headers={"Accept": "text/html"})


def send(browser: FlaskClient, path: str, origin: str | None = ELSEWHERE, **form: str) -> Any:
    headers = {"Origin": origin} if origin else {}
    return browser.post(path, data=form, base_url=ELSEWHERE, headers=headers)


def test_who_has_not_signed_in_is_asked_to_and_comes_back(site: Site) -> None:
    answer = open_page(site.browser(), "/objects?page=2")
    assert answer.status_code == 303
    assert answer.headers["Location"] == "/login?next=%2Fobjects%3Fpage%3D2"
    browser = site.browser()
    signed = send(browser, "/login", token=site.admin, next="/objects?page=2")
    assert signed.headers["Location"] == "/objects?page=2"
    assert open_page(browser, "/objects").status_code == 200


def test_the_cookie_is_for_this_site_and_out_of_reach_of_scripts(site: Site) -> None:
    cookie = send(site.browser(), "/login", token=site.admin).headers["Set-Cookie"]
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(cookie.split("; "))
    assert site.admin not in cookie
    over_tls = site.browser().post(
        "/login",
        data={"token": site.admin},
        base_url="https://robots.lab",
        headers={"Origin": "https://robots.lab"},
    )
    assert "Secure" in over_tls.headers["Set-Cookie"].split("; ")


@pytest.mark.parametrize("there", ["//evil.example", "https://evil.example/", "/\\evil", "x"])
def test_signing_in_leads_to_no_other_site(site: Site, there: str) -> None:
    assert send(site.browser(), "/login", token=site.admin, next=there).headers["Location"] == "/"


def test_a_wrong_token_does_not_sign_in_and_is_on_record(site: Site) -> None:
    answer = send(site.browser(), "/login", token="rtk_0123456789ab_" + "0" * 32)
    assert answer.status_code == 401
    assert "Set-Cookie" not in answer.headers
    events = site.app.extensions["rtask"].context.audit.recent()
    assert events[0]["event"] == "denied"
    assert events[0]["status"] == 401


def test_a_token_is_made_shown_once_and_revoked(site: Site) -> None:
    browser = site.signed_in(site.admin)
    page = open_page(browser, "/admin/tokens")
    assert page.headers["Cache-Control"] == "no-store"
    secret = secret_of(page.text)
    made = send(browser, "/admin/tokens", role="robot", name="nao-9", lifetime="30d", secret=secret)
    assert made.status_code == 201
    text = re.search(r"rtk_[0-9a-f]{12}_[0-9a-f]{32}", made.text)
    assert text
    token = site.tokens.authenticate(text.group())
    assert (token.role, token.agent) == ("robot", "nao-9")
    assert token.expires is not None
    assert text.group() not in open_page(browser, "/admin/tokens").text
    done = send(browser, f"/admin/tokens/{token.id}/revoke", secret=secret)
    assert done.status_code == 303
    assert not site.tokens.is_valid(token.id)


def test_a_page_elsewhere_can_neither_send_the_form_nor_guess_its_secret(site: Site) -> None:
    browser = site.signed_in(site.admin)
    secret = secret_of(open_page(browser, "/admin/tokens").text)
    before = len(site.tokens.all())
    form = {"role": "admin"}
    assert (
        send(browser, "/admin/tokens", "https://evil.example", secret=secret, **form).status_code
        == 403
    )
    assert send(browser, "/admin/tokens", None, secret=secret, **form).status_code == 403
    assert send(browser, "/admin/tokens", secret="guess", **form).status_code == 403
    assert send(browser, "/admin/tokens", **form).status_code == 403
    assert len(site.tokens.all()) == before


def test_a_cookie_writes_only_for_our_own_pages(site: Site) -> None:
    browser = site.signed_in(site.admin)
    form = {"update": "INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> 1 } }"}
    assert send(browser, "/update", "https://evil.example", **form).status_code == 403
    assert send(browser, "/update", None, **form).status_code == 403
    assert send(browser, "/update", **form).status_code == 204


def test_a_robot_does_not_see_the_operators_pages(site: Site) -> None:
    browser = site.signed_in(site.robot)
    for path in ("/admin/tokens", "/admin/tokens.json", "/admin/audit", "/admin/queries"):
        assert open_page(browser, path).status_code == 403
    assert send(browser, "/admin/tokens", role="admin").status_code == 403


def test_revoking_a_token_ends_its_sessions(site: Site) -> None:
    browser = site.signed_in(site.robot)
    assert open_page(browser, "/objects").status_code == 200
    site.tokens.revoke(site.robot_token.id)
    assert open_page(browser, "/objects").status_code == 303


def test_signing_out_ends_the_session_for_everybody_who_has_the_cookie(site: Site) -> None:
    browser = site.signed_in(site.admin)
    cookie = browser.get_cookie(COOKIE, domain="robots.lab")
    assert cookie is not None
    secret = secret_of(open_page(browser, "/admin/tokens").text)
    assert send(browser, "/logout", secret=secret).status_code == 303
    thief = site.browser()
    thief.set_cookie(COOKIE, cookie.value, domain="robots.lab")
    assert open_page(thief, "/objects").status_code == 303


def test_the_pages_never_show_a_digest_or_a_secret(site: Site) -> None:
    data = site.signed_in(site.admin).get("/admin/tokens.json", base_url=ELSEWHERE).get_json()
    assert {"id", "agent", "role", "created", "expires", "revoked", "rights"} == set(
        data["tokens"][0]
    )


def test_a_hostile_robot_name_is_text_in_the_audit_trail(site: Site) -> None:
    site.app.extensions["rtask"].context.audit.event("x", detail="<script>alert(1)</script>")
    page = open_page(site.signed_in(site.admin), "/admin/audit").text
    assert "<script>alert" not in page
    assert "&lt;script&gt;" in page


def test_on_loopback_without_tokens_nobody_is_an_operator() -> None:
    with closing(TokenStore(None)) as tokens, rtask.open(":memory:", ontologies=False) as kb:
        app = create_app(new_application(kb, NoEngine(), tokens, Config()))
        answer = app.test_client().get("/admin/tokens.json")
        assert answer.status_code == 401
        assert "rtask token" in answer.get_json()["detail"]
        app.extensions["rtask"].close()


def test_a_page_that_needs_a_token_offers_to_sign_in() -> None:
    with closing(TokenStore(None)) as tokens, rtask.open(":memory:", ontologies=False) as kb:
        application = new_application(kb, NoEngine(), tokens, Config())
        browser = create_app(application).test_client()
        answer = browser.get("/admin/tokens?x=1", headers={"Accept": "text/html"})
        application.close()
    assert answer.status_code == 401
    assert 'href="/login?next=%2Fadmin%2Ftokens%3Fx%3D1"' in answer.text


def test_an_operator_adopts_and_refuses_proposals_on_a_page(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    quads = [
        pyoxigraph.Quad(*map(pyoxigraph.NamedNode, (f"urn:{name}", "urn:p", "urn:o", "urn:g")))
        for name in ("first", "second")
    ]
    for quad in quads:
        site.kb.propose([quad], author="nao-1", reason="<i>why</i>")
    robot = site.signed_in(site.robot)
    assert robot.get("/admin/proposals", base_url=ELSEWHERE).status_code == 403
    browser = site.signed_in(site.admin)
    shown = browser.get("/admin/proposals", base_url=ELSEWHERE).text
    assert "Proposal 2 of nao-1" in shown
    assert "&lt;i&gt;why" in shown
    form = {"secret": secret_of(shown), "remark": "too general"}
    for address in ("1/adopt", "2/refuse"):
        refused = browser.post(f"/admin/proposals/{address}", data={}, base_url=ELSEWHERE)
        assert refused.status_code == 403
        done = browser.post(
            f"/admin/proposals/{address}", data=form, base_url=ELSEWHERE, headers=OWN
        )
        assert (done.status_code, done.location) == (303, "/admin/proposals")
    assert [quad in site.kb.store for quad in quads] == [True, False]
    shown = browser.get("/admin/proposals", base_url=ELSEWHERE).text
    assert "Nothing waits for a decision" in shown
    assert "too general" in shown
    assert "data-left-out" not in shown
    monkeypatch.setattr("endpoint.pages.admin._DECIDED", 1)
    shown = browser.get("/admin/proposals", base_url=ELSEWHERE).text
    assert "1 were decided before" in shown


def test_the_page_of_a_follower_leads_to_the_proposals_of_its_writer(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    site.kb.propose(
        [pyoxigraph.Quad(*map(pyoxigraph.NamedNode, ("urn:a", "urn:p", "urn:o", "urn:g")))],
        author="nao-1",
        reason="left from before",
    )
    browser = site.signed_in(site.admin)
    form = {"secret": secret_of(browser.get("/admin/tokens", base_url=ELSEWHERE).text)}
    writer = SimpleNamespace(
        url="http://writer.lab:8765", is_connected=True, seconds_behind=0.0, commits_behind=0
    )
    application = site.app.extensions["rtask"]
    monkeypatch.setattr(application, "context", replace(application.context, following=writer))
    shown = browser.get("/admin/proposals", base_url=ELSEWHERE).text
    assert 'href="http://writer.lab:8765/admin/proposals"' in shown
    assert "Nothing waits" not in shown
    assert "left from before" not in shown
    done = browser.post("/admin/proposals/1/adopt", data=form, base_url=ELSEWHERE, headers=OWN)
    assert done.status_code == 403
    assert "http://writer.lab:8765" in done.text
    assert site.kb.proposals.find("proposed", None)
