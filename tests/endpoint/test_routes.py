"""The table of addresses: each is served as it says, and does to the graph what it declares."""

from __future__ import annotations

import json
import re
from contextlib import closing
from dataclasses import replace

import pytest

import rtask
from endpoint.access.auth import Caller
from endpoint.access.tokens import TokenStore
from endpoint.api.openapi import document
from endpoint.http.agent_calls import AgentCall
from endpoint.http.messages import Request
from endpoint.routes import ROUTES, Match, find
from endpoint.routes.messages import Messages
from endpoint.settings import Config
from rtask.engine import Engine
from rtask.errors import AuthenticationError, ForbiddenError
from rtask.kb.commit.access import Access
from rtask.services import Service, ServiceHost
from rtask.services import method as service_method
from tests.servers import new_application

_SITE = "http://localhost"
_ADMIN = Caller(Access("admin", "admin"))
_JSON = {"content-type": "application/json"}
_RULE = {"label": "heavy", "text": "CONSTRUCT { ?s a <urn:Heavy> } WHERE { ?s <urn:kg> ?o }"}


class Changing(Service):
    """A service with a method of each effect."""

    name = "lab/Changing"

    @service_method(effect="writes")
    def change(self) -> str:
        """Change something."""
        return "done"

    @service_method(effect="reads")
    def look(self) -> str:
        """Change nothing."""
        return "done"


class Site:
    """An application in this process, and an administrator who asks it."""

    def __init__(self, application, kb, secret):
        self.application, self.router, self.kb = application, application.router, kb
        self._secret = secret

    def ask(self, method, path, query="", body=b"", headers=None):
        """Send a request as it is and return the response."""
        sender = {"host": "localhost", "authorization": f"Bearer {self._secret}"}
        request = Request(method, path, query, {**sender, **(headers or {})}, body, _SITE)
        return self.application.handle(request)


@pytest.fixture(scope="module")
def site():
    with (
        rtask.open(":memory:", base="urn:lab/") as kb,
        Engine(kb) as engine,
        closing(TokenStore(None)) as tokens,
    ):
        secret, _ = tokens.create("admin")
        config = Config(rate=1e6, write_rate=1e6)
        services = ServiceHost([Changing])
        application = new_application(kb, engine, tokens, config, services=services)
        yield Site(application, kb, secret)
        application.close()


def example(pattern):
    """Return an address that fits a pattern."""
    return re.sub(r"<(?:path:)?(\w+)>", lambda part: f"some-{part[1]}", pattern)


@pytest.mark.parametrize("pattern", list(dict.fromkeys(one.pattern for one in ROUTES)))
def test_options_and_405_list_the_methods_of_the_table(site, pattern):
    address = example(pattern)
    match = find(address)
    assert {one.pattern for one in match.routes} == {pattern}
    allow = ", ".join(match.allow)
    told = site.ask("OPTIONS", address)
    assert (told.status, dict(told.headers)["Allow"]) == (204, allow)
    refused = site.ask("PATCH", address)
    assert (refused.status, dict(refused.headers)["Allow"]) == (405, allow)


def test_every_handler_in_the_table_is_one_of_the_router(site):
    named = {one.handler for one in ROUTES if one.lane != "stream" and one.right != "public"}
    assert named == set(site.router._made_handlers())


def test_the_description_holds_what_the_table_says_and_nothing_else(site):
    context = site.application.context
    described = document(context.engine, context.services.registry)
    left = {(path, method) for path, methods in described["paths"].items() for method in methods}
    for path, method in left:
        effect = described["paths"][path][method]["x-effect"]
        route = find(path).by(method.upper())
        assert route is not None, (method, path)
        assert effect == route.effect or route.effect == "declared", (method, path)
    for route in ROUTES:
        path = re.sub(r"<(?:path:)?(\w+)>", r"{\1}", route.pattern)
        if isinstance(route.messages, Messages):
            left.remove((path, route.methods[0].lower()))
    assert {path.split("/")[1] for path, _ in left} == {"engine", "services", "api"}


