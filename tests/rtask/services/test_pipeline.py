"""Pipelines: order, references, lists, and everything that is refused before anything runs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar

import numpy as np
import pytest

from rtask.errors import MissingDataError, ServiceError, UnknownTermError, UsageError
from rtask.services import Service, ServiceHost, method
from rtask.services.builtin import Pipeline
from rtask.services.definition import define
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Pose, Unit
from tests.rtask.services.lab import Reader


class Part(Answer):
    """A part of a cloud."""

    cloud: Bytes
    pose: Pose


class Parts(Answer):
    """Parts of a cloud."""

    parts: list[Part]
    heights: Annotated[Array, Unit("m")]


class Cut(Service):
    """Cuts and weighs."""

    name = "lab/Cut"
    calls: ClassVar[list[str]] = []

    @method
    def cut(self, cloud: Bytes, size: int) -> Parts:
        """Cut a cloud."""
        self.calls.append("cut")
        pieces = [cloud[k : k + size] for k in range(0, len(cloud), size)]
        found = [Part(cloud=piece, pose=np.eye(4)) for piece in pieces]
        return Parts(parts=found, heights=np.arange(len(pieces), dtype=float))

    @method(output="mass")
    def weigh(self, cloud: Bytes, pose: Pose, offset: float = 0.0) -> float:
        """Weigh a cloud."""
        self.calls.append("weigh")
        if cloud == b"!":
            raise ServiceError("too heavy")
        return float(len(cloud)) + offset + float(pose[0, 3])

    @method(output="total")
    def add(self, numbers: Array) -> float:
        """Add numbers."""
        self.calls.append("add")
        return float(numbers.sum())


@pytest.fixture
def host() -> Iterator[ServiceHost]:
    Cut.calls.clear()
    with ServiceHost([Cut, Pipeline]) as opened:
        yield opened


CUT = {
    "id": "parts",
    "call": "lab/Cut/cut",
    "inputs": {"cloud": {"$input": "cloud"}, "size": 2},
}
WEIGH = {
    "id": "masses",
    "call": "lab/Cut@0.*/weigh",
    "each": {"$ref": "parts.parts"},
    "inputs": {"cloud": {"$ref": "item.cloud"}, "pose": {"$ref": "item.pose"}},
}
ADD = {"id": "sum", "call": "lab/Cut/add", "inputs": {"numbers": {"$ref": "parts.heights"}}}


def run(host: ServiceHost, *steps: Any, output: Any, cloud: str = "QUJDREU=") -> Any:
    request = {"steps": list(steps), "inputs": {"cloud": cloud}, "output": output}
    return host.call("rtask/Pipeline", "run", request)["output"]


def test_values_go_from_step_to_step_and_only_the_output_comes_back(host):
    # Written out of order: a step runs once what it needs is there.
    wanted = {
        "masses": {"$ref": "masses"},
        "first": {"$ref": "masses.0.mass"},
        "pose": {"$ref": "parts.parts.0.pose.position.x"},
        "sum": {"$ref": "sum.total"},
    }
    found = run(host, WEIGH, ADD, CUT, output=wanted)
    assert found == {
        "masses": [{"mass": 2.0}, {"mass": 2.0}, {"mass": 1.0}],
        "first": 2.0,
        "pose": 0.0,
        "sum": 3.0,
    }


def test_the_answer_says_how_long_each_step_took(host):
    request = {"steps": [WEIGH, CUT], "inputs": {"cloud": "QUJD"}, "output": {}}
    found = host.call("rtask/Pipeline", "run", request)
    assert found["took_ms"].keys() == {"parts", "masses"}
    assert min(found["took_ms"].values()) > 0


@pytest.mark.parametrize(
    ("steps", "output", "words"),
    [
        ([CUT, CUT], {}, "step 'parts': expected a name of its own"),
        ([{**CUT, "id": "a.b"}], {}, "step 'a.b': expected a name of its own"),
        ([WEIGH], {}, "step masses: there is no step 'parts'"),
        ([CUT], {"x": {"$ref": "part.parts"}}, "output: there is no step 'part'; did you mean"),
        ([CUT], {"x": {"$ref": "parts.part"}}, "parts answers no 'part'; it answers parts, heig"),
        ([{**CUT, "inputs": {"clud": 1}}], {}, "has no input 'clud'; did you mean 'cloud'"),
        ([{**CUT, "inputs": {"cloud": {"$input": "x"}}}], {}, "there is no input 'x'"),
        (
            [
                {"id": "a", "call": "lab/Cut/add", "inputs": {"numbers": {"$ref": "b.total"}}},
                {"id": "b", "call": "lab/Cut/add", "inputs": {"numbers": {"$ref": "a.total"}}},
            ],
            {},
            "these steps wait for each other: a, b",
        ),
        (
            [CUT, {**WEIGH, "each": {"$ref": "parts"}}],
            {},
            "step masses: each: a Parts is not a list",
        ),
        (
            [CUT, {**WEIGH, "inputs": {"cloud": {"$ref": "item.pose"}}}],
            {},
            "step masses: cloud: item.pose does not fit: a geometry_msgs/Pose is not bytes",
        ),
        (
            [CUT, {**ADD, "inputs": {"numbers": {"$ref": "parts.parts"}}}],
            {},
            "step sum: numbers: parts.parts does not fit: a list of: a Part is not a list of numb",
        ),
        ([CUT, {**ADD, "inputs": {}}], {}, "step sum: .* needs the input 'numbers'"),
        ([], {}, "steps: length 0 is below 1"),
    ],
)
def test_a_pipeline_that_cannot_work_is_refused_before_anything_runs(host, steps, output, words):
    with pytest.raises(UsageError, match=words):
        run(host, *steps, output=output)
    assert Cut.calls == []


def test_an_unknown_service_is_refused_before_anything_runs(host):
    with pytest.raises(UnknownTermError, match="did you mean lab/Cut"):
        run(host, CUT, {**ADD, "call": "lab/Cup/add"}, output={})
    assert Cut.calls == []


def test_the_error_of_a_step_names_it(host):
    with pytest.raises(ServiceError, match="step masses: too heavy"):
        run(host, {**CUT, "inputs": {**CUT["inputs"], "size": 1}}, WEIGH, output={}, cloud="IQ==")


def test_a_pipeline_in_a_pipeline_is_a_circle(host):
    inner = {"id": "inner", "call": "rtask/Pipeline/run", "inputs": {"steps": [CUT], "output": {}}}
    with pytest.raises(UsageError, match="step inner: a circle of calls"):
        run(host, inner, output={})


@pytest.mark.parametrize("value", [{"$input": 5}, {"$ref": ["parts"]}, {"$ref": None}])
def test_what_only_looks_like_a_reference_stands_for_itself(host, value):
    assert run(host, CUT, output={"x": value}) == {"x": value}


def test_missing_data_are_named_before_the_first_step_runs(host):
    host.registry.add(define(Reader))
    steps = [CUT, {"id": "model", "call": "lab/Reader/read", "inputs": {}}]
    with pytest.raises(MissingDataError, match=r"step model: .*'model'; give it as \"data\": {"):
        host.call("rtask/Pipeline", "run", {"steps": steps, "output": {}, "inputs": {"cloud": ""}})
    assert Cut.calls == []
