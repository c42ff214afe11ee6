"""Tools of agents: calls hold no thread of the server, and every refusal is a result to read."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import ontology
import rtask
from endpoint.access.auth import Authenticator, Caller
from endpoint.access.tokens import TokenStore
from endpoint.api.tools import _answer, effect_of_tool, plan_tools
from endpoint.http.agent_calls import AgentCalls
from endpoint.http.messages import Request
from endpoint.http.plan import Plan
from endpoint.settings import Config
from rtask.engine import Engine
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase
from rtask.services import Service, ServiceHost, method
from rtask.services.offered import open_host

MAY_END = threading.Event()


class Waiting(Service):
    """A service that answers when it may."""

    name = "lab/Waiting"

    @method
    def answer(self) -> str:
        """Answer."""
        MAY_END.wait(60)
        return "done"


class Late(Waiting):
    """The same, too late."""

    name = "lab/Late"
    timeout_s = 0.05


class Full(Waiting):
    """The same, with too many callers."""

    name = "lab/Full"
    max_waiting = 0


class Changing(Waiting):
    """The same, and a method that changes the graph."""

    name = "lab/Changing"

    @method(effect="writes", scope="write")
    def change(self) -> str:
        """Change the graph."""
        return "done"

    @method(effect="reads")
    def look(self) -> str:
        """Read the graph."""
        return "done"


@pytest.fixture
def host() -> Iterator[ServiceHost]:
    MAY_END.clear()
    with ServiceHost([Waiting, Late, Full, Changing]) as opened:
        yield opened
        MAY_END.set()


def planned(host: ServiceHost, tool: str, **arguments: Any) -> Plan:
    """Return the plan of one call of a tool by a robot."""
    params = {"name": tool, "arguments": arguments}
    message = {"jsonrpc": "2.0", "id": 7, "method": "tools/call", "params": params}
    headers = {"host": "localhost", "content-type": "application/json"}
    request = Request("POST", "/mcp/services", "", headers, json.dumps(message).encode())
    auth = Authenticator(TokenStore(None), Config())
    return plan_tools(host, auth, request, Caller(Access("nao-1", "robot")), AgentCalls())


def result(plan: Plan) -> dict[str, Any]:
    answer = json.loads(plan.run().body)
    assert answer["id"] == 7
    found: dict[str, Any] = answer["result"]
    return found


def test_a_call_runs_in_the_threads_of_the_services(host):
    plan = planned(host, "lab_Waiting_answer")
    assert plan.elsewhere is not None
    work = plan.elsewhere.start()
    assert not work.done()
    MAY_END.set()
    work.result(60)
    assert result(plan)["structuredContent"] == {"result": "done"}


@pytest.mark.parametrize(
    ("tool", "words"),
    [("lab_Late_answer", "no answer within 0.05 s"), ("lab_Full_answer", "try again later")],
)
def test_an_agent_reads_why_there_is_no_answer(host, tool, words):
    plan = planned(host, tool)
    assert plan.elsewhere is not None
    plan.elsewhere.start()
    refused = result(plan)
    assert refused["isError"]
    assert words in refused["content"][0]["text"]


def test_a_call_that_was_given_up_in_the_queue_is_late(host):
    plan = planned(host, "lab_Late_answer")
    assert plan.elsewhere is not None
    assert plan.elsewhere.late is not None
    plan.elsewhere.late()
    assert "no answer within 0.05 s" in result(plan)["content"][0]["text"]


@pytest.mark.parametrize(
    ("tool", "effect"),
    [
        ("lab_Changing_change", "writes"),
        ("lab_Changing_look", "reads"),
        ("lab_Nothing_change", "reads"),
        (["lab_Changing_change"], "reads"),
    ],
)
def test_a_call_does_what_the_method_declares_and_a_refused_one_nothing(host, tool, effect):
    assert effect_of_tool(host, tool) == effect


def test_the_schemas_of_all_tools_are_for_agents_and_allow_their_own_defaults() -> None:
    with rtask.open(":memory:", reason=False) as kb, Engine(kb) as engine:
        assert isinstance(kb, KnowledgeBase)
        with open_host(engine) as opened:
            tools = listed(opened)
    assert len(tools) > 40
    assert len(json.dumps(tools)) < 150_000
    assert sum(len(json.dumps(tool["outputSchema"])) for tool in tools) < 28_500
    defaults = 0
    for tool in tools:
        Draft202012Validator.check_schema(tool["outputSchema"])
        schema = tool["inputSchema"]
        Draft202012Validator.check_schema(schema)
        for part in parts(schema):
            assert not any(name.startswith("x-") for name in part)
            if "default" in part:
                whole = {**part, "$defs": schema.get("$defs", {})}
                Draft202012Validator(whole).validate(part["default"])
                defaults += 1
    assert defaults > 10


def test_answers_are_as_their_schemas_announce_them() -> None:
    """A client that checks them, such as the official SDK, refuses any other."""
    asked: tuple[tuple[str, dict[str, Any]], ...] = (
        ("recall_grasps", {"object": "mug"}),
        ("list_plans", {}),
        ("compare_contributors", {}),
        ("where_is", {"name": "mug"}),
        ("list_questions", {}),
    )
    with rtask.open(":memory:") as kb, Engine(kb) as engine:
        assert isinstance(kb, KnowledgeBase)
        kb.load(ontology.path("examples/sample.trig"))
        with open_host(engine) as opened:
            schemas = {tool["name"]: tool["outputSchema"] for tool in listed(opened)}
            for name, arguments in asked:
                plan = planned(opened, f"rtask_Engine_{name}", **arguments)
                assert plan.elsewhere is not None, plan.run().body
                plan.elsewhere.start().exception(20)
                answered = result(plan)
                assert not answered["isError"], answered["content"]
                schema = schemas[f"rtask_Engine_{name}"]
                Draft202012Validator(schema).validate(answered["structuredContent"])
                assert schema["required"]


def listed(host: ServiceHost) -> list[dict[str, Any]]:
    """Return the tools that an admin is offered."""
    caller = Caller(Access("ann", "admin"))
    tools: list[dict[str, Any]] = _answer(host, caller, "tools/list", {})["result"]["tools"]
    return tools


def parts(schema: Any) -> Iterator[dict[str, Any]]:
    """Yield the schemas within a schema, itself among them."""
    if isinstance(schema, dict):
        yield schema
        for part in schema.values():
            yield from parts(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from parts(part)