ROBOT, READER = ("robot", "nao-1", ()), ("reader", None, ())
ENOUGH = {
    "write": ROBOT,
    "rules": ("robot", "nao-1", ("rules",)),
    "schema": ("robot", "nao-1", ("schema",)),
    "replicate": ("reader", None, ("replicate",)),
    "token": READER,
    "admin": ("admin", None, ()),
    "monitor": ("admin", None, ()),
}
TOO_LITTLE = {"write": READER, "token": None, "monitor": READER}


@pytest.fixture(scope="module")
def bearers(site):
    """Return the header of a caller with a role, a name and rights; one for each."""
    tokens, made = site.application.context.tokens, {None: {}}

    def header(who):
        if who not in made:
            role, agent, rights = who
            secret, _ = tokens.create(role, agent=agent, rights=rights)
            made[who] = {"authorization": f"Bearer {secret}"}
        return made[who]

    return header


def _admits(site, route, method, who):
    """Return whether a request has what its line of the table asks for."""
    context = site.application.context
    headers = {"host": "localhost", **who}
    request = Request(method, example(route.pattern), "", headers, b"", _SITE)
    try:
        context.rights.require(route.right, request, context.auth.identify(request))
    except (AuthenticationError, ForbiddenError):
        return False
    return True


@pytest.mark.parametrize("right", list(ENOUGH))
def test_an_address_admits_who_has_the_right_and_refuses_who_has_not(site, bearers, right):
    routes = [route for route in ROUTES if route.right == right]
    assert routes
    for route in routes:
        for method in route.methods:
            assert _admits(site, route, method, bearers(ENOUGH[right])), (method, route.pattern)
            too_little = bearers(TOO_LITTLE.get(right, ROBOT))
            assert not _admits(site, route, method, too_little), (method, route.pattern)


def test_the_right_in_the_table_is_the_one_that_is_checked(site, bearers):
    robot = bearers(ROBOT)
    request = Request("GET", "/terms", "words=cup", {"host": "localhost", **robot}, b"", _SITE)
    assert site.application.handle(request).status == 200
    stricter = Match(tuple(replace(one, right="admin") for one in find("/terms").routes))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("endpoint.router.find", lambda address: stricter)
        refused = site.application.handle(request)
    assert (refused.status, b"scope admin" in refused.body) == (403, True)


_GUARDED = [one for one in ROUTES if one.right in ENOUGH and one.lane != "stream"]


@pytest.mark.parametrize("route", _GUARDED)
def test_no_handler_is_reached_without_the_right(site, bearers, route):
    who = bearers(TOO_LITTLE.get(route.right, ROBOT))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(site.router._handlers, route.handler, pytest.fail)
        for method in route.methods:
            headers = {"host": "localhost", **who}
            request = Request(method, example(route.pattern), "", headers, b"", _SITE)
            assert site.application.handle(request).status in (401, 403), (method, route.pattern)


@pytest.mark.parametrize("route", [one for one in ROUTES if one.effect == "reads"])
def test_an_address_that_reads_commits_nothing(site, route):
    before = site.kb.seq
    for method in route.methods:
        site.ask(method, example(route.pattern), "query=ASK{}", b"{}", _JSON)
        site.ask(method, example(route.pattern), "s=urn:a&p=urn:b&o=urn:c")
    assert site.kb.seq == before


_FORM = {"content-type": "application/x-www-form-urlencoded"}
_SPARQL = {"content-type": "application/sparql-update"}
_TURTLE = {"content-type": "text/turtle"}
_HAND = {"name": "hand", "kind": "ParallelJawGripper", "gripper_type": "jaws", "max_opening": 0.08,
         "jaw_width": 0.02, "finger_length": 0.05, "max_payload": 1.0}  # fmt: skip


