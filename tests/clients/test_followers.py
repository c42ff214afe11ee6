"""Followers: servers that copy another one's journal, answer reads and pass writes on."""

from __future__ import annotations

import gzip
import json
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

import rtask
from features.codec import encode_frame, to_wire
from features.geometry import Frame, Intrinsics
from rtask.loader import load
from rtask.model import RTASK
from rtask.remote.served import ServedKnowledgeBase
from tests.commands import run_command
from tests.servers import RunningServer, bearer, running_server
from tests.sparql_servers import free_port

pytestmark = pytest.mark.slow

_HANDS = [
    {"name": "hand", "kind": "ParallelJawGripper", "gripper_type": "jaws", "max_opening": 0.08,
     "jaw_width": 0.02, "finger_length": 0.05, "max_payload": 1.0}
]  # fmt: skip
_ROWS = {"Accept": "application/sparql-results+json"}


def _rtask(*arguments: str) -> str:
    return run_command(*arguments, check=True).stdout.strip()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return a folder that each test copies, and a token that may replicate."""
    folder = tmp_path_factory.mktemp("made") / "writer"
    with rtask.open(folder, ontologies=False) as kb:
        kb.update("INSERT DATA { <urn:old> <urn:p> 1 }", "nao-1")
    rights = ("--role", "reader", "--right", "replicate")
    return folder, _rtask("token", "create", "-d", str(folder), *rights)


@pytest.fixture
def folder(made: tuple[Path, str], tmp_path: Path) -> Path:
    return Path(shutil.copytree(made[0], tmp_path / "writer"))


@pytest.fixture
def token_file(made: tuple[Path, str], tmp_path: Path) -> Path:
    file = tmp_path / "token"
    file.write_text(made[1], "utf-8")
    return file


@pytest.fixture
def writer(folder: Path, token_file: Path) -> Iterator[RunningServer]:
    with running_server(folder) as running:
        yield running


Start = Callable[..., Any]


@pytest.fixture
def follow(token_file: Path, tmp_path: Path) -> Start:
    def start(url: str, name: str = "follower", *options: str) -> Any:
        where = ("--follow", url, "--token-file", str(token_file))
        return running_server(tmp_path / name, *where, *options)

    return start


def _wait(condition: Callable[[], bool], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.1)


def _values(server: RunningServer, subject: str, headers: dict[str, str]) -> list[str]:
    params = {"query": f"SELECT ?o {{ <{subject}> ?p ?o }} ORDER BY ?o"}
    answer = httpx.get(server.url + "/sparql", params=params, headers={**_ROWS, **headers})
    assert answer.status_code == 200, answer.text
    return [row["o"]["value"] for row in answer.json()["results"]["bindings"]]


def _digest(folder: Path) -> set[str]:
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        return set(map(str, kb.store.quads_for_pattern(None, None, None)))


def test_a_follower_answers_reads_passes_writes_on_and_shows_ones_own(
    writer: RunningServer, folder: Path, follow: Start
) -> None:
    robot = bearer(_rtask("token", "create", "-d", str(folder), "--robot", "nao-2"))
    with follow(writer.url) as follower:
        assert _values(follower, "urn:old", robot) == ["1"]
        for number in range(5):
            text = f"INSERT DATA {{ <urn:new> <urn:p> {number} }}"
            done = httpx.post(follower.url + "/update", data={"update": text}, headers=robot)
            assert done.status_code in (200, 204), done.text
            own = {"RTASK-Min-Version": done.headers["RTASK-Version"], **robot}
            assert len(_values(follower, "urn:new", own)) == number + 1
        answer = httpx.get(follower.url + "/sparql", params={"query": "ASK {}"}, headers=robot)
        assert float(answer.headers["RTASK-Staleness"]) < 10.0
        assert "RTASK-Stale" not in answer.headers
        stranger = httpx.post(follower.url + "/update", data={"update": "CLEAR ALL"})
        assert stranger.status_code in (401, 403)
        theirs = "INSERT DATA { GRAPH <%s> { <urn:x> <urn:p> 1 } }"
        with rtask.open(folder, mode="r") as kb:
            other = kb.graphs.agent("nao-1").value
        refused = httpx.post(
            follower.url + "/update", data={"update": theirs % other}, headers=robot
        )
        assert refused.status_code == 403
        body = gzip.compress(b"update=INSERT DATA { <urn:packed> <urn:p> 1 }".replace(b" ", b"+"))
        form = {"Content-Type": "application/x-www-form-urlencoded", "Content-Encoding": "gzip"}
        packed = httpx.post(follower.url + "/update", content=body, headers={**form, **robot})
        assert packed.status_code in (200, 204), packed.text
        call = f"{writer.url}/services/rtask/Engine/recall_grasps"
        made = httpx.post(
            call, json={"object": "none"}, headers={"Prefer": "respond-async", **robot}
        )
        assert made.status_code == 202, made.text
        place = made.headers["Location"]
        near = httpx.get(follower.url + place, params={"wait": "30"}, headers=robot)
        assert (near.status_code, near.json()["id"]) == (200, made.json()["id"]), near.text
        events = {"Accept": "text/event-stream", **robot}
        assert httpx.get(follower.url + place, headers=events).headers["Location"] == (
            writer.url + place
        )
        ended = httpx.delete(follower.url + place, headers=robot)
        assert (ended.status_code, ended.json()["id"]) == (200, made.json()["id"]), ended.text
        assert httpx.get(follower.url + "/jobs/none", headers=robot).status_code == 404
        writer_epoch, _, seq = done.headers["RTASK-Version"].partition(":")
        future = {"RTASK-Min-Version": f"{writer_epoch}:{int(seq) + 1000}", **robot}
        behind = httpx.get(follower.url + "/sparql", params={"query": "ASK {}"}, headers=future)
        assert (behind.status_code, behind.json()["type"]) == (503, "/errors/behind")
    assert follower.process.returncode == 0
    assert writer.stop() == 0
    assert _digest(folder) == _digest(follower.data)


def test_a_session_at_a_follower_reads_what_it_wrote(
    writer: RunningServer, folder: Path, follow: Start
) -> None:
    token = _rtask("token", "create", "-d", str(folder), "--robot", "nao-2")
    with follow(writer.url) as follower:
        with rtask.open(follower.url + "/sparql", token=token) as kb:
            assert isinstance(kb, ServedKnowledgeBase)
            with kb.session("nao-2") as s, kb.session("nao-2") as other:
                mug = RTASK.Mug(iri="urn:mug", object_id="lab/mug-1", mass=0.5)
                s.add(mug)
                s.flush()
                for number in range(1, 9):
                    mug.mass = float(number)
                    assert s.flush() is not None
                    assert other.get(RTASK.Mug, "urn:mug").mass == number
                    assert s.query(RTASK.Mug).where(RTASK.Mug.mass == number).one() is mug
        assert follower.process.poll() is None


def _call(robot: ClientConnection, service: str, **args: Any) -> dict[str, Any]:
    robot.send(json.dumps({"op": "call_service", "id": "1", "service": service, "args": args}))
    while True:
        answer: dict[str, Any] = json.loads(robot.recv(timeout=60))
        if answer["op"] == "service_response":
            return answer


def _unknown_object() -> dict[str, Any]:
    """Return the request of a robot that sees something unknown, and wants a decision."""
    camera = Intrinsics.from_fov(64, 48, 1.0)
    rng = np.random.default_rng(0)
    depth = np.full((48, 64), 0.5, np.float32)
    depth[10:30, 20:40] = 0.45
    colours = rng.integers(0, 255, (48, 64, 3), np.uint8)
    frame = Frame(depth, camera, colours, depth < 0.48, frame_id="optical")
    data = to_wire(encode_frame(frame.crop(depth < 0.48)))
    return {"task": "pick", "gripper_id": "hand", "data": data, "decide": True}


def _has_come(server: RunningServer, seq: int) -> bool:
    return int(httpx.get(server.url + "/health").json()["seq"]) >= seq


def _websocket(server: RunningServer, headers: dict[str, str]) -> ClientConnection:
    """Connect; a follower that has not heard of its writer for a while says to ask again."""
    address, end = server.url.replace("http", "ws", 1), time.monotonic() + 60
    while True:
        try:
            return connect(address, additional_headers=headers, max_size=None)
        except InvalidStatus as refused:
            if refused.response.status_code != 503 or time.monotonic() > end:
                raise
        time.sleep(0.1)


def test_robots_write_and_meet_others_through_a_follower_and_read_there(
    folder: Path, token_file: Path, follow: Start
) -> None:
    with rtask.open(folder):  # with the ontology, for the engine
        pass
    robot = bearer(_rtask("token", "create", "-d", str(folder), "--robot", "nao-2"))
    reader = bearer(_rtask("token", "create", "-d", str(folder), "--role", "reader"))
    admin = bearer(_rtask("token", "create", "-d", str(folder), "--role", "admin"))
    with running_server(folder) as writer, follow(writer.url) as follower:
        with _websocket(follower, robot) as near, _websocket(writer, robot) as far:
            for number in range(3):
                told = {"name": "nao-2", "model": f"Nao {number}", "end_effectors": _HANDS}
                stored = _call(near, "/rtask/register_robot", **told, replace=True)
                assert stored["result"] is True, stored
                seq = httpx.get(writer.url + "/health").json()["seq"]
                assert _call(near, "/rtask/compare_contributors")["result"] is True
                _wait(partial(_has_come, follower, seq))
            refused = _call(near, "/rtask/recognise_for_grasp", **_unknown_object())
            assert refused["result"] is True, refused
            refusal = refused["values"]["decision"]["refusal"]
            done = _call(near, "/rtask/report_refusal", refusal=refusal, response="left_alone")
            assert done["values"]["stored"] == 1, "the writer had the refusal before the response"
            far.send(json.dumps({"op": "subscribe", "topic": "/hello", "type": "std_msgs/String"}))
            _call(far, "/rosapi/get_time")  # the subscription before it has been carried out
            message = {"topic": "/hello", "msg": {"data": "here"}}
            near.send(json.dumps({"op": "advertise", "topic": "/hello", "type": "std_msgs/String"}))
            near.send(json.dumps({"op": "publish", **message}))
            assert json.loads(far.recv(timeout=60)) == {"op": "publish", **message}
            with _websocket(follower, reader) as other:
                refused = _call(
                    other,
                    "/rtask/register_robot",
                    name="nao-2",
                    model="other",
                    end_effectors=_HANDS,
                )
                assert (refused["result"], refused["status"]) == (False, 403)
            writer.stop()
            with pytest.raises(ConnectionClosed):  # what was advertised there is gone
                near.recv(timeout=60)
        with _websocket(follower, robot) as near:
            refused = _call(
                near, "/rtask/register_robot", name="nao-2", model="other", end_effectors=_HANDS
            )
            assert (refused["result"], refused["status"]) == (False, 503)
            assert writer.url in refused["values"]
            again = _call(near, "/rtask/recognise_for_grasp", **_unknown_object())
            assert again["values"]["decision"]["refusal"], "it is answered, and waits on disk"
            waits = httpx.get(follower.url + "/metrics", headers=admin).text
            assert "rtask_follower_records_waiting 2" in waits
            goal = {"op": "send_action_goal", "action": "/rtask/plan_grasps", "id": "goal"}
            near.send(json.dumps({**goal, "args": {"gripper_id": "hand"}}))
            ended = json.loads(near.recv(timeout=60))
            assert ended["op"] == "action_result"
            assert writer.url not in json.dumps(ended), "it is an action that does not write"
            assert _call(near, "/rtask/compare_contributors")["result"] is True


def test_a_token_that_the_writer_revokes_is_void_on_followers(
    writer: RunningServer, folder: Path, follow: Start
) -> None:
    secret = _rtask("token", "create", "-d", str(folder), "--robot", "nao-2")
    with follow(writer.url) as follower:
        assert _values(follower, "urn:old", bearer(secret)) == ["1"]
        tokens = json.loads(_rtask("token", "list", "-d", str(folder), "--json"))
        [mine] = [token for token in tokens if token["agent"]]
        _rtask("token", "revoke", mine["id"], "-d", str(folder))

        def is_void() -> bool:
            params = {"query": "ASK {}"}
            answer = httpx.get(follower.url + "/sparql", params=params, headers=bearer(secret))
            return answer.status_code == 401

        _wait(is_void)


def test_copying_needs_the_right_to_it(writer: RunningServer, folder: Path) -> None:
    reader = bearer(_rtask("token", "create", "-d", str(folder), "--role", "reader"))
    for address in ("/replicate/records?since=x:0", "/replicate/snapshot"):
        refused = httpx.get(writer.url + address, headers=reader)
        assert refused.status_code == 403, refused.text
        assert "replicate" in refused.json()["detail"]


def test_a_follower_goes_on_without_its_writer_and_takes_its_place_when_promoted(
    writer: RunningServer, folder: Path, follow: Start, tmp_path: Path
) -> None:
    robot = bearer(_rtask("token", "create", "-d", str(folder), "--robot", "nao-2"))
    with follow(writer.url) as follower:
        writer.stop(signal.SIGKILL)

        def is_stale() -> bool:
            answer = httpx.get(follower.url + "/sparql", params={"query": "ASK {}"}, headers=robot)
            assert answer.status_code == 200
            return "RTASK-Stale" in answer.headers

        _wait(is_stale)
        asked = httpx.post(
            follower.url + "/engine/recall_grasps", json={"object": "cup"}, headers=robot
        )
        unknown = asked.json()
        assert unknown["type"] == "/errors/unknown-term"
        assert unknown["as_of"] == asked.headers["RTASK-Version"]
        assert "lags behind its writer" in unknown["not_yet"]
        text = {"update": "INSERT DATA { <urn:new> <urn:p> 1 }"}
        refused = httpx.post(follower.url + "/update", data=text, headers=robot)
        assert (refused.status_code, refused.json()["type"]) == (503, "/errors/writer-unreachable")
        for tool, status in (("recall_grasps", 200), ("teach_object", 503)):
            params = {"name": f"rtask_Engine_{tool}", "arguments": {}}
            call = {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": params}
            answer = httpx.post(follower.url + "/mcp/services", json=call, headers=robot)
            assert answer.status_code == status, answer.text
        _wait(lambda: httpx.get(follower.url + "/health/ready").status_code == 503)
        assert "behind" in httpx.get(follower.url + "/health/ready").json()["failing"]
    assert follower.data is not None
    done = run_command("serve", "-d", str(follower.data), "-p", "0")
    assert done.returncode != 0
    assert "rtask promote" in done.stderr
    _rtask("promote", str(follower.data))
    with running_server(follower.data) as promoted:
        stored = httpx.post(promoted.url + "/update", data=text, headers=robot, timeout=60)
        assert stored.status_code in (200, 204), stored.text
        assert _values(promoted, "urn:new", robot) == ["1"]


@pytest.mark.deep
def test_a_bulk_load_makes_a_follower_start_over(
    folder: Path, token_file: Path, follow: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The journal does not hold what a bulk load adds."""
    port = ("-p", str(free_port()))
    reader = bearer(token_file.read_text("utf-8"))
    with (
        running_server(folder, *port) as writer,
        follow(writer.url, "copy", "-p", str(free_port())) as copy,
    ):
        assert _values(copy, "urn:old", reader) == ["1"]
        assert writer.stop() == 0
        monkeypatch.setattr(load, "MAX_QUADS", 100)
        lines = "".join(f"<urn:bulk{n}> <urn:p> {n} .\n" for n in range(200))
        with rtask.open(folder, ontologies=False) as kb:
            kb.load(lines.encode(), format="turtle", graph="urn:bulk")
        with running_server(folder, *port):
            _wait(lambda: _has(copy, "urn:bulk199", reader), seconds=90.0)


