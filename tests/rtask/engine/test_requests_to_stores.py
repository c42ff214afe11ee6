"""Over a SPARQL server, an insertion asks little, however many objects it has."""

from __future__ import annotations

from pathlib import Path

import pytest

import rtask
from rtask.engine import Engine
from rtask.remote import sync
from rtask.remote.store import RemoteStore
from tests.sparql_servers import OXIGRAPH, Oxigraph

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(OXIGRAPH is None, reason="the program oxigraph is not installed"),
]


# Without a reasoner no closure is kept on the server, half of what this takes.
@pytest.mark.parametrize(
    ("count", "reason"), [(1, False), pytest.param(10, True, marks=pytest.mark.deep)]
)
def test_new_objects_take_at_most_two_requests_each(
    bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int, reason: bool
) -> None:
    monkeypatch.setattr(sync, "EVERY_S", 3600.0)  # the look for commits of others
    server = Oxigraph(tmp_path / "oxigraph")
    server.start()
    try:
        here = tmp_path / "here"
        with rtask.open(server.address, folder=here, reason=reason) as kb, Engine(kb) as engine:
            assert isinstance(kb.store, RemoteStore)
            robot = bench.Robot("nao-1", engine)
            robot.register()
            sizes = [(0.046 + 0.003 * k, 0.032, 0.055) for k in range(count)]
            things = [bench.Thing(size, texture_seed=20 + k) for k, size in enumerate(sizes)]
            items = [{**bench.sight(thing), "gripper_id": robot.gripper} for thing in things]
            connection = kb.store.endpoints.connection
            before = connection.requests
            stored = robot.call("insert_object", objects=items)
            sent = connection.requests - before
            assert stored["stored"] == count
            # Some seven for the whole, whatever the number of objects.
            assert sent <= 2 * count + 9
            again = robot.call("insert_object", objects=items)
            assert [one["object"] for one in again["objects"]] == [
                one["object"] for one in stored["objects"]
            ]
    finally:
        server.kill()