def test_addresses_that_write_commit(site):
    rule = json.dumps(_RULE).encode()
    robot = json.dumps({"name": "nao-1", "model": "nao", "end_effectors": [_HAND]}).encode()
    for method, path, query, body, headers in (
        ("POST", "/update", "", b"INSERT DATA { <urn:a> <urn:b> <urn:c> }", _SPARQL),
        ("POST", "/sparql", "", b"DELETE DATA { <urn:a> <urn:b> <urn:c> }", _SPARQL),
        ("PUT", "/store", "graph=urn:g", b"<urn:cup> <urn:kg> 1 .", _TURTLE),
        ("POST", "/store", "graph=urn:g", b"<urn:cup> <urn:kg> 2 .", _TURTLE),
        ("DELETE", "/store", "graph=urn:g", b"", {}),
        ("PUT", "/store/g/1", "", b"<urn:cup> <urn:kg> 1 .", _TURTLE),
        ("POST", "/store/g/1", "", b"<urn:cup> <urn:kg> 3 .", _TURTLE),
        ("DELETE", "/store/g/1", "", b"", {}),
        ("POST", "/reasoner/rules", "", rule, _JSON),
        ("DELETE", "/reasoner/rules/heavy", "", b"", {}),
        ("POST", "/reasoner/rules", "", rule, _JSON),
        ("DELETE", "/reasoner/rules", "label=heavy", b"", {}),
        ("POST", "/engine/register_robot", "", robot, _JSON),
    ):
        before = site.kb.seq
        answer = site.ask(method, path, query, body, headers)
        assert answer.status < 300, (method, path, answer.body)
        assert site.kb.seq > before, (method, path)
        request = Request(method, path, query, headers, body, "", "")
        assert site.router.effect(request, path) == "writes"


def _message(tool):
    return {"id": 1, "method": "tools/call", "params": {"name": tool}}


def _called(*tools):
    messages = [_message(tool) for tool in tools]
    return json.dumps(messages[0] if len(tools) == 1 else messages).encode()


@pytest.mark.parametrize(
    ("method", "path", "body", "headers", "effect"),
    [
        ("GET", "/sparql", b"", {}, "reads"),
        ("POST", "/sparql", b"query=ASK{}", {}, "reads"),
        ("POST", "/sparql", b"query=SELECT+*+{?s+a+?update}", {}, "reads"),
        ("POST", "/sparql", b"update=CLEAR+ALL", {}, "writes"),
        ("POST", "/sparql", b"note=x&%75pdat%65=CLEAR+ALL", {}, "writes"),
        ("POST", "/mcp/services", _called("lab_Changing_change"), _JSON, "writes"),
        ("POST", "/mcp/services", _called("lab_Changing_look"), _JSON, "reads"),
        ("POST", "/services/lab/Changing/change", b"{}", _JSON, "writes"),
        ("POST", "/services/lab/Changing/look", b"{}", _JSON, "reads"),
        ("POST", "/mcp/services", b'{"id": 1, "method": "tools/list"}', _JSON, "reads"),
        ("POST", "/mcp/services", _called("no_such_tool"), _JSON, "reads"),
        ("POST", "/engine/recall_grasps", b"{}", _JSON, "reads"),
        ("POST", "/engine/recognise_for_grasp", b"{}", _JSON, "records"),
        ("POST", "/engine/teach_object", b"{}", _JSON, "writes"),
        ("POST", "/engine/no_such_thing", b"{}", _JSON, "reads"),
        ("DELETE", "/robots", b"", {}, "reads"),
    ],
)
def test_a_request_has_the_effect_that_it_asks_for(site, method, path, body, headers, effect):
    assert site.router.effect(Request(method, path, "", headers, body), path) == effect


def test_an_update_in_the_address_is_one(site):
    request = Request("POST", "/sparql", "update=CLEAR+ALL", _FORM, b"")
    assert site.router.effect(request, "/sparql") == "writes"
    before = site.kb.seq
    insert = "update=INSERT+DATA+{<urn:x>+<urn:y>+<urn:z>}"
    assert site.ask("POST", "/sparql", insert, b"", _FORM).status < 300
    assert site.kb.seq > before


