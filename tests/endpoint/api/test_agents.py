"""The graph for agents over HTTP: rights, versions, batches, cancellation, services elsewhere."""

from __future__ import annotations

import gc
import json
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.application import Application
from endpoint.http.agent_calls import SESSION, AgentCall, AgentCalls
from endpoint.http.messages import Request, Response
from endpoint.settings import Config
from rtask.engine import Engine
from tests.servers import new_application

pytestmark = pytest.mark.slow  # opens the ontology


@pytest.fixture(scope="module")
def tokens() -> Iterator[TokenStore]:
    with closing(TokenStore(None)) as store:
        yield store


@pytest.fixture(scope="module")
def application(tokens: TokenStore) -> Iterator[Application]:
    with rtask.open(":memory:", base="urn:lab/") as kb, Engine(kb) as engine:
        kb.load(ontology.path("examples/sample.trig"))
        made = new_application(kb, engine, tokens, Config())
        yield made
        made.close()


@pytest.fixture(scope="module")
def robot(tokens: TokenStore, application: Application) -> str:
    return tokens.create("robot", agent="nao")[0]


def send(application: Application, body: Any, token: str = "", **headers: str) -> Response:
    sent = {"host": "localhost", "content-type": "application/json"}
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    if token:
        sent["authorization"] = f"Bearer {token}"
    return application.handle(Request("POST", "/mcp", "", sent, json.dumps(body).encode()))


def message(method: str, number: int = 1, **params: Any) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "id": number, "method": method, "params": params}


def call(name: str, number: int = 1, **arguments: Any) -> dict[str, Any]:
    return message("tools/call", number, name=name, arguments=arguments)


def result(response: Response) -> dict[str, Any]:
    assert response.status == 200, response.body
    answered: dict[str, Any] = json.loads(response.body)["result"]
    return answered


def test_the_instructions_say_where_the_tools_of_services_are(application, robot):
    greeted = result(send(application, message("initialize"), robot))
    assert "http://localhost/mcp/services" in greeted["instructions"]
    sent = send(application, message("tools/list"), robot)
    assert len(sent.body) <= 11_000
    listed = result(sent)["tools"]
    assert "ask_sparql" in {tool["name"] for tool in listed}


def test_an_answer_names_the_commit_and_where_its_proofs_are(application, robot):
    about = call("describe", term="https://w3id.org/rtask-kg/kb/sample/mug")
    described = result(send(application, about, robot))["structuredContent"]
    assert described["commit"] == application.context.kb.seq
    assert described["facts"][0]["proof"].startswith("http://localhost/explain?s=")


def test_who_may_not_write_proposes_nothing(application, robot):
    proposal = call("propose_change", add=[["kb:x", "rt:name", '"x"']])
    stranger = json.loads(send(application, proposal).body)
    assert stranger["error"]["code"] == -32602
    assert result(send(application, proposal, robot))["structuredContent"]["proposal"] == 1
    assert send(application, proposal, "no-such-token").status == 401
    assert send(application, proposal, origin="http://evil.example").status == 403


def test_a_version_that_is_not_spoken_is_refused(application, robot):
    ping = message("ping")
    assert send(application, ping, robot, mcp_protocol_version="2024-01-01").status == 400
    assert send(application, ping, robot, mcp_protocol_version="2025-06-18").status == 200


def test_several_messages_are_answered_in_one_body_in_the_older_version(application, robot):
    batch = [message("ping", 1), {"jsonrpc": "2.0", "method": "notifications/initialized"},
             call("search", 2, words="mug")]  # fmt: skip
    answers = json.loads(send(application, batch, robot).body)
    assert [one["id"] for one in answers] == [1, 2]
    newer = send(application, batch, robot, mcp_protocol_version="2025-06-18")
    assert newer.status == 400
    assert send(application, batch[1], robot).status == 202


def test_what_a_call_does_to_the_graph_is_what_its_tool_declares(application):
    router = application.router

    def effect(body: Any) -> str:
        request = Request("POST", "/mcp", "", {}, json.dumps(body).encode())
        return router.effect(request, "/mcp")

    assert effect(call("ask_sparql")) == effect(message("tools/list")) == effect("x") == "reads"
    assert effect([call("search"), call("propose_change")]) == "writes"


def test_a_call_is_given_up_by_a_notification_of_its_caller_alone():
    calls, mine, other = AgentCalls(), AgentCall(), AgentCall()
    stopped: list[str] = []
    mine.on_stop(lambda: stopped.append("mine"))
    end = calls.add("nao", 7, mine)
    calls.add("pr2", 7, other)
    calls.cancel("pr2", 8)
    assert not stopped
    calls.cancel("nao", 7)
    end()
    assert (stopped, mine.is_stopped, other.is_stopped) == (["mine"], True, False)
    mine.on_stop(lambda: stopped.append("late"))
    assert stopped == ["mine", "late"]
    calls.cancel("nao", 7)


def test_of_two_programs_with_one_token_none_gives_up_the_call_of_the_other():
    calls, first, second = AgentCalls(), AgentCall(), AgentCall()
    for each in (first, second):
        calls.add("nao", 7, each)
    calls.cancel("nao", 7)
    assert (first.is_stopped, second.is_stopped) == (False, False)


def test_a_greeting_hands_out_a_name_by_which_programs_with_one_token_are_told_apart(
    application, robot
):
    greetings = [send(application, message("initialize"), robot) for _ in range(2)]
    first, second = (dict(greeting.headers)[SESSION] for greeting in greetings)
    assert first != second

    def request(body: Any, session: str) -> Request:
        sent = {"host": "localhost", "content-type": "application/json",
                "authorization": f"Bearer {robot}", SESSION.lower(): session}  # fmt: skip
        return Request("POST", "/mcp", "", sent, json.dumps(body).encode())

    body = call("ask_sparql", 3, query="ASK { ?s ?p ?o }")
    mine, other = (application.admit(request(body, name)) for name in (first, second))
    cancelled = {"method": "notifications/cancelled", "params": {"requestId": 3}}
    application.handle(request({"jsonrpc": "2.0", **cancelled}, first))
    answers = [result(application.run(each))["structuredContent"] for each in (mine, other)]
    assert answers[0]["error"] == "cancelled"
    assert "error" not in answers[1]


def test_a_call_that_waits_for_its_turn_is_given_up_and_leaves_nothing_behind(application, robot):
    sent = {"host": "localhost", "content-type": "application/json"}
    sent["authorization"] = f"Bearer {robot}"

    def request(body: Any) -> Request:
        return Request("POST", "/mcp", "", sent, json.dumps(body).encode())

    cancelled = {"method": "notifications/cancelled", "params": {"requestId": 3}}
    waiting = application.admit(request(call("ask_sparql", 3, query="SELECT * { ?s ?p ?o }")))
    application.handle(request({"jsonrpc": "2.0", **cancelled}))
    answered = application.run(waiting)
    assert result(answered)["structuredContent"]["error"] == "cancelled"
    calls, dropped = AgentCalls(), AgentCall()
    calls.add("nao", 7, dropped)
    del dropped
    gc.collect()
    assert not calls._calls
