"""The command: starts, says so, refuses clearly, ends in order."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.commands import run_command
from tests.servers import RunningServer, running_server


def rtask(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    return run_command(*arguments)


@pytest.mark.slow
def test_what_was_written_is_there_after_a_restart(tmp_path: Path) -> None:
    folder, base = tmp_path / "store", "https://lab.example/kb/"
    with running_server(folder, "--base", base) as first:
        text = "INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> 1 } . <urn:s> <urn:p> 2 }"
        assert httpx.post(f"{first.url}/update", data={"update": text}).status_code == 204
        assert first.stop(signal.SIGINT) == 0
    with running_server(folder) as second:
        query = {"query": "ASK { GRAPH <urn:g> { <urn:s> <urn:p> 1 } }"}
        assert httpx.get(f"{second.url}/sparql", params=query).json()["boolean"] is True
        query = {"query": f"ASK {{ GRAPH <{base}graph/shared> {{ <urn:s> <urn:p> 2 }} }}"}
        assert httpx.get(f"{second.url}/sparql", params=query).json()["boolean"] is True


@pytest.mark.slow
def test_ending_tells_robots_and_leaves_no_lock(tmp_path: Path) -> None:
    with running_server(tmp_path / "store") as running, connect(running.websocket) as robot:
        robot.send(json.dumps({"op": "subscribe", "topic": "/t"}))
        running.process.send_signal(signal.SIGTERM)
        with pytest.raises(ConnectionClosed) as closed:
            robot.recv(timeout=60)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1012
        assert running.process.wait(60) == 0
    done = rtask("stats", "--data", str(tmp_path / "store"))
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_query_that_takes_too_long_is_given_up_and_does_not_hold_up_the_end(
    tmp_path: Path,
) -> None:
    """Some 10^11 combinations; the store cannot stop it, so the process ends with it."""
    heavy = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i FILTER(?a != ?f) }"
    with running_server(tmp_path / "store") as running:
        asked = {"query": heavy, "timeout": "0.2"}
        answer = httpx.get(f"{running.url}/sparql", params=asked, timeout=60)
        assert answer.status_code == 504
        assert answer.json()["type"] == "/errors/query-timeout"
        small = httpx.get(f"{running.url}/sparql", params={"query": "ASK {}"}, timeout=60)
        assert small.json()["boolean"] is True
        assert running.stop() == 0


@pytest.mark.slow
def test_a_port_in_use_is_one_line_and_exit_3(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = rtask("serve", "--data", str(tmp_path / "store"), "-p", str(port))
    assert done.returncode == 3
    (line,) = done.stderr.strip().splitlines()
    assert f"127.0.0.1:{port}" in line
    assert "-p 0" in line


@pytest.mark.slow
def test_a_folder_in_use_says_by_whom(server: RunningServer) -> None:
    done = rtask("serve", "--data", str(server.data), "-p", "0")
    assert done.returncode == 3
    assert str(server.process.pid) in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.slow
def test_other_machines_are_not_served_without_a_token(tmp_path: Path) -> None:
    done = rtask("serve", "--data", str(tmp_path / "store"), "-p", "0", "--host", "0.0.0.0")
    assert done.returncode == 2
    assert "rtask token create" in done.stderr


@pytest.mark.slow
def test_tokens_are_made_listed_and_revoked_by_command(tmp_path: Path) -> None:
    folder = str(tmp_path / "store")
    made = rtask("token", "create", "--data", folder, "--robot", "nao-1", "--json")
    assert made.returncode == 0, made.stderr
    members = json.loads(made.stdout)
    assert (members["agent"], members["role"]) == ("nao-1", "robot")
    listed = rtask("token", "list", "--data", folder)
    assert members["id"] in listed.stdout
    assert members["token"].split("_")[2] not in listed.stdout
    assert rtask("token", "revoke", members["id"], "--data", folder).returncode == 0
    again = rtask("token", "revoke", members["id"], "--data", folder)
    assert again.returncode == 2
    assert "revoked" in rtask("token", "list", "--data", folder).stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["token", "create", "--data", "{}", "--role", "king"], "unknown role"),
        (["token", "create", "--data", "{}"], "--robot NAME"),
        (["token", "create", "--data", "{}", "--robot", "a", "--name", "b"], "not both"),
        (["token", "create", "--data", "{}", "--robot", "a", "--expires", "soon"], "--expires"),
    ],
)
def test_wrong_usage_of_the_token_command_is_one_line(
    server: RunningServer, arguments: list[str], part: str
) -> None:
    done = rtask(*(argument.format(server.data) for argument in arguments))
    assert done.returncode == 2
    assert part in done.stderr
    assert "Traceback" not in done.stderr


def test_tokens_of_a_folder_that_is_no_knowledge_base_fail_in_one_line(
    server: RunningServer,
) -> None:
    done = rtask("token", "list", "--data", f"{server.data}/nothing")
    assert done.returncode == 2
    assert "not a knowledge base" in done.stderr
    assert "Traceback" not in done.stderr
