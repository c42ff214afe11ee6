"""A caller that knows the texts of the tools alone asks over real transports."""

from __future__ import annotations

import re
from typing import Any, cast

import httpx
import pytest

import ontology
from rtask.asking.tools.toolbox import Toolbox
from rtask.kb.commit.access import Access
from tests.clients.agents.calling import Call, by_http, by_stdio
from tests.rtask.asking.scripted_caller import ScriptedCaller
from tests.servers import RunningServer

pytestmark = pytest.mark.slow

_FILES = [*ontology.queries(), *ontology.episode_queries()]


class Served:
    """The tools of a server, as :class:`ScriptedCaller` takes those of a graph."""

    def __init__(self, call: Call) -> None:
        self._call = call

    def listed(self, access: Access) -> list[dict[str, Any]]:
        tools: list[dict[str, Any]] = self._call("tools/list", {})["result"]["tools"]
        return tools

    def call(self, name: str, arguments: dict[str, Any], *_: object) -> dict[str, Any]:
        answer = self._call("tools/call", {"name": name, "arguments": arguments})
        result: dict[str, Any] = answer["result"]
        return result


def _without_blob(trig: str) -> str:
    """Return the sample with a point cloud that names no bytes, which this server does not have."""
    return re.sub(r"rt:hasBlob <urn:sha256:\w+>", 'rt:name "bytes elsewhere"', trig)


@pytest.fixture(scope="module")
def sample(server: RunningServer) -> RunningServer:
    with httpx.Client(base_url=server.url, timeout=60) as client:
        loaded = client.post(
            "/store",
            content=_without_blob(ontology.path("examples/sample.trig").read_text("utf-8")),
            headers={"Content-Type": "application/trig"},
        )
        assert loaded.status_code in (200, 201, 204), loaded.text
    return server


@pytest.mark.parametrize(
    ("way", "files"),
    [
        (by_http, _FILES[::9]),
        pytest.param(by_http, _FILES, marks=pytest.mark.deep),
        pytest.param(by_stdio, _FILES, marks=pytest.mark.deep),
    ],
)
def test_each_question_has_its_rows_within_three_calls(
    sample: RunningServer, way: Any, files: list[Any]
) -> None:
    with httpx.Client(base_url=sample.url, timeout=60) as client, way(client, "") as call:
        caller = ScriptedCaller(cast("Toolbox", Served(call)), Access())
        for file in files:
            text = file.read_text("utf-8")
            rows, calls = caller.answer(text.splitlines()[0].removeprefix("# question: "))
            asked = client.post("/sparql", data={"query": text}, headers={"Accept": "text/csv"})
            assert calls <= 3, file.stem
            assert len(rows) == len(asked.text.splitlines()) - 1, file.stem
