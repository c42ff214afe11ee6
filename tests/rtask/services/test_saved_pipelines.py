"""Saved pipelines are services: typed, versioned, owned, and there again after a restart."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from annotated_types import Ge

import rtask
from rtask.engine.engine import Engine
from rtask.errors import (
    ConflictError,
    ForbiddenError,
    UnknownTermError,
    UnsupportedError,
    UsageError,
)
from rtask.kb.commit.access import Access
from rtask.services import Service, ServiceHost, method
from rtask.services.builtin import Pipeline
from rtask.services.definition import define
from rtask.services.offered import open_host
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Pose, Unit

pytestmark = pytest.mark.slow


class Piece(Answer):
    """A part of a cloud."""

    cloud: Bytes


class Pieces(Answer):
    """Parts of a cloud."""

    pieces: list[Piece]
    heights: Annotated[Array, Unit("m")]


class Saw(Service):
    """Cuts and weighs."""

    name = "lab/Saw"

    @method
    def cut(self, cloud: Bytes, size: Annotated[int, Ge(1)]) -> Pieces:
        """Cut a cloud.

        Parameters
        ----------
        cloud
            What to cut.
        size
            Of a piece, in bytes.
        """
        pieces = [cloud[k : k + size] for k in range(0, len(cloud), size)]
        return Pieces(pieces=[Piece(cloud=one) for one in pieces], heights=np.arange(len(pieces)))

    @method(output="mass")
    def weigh(self, cloud: Bytes, pose: Pose | None = None) -> float:
        """Weigh a cloud."""
        return float(len(cloud)) + (0.0 if pose is None else float(pose[0, 3]))


STEPS: list[dict[str, Any]] = [
    {
        "id": "parts",
        "call": "lab/Saw/cut",
        "inputs": {"cloud": {"$input": "cloud"}, "size": {"$input": "size"}},
    },
    {
        "id": "masses",
        "call": "lab/Saw/weigh",
        "each": {"$ref": "parts.pieces"},
        "inputs": {"cloud": {"$ref": "item.cloud"}, "pose": {"$input": "pose"}},
    },
]
OUTPUT = {
    "masses": {"$ref": "masses"},
    "heights": {"$ref": "parts.heights"},
    "given": {"$input": "cloud"},
}
REQUEST = {
    "pipeline": "lab/Weigh",
    "steps": STEPS,
    "output": OUTPUT,
    "defaults": {"size": 2},
    "summary": "Weigh the parts",
}
CLOUD = base64.b64encode(b"ABCDE").decode()
FOUND = {
    "masses": [{"mass": 2.0}, {"mass": 2.0}, {"mass": 1.0}],
    "heights": [0.0, 1.0, 2.0],
    "given": CLOUD,
}


def opened(folder: Path) -> Iterator[ServiceHost]:
    with rtask.open(folder) as kb, Engine(kb) as engine, open_host(engine) as host:
        host.registry.add(define(Saw))
        yield host


@pytest.fixture
def host(tmp_path: Path) -> Iterator[ServiceHost]:
    yield from opened(tmp_path / "kb")


def save(host: ServiceHost, access: Access | None = None, **changes: Any) -> dict[str, Any]:
    return host.call("rtask/Pipeline", "save", {**REQUEST, **changes}, access).as_json()


def test_a_saved_pipeline_is_called_like_a_method_and_is_there_after_a_restart(tmp_path: Path):
    for host in opened(tmp_path / "kb"):
        assert save(host)["version"] == "1.0.0"
        assert host.call("lab/Weigh", "run", {"cloud": CLOUD}).as_json() == FOUND
    for host in opened(tmp_path / "kb"):
        assert host.call("lab/Weigh@1.*", "run", {"cloud": CLOUD}).as_json() == FOUND
        (listed,) = host.call("rtask/Pipeline", "saved_pipelines")["result"]
        assert (listed["name"], listed["output"]) == ("lab/Weigh", OUTPUT)


def test_the_request_and_the_answer_are_those_of_the_steps(host):
    save(host)
    described = host.description("lab/Weigh")["methods"]["run"]
    fields = described["request"]["properties"]
    assert fields["cloud"]["contentEncoding"] == "base64"
    assert fields["cloud"]["description"] == "What to cut"
    assert (fields["size"]["type"], fields["size"]["minimum"]) == ("integer", 1)
    assert fields["size"]["default"] == 2
    assert described["request"]["required"] == ["cloud"]
    assert described["answer"]["properties"]["heights"]["x-unit"] == "m"
    with pytest.raises(UsageError, match=r"size: .*below"):
        host.call("lab/Weigh", "run", {"cloud": CLOUD, "size": 0})
    with pytest.raises(UsageError, match="cloud is missing"):
        host.call("lab/Weigh", "run", {})


def test_an_input_of_an_optional_field_may_be_left_out_or_given(host):
    save(host)
    pose = {"position": {"x": 5.0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    answer = host.connect("lab/Weigh").run(cloud=b"ABCDE", pose=pose)
    assert [one["mass"] for one in answer.masses] == [7.0, 7.0, 6.0]


def test_a_version_never_changes_and_versions_stand_side_by_side(host):
    save(host)
    save(host)  # the same again is no change
    with pytest.raises(ConflictError, match=r"lab/Weigh@1.0.0 is saved already; .*new version"):
        save(host, defaults={"size": 3})
    save(host, version="1.1.0", defaults={"size": 5})
    assert host.call("lab/Weigh", "run", {"cloud": CLOUD})["masses"] == [{"mass": 5.0}]
    old = host.call("lab/Weigh@1.0.0", "run", {"cloud": CLOUD})
    assert len(old["masses"]) == 3


def test_only_its_owner_changes_or_removes_it(host):
    mine, other = Access(agent="nao-1", role="robot"), Access(agent="panda-1", role="robot")
    assert save(host, mine)["owner"] == "nao-1"
    assert save(host, other)["owner"] == "nao-1"  # the same again changes nothing
    with pytest.raises(ForbiddenError, match="belongs to nao-1"):
        save(host, other, version="2.0.0")
    gone = {"pipeline": "lab/Weigh", "version": "1.0.0"}
    with pytest.raises(ForbiddenError, match="belongs to nao-1"):
        host.call("rtask/Pipeline", "remove", gone, other)
    assert host.call("lab/Weigh", "run", {"cloud": CLOUD}, other).as_json() == FOUND
    assert host.call("rtask/Pipeline", "remove", gone, mine)["removed"] == "lab/Weigh@1.0.0"
    with pytest.raises(UnknownTermError, match="no service lab/Weigh"):
        host.call("lab/Weigh", "run", {"cloud": CLOUD})
    with pytest.raises(UnknownTermError, match=r"no saved pipeline lab/Weigh@1\.0\.0"):
        host.call("rtask/Pipeline", "remove", gone, mine)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"pipeline": "lab/Saw"}, ConflictError, "lab/Saw is a service already"),
        ({"pipeline": "Weigh"}, UsageError, "expected <namespace>/<name>"),
        ({"version": "1"}, UsageError, "expected 1.2.3"),
        ({"defaults": {"sise": 2}}, UsageError, "no input 'sise'; did you mean 'size'"),
        ({"defaults": {"size": 0}}, UsageError, "defaults: size: 0 is below 1"),
        ({"defaults": {"size": "two"}}, UsageError, "defaults: size: expected"),
        ({"output": {"a-b": {"$ref": "parts"}}}, UsageError, "a-b: a field cannot have this name"),
        ({"output": {"x": {"$ref": "cuts"}}}, UsageError, "there is no step 'cuts'"),
        ({"output": {}}, UsageError, "output"),
    ],
)
def test_what_cannot_be_a_service_is_refused_and_nothing_is_kept(host, changes, error, words):
    before = [one["href"] for one in host.listing()]
    with pytest.raises(error, match=words):
        save(host, **changes)
    assert [one["href"] for one in host.listing()] == before
    assert host.call("rtask/Pipeline", "saved_pipelines")["result"] == []


def test_a_step_that_is_gone_is_named_when_the_pipeline_is_called(tmp_path: Path):
    for host in opened(tmp_path / "kb"):
        save(host)
        host.registry.forget("lab/Saw")
        with pytest.raises(UnknownTermError, match="no service lab/Saw"):
            host.call("lab/Weigh", "run", {"cloud": CLOUD})


def test_a_pipeline_may_call_a_saved_one_and_a_circle_is_refused(host):
    save(host)
    inner = {"id": "a", "call": "lab/Weigh/run", "inputs": {"cloud": {"$input": "cloud"}}}
    save(host, pipeline="lab/Outer", steps=[inner], output={"m": {"$ref": "a.masses"}}, defaults={})
    assert host.call("lab/Outer", "run", {"cloud": CLOUD})["m"] == FOUND["masses"]
    again = {**inner, "call": "lab/Outer/run"}
    save(
        host, pipeline="lab/Weigh", version="3.0.0", steps=[again],
        output={"masses": {"$ref": "a.m"}}, defaults={},
    )  # fmt: skip
    with pytest.raises(UsageError, match="a circle of calls"):
        host.call("lab/Weigh", "run", {"cloud": CLOUD})


def test_a_file_that_cannot_be_read_is_left_out_and_stays(tmp_path: Path, caplog):
    for host in opened(tmp_path / "kb"):
        save(host)
    file = tmp_path / "kb" / "pipelines" / "lab" / "Weigh@1.0.0.json"
    assert json.loads(file.read_text())["steps"][0]["id"] == "parts"
    broken = file.with_name("Broken@1.0.0.json")
    broken.write_text("{")
    for host in opened(tmp_path / "kb"):
        assert host.registry.find("lab/Weigh")
        with pytest.raises(UnknownTermError):
            host.registry.find("lab/Broken")
    assert "Broken@1.0.0.json is not offered" in caplog.text
    assert broken.read_text() == "{"


def test_without_a_server_there_is_nowhere_to_save():
    with (
        ServiceHost([Saw, Pipeline]) as host,
        pytest.raises(UnsupportedError, match="connect to a server"),
    ):
        save(host)
