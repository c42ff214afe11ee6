"""Whatever a robot puts into whichever field, it changes nothing that is another robot's.

The walk goes over all operations and all fields of text, those that come later included: an
operation that writes and is not called here fails the first test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import BaseModel

from rtask.engine.operations.table import OPERATIONS
from rtask.errors import RtaskError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode
from rtask.wire.fields import kind_of
from tests.rtask.engine.conftest import Bench, registration

TAUGHT = {"give_feedback", "curate_object", "withdraw_contributor", "answer_question"}
"""For people: robots have no such right."""
SIGHT = Bench.sight(Bench.CAN)
POSE = {
    "position": {"x": 0.1, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}
GRASP = {"in_object": {"x": 0.01, "y": 0.0, "z": 0.03, "theta": 1.57}, "opening": 0.04}
CALLS: dict[str, dict[str, Any]] = {
    "register_robot": {**registration("nao-2", "right_hand"), "replace": True,
                       "places": [{"name": "box", "pose": POSE, "length": 0.3, "width": 0.2}]},
    "recognise_for_grasp": {**SIGHT, "gripper_id": "right_hand", "propose": True},
    "plan_in_space": {"object": "{object}", "gripper_id": "right_hand"},
    "reconstruct_mesh": {"object": "{object}"},
    "state_place": {"thing": "{cup}", "place": "{spot}"},
    "state_reach": {"place": "{spot}"},
    "report_sightings": {"frame": "base_footprint", "gone": ["{cup}"],
                         "seen": [{"object": "{object}", "pose": POSE}]},
    "state_frame": {"frame": "camera", "parent": "base_footprint", "pose": POSE},
    "store_plan": {"goal": "every pen into the left box"},
    "claim_step": {},
    "end_step": {"task": "urn:step", "result": "done"},
    "cancel_plan": {"plan": "urn:plan", "reason": "late"},
    "ask_person": {"task": "urn:step", "kind": "act", "text": "Which?",
                   "choices": [{"code": "a", "text": "this"}, {"code": "b", "text": "that"}]},
    "insert_object": {"objects": [{**SIGHT, "gripper_id": "right_hand", "name": "can",
                                   "outcome": Bench.missed(), "grasp": GRASP}]},
    "report_outcome": {"object": "{object}", "grasp": "{grasp}", "gripper_id": "right_hand",
                       "outcome": Bench.missed()},
    "report_refusal": {"refusal": "urn:refusal", "response": "left_alone"},
    "teach_object": {"operation": "search", "object": "{object}"},
}  # fmt: skip
"""How a robot calls what writes or records; names in braces are those of :func:`owned`."""

OF_A_PLAN = {
    "store_plan": "left",
    "end_step": "urn:step",
    "cancel_plan": "own alone",
    "ask_person": "urn:step",
    "report_refusal": "urn:refusal",
}
WITH_PICTURES = {"recognise_for_grasp", "insert_object"}
"""What is refused as it is called here, since the robot has nothing of that kind itself."""


def fields(model: type[BaseModel], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the paths of the fields of text."""
    for name, field in model.model_fields.items():
        kind = kind_of(field)
        if kind.message is not None:
            yield from fields(kind.message, (*path, name))
        elif kind.type is str:
            yield (*path, name)


def filled(request: Any, names: dict[str, str]) -> Any:
    if isinstance(request, str):
        return request.format(**names)
    if isinstance(request, dict):
        return {key: filled(value, names) for key, value in request.items()}
    return [filled(item, names) for item in request] if isinstance(request, list) else request


def with_name(model: type[BaseModel], request: dict[str, Any], path: tuple[str, ...], name: str):
    """Return a request whose field of a path holds a name."""
    field, *rest = path
    kind = kind_of(model.model_fields[field])
    if not rest:
        return {**request, field: [name] if kind.is_list else name}
    part = request.get(field) or ([{}] if kind.is_list else {})
    if kind.is_list:
        first = with_name(kind.message, part[0], tuple(rest), name)
        return {**request, field: [first, *part[1:]]}
    return {**request, field: with_name(kind.message, part, tuple(rest), name)}


