"""Task trees in the graph: a robot's goal, its attempts, and what it did then."""

from __future__ import annotations

import time

import pytest

import ontology
import rtask
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow

ANN = Access("ann", "teacher")


def grasp(x):
    return {"in_object": {"x": x, "y": 0.0, "z": 0.01, "theta": 1.57}, "quality": 0.6,
            "opening": 0.04}  # fmt: skip


def report(robot, thing, x, outcome, **more):
    return robot.call(
        "report_outcome", object=thing, gripper_id=robot.gripper, grasp=grasp(x), outcome=outcome,
        **more,
    )  # fmt: skip


def answers(engine, number):
    (file,) = [path for path in ontology.episode_queries() if path.stem == f"eq{number:02}"]
    return [row.to_dict() for row in engine.kb.select(file.read_text("utf-8"))]


def wholes(engine):
    return {q.subject for q in engine.kb.match(None, RT.hasSubTask, None)}


@pytest.fixture
def kb():
    """Return a store with a reasoner, so that the shapes hold."""
    with rtask.open(":memory:", base="https://example.org/kb/") as opened:
        yield opened


@pytest.fixture
def pen(bench, robots):
    """Two robots, and a pen that the first has inserted."""
    one, two = robots("nao-1"), robots("nao-2")
    return one, two, one.insert(bench.sight(bench.PEN), name="pen")["objects"][0]["object"]


def test_what_a_robot_tried_and_did_then_is_one_query(bench, engine, pen):
    _, two, thing = pen
    failed = bench.missed(reason="slip_lift", comment="opening .68 -> .02")
    report(two, thing, 0.0, failed)
    report(two, thing, 0.03, bench.missed(attempt_number=2))
    report(two, thing, 0.03, bench.missed(attempt_number=3))
    report(two, thing, -0.03, bench.held(attempt_number=4, place="left box"))
    rows = answers(engine, 23)
    assert [
        (row["robot"], row["object"], int(row["number"]), row["held"], row["reason"], row["then"])
        for row in rows
    ] == [
        ("nao-2", "pen", 1, False, "slip_lift", "tried another grasp"),
        ("nao-2", "pen", 2, False, "missed", "tried the same grasp again"),
        ("nao-2", "pen", 3, False, "missed", "tried another grasp"),
        ("nao-2", "pen", 4, True, "ok", None),
    ]
    assert rows[0]["why"] == "opening .68 -> .02"
    assert [row["place"] for row in rows] == [None, None, None, "left box"]
    assert len(wholes(engine)) == 1
    assert not engine.kb.validate()


def test_each_robot_and_each_episode_has_a_tree_of_its_own(bench, engine, pen):
    one, two, thing = pen
    for robot in (one, two, one):
        report(robot, thing, 0.0, bench.missed())
        report(robot, thing, 0.03, bench.held(attempt_number=2))
    assert len(wholes(engine)) == 3
    assert all(len(engine.kb.match(whole, RT.hasSubTask)) == 3 for whole in wholes(engine))


def test_an_attempt_without_a_number_is_a_tree_by_itself(bench, engine, pen):
    one, _, thing = pen
    for _ in range(2):
        report(one, thing, 0.0, {"success": False, "reason": "missed"})
    assert len(wholes(engine)) == 2


def test_an_object_that_was_put_into_a_box_is_there_until_it_is_seen_elsewhere(bench, engine, pen):
    one, _, thing = pen
    exemplar = report(one, thing, 0.0, bench.held(place="right box", placed=True))["thing"]
    (row,) = answers(engine, 22)
    assert (row["object"], row["place"], row["robot"]) == ("pen", "right box", "nao-1")
    moved = bench.Thing(bench.PEN.size, texture_seed=3, position=(0.2, 0.02))
    one.insert(bench.sight(moved), object=thing, thing=exemplar)
    (row,) = answers(engine, 22)
    assert row["place"] is None
    assert row["frame"] == "base_footprint"
    assert not engine.kb.match(iri(exemplar), RT.locatedOn)
    assert engine.kb.match(iri(exemplar), RT.currentPose)
    assert not engine.kb.validate()


