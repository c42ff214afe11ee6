"""Over a SPARQL server, an insertion asks little, however many objects it has."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

import rtask
from rtask.engine import Engine
from rtask.remote.store import RemoteStore
from tests.sparql_servers import OXIGRAPH, Oxigraph

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(OXIGRAPH is None, reason="the program oxigraph is not installed"),
]


def test_ten_new_objects_take_at_most_thirty_requests(bench, tmp_path: Path) -> None:
    server = Oxigraph(tmp_path / "oxigraph")
    server.start()
    try:
        with rtask.open(server.address, folder=tmp_path / "here") as kb, Engine(kb) as engine:
            assert isinstance(kb.store, RemoteStore)
            robot = bench.Robot("nao-1", engine)
            robot.register()
            sizes = [(0.046 + 0.003 * k, 0.032, 0.055) for k in range(10)]
            things = [bench.Thing(size, texture_seed=20 + k) for k, size in enumerate(sizes)]
            items = [{**bench.sight(thing), "gripper_id": robot.gripper} for thing in things]
            connection = kb.store.endpoints.connection
            before, started = connection.requests, time.monotonic()
            stored = robot.call("insert_object", objects=items)
            sent = connection.requests - before
            assert stored["stored"] == 10
            # One for each object and two for its place among the things that are there; the look
            # for commits of others sends one a second.
            assert sent <= 30 + 1 + int(time.monotonic() - started)
            again = robot.call("insert_object", objects=items)
            assert [one["object"] for one in again["objects"]] == [
                one["object"] for one in stored["objects"]
            ]
    finally:
        server.kill()
