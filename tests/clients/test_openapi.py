"""The description of the HTTP interface: true, valid, and a weapon against the server."""

from __future__ import annotations

import contextlib
import json
from typing import Any

import httpx
import pytest
from jsonschema import Draft202012Validator

from endpoint.api.openapi import document
from rtask.engine import Engine
from rtask.services.offered import open_host
from tests.servers import RunningServer

ROBOT = {
    "name": "open-1",
    "model": "nao-h25-v5",
    "end_effectors": [
        {"name": "hand", "gripper_type": "nao", "max_opening": 0.08, "max_payload": 0.1}
    ],
}


@pytest.fixture(scope="module")
def described(client_of_module: httpx.Client) -> dict[str, Any]:
    answer = client_of_module.get("/openapi.json")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    found: dict[str, Any] = answer.json()
    return found


@pytest.fixture(scope="module")
def client_of_module(server: RunningServer) -> Any:
    with httpx.Client(base_url=server.url, timeout=60) as connected:
        yield connected


def schema_of(described: dict[str, Any], name: str) -> Draft202012Validator:
    schema = {"$ref": f"#/components/schemas/{name}", "components": described["components"]}
    return Draft202012Validator(schema)


def test_every_operation_of_the_engine_is_described(described: dict[str, Any]) -> None:
    assert described["openapi"] == "3.1.0"
    named = {path.removeprefix("/engine/") for path in described["paths"] if "/engine/" in path}
    assert named == set(Engine.operations)
    with open_host() as host:
        whole = document(Engine, host.registry)  # type: ignore[arg-type]
    assert described == json.loads(json.dumps(whole))


def test_every_schema_is_one_and_every_reference_leads_somewhere(
    described: dict[str, Any],
) -> None:
    schemas = described["components"]["schemas"]
    for schema in schemas.values():
        Draft202012Validator.check_schema(schema)
    wanted = {
        part.split('"')[0] for part in json.dumps(described).split('"#/components/schemas/')[1:]
    }
    assert wanted <= set(schemas)


def test_requests_that_the_server_takes_fit_the_description_and_so_do_its_answers(
    described: dict[str, Any], client_of_module: httpx.Client
) -> None:
    schema_of(described, "RegisterRobotRequest").validate(ROBOT)
    answer = client_of_module.post("/engine/register_robot", json=ROBOT)
    assert answer.status_code == 200
    schema_of(described, "RegisteredRobot").validate(answer.json())
    refused = client_of_module.post("/engine/register_robot", json={"nme": 1})
    schema_of(described, "Problem").validate(refused.json())
    hand = {**ROBOT["end_effectors"][0], "jaw_width": None}  # type: ignore[dict-item]
    absent = {**ROBOT, "end_effectors": [hand]}
    schema_of(described, "RegisterRobotRequest").validate(absent)
    assert client_of_module.post("/engine/register_robot", json=absent).status_code == 200


def test_the_description_shows_one_form_and_the_server_takes_printed_numbers_too(
    described: dict[str, Any], client_of_module: httpx.Client
) -> None:
    hand = described["components"]["schemas"]["EndEffector"]["properties"]["max_opening"]
    assert hand["type"] == "number"
    assert hand["minimum"] == 0
    assert hand["x-unit"] == "m"
    printed = [{**ROBOT["end_effectors"][0], "max_opening": "0.08"}]  # type: ignore[dict-item]
    loose = {**ROBOT, "end_effectors": printed, "simulated": "false"}
    assert client_of_module.post("/engine/register_robot", json=loose).status_code == 200


def test_no_enumeration_mixes_types_and_every_schema_is_named(described: dict[str, Any]) -> None:
    def enumerations(schema: Any) -> Any:
        if isinstance(schema, dict):
            if "enum" in schema:
                yield schema["enum"]
            for one in schema.values():
                yield from enumerations(one)
        elif isinstance(schema, list):
            for one in schema:
                yield from enumerations(one)

    for values in enumerations(described):
        assert {type(value) for value in values} == {str}, values


