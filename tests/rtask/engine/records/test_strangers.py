"""The token says who acts, and one task has one outcome."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from pydantic import BaseModel

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from rtask.engine import Engine
from rtask.engine.decision_log import DecisionLog
from rtask.engine.operations.outcome import ReportOutcome
from rtask.engine.operations.table import OPERATIONS
from rtask.errors import ConflictError, ForbiddenError, UsageError
from rtask.kb.commit.access import Access, unnamed_person
from rtask.rdf.namespaces import RT
from rtask.services.offered import open_host
from rtask.wire.fields import kind_of
from tests.rtask.engine.conftest import Robot, registration

NAMES_SOMEBODY = re.compile(
    r"(^|_)(robot|gripper|hand|task|attempt|frame|refusal|contributor|operator|agent|by|place)(s|_id|$)"
)
TRIED = {
    "gripper_id": "test_a_robot_cannot_name_the_hand_of_another",
    "task_id": "test_a_robot_cannot_report_on_the_task_of_another",
    "operator": "test_nobody_confirms_for_somebody_else_whether_or_not_they_ever_wrote",
    "refusal": "test_a_robot_cannot_answer_the_refusal_of_another",
    "robot": "test_a_robot_cannot_work_or_state_places_for_another",
    "frame": "test_a_robot_cannot_move_a_frame_of_another",
    "agent": "test_a_robot_cannot_work_or_state_places_for_another",
    "place": "test_a_robot_cannot_say_what_the_hand_of_another_holds",
}
NOBODY = {
    "task": "a purpose: pick, place",
    "frame_id": "a name within the robot's own frames",
    "frames": "names within the robot's own frames",
    "places": "where the robot that registers works, by names within it",
    "confirmed_by": "a kind of judge",
    "attempt_number": "a count",
    "max_places": "a count",
    "contributor": "of reading, and of the right to withdraw, which no robot has",
}


def hand(engine, robot: str) -> str:
    return next(one.iri.value for one in engine.grippers.all() if one.robot_name == robot)


@pytest.mark.parametrize("is_registered", [True, False])
@pytest.mark.parametrize("by_name", [True, False])
def test_a_robot_cannot_name_the_hand_of_another(engine, bench, robots, is_registered, by_name):
    robots("nao-1")
    stranger = Robot("nao-2", engine)
    if is_registered:
        stranger.gripper = "left_hand"
        stranger.register()
    named = "right_hand" if by_name else hand(engine, "nao-1")
    missed = {"success": False, "reason": "missed"}
    asked = {
        "report_outcome": {"object": "urn:x", **missed},
        "recognise_for_grasp": bench.sight(bench.BOX),
        "insert_object": {"objects": [{**bench.sight(bench.BOX), "gripper_id": named}]},
    }
    for operation, args in asked.items():
        given = args if "objects" in args else {**args, "gripper_id": named}
        with pytest.raises(ForbiddenError) as caught:
            stranger.call(operation, **given)
        assert hand(engine, "nao-1") in str(caught.value), "the refusal names the hand in full"
    assert "gripper_id" in ReportOutcome.model_fields


def fields(model: type[BaseModel]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield name
        part = kind_of(field).message
        if part is not None:
            yield from fields(part)


def test_every_field_that_names_somebody_is_tried_with_the_token_of_a_stranger():
    declared = {name for one in OPERATIONS.values() for name in fields(one.request)}
    naming = {name for name in declared if NAMES_SOMEBODY.search(name)}
    assert naming - set(NOBODY) == set(TRIED)
    assert set(TRIED.values()) <= set(globals())


def test_no_service_takes_the_name_of_somebody():
    with open_host() as host:
        naming = {
            (service.name, field)
            for service in host.registry
            for method in service.methods.values()
            for field in fields(method.request)
            if NAMES_SOMEBODY.search(field)
        }
    # A description of a hand by its sizes; the operations of rtask/Engine are tried above.
    assert naming == {("rtask/SpacePlans", "gripper")}


def test_a_robot_cannot_report_on_the_task_of_another(engine, bench, robots, monkeypatch):
    asking, stranger = robots("nao-1"), robots("nao-2")
    seen = bench.sight(bench.BOX)
    asked = asking.recognise(seen)
    told = {"task_id": asked["task_id"], "grasp": asked["grasps"][0], "name": "tea box"}
    with pytest.raises(ForbiddenError, match=r"objects\[0\]\.task_id: .*is a task of nao-1"):
        stranger.insert(seen, outcome=bench.missed(), **told)
    monkeypatch.setattr(engine.context, "decisions", DecisionLog())  # as after a restart
    with pytest.raises(ForbiddenError, match=r"objects\[0\]\.task_id: .*given to another robot"):
        stranger.insert(seen, outcome=bench.missed(), **told)
    stored = asking.insert(seen, outcome=bench.held(), **told)
    report = {"object": str(stored["objects"][0]["object"]), "gripper_id": "right_hand"}
    with pytest.raises(ForbiddenError, match=r"task_id: .*is a task of nao-1"):
        stranger.call(
            "report_outcome", task_id=asked["task_id"], grasp=asked["grasps"][0], success=False,
            **report,
        )  # fmt: skip


def test_a_robot_cannot_say_what_is_in_the_hand_of_another(engine, bench, robots):
    one, stranger = robots("nao-1"), robots("nao-2")
    seen = bench.sight(bench.BOX)
    stored = one.insert(seen, name="tea box")
    thing = stored["objects"][0]["thing"]
    place = hand(engine, "nao-1")
    with pytest.raises(ForbiddenError, match=r"place: .*a hand of another robot"):
        stranger.call("state_place", thing=thing, place=place)
    assert one.call("state_place", thing=thing, place=place)["commit"]
    assert stranger.call("state_place", thing=thing, place=hand(engine, "nao-2"))["commit"]


def test_a_frame_is_one_of_the_robot_itself_whatever_its_name(engine, bench, robots):
    robots("nao-1").insert(bench.sight(bench.BOX), name="tea box")
    (frame,) = {
        quad.subject.value for quad in engine.kb.match(None, RT.frameId)
        if quad.object.value == "base_footprint"
    }  # fmt: skip
    stranger = robots("nao-2")
    stranger.insert({**bench.sight(bench.CAN), "frame_id": frame}, name="can")
    made = {q.subject.value for q in engine.kb.match(None, RT.frameId) if q.object.value == frame}
    own = engine.kb.graphs.agent_iri("nao-2").value
    assert made
    assert all(name.startswith(f"{own}/frame/") for name in made)


@pytest.mark.parametrize("role", ["robot", "teacher"])
@pytest.mark.parametrize("named", ["anna", "nao-2", "operator"])
def test_nobody_confirms_for_somebody_else_whether_or_not_they_ever_wrote(
    engine, bench, robots, role, named
):
    robots("nao-1"), robots("nao-2")
    caller = Access("nao-1", role)
    seen = bench.sight(bench.BOX)
    told = {**bench.held(), "confirmed_by": "human"}
    at = {"X": 0.1, "Y": 0.0, "Z": 0.1, "rad": 0.0}
    new = {**seen, **at, "gripper_id": hand(engine, "nao-1")}
    flat = {"object": "urn:x", "gripper_id": new["gripper_id"], "grasp": "urn:g"}
    calls = (
        ("insert_object", {"objects": [{**new, "operator": named}]}),
        ("insert_object", {"objects": [{**seen, "operator": named}]}),
        ("insert_object", {"objects": [{**new, "outcome": {**told, "operator": named}}]}),
        ("report_outcome", {**flat, "success": True, "operator": named}),
        ("report_outcome", {**flat, "outcome": {**told, "operator": named}}),
    )
    before = engine.kb.seq
    for operation, args in calls:
        with pytest.raises(ForbiddenError, match="the token belongs to 'nao-1'") as caught:
            engine.call(operation, args, caller)
        if role == "robot":
            assert caught.value.details["field"].endswith("operator")
            assert repr(named) in str(caught.value)
    assert engine.kb.seq == before


def test_who_confirms_through_a_robot_unnamed_has_a_name_that_no_token_can_have(
    engine, bench, robots
):
    robot = robots("nao-1")
    seen = bench.sight(bench.BOX)
    for named in ({}, {"operator": "nao-1"}):
        outcome = {**bench.held(), "confirmed_by": "human", **named}
        given = {"grasp": robot.recognise(seen)["grasps"][0], "name": "tea box"}
        robot.insert(seen, outcome=outcome, **given)
    names = {
        row["name"]
        for row in engine.kb.select(f"""PREFIX rt: <{ontology.PREFIXES["rt"]}>
