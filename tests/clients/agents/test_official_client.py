"""The official client of the Model Context Protocol holds a session with the graph.

Its dependencies are heavy, so it need not be installed beside the project: the tests use it from
this interpreter, or from the one that RTASK_MCP_PYTHON names, and are skipped where neither has it.
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

import ontology
from tests.servers import RTASK, RunningServer, running_server

_SESSION = Path(__file__).with_name("official_session.py")
_MUG = (
    f"PREFIX rt: <{ontology.NS}> INSERT DATA {{ "
    '<https://w3id.org/rtask-kg/kb/sample/mug> a rt:Mug ; rt:name "blue mug" }'
)
_INTERPRETER = os.environ.get("RTASK_MCP_PYTHON", sys.executable)


@functools.cache
def has_sdk() -> bool:
    """Whether the interpreter of the sessions has the SDK, in a version that they know."""
    tried = [_INTERPRETER, "-c", "from mcp import Client"]
    return subprocess.run(tried, capture_output=True, timeout=120, check=False).returncode == 0


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    if not has_sdk():
        pytest.skip("the mcp SDK is not installed; RTASK_MCP_PYTHON names an interpreter with it")
    with running_server(tmp_path_factory.mktemp("agents") / "store") as running:
        made = httpx.post(f"{running.url}/update", data={"update": _MUG}, timeout=60)
        assert made.status_code in (200, 204), made.text
        yield running


def session(*arguments: str, **environment: str) -> dict[str, Any]:
    """Return what the client saw."""
    done = subprocess.run(
        [_INTERPRETER, str(_SESSION), *arguments],
        capture_output=True,
        text=True,
        timeout=240,
        env={**os.environ, **environment},
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    seen: dict[str, Any] = json.loads(done.stdout)
    return seen


@pytest.mark.parametrize(
    ("by", "newest", "agreed"),
    [
        ("http", "", "2025-06-18"),
        ("http", "2025-03-26", "2025-03-26"),
        ("stdio", "", "2025-06-18"),
    ],
)
def test_the_official_client_uses_every_part(
    server: RunningServer, by: str, newest: str, agreed: str
) -> None:
    place = [f"{server.url}/mcp"] if by == "http" else ["--", *RTASK, "mcp", "--server", server.url]
    seen = session(*place, VERSION=newest)
    assert seen["version"] == agreed
    assert len(seen["tools"]) <= 12
    assert seen["size"] <= 12_000
    assert "rtask:/questions/cq05" in seen["resources"]
    assert seen["templates"] == ["rtask:/explain{?s,p,o}"]
    assert seen["ontology"] <= 6_000
    assert [call["tool"] for call in seen["calls"] if call["error"]] == []
    last = seen["calls"][-1]["answer"]
    assert "did you mean rt:Mug?" in last["faults"][0]["detail"]["value"]
    explained = seen["calls"][-2]["answer"]
    assert explained["verdict"] == "holds"
    assert seen["progress"], "no event about progress arrived"
    assert seen["cancelled"]
    assert seen["after"]
    assert _ends(server), "the cancelled query is still running"


def _ends(server: RunningServer) -> bool:
    """Whether no query of an agent is left, long before its own time limit."""
    for _ in range(40):
        if not httpx.get(f"{server.url}/queries", timeout=60).json()["queries"]:
            return True
        time.sleep(0.1)
    return False