def owned(bench: type[Bench], robots: Any) -> tuple[dict[str, str], dict[str, str]]:
    """Store what belongs to nao-1 and what is everybody's; return the names of both."""
    one = robots("nao-1")
    robots("nao-2")
    kb, own = one.engine.kb, one.engine.kb.graphs.agent_iri("nao-1").value
    seen = bench.sight(bench.BOX)
    refused = one.recognise(seen, decide=True, min_grasp=1.0)
    asked = one.recognise(seen)
    told = {"task_id": asked["task_id"], "grasp": asked["grasps"][0], "name": "tea box"}
    stored = one.insert(seen, outcome=bench.held(), **told)["objects"][0]
    kb.update(
        f"INSERT DATA {{ <urn:plan/1> a <{RT.TaskPlan.value}> }}", access=Access("nao-1", "robot")
    )
    kb.update(f"INSERT DATA {{ <urn:cup> a {RT.Exemplar} . <urn:spot> a {RT.SupportSurface} }}")
    held = {"hand": f"{own}/right_hand", "thing": str(stored["thing"])}
    one.call("state_place", thing=held["thing"], place=held["hand"])
    (attempt,) = {quad.subject.value for quad in kb.match(None, RT.hasOutcome)}
    theirs = {
        **held, "name": "nao-1", "robot": own, "task": str(asked["task_id"]), "attempt": attempt,
        "refusal": str(refused["decision"]["refusal"]), "frame": "nao-1/base_footprint",
        "body": f"{own}/frame/base_footprint", "plan": "urn:plan/1",
        "graph": kb.graphs.agent("nao-1").value,
    }  # fmt: skip
    shared = {"object": str(stored["object"]), "grasp": str(stored["grasp"]), "cup": "urn:cup",
              "spot": "urn:spot"}  # fmt: skip
    return theirs, shared


def test_every_operation_that_writes_is_called():
    writing = {name for name, one in OPERATIONS.items() if one.effect != "reads"}
    assert writing == {*CALLS, *TAUGHT}
    assert {OPERATIONS[name].scope for name in TAUGHT} == {"teach"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "kinds",
    [
        ("hand",),
        pytest.param(
            (
                "name",
                "robot",
                "hand",
                "task",
                "body",
                "attempt",
                "refusal",
                "frame",
                "plan",
                "graph",
                "thing",
            ),
            marks=pytest.mark.deep,
        ),
    ],
)
def test_no_field_reaches_what_is_another_robots(engine, bench, robots, kinds):
    theirs, shared = owned(bench, robots)
    kb, stranger = engine.kb, Access("nao-2", "robot")
    nodes = {theirs[kind] for kind in ("robot", "task", "attempt", "refusal", "body", "plan")}

    def of_theirs() -> set[Any]:
        """Return what nao-1 stated, and what anybody states of its own, or of it and its parts.

        That a thing lies on a robot, such as one with a tray, everybody may see and say.
        """
        return {
            quad
            for quad in kb.match()
            if quad.graph_name == kb.graphs.agent("nao-1")
            or quad.subject.value in nodes
            or (
                isinstance(quad.object, NamedNode)
                and f"{quad.object.value}/".startswith(f"{theirs['robot']}/")
                and (quad.predicate, quad.object.value) != (RT.placedOn, theirs["robot"])
            )
            or quad.subject.value.startswith(f"{theirs['robot']}/")
        }

    before = of_theirs()
    for operation, request in CALLS.items():
        if operation in WITH_PICTURES and len(kinds) == 1:
            continue  # a tenth of a second each
        model, given = OPERATIONS[operation].request, filled(request, shared)
        if operation in OF_A_PLAN:
            with pytest.raises(RtaskError, match=OF_A_PLAN[operation]):
                engine.call(operation, given, stranger)
        else:
            engine.call(operation, given, stranger)
        assert of_theirs() == before
        for path in fields(model):
            for kind in kinds:
                asked = with_name(model, given, path, theirs[kind])
                seq = kb.seq
                try:
                    engine.call(operation, asked, stranger)
                except RtaskError:
                    assert kb.seq == seq, f"{operation} {'.'.join(path)}: refused, and stored"
                changed = of_theirs() ^ before if kb.seq != seq else ()
                assert not changed, f"{operation} {'.'.join(path)} = {theirs[kind]}: {changed}"
