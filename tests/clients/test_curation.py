"""People put objects right over HTTP and rosbridge while robots go on, also when cut short."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import roslibpy

import rtask
from endpoint.access.tokens import TokenStore
from features.codec import encode_frame, to_wire
from features.geometry import Frame, Intrinsics
from rtask.engine import Engine
from rtask.rdf.namespaces import RT
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

CAMERA = Intrinsics(320, 240, 700.0, 700.0, 159.5, 119.5)


def sight(seed: int) -> dict[str, Any]:
    """Return a look from above at a box with a picture of its own."""
    mask = np.zeros((240, 320), bool)
    mask[100:140, 130:191] = True
    depth = np.where(mask, 0.53, 0.57).astype(np.float32)
    picture = np.random.default_rng(seed).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    return {
        "data": to_wire(encode_frame(Frame(depth, CAMERA, picture, mask).crop(mask))),
        "sensor_pose": {
            "position": {"x": 0.15, "y": 0.0, "z": 0.57},
            "orientation": {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0},
        },
        "frame_id": "base_footprint",
        "support_height": 0.0,
    }


class Lab:
    """A guarded server, two people, a robot, and boxes that the robot met."""

    def __init__(self, server: RunningServer, tokens: dict[str, str]) -> None:
        self.server, self.tokens = server, tokens
        self._clients = {
            name: httpx.Client(
                base_url=server.url, headers={"Authorization": f"Bearer {token}"}, timeout=120
            )
            for name, token in tokens.items()
        }

    def ask(self, who: str, name: str, key: str = "", **args: Any) -> httpx.Response:
        headers = {"Idempotency-Key": key} if key else {}
        return self._clients[who].post(f"/engine/{name}", json=args, headers=headers)

    def curate(self, who: str, operation: str, key: str = "", **args: Any) -> httpx.Response:
        return self.ask(who, "curate_object", key, operation=operation, **args)

    def met(self, seed: int) -> dict[str, Any]:
        """Store a box of its own and return its entry."""
        stored = self.ask("nao-1", "insert_object", merge=False, **sight(seed))
        assert stored.status_code == 200, stored.text
        return dict(stored.json()["objects"][0])

    def ros(self, who: str) -> roslibpy.Ros:
        """Return a connected client of rosbridge."""
        bearer = {"Authorization": f"Bearer {self.tokens[who]}"}
        client = roslibpy.Ros("127.0.0.1", self.server.port, headers=bearer)
        client.run(timeout=60)
        return client

    def close(self) -> None:
        for client in self._clients.values():
            client.close()


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder = tmp_path_factory.mktemp("curation") / "store"
    rtask.open(folder, base="urn:lab/").close()
    with closing(TokenStore(folder)) as store:
        tokens = {name: store.create("teacher", agent=name)[0] for name in ("ann", "bob")}
        tokens["nao-1"] = store.create("robot", agent="nao-1")[0]
    with running_server(folder) as running:
        made = Lab(running, tokens)
        yield made
        made.close()


def test_robots_may_not_and_people_may_over_http(lab: Lab) -> None:
    one, other = lab.met(1), lab.met(2)
    merge = {"object": other["object"], "into": one["object"]}
    refused = lab.curate("nao-1", "merge", **merge)
    assert refused.status_code == 403
    assert "needs scope teach" in refused.json()["detail"]
    assert lab.curate("ann", "merge", object=one["object"], into=one["object"]).status_code == 400
    nobody = httpx.post(f"{lab.server.url}/engine/curate_object", json={"operation": "forget"})
    assert (nobody.status_code, "WWW-Authenticate" in nobody.headers) == (401, True)
    unknown = lab.curate("ann", "merge", object="urn:lab/object/999", into=one["object"])
    assert (unknown.status_code, unknown.json()["field"]) == (422, "object")
    # The same key carries out the same once, however often and at once it is sent.
    answers: list[httpx.Response] = []
    threads = [
        threading.Thread(target=lambda: answers.append(lab.curate("ann", "merge", "k-1", **merge)))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {answer.status_code for answer in answers} == {200}
    (commit,) = {answer.json()["commit"] for answer in answers}
    reused = lab.curate("ann", "undo", "k-1", commit=commit)
    assert (reused.status_code, reused.json()["type"]) == (422, "/errors/idempotency-key-reused")
    without = lab.curate("bob", "merge", **merge)
    assert without.status_code == 400
    assert "cannot be merged with itself" in without.json()["detail"]
    assert lab.curate("bob", "undo", commit=commit).status_code == 200
    again = lab.curate("ann", "undo", commit=commit)
    assert (again.status_code, again.json()["type"]) == (409, "/errors/conflict")


def test_the_same_over_rosbridge_and_subscribers_hear_of_it(lab: Lab) -> None:
    one, other = lab.met(3), lab.met(4)
    robot, person = lab.ros("nao-1"), lab.ros("ann")
    heard: list[dict[str, Any]] = []
    roslibpy.Topic(robot, "/rtask/changes", "rtask/Change").subscribe(heard.append)
    service = "/rtask/curate_object", "rtask/CurateObject"
    merge = roslibpy.ServiceRequest(
        {"operation": "merge", "object": other["object"], "into": one["object"]}
    )
    with pytest.raises(roslibpy.core.ServiceException, match="needs scope teach"):
        roslibpy.Service(robot, *service).call(merge, timeout=60)
    done = roslibpy.Service(person, *service).call(merge, timeout=60)
    assert done["object"] == one["object"]
    named = roslibpy.Service(person, "/rtask/teach_object", "rtask/TeachObject").call(
        roslibpy.ServiceRequest({"operation": "teach", "object": other["object"], "name": "a tin"}),
        timeout=60,
    )
    assert named["objects"][0]["object"] == one["object"]
    with pytest.raises(roslibpy.core.ServiceException, match="did you mean 'split'"):
        roslibpy.Service(person, *service).call(
            roslibpy.ServiceRequest({"operation": "spilt", "object": one["object"]}), timeout=60
        )
    until = time.monotonic() + 60
    commits = {int(done["commit"][2:]), int(named["commit"][2:])}
    while not commits <= {one["commit"] for one in heard} and time.monotonic() < until:
        time.sleep(0.05)
    assert commits <= {one["commit"] for one in heard}
    assert {one["agent"] for one in heard if one["commit"] in commits} == {"ann"}
    for client in (robot, person):
        client.close()


def test_an_object_is_forgotten_while_a_robot_asks_about_it(lab: Lab) -> None:
    thing = lab.met(5)
    answers: list[httpx.Response] = []
    stop = threading.Event()

    def ask() -> None:
        while not stop.is_set():
            answers.append(lab.ask("nao-1", "search_object", **sight(5)))

    asking = threading.Thread(target=ask)
    asking.start()
    for _ in range(3):
        gone = lab.curate("ann", "forget", object=thing["object"])
        assert gone.status_code == 200
        assert lab.curate("bob", "undo", commit=gone.json()["commit"]).status_code == 200
    last = lab.curate("ann", "forget", object=thing["object"])
    stop.set()
    asking.join()
    assert last.status_code == 200
    assert {answer.status_code for answer in answers} == {200}
    found = lab.ask("nao-1", "search_object", **sight(5)).json()["similar_objects"]
    assert thing["object"] not in {one["object"] for one in found}


def test_a_merge_cut_short_is_wholly_there_or_absent(tmp_path: Path) -> None:
    folder = tmp_path / "store"
    with running_server(folder) as running, httpx.Client(base_url=running.url, timeout=60) as web:
        stored = [
            web.post("/engine/insert_object", json={**sight(seed), "merge": False}).json()
            for seed in (6, 7)
        ]
        one, other = (answer["objects"][0]["object"] for answer in stored)
        commits: list[str] = []

        def go_on() -> None:
            merge = {"operation": "merge", "object": other, "into": one}
            while True:
                try:
                    done = web.post("/engine/curate_object", json=merge).json()
                    commits.append(done["commit"])
                    undo = {"operation": "undo", "commit": done["commit"]}
                    web.post("/engine/curate_object", json=undo)
                except httpx.TransportError:
                    return

        busy = threading.Thread(target=go_on)
        busy.start()
        until = time.monotonic() + 60
        while len(commits) < 2 and time.monotonic() < until:
            time.sleep(0.01)
        running.process.send_signal(signal.SIGKILL)
        running.process.wait(60)
        busy.join(60)
    assert len(commits) >= 2
    with rtask.open(folder) as kb, Engine(kb) as engine:
        graph = {q.object.value: q.subject.value for q in kb.match(None, RT.hasView)}
        assert {name.view_iri: name.object_iri for name in engine.index.views()} == graph
        merged = bool(kb.match(None, RT.mergedInto))
        assert set(graph.values()) == ({one} if merged else {one, other})
        assert bool(kb.match(other, RT.objectId)) is not merged
