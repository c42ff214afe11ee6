"""A decision by thresholds: a grasp, or which confidence was too low, with what would help."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from types import SimpleNamespace

import pytest

import ontology
from features.recognition import Recogniser, Recognition
from rtask.engine import Engine, Policy
from rtask.engine.memory.thresholds import Assessment, Thresholds, decide
from rtask.engine.records import refusals
from rtask.errors import ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RDF, RT

pytestmark = pytest.mark.slow


def fill_store(bench, robots):
    """Let a robot hold a box and see a can."""
    robot = robots()
    seen = bench.sight(bench.BOX)
    answer = robot.recognise(seen)
    robot.insert(seen, grasp=answer["grasps"][0], outcome=bench.held(), name="tea box")
    robot.insert(bench.sight(bench.CAN), name="soup")


@pytest.fixture
def known(bench, engine, filled):
    """A robot that has held a box and seen a can, and what it saw of the box."""
    return bench.Robot("nao-1", engine), bench.sight(bench.BOX)


def test_who_does_not_ask_gets_the_same_answer_as_before(known):
    robot, seen = known
    plain = robot.recognise(seen)
    asked = robot.recognise(seen, decide=True, min_grasp=0.0)
    assert plain["decision"] is None
    assert [g["id"] for g in plain["grasps"]] == [g["id"] for g in asked["grasps"]]
    assert plain["task_response"] == asked["task_response"] == "grasp"


def test_a_sure_look_is_answered_with_a_grasp_and_all_three_numbers(known):
    robot, seen = known
    decision = robot.recognise(seen, decide=True)["decision"]
    assert decision["answer"] == "grasp"
    assert decision["too_low"] == ""
    assert decision["thresholds"] == {"identity": 0.7, "pose": 0.7, "grasp": 0.3}
    assert min(decision["confidences"].values()) > 0.7


@pytest.mark.parametrize(
    ("name", "request_field", "response"),
    [("identity", "min_identity", "unknown"), ("pose", "min_pose", "no_grasp"),
     ("grasp", "min_grasp", "no_grasp")],
)  # fmt: skip
def test_the_first_confidence_that_is_too_low_ends_the_decision(
    known, name, request_field, response
):
    robot, seen = known
    answer = robot.recognise(seen, **{request_field: 1.0})
    decision = answer["decision"]
    assert decision["too_low"] == name
    assert decision["threshold"] == 1.0
    assert decision["confidence"] == decision["confidences"][name] < 1.0
    assert f"{name}: {int(100 * decision['confidence']) / 100:.2f} is below" in decision["text"]
    assert decision["advice"]
    assert answer["task_response"] == response
    assert answer["grasps"] == []
    assert (answer["object"] == "") == (name == "identity")
    if name != "pose":  # a box with a picture on each side fits in one way only
        best = decision["alternatives"][0]
        assert best["confidence"] == pytest.approx(decision["confidence"])


def test_identity_comes_before_pose_and_grasp(known):
    robot, seen = known
    answer = robot.recognise(seen, min_identity=1.0, min_pose=1.0, min_grasp=1.0)
    assert answer["decision"]["too_low"] == "identity"
    assert answer["recognition"]["matches"][0]["label"] == "tea box"


def test_grasps_below_the_threshold_are_not_offered(known):
    robot, seen = known
    every = robot.recognise(seen)["grasps"]
    between = sorted(g["mean"] for g in every)[len(every) // 2]
    left = robot.recognise(seen, min_grasp=between)["grasps"]
    assert left
    assert len(left) < len(every)
    assert min(g["mean"] for g in left) >= between


def test_failures_bring_the_confidence_of_a_grasp_below_its_threshold(bench, known):
    robot, seen = known
    first = robot.recognise(seen, propose=False, min_grasp=0.5)
    assert first["decision"]["answer"] == "grasp"
    for k in range(8):
        robot.call(
            "report_outcome", task_id=f"urn:again:{k}", object=first["object"],
            grasp=first["grasps"][0]["id"], gripper_id="right_hand", outcome=bench.missed(),
        )  # fmt: skip
    now = robot.recognise(seen, propose=False, min_grasp=0.5)
    assert now["decision"]["too_low"] == "grasp"
    assert now["decision"]["alternatives"][0]["attempts"] == 9
    assert "propose" in now["decision"]["advice"]


def test_a_cautious_task_compares_the_lower_end_of_the_interval(known):
    robot, seen = known
    best = max(robot.recognise(seen)["grasps"], key=lambda g: g["interval90"][0])
    between = (best["mean"] + best["interval90"][0]) / 2
    bold = robot.recognise(seen, min_grasp=between)
    careful = robot.recognise(seen, min_grasp=between, cautious=True)
    assert bold["decision"]["answer"] == "grasp"
    assert careful["decision"]["too_low"] == "grasp"
    assert careful["decision"]["confidence"] == pytest.approx(best["interval90"][0])
    assert careful["grasps"] == []


def test_an_object_that_nobody_knows_cannot_be_identified(bench, known):
    robot, _ = known
    answer = robot.recognise(bench.sight(bench.PEN), decide=True)
    assert answer["decision"]["too_low"] == "identity"
    assert answer["decision"]["confidence"] < 0.7


def test_a_server_may_ask_for_more(bench, kb, filled):
    seen = bench.sight(bench.BOX)
    with Engine(kb, policy=Policy(min_grasp=0.99)) as strict:
        request = {"gripper_id": "right_hand", **seen}
        asked = strict.call("recognise_for_grasp", {**request, "decide": True})
        lenient = strict.call("recognise_for_grasp", {**request, "min_grasp": 0.5})
    assert asked["decision"]["too_low"] == "grasp"
    assert lenient["decision"]["answer"] == "grasp"


def test_a_threshold_outside_of_its_range_is_refused(known):
    robot, seen = known
    with pytest.raises(UsageError, match=r"min_pose: 1\.2 is above 1"):
        robot.recognise(seen, min_pose=1.2)


def test_a_pose_that_is_asked_for_and_that_nothing_tells_is_too_low():
    nothing = SimpleNamespace(matches=(), accepted=True)
    known = SimpleNamespace(iri="urn:box")
    case = Assessment(nothing, SimpleNamespace(objects={}), known, None, ())
    asked_for = decide(Thresholds(0.7, 0.7, 0.3, needs_pose=True), case, 0.9)
    assert (asked_for["too_low"], asked_for["confidence"]) == ("pose", 0.0)
    assert asked_for["confidences"]["pose"] is None
    assert "nothing stored tells it" in asked_for["text"]
    assert "views" in asked_for["advice"]
    by_default = decide(Thresholds(0.7, 0.7, 0.3), case, 0.9)
    assert by_default["too_low"] == "grasp"


def test_a_plate_that_lies_flat_is_to_be_slid_to_the_edge():
    known = SimpleNamespace(iri="urn:tray")
    nothing = SimpleNamespace(matches=(), accepted=True)
    case = Assessment(nothing, SimpleNamespace(objects={}), known, None, (), lies_flat=True)
    decision = decide(Thresholds(0.7, 0.7, 0.3), case, 0.9)
    assert decision["too_low"] == "grasp"
    assert "slide it to the edge" in decision["advice"]


@pytest.mark.parametrize(
    ("field", "lacking"), [("min_identity", "identity"), ("min_pose", "pose"),
                           ("min_grasp", "grasp")],
)  # fmt: skip
def test_why_a_robot_did_not_grasp_is_a_query(kb, known, field, lacking):
    robot, seen = known
    answer = robot.recognise(seen, **{field: 1.0})
    rows = kb.query("""
        PREFIX rt: <https://w3id.org/rtask-kg/ns#> PREFIX prov: <http://www.w3.org/ns/prov#>
        SELECT ?refusal ?robot ?object ?lacking ?found ?required ?graph {
          GRAPH ?graph { ?refusal a rt:GraspRefusal ; prov:wasAssociatedWith ?robot ;
            rt:refusedObject ?object ; rt:lackingConfidence ?lacking ;
            rt:foundConfidence ?found ; rt:requiredConfidence ?required } }""")
    (row,) = [row.to_dict() for row in rows]
    decision = answer["decision"]
    assert row["refusal"] == decision["refusal"] != ""
    assert (row["lacking"], row["required"]) == (lacking, 1.0)
    assert row["found"] == pytest.approx(decision["confidence"], abs=1e-6)
    assert "/graph/agent/" in str(row["graph"])


def test_a_grasp_and_a_mere_reader_store_no_refusal(bench, kb, filled):
    seen = bench.sight(bench.BOX)
    before = kb.match(None, RDF.type, RT.GraspRefusal)
    with Engine(kb) as engine:
        request = {"gripper_id": "right_hand", **seen}
        granted = engine.call("recognise_for_grasp", {**request, "min_grasp": 0.1})
        refused = engine.call(
            "recognise_for_grasp", {**request, "min_grasp": 1.0}, access=Access(None, "reader")
        )
    assert granted["decision"]["refusal"] == refused["decision"]["refusal"] == ""
    assert refused["decision"]["too_low"] == "grasp"
    assert kb.match(None, RDF.type, RT.GraspRefusal) == before


def test_a_question_repeated_before_a_response_is_one_refusal(kb, known):
    robot, seen = known
    first, again = (robot.recognise(seen, min_grasp=1.0) for _ in range(2))
    refusal = first["decision"]["refusal"]
    assert again["decision"]["refusal"] == refusal != ""
    assert len(kb.match(None, RDF.type, RT.GraspRefusal)) == 1
    (task,) = kb.match(refusal, RT.requestId)
    assert task.object.value == again["task_id"] != first["task_id"]
    (_,) = kb.match(refusal, RT.atTime)
    other_values = robot.recognise(seen, min_grasp=0.99)["decision"]["refusal"]
    assert other_values != refusal


def test_an_object_that_was_put_off_and_left_alone_has_one_refusal(kb, known):
    robot, seen = known

    def ask():
        return robot.recognise(seen, min_grasp=1.0)["decision"]["refusal"]

    refusal = ask()
    robot.call("report_refusal", refusal=refusal, response="postponed")
    assert ask() == refusal
    assert robot.call("report_refusal", refusal=refusal, response="left_alone")["stored"] == 1
    (told,) = kb.match(refusal, RT.refusalResponse)
    assert told.object.value == "left_alone"
    assert ask() != refusal  # it has come back to what it had left


def test_the_same_question_long_afterwards_is_a_refusal_of_its_own(kb, known, monkeypatch):
    robot, seen = known
    monkeypatch.setattr(refusals, "_REPEATED_WITHIN", dt.timedelta(0))
    first, again = (robot.recognise(seen, min_grasp=1.0)["decision"]["refusal"] for _ in range(2))
    assert first != again


def test_each_refusal_of_what_resembles_nothing_known_is_its_own(kb, bench, robots):
    robot = robots("nao-1")
    pen = bench.sight(bench.PEN)
    found = {robot.recognise(pen, decide=True)["decision"]["refusal"] for _ in range(2)}
    assert len(found) == len(kb.match(None, RDF.type, RT.GraspRefusal)) == 2


def test_an_object_that_resembles_nothing_known_may_be_grasped_as_a_new_one(bench, known):
    robot, _ = known
    answer = robot.recognise(bench.sight(bench.PEN), decide=True, unknown="if_new", propose=True)
    assert answer["decision"]["answer"] == "grasp"
    assert "new object" in answer["decision"]["text"]
    assert answer["grasps"]
    assert answer["object"] == ""
    nothing = robot.recognise(bench.sight(bench.PEN), unknown="if_new", propose=True, min_grasp=1.0)
    assert nothing["decision"]["too_low"] == "grasp"


def test_what_another_view_may_recognise_is_grasped_only_by_a_task_that_takes_anything():
    doubtful = SimpleNamespace(matches=(), accepted=False, ask_again=True)
    option = SimpleNamespace(choice=SimpleNamespace(mean=0.9, interval90=(0.7, 1.0)))
    case = Assessment(doubtful, SimpleNamespace(objects={}), None, None, (option,))
    told = {
        unknown: decide(Thresholds(0.7, 0.7, 0.3, unknown=unknown), case, 0.6)["too_low"]
        for unknown in ("refuse", "if_new", "grasp")
    }
    assert told == {"refuse": "identity", "if_new": "identity", "grasp": ""}


@pytest.mark.parametrize(("sure", "is_known"), [(0.77, True), (0.65, False)])
def test_two_looks_that_each_suffice_suffice_in_a_decision(known, monkeypatch, sure, is_known):
    robot, seen = known
    recognise = Recogniser.recognise

    def less_sure(self, features, min_confidence=None, max_results=10):
        first = recognise(self, features, 0.0, max_results).matches[0]
        accepted = sure >= (0.7 if min_confidence is None else min_confidence)
        doubted = replace(first, confidence=sure, by_print=False, inliers=20)
        return Recognition("single", accepted, (doubted,))

    monkeypatch.setattr(Recogniser, "recognise", less_sure)
    answer = robot.recognise(seen, looks=[seen], decide=True)
    assert bool(answer["object"]) is is_known
    # A threshold that the request names holds for each look.
    assert not robot.recognise(seen, looks=[seen], min_identity=0.8)["object"]


def test_a_robot_tells_once_what_it_did_after_a_refusal(kb, robots, known):
    robot, seen = known
    refusal = robot.recognise(seen, min_grasp=1.0)["decision"]["refusal"]
    first = robot.call("report_refusal", refusal=refusal, response="postponed")
    again = robot.call("report_refusal", refusal=refusal, response="left_alone")
    assert (first["stored"], again["stored"], again["commit"]) == (1, 0, "")
    (told,) = kb.match(refusal, RT.refusalResponse)
    assert told.object.value == "postponed"
    (file,) = [path for path in ontology.episode_queries() if path.stem == "eq24"]
    (row,) = kb.select(file.read_text("utf-8")).to_dicts()
    told_of = (row["robot"], row["object"], row["lacking"], row["required"], row["then"])
    assert told_of == (robot.name, "tea box", "grasp", 1.0, "postponed")
    (stored,) = kb.match(refusal, RT.refusalReason)
    assert told.graph_name == stored.graph_name
    other = robots("nao-2")
    with pytest.raises(ForbiddenError, match="of another robot"):
        other.call("report_refusal", refusal=refusal, response="left_alone")
    with pytest.raises(UnknownTermError, match="has no refusal"):
        robot.call("report_refusal", refusal="urn:nothing", response="left_alone")
