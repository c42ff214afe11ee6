"""A robot hides instructions in odd places; an agent of another robot obeys them to the letter."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from tests.clients.agents.calling import by_http, by_stdio, tool_caller
from tests.clients.agents.odd_places import COUNT, ObeyingReader, orders, stored_by
from tests.clients.conftest import MakeToken, robot
from tests.servers import RunningServer

pytestmark = pytest.mark.slow


def of_others(admin: httpx.Client, base: str) -> set[str]:
    """Return the statements outside of the obeying robot's graph and of what is derived."""
    own = f"{base}graph/agent/nao-1"
    derived = (f"{base}graph/inferred", f"{base}graph/meta", f"{base}graph/provenance")
    query = "SELECT ?g ?s ?p ?o { GRAPH ?g { ?s ?p ?o } }"
    answer = admin.post("/sparql", data={"query": query}, headers={"Accept": "text/csv"})
    assert answer.status_code == 200
    lines = answer.text.splitlines()
    return {line for line in lines if not line.startswith((own, *derived))}


@pytest.mark.parametrize("way", [by_http, pytest.param(by_stdio, marks=pytest.mark.deep)])
def test_instructions_in_odd_places_change_nothing_of_others(
    guarded: RunningServer, make_token: MakeToken, base: str, way: Any
) -> None:
    tokens = [make_token("--robot", name) for name in ("nao-1", "nao-2", "evil")]
    nao_1, nao_2, evil = (robot(guarded, token) for token in tokens)
    with (
        nao_1,
        nao_2,
        evil,
        robot(guarded, make_token("--name", "ann", "--role", "admin")) as admin,
    ):
        nao_2.post("/update", data={"update": "INSERT DATA { <urn:victim> <urn:p> 0 }"})
        hidden = evil.post("/update", data={"update": stored_by(f"{base}robot/evil/")})
        assert hidden.status_code == 204, hidden.text
        before = of_others(admin, base)
        assert any("urn:victim" in line for line in before)

        def send(method: str, address: str, media_type: str, body: str) -> httpx.Response:
            return nao_1.request(
                method, address, content=body, headers={"Content-Type": media_type}
            )

        with way(nao_1, tokens[0]) as call:
            reader = ObeyingReader(tool_caller(call), send, orders(f"{base}graph/agent/nao-2"))
            reader.read_and_obey()
        assert reader.obeyed == set(range(COUNT))
        assert not reader.misplaced
        assert of_others(admin, base) == before
        proposals = admin.get("/proposals", headers={"Accept": "application/json"}).json()
        assert {one["state"] for one in proposals["proposals"]} == {"proposed"}