PREFIX prov: <http://www.w3.org/ns/prov#>
SELECT ?name {{ ?said a rt:HumanFeedback ; prov:wasAttributedTo/rt:name ?name }}""").to_dicts()
    }
    assert names == {unnamed_person("nao-1")}
    with pytest.raises(UsageError, match="not a valid name"):
        TokenStore(None).create("teacher", agent=unnamed_person("nao-1"))


@pytest.mark.parametrize(
    ("operation", "args"),
    [
        ("give_feedback", {"verdict": "confirm", "task_id": "urn:t"}),
        ("teach_object", {"operation": "confirm", "grasp": "urn:g"}),
        ("curate_object", {"operation": "forget", "object": "urn:x"}),
        ("withdraw_contributor", {"contributor": "nao-1"}),
        ("answer_question", {"question": "urn:q", "choice": 1}),
        ("cancel_plan", {"plan": "urn:p", "reason": "late"}),
    ],
)
def test_a_person_cannot_act_for_another(engine, operation, args):
    with pytest.raises(ForbiddenError, match="operator: the token belongs to 'ben': it cannot act"):
        engine.call(operation, {**args, "operator": "anna"}, Access("ben", "teacher"))


@pytest.mark.parametrize(
    ("operation", "args"),
    [
        ("state_place", {"agent": "nao-1", "thing": "urn:x", "lost": True}),
        ("report_sightings", {"agent": "nao-1", "frame": "table"}),
        ("state_frame", {"agent": "nao-1", "frame": "table", "lost": True}),
        ("store_plan", {"agent": "anna", "goal": "every pen into the left box"}),
        ("claim_step", {"robot": "nao-1"}),
        ("register_robot", registration("nao-1", "right_hand")),
        ("register_robot", registration("ben", "right_hand")),
    ],
)
def test_a_person_cannot_act_for_a_robot(engine, robots, operation, args):
    robots("nao-1")
    with pytest.raises(ForbiddenError, match="'ben'"):
        engine.call(operation, args, Access("ben", "teacher"))


def test_a_person_cannot_report_what_the_hand_of_a_robot_did_but_may_ask_what_it_can(
    engine, bench, robots
):
    robots("nao-1")
    seen = bench.sight(bench.BOX)
    own = hand(engine, "nao-1")
    ben = Access("ben", "teacher")
    with pytest.raises(ForbiddenError, match=f"the token belongs to 'ben', and .*{own}"):
        engine.call("insert_object", {"objects": [{**seen, "gripper_id": own}]}, ben)
    report = {"object": "urn:x", "grasp": "urn:g", "success": False, "gripper_id": own}
    with pytest.raises(ForbiddenError, match=f"the token belongs to 'ben', and .*{own}"):
        engine.call("report_outcome", report, ben)
    asked = {**seen, "gripper_id": own, "propose": True}
    assert engine.call("recognise_for_grasp", asked, ben).as_json()["grasps"]


def test_a_robot_cannot_answer_the_refusal_of_another(bench, robots):
    refused = robots("nao-1").recognise(bench.sight(bench.BOX), decide=True, min_grasp=1.0)
    answer = {"refusal": refused["decision"]["refusal"], "response": "left_alone"}
    with pytest.raises(ForbiddenError, match="is that of another robot"):
        robots("nao-2").call("report_refusal", **answer)


@pytest.mark.parametrize(
    "predicate",
    [
        "rt:performedBy", "rt:activates", "rt:acquiredBy", "rt:knownBy",
        "rt:calibratesHand", "rt:refusedWith", "rt:graphOwner", "sosa:madeBySensor",
        "prov:wasAssociatedWith", "prov:wasAttributedTo", "prov:agent", "prov:actedOnBehalfOf",
    ],
)  # fmt: skip
def test_an_update_cannot_say_that_another_robot_did_it(engine, robots, predicate):
    robots("nao-1"), robots("nao-2")
    kb = engine.kb
    own, other = kb.graphs.agent_iri("nao-2"), kb.graphs.agent_iri("nao-1")
    for named, is_refused in ((own, False), (other, True), (f"<{other.value}/right_hand>", True)):
        text = f"""PREFIX rt: <{ontology.PREFIXES["rt"]}> PREFIX prov: <http://www.w3.org/ns/prov#>
