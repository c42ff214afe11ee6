"""Nobody confirms in another's name, whichever way the message comes, also if they never wrote."""

from __future__ import annotations

import json
from collections.abc import Callable

import httpx
import pytest
from websockets.sync.client import connect

import rtask
from ontology import PREFIXES
from rtask.errors import RtaskError
from tests.servers import RunningServer

pytestmark = pytest.mark.slow

HAND = {"name": "right_hand", "gripper_type": "nao", "max_opening": 0.05, "max_payload": 0.3}
REPORT = {
    "object": "urn:x", "grasp": "urn:g", "gripper_id": "right_hand", "success": True,
    "confirmed_by": "human", "operator": "anna",
}  # fmt: skip


def over_http(server: RunningServer, token: str, base: str) -> str:
    headers = {"Authorization": f"Bearer {token}"}
    answer = httpx.post(
        f"{server.url}/engine/report_outcome", json=REPORT, headers=headers, timeout=120
    )
    assert answer.status_code == 403
    return answer.text


def with_the_client(server: RunningServer, token: str, base: str) -> str:
    with (
        rtask.connect(server.url, token=token, timeout_s=120) as robot,
        pytest.raises(RtaskError) as caught,
    ):
        robot.call("report_outcome", **REPORT)
    return str(caught.value)


def with_the_client_over_a_websocket(server: RunningServer, token: str, base: str) -> str:
    address = server.url.replace("http", "ws") + "/rosbridge"
    with (
        rtask.connect(address, token=token, timeout_s=120) as robot,
        pytest.raises(RtaskError) as caught,
    ):
        robot.call("report_outcome", **REPORT)
    return str(caught.value)


def over_rosbridge(server: RunningServer, token: str, base: str) -> str:
    asked = {"op": "call_service", "id": "1", "service": "/rtask/report_outcome", "args": REPORT}
    address = server.url.replace("http", "ws") + "/rosbridge"
    headers = {"Authorization": f"Bearer {token}"}
    with connect(address, additional_headers=headers) as robot:
        robot.send(json.dumps(asked))
        while (answer := json.loads(robot.recv(120)))["op"] != "service_response":
            pass
    assert answer["result"] is False
    return json.dumps(answer)


def over_sparql(server: RunningServer, token: str, base: str) -> str:
    said = f"INSERT DATA {{ <urn:f> <{PREFIXES['prov']}wasAttributedTo> <{base}person/anna> }}"
    headers = {
        "Authorization": f"Bearer {token}", "Content-Type": "application/sparql-update",
    }  # fmt: skip
    answer = httpx.post(f"{server.url}/update", content=said, headers=headers, timeout=120)
    assert answer.status_code == 403
    return answer.text


@pytest.fixture(scope="module")
def tokens(guarded: RunningServer, make_token: Callable[..., str]) -> dict[str, str]:
    made = {
        "anna": make_token("--name", "anna", "--role", "teacher"),
        "ben": make_token("--name", "ben", "--role", "teacher"),
        "nao-1": make_token("--robot", "nao-1"),
    }
    with rtask.connect(guarded.url, token=made["nao-1"], timeout_s=120) as robot:
        robot.register_robot(name="nao-1", model="nao", end_effectors=[HAND])
    return made


@pytest.mark.parametrize("who", ["nao-1", "ben"])
@pytest.mark.parametrize(
    "way",
    [
        over_http, with_the_client, with_the_client_over_a_websocket, over_rosbridge, over_sparql,
    ],
)  # fmt: skip
def test_nobody_confirms_as_anna_who_has_a_token_and_never_wrote(
    guarded: RunningServer, tokens: dict[str, str], base: str, way: Callable[..., str], who: str
) -> None:
    said = way(guarded, tokens[who], base)
    assert f"the token belongs to '{who}'" in said
    with rtask.connect(guarded.url, token=tokens["anna"], timeout_s=120) as reader:
        anna = f"<{base}person/anna>"
        assert not reader.ask(f"ASK {{ {{ ?s ?p {anna} }} UNION {{ {anna} ?p ?o }} }}")
