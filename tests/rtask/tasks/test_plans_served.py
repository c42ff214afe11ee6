"""Plans of a real server: by HTTP, rosbridge, agents' tools and the command line, all alike."""

from __future__ import annotations

import json
from collections.abc import Iterator

import httpx
import pytest
from websockets.sync.client import connect

from rtask.cli import main
from tests.rtask.tasks.conftest import LAB
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

GOAL = {"goal": "every cup into the left box"}


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    """A server that knows the lab."""
    with running_server(None) as running:
        httpx.post(f"{running.url}/update", data={"update": LAB}, timeout=60).raise_for_status()
        yield running


def test_http_rosbridge_and_agents_get_the_same_plan(server: RunningServer) -> None:
    by_http = httpx.post(f"{server.url}/engine/plan_goal", json=GOAL, timeout=60).json()
    assert [len(step["because"]) for step in by_http["steps"]] == [10, 8, 10, 8]
    with connect(server.websocket) as robot:
        call = {"op": "call_service", "service": "/rtask/plan_goal", "args": GOAL}
        robot.send(json.dumps(call))
        assert json.loads(robot.recv(60))["values"] == by_http
    message = {"jsonrpc": "2.0", "id": 1, "method": "tools/call",
               "params": {"name": "rtask_Engine_plan_goal", "arguments": GOAL}}  # fmt: skip
    answer = httpx.post(
        f"{server.url}/mcp/services", json=message, timeout=60,
        headers={"Accept": "application/json, text/event-stream"},
    ).json()  # fmt: skip
    assert answer["result"]["structuredContent"] == by_http
    tools = httpx.post(
        f"{server.url}/mcp/services", json={"jsonrpc": "2.0", "id": 2, "method": "tools/list"},
        timeout=60, headers={"Accept": "application/json, text/event-stream"},
    ).json()["result"]["tools"]  # fmt: skip
    hints = {tool["name"]: tool["annotations"]["readOnlyHint"] for tool in tools}
    assert (hints["rtask_Engine_plan_goal"], hints["rtask_Engine_store_plan"]) == (True, False)


def test_the_command_plans_and_stores_on_a_server(server: RunningServer, capsys) -> None:
    def run(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            main(["plan", *arguments, "--server", server.url])
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    code, out, _ = run(GOAL["goal"], "--because")
    assert (code, "red cup located on table  (after step 2)" in out) == (0, True)
    assert "<BehaviorTree" in run(GOAL["goal"], "--behaviour-tree")[1]
    assert "(define (domain rtask)" in run(GOAL["goal"], "--pddl")[1]
    code, out, _ = run("the jug into the left box")
    assert (code, "no hand of nao-1 opens beyond 50 mm" in out) == (1, True)
    code, _, err = run("the pen into the right box", "--store", "--agent", "ann")
    task = err.partition("stored as ")[2].split()[0]
    assert (code, f"--server {server.url}" in err) == (0, True)
    query = f"ASK {{ GRAPH ?g {{ <{task}> ?p ?o }} FILTER(STRENDS(STR(?g), '/agent/ann')) }}"
    asked = httpx.get(f"{server.url}/sparql", params={"query": query}, timeout=60)
    assert "true" in asked.text
