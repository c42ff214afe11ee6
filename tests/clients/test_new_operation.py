"""An operation that is declared once is there everywhere: described, generated, and answered."""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from jsonschema import Draft202012Validator
from openapi_spec_validator import validate
from websockets.sync.client import connect

from endpoint.rosbridge.typedefs import full_text, typedefs_of
from rtask.engine.context import Context
from rtask.engine.operations.operation import operation
from rtask.kb.commit.access import Access
from rtask.wire.stubs import source_of
from tests.clients.toy_operation import OPERATIONS, Weighed, WeighObject, weigh_object
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    """A server of its own process, whose table has one operation more."""
    with running_server(
        None, command=(sys.executable, "-m", "tests.clients.toy_operation")
    ) as running:
        yield running


@pytest.fixture(scope="module")
def described(server: RunningServer) -> dict[str, Any]:
    found: dict[str, Any] = httpx.get(f"{server.url}/openapi.json", timeout=60).json()
    return found


def bare(context, request, access):
    return Weighed(class_="thing", mass=1.0)


def loose(context: Context, request: dict, access: Access) -> Weighed:
    return Weighed(class_="thing", mass=1.0)


@pytest.mark.parametrize("handler", [bare, loose])
def test_a_handler_whose_annotations_declare_nothing_is_refused(handler):
    with pytest.raises(TypeError, match=handler.__name__):
        operation("read", "reads", "weigh")(handler)


def test_a_scope_that_no_role_holds_is_refused():
    with pytest.raises(ValueError, match="'fly'"):
        operation("fly", "reads", "weigh")


def test_the_document_describes_request_and_answer(described):
    validate(described)
    path = described["paths"]["/engine/weigh_object"]["post"]
    assert path["summary"] == "tell what an object weighs"
    wanted = described["components"]["schemas"]["WeighObjectRequest"]
    assert wanted["required"] == ["object", "volume"]
    assert wanted["properties"]["volume"] == {
        "description": "of the material (m3)",
        "type": "number",
        "minimum": 0,
        "maximum": 1,
        "x-unit": "m3",
        "x-ros-type": "float64",
    }
    assert wanted["properties"]["hollow"]["x-ros-type"] == "bool[]"
    assert wanted["properties"]["hollow"]["x-absent"] == "true"
    assert wanted["properties"]["material"]["enum"] == ["steel", "wood"]
    answer = described["components"]["schemas"]["Weighed"]
    assert set(answer["properties"]) == {"class", "mass"}


def test_the_answer_over_http_fits_its_schema(server, described):
    url = f"{server.url}/engine/weigh_object"
    answer = httpx.post(url, json={"object": "cube", "volume": "0.5", "hollow": "false"})
    assert answer.json() == {"class": "thing", "mass": 300.0}
    schema = {"$ref": "#/components/schemas/Weighed", "components": described["components"]}
    Draft202012Validator(schema).validate(answer.json())
    refused = httpx.post(url, json={"object": "cube", "volume": 2})
    assert refused.status_code == 400
    assert "volume: 2 is above 1" in refused.json()["detail"]


def test_an_answer_that_does_not_fit_its_declaration_is_an_error(server):
    answer = httpx.post(
        f"{server.url}/engine/weigh_object", json={"object": "cursed", "volume": 0.1}
    )
    assert answer.status_code == 500
    assert "mass" not in answer.text


def test_rosbridge_answers_and_describes_it(server):
    def call(service, **args):
        socket.send(json.dumps({"op": "call_service", "service": service, "args": args}))
        return json.loads(socket.recv(30))["values"]

    with connect(server.websocket) as socket:
        steel = call("/rtask/weigh_object", object="cube", volume=0.1, material="steel")
        typed = call("/rtask/weigh_object", object="cube", volume=0.1, material="", hollow=[])
        details = call("/rosapi/service_request_details", type="rtask/WeighObject")
        assert "/rtask/weigh_object" in call("/rosapi/services")["services"]
    assert steel == {"class": "thing", "mass": 392.5}
    assert typed == {"class": "thing", "mass": 30.0}
    (typedef,) = details["typedefs"]
    assert full_text(typedef) == ("string object\nfloat64 volume\nstring material\nbool[] hollow")
    assert typedefs_of("rtask/WeighObjectRequest", WeighObject) == [typedef]


def test_the_generated_client_has_a_method_for_it():
    source = source_of(OPERATIONS.values(), "tests")
    tree = ast.parse(source)
    calls = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == "Calls")
    method = next(
        n for n in calls.body if isinstance(n, ast.FunctionDef) and n.name == weigh_object.name
    )
    keywords = {one.arg: ast.unparse(one.annotation) for one in method.args.kwonlyargs}
    assert keywords == {
        "object": "str",
        "volume": "float",
        "material": "Literal['steel', 'wood'] | None",
        "hollow": "bool | None",
    }
    assert ast.unparse(method.returns) == "Weighed"