def _has(server: RunningServer, subject: str, headers: dict[str, str]) -> bool:
    try:
        return bool(_values(server, subject, headers))
    except (httpx.TransportError, AssertionError):  # it is starting again
        return False


def test_byte_strings_come_when_they_are_asked_for(
    folder: Path, token_file: Path, follow: Start
) -> None:
    with rtask.open(folder, ontologies=False) as kb, kb.transaction("nao-1") as tx:
        name = tx.blob(b"a picture", "image/png")
    with running_server(folder) as writer, follow(writer.url) as follower:
        reader = bearer(token_file.read_text())
        digest = name.value.rpartition(":")[2]
        assert (
            httpx.get(f"{follower.url}/api/blobs/{digest}", headers=reader).content == b"a picture"
        )
        missing = httpx.get(f"{follower.url}/api/blobs/{'0' * 64}", headers=reader)
        assert missing.status_code == 404


def test_a_backup_is_made_at_the_writer_or_of_a_stopped_follower(
    writer: RunningServer, folder: Path, follow: Start, tmp_path: Path
) -> None:
    admin = bearer(_rtask("token", "create", "-d", str(folder), "--role", "admin"))
    with follow(writer.url) as follower:
        text = {"update": "INSERT DATA { <urn:new> <urn:p> 1 }"}
        stored = httpx.post(follower.url + "/update", data=text, headers=admin, timeout=60)
        own = {"RTASK-Min-Version": stored.headers["RTASK-Version"], **admin}
        _wait(lambda: _has(follower, "urn:new", own))
        made = httpx.post(follower.url + "/backup", headers=admin, timeout=60)
        assert made.status_code == 201, made.text
        assert made.json()["folder"].startswith(str(folder))
    assert writer.stop() == 0
    assert follower.data is not None
    _rtask("backup", "-d", str(follower.data), str(tmp_path / "backup"))
    _rtask("restore", str(tmp_path / "backup"), str(tmp_path / "restored"))
    assert _digest(tmp_path / "restored") == _digest(folder)