def test_where_an_object_went_is_unknown_if_the_robot_does_not_say(bench, engine, pen):
    one, _, thing = pen
    report(one, thing, 0.0, bench.held(placed=True))
    assert answers(engine, 22) == []
    report(one, thing, 0.0, bench.held(placed=None))
    (row,) = answers(engine, 22)
    assert row["place"] == "right_hand"
    let_go = bench.held(placed=None, place="right box")  # and not seen there
    report(one, thing, 0.0, let_go)
    assert answers(engine, 22) == []


def test_why_a_held_object_did_not_arrive_is_kept(bench, engine, pen):
    one, _, thing = pen
    report(one, thing, 0.0, bench.held(placed=False, reason="drop_outside", place="right box"))
    (said,) = engine.kb.match(None, RT.placeReason)
    assert said.object == RT.reason_drop_outside
    assert not engine.kb.match(None, RT.locatedOn)
    assert not engine.kb.validate()


def test_a_withdrawn_robot_takes_its_tasks_along(bench, engine, pen):
    one, two, thing = pen
    report(one, thing, 0.0, bench.held(place="left box"))
    report(two, thing, 0.0, bench.held(place="left box"))
    engine.call("withdraw_contributor", {"contributor": "nao-2"}, ANN)
    assert [row["robot"] for row in answers(engine, 23)] == ["nao-1"]
    assert [row["robot"] for row in answers(engine, 22)] == ["nao-1"]
    assert not engine.kb.validate()


def test_the_tasks_of_a_part_that_is_split_off_go_with_it(bench, engine, robots):
    robot = robots("nao-1")
    first = robot.insert(bench.sight(bench.PEN), grasp=grasp(0.0), outcome=bench.missed())
    thing = first["objects"][0]["object"]
    other = bench.sight(bench.PEN, bench.Eye(position=(0.1, 0.2, 0.6)))
    outcome = bench.held(attempt_number=2, place="left box")
    second = robot.insert(other, object=thing, grasp=grasp(0.03), outcome=outcome)
    assert len(wholes(engine)) == 1
    (whole,) = wholes(engine)
    views = [second["objects"][0]["view"]]
    said = {"operation": "split", "object": thing, "views": views}
    new = engine.call("curate_object", said, ANN).as_json()["object"]
    assert new != thing
    (placing,) = engine.kb.match(None, RT.targetSurface)
    assert [q.object.value for q in engine.kb.match(placing.subject, RT.handles)] == [new]
    assert [q.object.value for q in engine.kb.match(whole, RT.handles)] == [thing]
    parts = {q.object for q in engine.kb.match(whole, RT.hasSubTask)}
    assert placing.subject not in parts
    assert len(parts) == 1


def test_what_lies_in_a_box_is_drawn_where_the_robot_said_that_the_box_stands(kb, robots, bench):
    one, two = robots("nao-1"), robots("nao-2")
    one.call(
        "state_frame", frame="nao-1/left box", parent="nao-1/base_footprint",
        pose={"position": {"x": 0.15, "y": 0.29, "z": 0.27},
              "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}},
    )  # fmt: skip
    for robot in (one, two):
        stored = robot.insert(bench.sight(bench.BOX), name="tea")["objects"][0]
        answer = robot.recognise(bench.sight(bench.BOX))
        robot.call(
            "report_outcome", object=stored["object"], task_id=answer["task_id"],
            grasp=dict(answer["grasps"][0]), gripper_id=robot.gripper,
            outcome=bench.held(place="left box"),
        )  # fmt: skip
    scene = kb.world.scene(time.time() + 1.0, "nao-1/base_footprint")
    ((number, tea),) = [(k, n) for k, n in enumerate(scene.nodes) if n.kind == "thing"]
    assert tea.label == "tea"
    assert scene.root_from_nodes()[number][:3, 3].round(3).tolist() == [0.15, 0.29, 0.27]
    # The other robot's box has the same name and stands nobody knows where.
    assert [one.reason for one in scene.unplaced] == ["in left box, whose pose is not known"]