def test_what_reads_does_not_count_as_a_change(site):
    counted = []
    limiter = site.application.context.limiter
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limiter, "admit_calls", lambda _, calls, changes: counted.append(changes))
        for path, body, headers in (
            ("/reasoner/entails", b"{}", _JSON),
            ("/sparql/check", b"{}", _JSON),
            ("/engine/recall_grasps", b"{}", _JSON),
            ("/sparql", b"ASK {}", {"content-type": "application/sparql-query"}),
            ("/mcp/services", _called("lab_Changing_look"), _JSON),
            ("/services/lab/Changing/look", b"{}", _JSON),
            ("/mcp", _called("search"), _JSON),
        ):
            site.ask("POST", path, "", body, headers)
        assert counted == [0] * 7
        for path, body, headers in (
            ("/update", b"CLEAR GRAPH <urn:none>", _SPARQL),
            ("/sparql", b"CLEAR SILENT GRAPH <urn:none>", _SPARQL),
            ("/engine/recognise_for_grasp", b"{}", _JSON),  # stores what it refuses
            ("/engine/give_feedback", b"{}", _JSON),
            ("/mcp", _called("propose_change"), _JSON),
            ("/mcp/services", _called("lab_Changing_change"), _JSON),
            ("/services/lab/Changing/change", b"{}", _JSON),
        ):
            counted.clear()
            site.ask("POST", path, "", body, headers)
            assert counted == [1], path


def test_each_call_in_a_list_of_messages_counts(site):
    counted = []
    limiter = site.application.context.limiter
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limiter, "admit_calls", lambda _, *counts: counted.append(counts))
        look, change = "lab_Changing_look", "lab_Changing_change"
        site.ask("POST", "/mcp/services", "", _called(look, change, look, change), _JSON)
        site.ask("POST", "/mcp", "", _called("search", "propose_change", "search"), _JSON)
        site.ask("POST", "/mcp", "", _called(*["propose_change"] * 21), _JSON)  # refused
    assert counted == [(4, 2), (3, 1), (0, 0)]


def test_a_follower_carries_out_what_it_has_and_passes_the_rest_on(site):
    ways = {
        ("lab_Changing_look",): False,
        ("lab_Changing_change",): True,
        ("lab_Changing_look", "lab_Changing_change"): True,
        ("no_such_tool",): True,  # the other server may have it
    }
    for tools, is_passed_on in ways.items():
        assert _is_for_writer(site, "/mcp/services", _called(*tools)) == is_passed_on, tools
    listed = b'{"id": 1, "method": "tools/list"}'
    assert not _is_for_writer(site, "/mcp/services", listed)


def test_a_follower_that_derives_nothing_passes_on_what_the_reasoner_answers(site):
    asks = [
        ("GET", "/reasoner/rules", b"", {}),
        ("POST", "/reasoner/entails", b"{}", _JSON),
        ("POST", "/mcp", _called("explain"), _JSON),
        ("POST", "/mcp", _called("search", "explain"), _JSON),
    ]

    def passed_on():
        return [
            site.router.is_for_writer(Request(method, path, "", headers, body), _ADMIN, path)
            for method, path, body, headers in asks
        ]

    assert passed_on() == [False] * 4
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(site.kb), "reasons", False)
        assert passed_on() == [True] * 4
        assert not _is_for_writer(site, "/mcp", _called("search"))
    for path in ("/proposals", "/proposals/1"):  # nobody but the writer has them
        assert site.router.is_for_writer(Request("GET", path), _ADMIN, path)


@pytest.mark.parametrize("path", ["/mcp", "/mcp/services"])
def test_a_follower_gives_up_the_calls_it_carries_out_and_passes_on_word_of_others(site, path):
    note = {"method": "notifications/cancelled", "params": {"requestId": 7}}
    body = json.dumps(note).encode()
    assert _is_for_writer(site, path, body)
    call = AgentCall(7)
    remove = site.router._calls.add(_ADMIN.key, 7, call)
    assert not _is_for_writer(site, path, body)
    remove()
    assert _is_for_writer(site, path, body)


def _is_for_writer(site, path, body):
    return site.router.is_for_writer(Request("POST", path, "", _JSON, body), _ADMIN, path)