@pytest.mark.parametrize(
    "change",
    [
        {"nme": "x"},
        {"name": ""},
        {"name": 5},
        {"end_effectors": []},
        {"end_effectors": [{"name": "hand"}]},
        {"end_effectors": [{**ROBOT["end_effectors"][0], "max_opening": -1.0}]},  # type: ignore[dict-item]
        {"end_effectors": [{**ROBOT["end_effectors"][0], "kind": "Foot"}]},  # type: ignore[dict-item]
        {"simulated": "perhaps"},
        {"frames": [1]},
    ],
)
def test_what_the_description_forbids_the_server_refuses(
    described: dict[str, Any], client_of_module: httpx.Client, change: dict[str, Any]
) -> None:
    wrong = {**ROBOT, **change}
    assert not schema_of(described, "RegisterRobotRequest").is_valid(wrong)
    answer = client_of_module.post("/engine/register_robot", json=wrong)
    assert answer.status_code == 400
    assert answer.headers["content-type"] == "application/problem+json"


def test_the_page_for_people_names_every_operation(client_of_module: httpx.Client) -> None:
    answer = client_of_module.get("/openapi")
    assert answer.headers["content-type"].startswith("text/html")
    for name in Engine.operations:
        assert f"POST /engine/{name}" in answer.text
    assert "<script" not in answer.text


@pytest.mark.slow
def test_an_idempotency_key_stores_once(client_of_module: httpx.Client) -> None:
    import numpy as np

    rng = np.random.default_rng(5)
    points = rng.uniform(-0.02, 0.02, (400, 3)).round(4)
    lines = [
        "ply", "format ascii 1.0", "element vertex 400", "property float x", "property float y",
        "property float z", "end_header", *(" ".join(map(str, point)) for point in points),
    ]  # fmt: skip
    import base64

    body = {"data": base64.b64encode("\n".join(lines).encode()).decode(), "name": "once"}
    key = {"Idempotency-Key": "open-key-1"}
    first = client_of_module.post("/engine/insert_object", json=body, headers=key)
    assert first.status_code == 200, first.text
    again = client_of_module.post("/engine/insert_object", json=body, headers=key)
    assert (first.json()["stored"], again.json()["stored"]) == (1, 0)
    assert again.json()["objects"][0]["object"] == first.json()["objects"][0]["object"]
    other = client_of_module.post(
        "/engine/insert_object", json={**body, "name": "twice"}, headers=key
    )
    assert other.status_code == 422
    assert other.json()["type"].endswith("idempotency-key-reused")
    faulty = client_of_module.post(
        "/engine/insert_object", json=body, headers={"Idempotency-Key": "no spaces"}
    )
    assert faulty.status_code == 400


# Hypothesis compares the state of the global `random` before and after each draw, and another
# thread of this process (a server's client, a pool) may have drawn from it in between.
@pytest.mark.filterwarnings("ignore:Do not use the .random. module inside strategies")
@pytest.mark.slow
@pytest.mark.parametrize("examples", [1, pytest.param(12, marks=pytest.mark.deep)])
def test_schemathesis_finds_no_server_error_and_no_undescribed_answer(
    server: RunningServer, described: dict[str, Any], examples: int
) -> None:
    """Property-based fuzzing of the whole description, good and bad requests alike."""
    schemathesis = pytest.importorskip("schemathesis", reason="schemathesis is not installed")
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis.errors import Unsatisfiable
    from schemathesis import GenerationMode
    from schemathesis.specs.openapi import checks

    wanted = [
        schemathesis.checks.not_a_server_error,
        checks.status_code_conformance,
        checks.content_type_conformance,
        checks.response_schema_conformance,
    ]
    schema = schemathesis.openapi.from_dict(described)
    schema.config.update(base_url=server.url)
    statuses: list[int] = []
    bounded = settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    both = (GenerationMode.POSITIVE, GenerationMode.NEGATIVE)
    for turn, found in enumerate(schema.get_all_operations()):
        operation = found.ok()
        if examples == 1 and turn % 3:
            continue  # the deep case asks all
        if operation.path == "/changes":
            continue  # it never ends, and has tests elsewhere
        if operation.path.startswith("/services/example/"):
            continue  # planning takes long, and their requests are checked like all others
        for mode in both if examples > 1 else (both[turn // 3 % 2],):

            @bounded
            @given(case=operation.as_strategy(generation_mode=mode))
            def attack(case: Any) -> None:
                response = case.call(timeout=240)
                statuses.append(response.status_code)
                case.validate_response(response, checks=wanted)

            # Where nothing can be sent, nothing can be sent wrongly.
            with contextlib.suppress(Unsatisfiable):
                attack()
    assert len(statuses) > (100 if examples > 1 else 13)
    assert {200, 400} <= set(statuses)  # both good and bad requests were made