PREFIX sosa: <{ontology.PREFIXES["sosa"]}>
INSERT DATA {{ <urn:what> {predicate} {named} }}"""
        if is_refused:
            with pytest.raises(ForbiddenError, match=r"belongs to 'nao-2'.*which is 'nao-1'"):
                kb.update(text, access=Access("nao-2", "robot"))
        else:
            kb.update(text, access=Access("nao-2", "robot"))


DESCRIBING = (
    "<{outcome}> rt:disputed true",
    "<{outcome}> a rt:GraspOutcome ; rt:disputed true",
    "<{outcome}> rt:judgedSuccess false",
    "<{outcome}> rt:success false",
    "<{outcome}> rt:hasFeedback <urn:f>",
    '<{feedback}> rt:preset "fast"',
    "<{feedback}> rt:verdict false",
    "<{attempt}> rt:hasOutcome <urn:o>",
    "<urn:o> rt:outcomeOf <{attempt}>",
    '<{attempt}> prov:endedAtTime "2030-01-01T00:00:00Z"^^xsd:dateTime',
    '<{robot}> rt:name "liar"',
    '<{robot}/right_hand> rt:gripperType "cup"',
    "<{robot}> rt:reaches <urn:table>",
    "<urn:table> rt:beyondReachOf <{robot}/right_hand>",
    "<{own}> rt:meets <{robot}>",
    "<{robot}> rt:meets <{own}>",
    "<{robot}> rt:canGrasp <urn:x>",
    "<{robot}> rt:hasCapability rt:pushing",
    "<{robot}/right_hand> rt:providesCapability rt:pushing",
    "<{robot}> rt:hasEndEffector <{own}/right_hand>",
    "<urn:hand> rt:endEffectorOf <{robot}>",
    "<{robot}/right_hand> a rt:OutOfOrder",
    "<urn:p> a rt:Placement ; rt:placementOf <{robot}/frame/base_footprint>",
    "<urn:t> rt:targetSurface <urn:table> ; rt:carriedOutBy <{attempt}>",
    "<urn:t> rt:handles <urn:x> ; rt:through <{attempt}>",
)
TERMS = {name: ontology.PREFIXES[name] for name in ("rt", "prov", "xsd")}


def test_no_graph_of_a_robot_changes_what_another_is_did_and_reported(engine, bench, robots):
    one, kb = robots("nao-1"), engine.kb
    stranger = Access(robots("nao-2").name, "robot")
    seen = bench.sight(bench.BOX)
    grasp = one.recognise(seen)["grasps"][0]
    one.insert(seen, outcome=bench.held(), grasp=grasp, name="tea box")
    (outcome,) = (quad.subject.value for quad in kb.match(None, RT.success))
    (attempt,) = {quad.subject.value for quad in kb.match(None, RT.hasOutcome)}
    feedback = next(quad.object.value for quad in kb.match(None, RT.hasFeedback))
    own = {"outcome": outcome, "attempt": attempt, "feedback": feedback,
           "robot": kb.graphs.agent_iri("nao-1").value,
           "own": kb.graphs.agent_iri("nao-2").value}  # fmt: skip
    before = kb.seq
    for described in DESCRIBING:
        statement = described.format(**own)
        sparql = "".join(f"PREFIX {name}: <{iri}> " for name, iri in TERMS.items())
        turtle = "".join(f"@prefix {name}: <{iri}> . " for name, iri in TERMS.items())
        refusal = r"belongs to 'nao-2'.*which is that of 'nao-1'"
        with pytest.raises(ForbiddenError, match=refusal):
            kb.update(f"{sparql} INSERT DATA {{ {statement} }}", access=stranger)
        data = f"{turtle} {statement} .".encode()
        with pytest.raises(ForbiddenError, match=refusal):
            kb.load(data, format="turtle", graph=kb.graphs.agent("nao-2"), access=stranger)
    assert kb.seq == before
    mine = (
        f"{sparql} INSERT DATA {{ <urn:o> a rt:GraspOutcome ; rt:success true ; rt:placed true }}"
    )
    assert kb.update(mine, access=stranger).added == 3


def test_it_does_not_follow_from_what_a_robot_states_that_another_is_out_of_order():
    prefixes = f"PREFIX rt: <{TERMS['rt']}> PREFIX rdfs: <{ontology.PREFIXES['rdfs']}>"
    with rtask.open(":memory:", base="https://example.org/kb/") as kb, Engine(kb) as engine:
        for name in ("nao-1", "nao-2"):
            Robot(name, engine).register()
        own = kb.graphs.agent_iri("nao-2").value
        stranger = Access("nao-2", "robot")
        kb.update(
            f"{prefixes} INSERT DATA {{ <{own}/broken> rdfs:domain rt:OutOfOrder }}",
            access=stranger,
        )
        for taken, is_refused in ((hand(engine, "nao-1"), True), (hand(engine, "nao-2"), False)):
            text = f"INSERT DATA {{ <{taken}> <{own}/broken> 1 }}"
            if is_refused:
                with pytest.raises(ForbiddenError, match="'nao-1', is out of order"):
                    kb.update(text, access=stranger)
            else:
                kb.update(text, access=stranger)
            asked = f"ASK {{ <{taken}> a <{RT.OutOfOrder.value}> }}"
            assert kb.query(asked) is not is_refused


def test_another_body_under_a_name_is_a_conflict_unless_it_takes_the_place(engine, robots):
    robot = robots("nao-1")
    hand_ = {"name": "right_hand", "gripper_type": "two_finger", "max_opening": 0.08,
             "max_payload": 0.5}  # fmt: skip
    other = {"name": "nao-1", "model": "panda", "end_effectors": [hand_]}
    with pytest.raises(ConflictError, match="hasRobotModel") as caught:
        robot.call("register_robot", **other)
    assert "register it with replace" in str(caught.value)
    robot.call("register_robot", replace=True, **other)
    assert robot.call("register_robot", **other)["commit"] == ""


def test_a_name_that_two_robots_use_is_the_callers_own(engine, robots):
    robots("nao-1"), robots("nao-2")
    for name in ("nao-1", "nao-2"):
        found = engine.grippers.find("right_hand", Robot(name, engine).access)
        assert found.robot_name == name


def test_a_second_outcome_of_a_task_that_disagrees_is_a_conflict(bench, robots):
    robot = robots("nao-1")
    seen = bench.sight(bench.BOX)
    asked = robot.recognise(seen)
    told = {"task_id": asked["task_id"], "grasp": asked["grasps"][0]}
    robot.insert(seen, outcome=bench.held(), name="tea box", **told)
    repeated = robot.insert(seen, outcome=bench.held(), name="tea box", **told)
    with pytest.raises(ConflictError, match="stored as succeeded, and this report says that it"):
        robot.insert(seen, outcome=bench.missed(), name="tea box", **told)
    thing = str(repeated["objects"][0]["object"])
    common = {"object": thing, "gripper_id": "right_hand", **told}
    assert robot.call("report_outcome", outcome=bench.held(), **common)["stored"] == 0
    with pytest.raises(ConflictError, match="failed"):
        robot.call("report_outcome", outcome=bench.missed(), **common)


@pytest.mark.parametrize(
    ("operation", "args"),
    [
        ("claim_step", {"robot": "nao-1"}),
        ("end_step", {"robot": "nao-1", "task": "urn:t", "result": "done"}),
        ("state_place", {"agent": "nao-1", "thing": "urn:x", "lost": True}),
        ("state_reach", {"robot": "nao-1", "place": "table"}),
        ("state_reach", {"agent": "nao-1", "place": "table"}),
        ("report_sightings", {"agent": "nao-1", "frame": "table"}),
        ("state_frame", {"agent": "nao-1", "frame": "table", "lost": True}),
        ("store_plan", {"agent": "nao-1", "goal": "every pen into the left box"}),
        ("cancel_plan", {"operator": "nao-1", "plan": "urn:p", "reason": "late"}),
    ],
)
def test_a_robot_cannot_work_or_state_places_for_another(robots, operation, args):
    robots("nao-1")
    stranger = robots("nao-2")
    with pytest.raises(ForbiddenError, match="the token belongs to 'nao-2': it cannot act for"):
        stranger.call(operation, **args)


def test_a_robot_cannot_move_a_frame_of_another(robots):
    robots("nao-1")
    stranger = robots("nao-2")
    with pytest.raises(ForbiddenError, match="on another robot's body than that of 'nao-2'"):
        stranger.call("state_frame", frame="nao-1/base_footprint", lost=True)
    assert stranger.call("locate_frame", frame="nao-1/base_footprint")["known"], "it may ask"


def test_a_robot_cannot_declare_a_frame_on_the_body_of_another(engine, robots):
    robots("nao-1")
    stranger, before = robots("nao-2"), engine.kb.seq
    body = engine.kb.graphs.agent_iri("nao-1").value
    for frame in ("nao-1/camera_9", f"{body}/frame/camera_9"):
        with pytest.raises(ForbiddenError, match="on another robot's body than that of 'nao-2'"):
            stranger.call("report_sightings", frame=frame)
    assert engine.kb.seq == before


def test_a_robot_cannot_say_what_the_hand_of_another_holds(engine, robots):
    robots("nao-1")
    stranger, taken = robots("nao-2"), hand(engine, "nao-1")
    engine.kb.update(f"INSERT DATA {{ <urn:cup> a {RT.Exemplar} }}")
    for operation, args in (
        ("state_place", {"thing": "urn:cup"}),
        ("end_step", {"task": "urn:step", "result": "done"}),
    ):
        with pytest.raises(ForbiddenError, match=f"{taken} is a hand of another robot"):
            stranger.call(operation, place=taken, **args)


def test_a_robot_cannot_say_that_what_another_holds_is_gone_but_may_take_it(engine, robots):
    owner, stranger = robots("nao-1"), robots("nao-2")
    engine.kb.update(f"INSERT DATA {{ <urn:cup> a {RT.Exemplar} }}")
    owner.call("state_place", thing="urn:cup", place=hand(engine, "nao-1"))
    for operation, args in (
        ("state_place", {"thing": "urn:cup", "lost": True}),
        ("report_sightings", {"frame": "base_footprint", "gone": ["urn:cup"]}),
    ):
        with pytest.raises(ForbiddenError, match="is in right_hand of nao-1"):
            stranger.call(operation, **args)
    stranger.call("state_place", thing="urn:cup", place=hand(engine, "nao-2"))
    stranger.call("state_place", thing="urn:cup", lost=True)
