"""Grasps of suction cups and of three fingers in the graph: stored, recalled, offered, refused."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from grasp.messages import matrix_from_message
from rtask.errors import UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RT

pytestmark = pytest.mark.slow

BOX = (0.080, 0.060, 0.050)
PREFIX = "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
HANDS = {
    "suction": {"kind": "SuctionCup", "gripper_type": "cup_24", "lip_radius": 0.012},
    "three_fingers": {"kind": "ThreeFingerHand", "gripper_type": "three_100", "max_opening": 0.1,
                      "max_force": 60.0},
}  # fmt: skip


def robot_with(bench: Any, engine: Any, name: str, hand: dict[str, Any]) -> Any:
    """Return a registered robot whose only hand has the given fields."""
    robot = bench.Robot(name, engine, gripper=f"{name}_hand")
    message = bench.registration(name, f"{name}_hand")
    message["end_effectors"] = [{"name": f"{name}_hand", "max_payload": 1.0, **hand}]
    robot.call("register_robot", **message)
    return robot


@pytest.fixture(
    params=["suction", pytest.param("three_fingers", marks=pytest.mark.deep)],
)
def kind(request: pytest.FixtureRequest) -> str:
    """Return what holds; the kinds differ in how contacts are stored, which both always show."""
    return str(request.param)


@pytest.fixture
def first(bench: Any, engine: Any, kind: str) -> Any:
    return robot_with(bench, engine, "one", HANDS[kind])


@pytest.fixture
def box(bench: Any) -> Any:
    return bench.Thing(BOX, texture_seed=1)


def try_out(robot: Any, bench: Any, seen: dict[str, Any], **outcome: Any) -> tuple[str, dict]:
    """Let a robot grasp an object that the graph does not know; return it and the grasp."""
    answer = robot.recognise(seen)
    best = answer["grasps"][0]
    item = robot.insert(seen, task_id=answer["task_id"], grasp=best, outcome=bench.held(**outcome))[
        "objects"
    ][0]
    return item["object"], {**best, "stored": item["grasp"]}


def touches(grasp: dict[str, Any]) -> np.ndarray:
    return np.array([[one[k] for k in ("x", "y", "z", "nx", "ny", "nz")]
                     for one in grasp["contacts"]])  # fmt: skip


def test_what_one_robot_held_the_next_one_with_such_a_hand_is_served_from_memory(
    first: Any, bench: Any, engine: Any, box: Any, kind: str
) -> None:
    thing, tried = try_out(first, bench, bench.sight(box))
    assert tried["source"] == "candidate"
    second = robot_with(bench, engine, "two", HANDS[kind])
    moved = bench.sight(box.at(0.19, 0.04, 0.9))
    answer = second.recognise(moved)
    assert answer["object"] == thing
    served = answer["grasps"][0]
    assert (served["source"], served["id"]) == ("memory", tried["stored"])
    assert served["mean"] > tried["mean"]
    told = second.call(
        "report_outcome", task_id=answer["task_id"], grasp=served, outcome=bench.held()
    )
    assert (told["grasp"], told["statistics"]["successes"]) == (tried["stored"], 2)
    # The same place on the object, wherever that stands now.
    c, s = np.cos(0.9 - 0.3), np.sin(0.9 - 0.3)
    turn = np.array([[c, -s], [s, c]])
    there = touches(tried)[:, :2] - box.position
    here = touches(served)[:, :2] - (0.19, 0.04)
    off = min(np.abs(here - sign * there @ turn.T).max() for sign in (1, -1))
    assert off < 0.004


@pytest.mark.parametrize("kind", sorted(HANDS))
def test_contacts_are_stored_as_nodes_and_read_back_as_they_were(
    first: Any, bench: Any, engine: Any, box: Any, kind: str
) -> None:
    thing, tried = try_out(first, bench, bench.sight(box))
    (back,) = first.call("recall_grasps", object=thing, max_grasps=50)["grasps"]
    assert (back["id"], back["contact_kind"], back["kind"]) == (tried["stored"], kind, "spatial")
    wanted = matrix_from_message(tried["grasp_pose"]["pose"])
    stored = matrix_from_message(back["grasp_pose"]["pose"])
    for grasp, pose in ((tried, wanted), (back, stored)):
        grasp["local"] = (touches(grasp)[:, :3] - pose[:3, 3]) @ pose[:3, :3]
    # Places are kept to a micrometre, poses by quaternions of ten digits.
    np.testing.assert_allclose(back["local"], tried["local"], atol=3e-6)
    assert [c["seal_radius"] for c in back["contacts"]] == (
        [0.012] if kind == "suction" else [None] * len(tried["contacts"])
    )
    rows = engine.kb.select(f"""{PREFIX}SELECT ?x ?y ?z ?nz ?seal WHERE {{
      <{thing}> rt:hasGrasp ?grasp . ?grasp rt:hasContact ?touch .
      ?touch a rt:GraspContact ; rt:contactIndex ?k ; rt:x ?x ; rt:y ?y ; rt:z ?z ;
        rt:contactNormal/rt:dirZ ?nz OPTIONAL {{ ?touch rt:sealRadius ?seal }}
    }} ORDER BY ?k""")
    found = [[float(str(row.value(k))) for k in ("x", "y", "z", "nz")] for row in rows]
    assert np.array_equal(found, touches(back)[:, [0, 1, 2, 5]])


@pytest.mark.parametrize("kind", sorted(HANDS))
def test_they_are_individuals_of_the_python_classes(
    first: Any, bench: Any, engine: Any, box: Any, kind: str
) -> None:
    from rtask.model.generated.rtask import SuctionGrasp, ThreeFingerGrasp

    try_out(first, bench, bench.sight(box))
    cls, other = SuctionGrasp, ThreeFingerGrasp
    if kind == "three_fingers":
        cls, other = other, cls
    with engine.kb.session() as session:
        (one,) = session.query(cls)
        assert list(session.query(other)) == []
        contact = sorted(one.has_contact, key=lambda each: each.contact_index)[0]
        normal = contact.contact_normal
        assert abs(np.linalg.norm([normal.dir_x, normal.dir_y, normal.dir_z]) - 1) < 1e-9


def test_a_hand_is_not_offered_what_only_another_kind_can_carry_out(
    first: Any, bench: Any, engine: Any, box: Any, kind: str
) -> None:
    thing, tried = try_out(first, bench, bench.sight(box))
    jaws = robot_with(bench, engine, "jaws", {"gripper_type": "jaw_80", "max_opening": 0.08})
    other = next(name for name in HANDS if name != kind)
    third = robot_with(bench, engine, "other", HANDS[other])
    for robot in (jaws, third):
        answer = robot.recognise(bench.sight(box), in_space=True)
        # Which object it is carries over; how it is held does not.
        assert answer["object"] == thing
        assert {grasp["source"] for grasp in answer["grasps"]} == {"candidate"}
        assert max(max(g["explanation"]["graph"]) for g in answer["grasps"]) == 0
        hand = f"{robot.name}_hand"
        assert robot.call("recall_grasps", object=thing, gripper_id=hand)["grasps"] == []
        with pytest.raises(UsageError, match=f"is by {kind}, and '{hand}' holds by"):
            robot.call("report_outcome", object=thing, grasp=tried["stored"], success=True)


def test_a_failure_makes_the_next_choice_go_elsewhere_and_the_map_grows(
    first: Any, bench: Any, engine: Any, box: Any
) -> None:
    seen = bench.sight(box)
    answer = first.recognise(seen)
    best = answer["grasps"][0]
    thing = first.insert(seen, task_id=answer["task_id"], grasp=best, outcome=bench.missed())[
        "objects"
    ][0]["object"]
    again = first.recognise(seen, object=thing)
    assert again["grasps"][0]["id"] != best["id"]
    (known,) = [grasp for grasp in again["grasps"] if grasp["source"] == "memory"]
    assert known["mean"] < best["mean"]
    counted = engine.kb.select(f"""{PREFIX}SELECT ?n WHERE {{
      ?map a rt:ScoreCalibration ; rt:calibratedScore "pose perturbation" ;
        rt:outcomeCount ?n }}""")
    assert [int(str(row.value("n"))) for row in counted] == [1]


def test_plans_on_what_is_stored_are_stored_with_contacts(
    first: Any, bench: Any, box: Any, kind: str
) -> None:
    thing = first.insert(bench.sight(box), name="tea box")["objects"][0]["object"]
    plan = first.call("plan_in_space", object=thing, samples=20, max_grasps=3)
    assert plan["reason"] == ""
    assert {grasp["contact_kind"] for grasp in plan["grasps"]} == {kind}
    assert all(grasp["contacts"] for grasp in plan["grasps"])
    again = first.call("plan_in_space", object=thing, samples=20, max_grasps=3)
    assert again["commit"] == ""
    answer = first.recognise(bench.sight(box), propose=False)
    assert {grasp["source"] for grasp in answer["grasps"]} == {"memory"}


def test_bad_contacts_are_refused_by_name(first: Any, bench: Any, box: Any) -> None:
    seen = bench.sight(box)
    best = first.recognise(seen)["grasps"][0]
    for change, message in (
        ({"nx": 0.5}, "unit vectors"),
        ({"x": 0.9}, "mm from the"),
        ({"nx": None}, r"contacts\[0\]\.nx"),
    ):
        bad = copy.deepcopy({**best, "id": ""})
        bad["contacts"][0].update(change)
        with pytest.raises(UsageError, match=message):
            first.insert(seen, grasp=bad, outcome=bench.held())


def test_contacts_of_jaws_are_refused(bench: Any, engine: Any, first: Any, box: Any) -> None:
    seen = bench.sight(box)
    best = first.recognise(seen)["grasps"][0]
    best["id"] = ""
    jaws = robot_with(bench, engine, "jaws", {"gripper_type": "jaw_80", "max_opening": 0.08})
    with pytest.raises(UsageError, match="which holds by jaws"):
        jaws.insert(seen, grasp=best, outcome=bench.held())


@pytest.mark.parametrize(
    ("hand", "message"),
    [
        ({"kind": "SuctionCup"}, "lip_radius is missing"),
        ({"kind": "SuctionCup", "lip_radius": 0.01, "max_opening": 0.1}, "opens to no width"),
        ({"kind": "ThreeFingerHand"}, "max_opening is missing"),
        ({"kind": "Hand", "max_opening": 0.1, "lip_radius": 0.01}, "lip_radius is of suction cups"),
        (
            {"kind": "Hand", "max_opening": 0.1, "flange_radius": 0.04},
            "flange_radius is of suction cups",
        ),
    ],
)
def test_a_hand_states_what_its_kind_needs(
    bench: Any, engine: Any, hand: dict[str, Any], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        robot_with(bench, engine, "one", {"gripper_type": "any", **hand})


def test_a_wider_lip_is_not_offered_a_place_where_a_smaller_one_sealed(
    bench: Any, engine: Any, box: Any
) -> None:
    try_out(robot_with(bench, engine, "one", HANDS["suction"]), bench, bench.sight(box))
    wide = robot_with(bench, engine, "two", {**HANDS["suction"], "lip_radius": 0.02})
    assert {g["source"] for g in wide.recognise(bench.sight(box))["grasps"]} == {"candidate"}
    narrow = robot_with(bench, engine, "three", {**HANDS["suction"], "lip_radius": 0.008})
    assert narrow.recognise(bench.sight(box))["grasps"][0]["source"] == "memory"


def test_merging_and_splitting_take_the_contacts_along(bench: Any, engine: Any, box: Any) -> None:
    robot = robot_with(bench, engine, "one", HANDS["three_fingers"])
    kept = robot.insert(bench.sight(box))["objects"][0]
    # Seen a quarter turn on, so that its frame is another.
    seen = bench.sight(box.at(0.15, -0.05, 0.3 + 3.0))
    best = robot.recognise(seen)["grasps"][0]
    best["id"] = ""
    other = robot.insert(seen, grasp=best, outcome=bench.held(), merge=False)["objects"][0]

    def local(thing: str) -> np.ndarray:
        """Return the contacts as the hand has them."""
        (one,) = robot.call("recall_grasps", object=thing)["grasps"]
        pose = matrix_from_message(one["grasp_pose"]["pose"])
        rows = touches(one)
        return np.hstack([(rows[:, :3] - pose[:3, 3]) @ pose[:3, :3], rows[:, 3:] @ pose[:3, :3]])

    wanted = local(other["object"])
    teacher = Access("ann", "teacher")
    merge = {"operation": "merge", "object": other["object"], "into": kept["object"]}
    engine.call("curate_object", merge, teacher)
    np.testing.assert_allclose(local(kept["object"]), wanted, atol=5e-6)
    split = {"operation": "split", "object": kept["object"], "views": [other["view"]]}
    new = engine.call("curate_object", split, teacher).as_json()["object"]
    np.testing.assert_allclose(local(new), wanted, atol=5e-6)
    engine.call("curate_object", {"operation": "forget", "object": new, "purge": True}, teacher)
    assert not engine.kb.match(None, RT.hasContact)
    assert not engine.kb.match(None, RT.contactNormal)
