"""Grasps in space on what the graph knows: planned, stored, offered, tried, weighed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from grasp.learning.env import quadrant
from grasp.messages import matrix_from_message
from grasp.spatial.frames import angle_between_axes
from grasp.spatial.meshes.shapes import box_mesh
from rtask.engine.memory.learners import experience
from rtask.engine.records.shapes import object_shape
from rtask.errors import UnknownTermError, UsageError

pytestmark = pytest.mark.slow

PLAN = {"samples": 40, "max_grasps": 30}
Known = tuple[Any, str, dict[str, Any]]
TALL = (0.050, 0.036, 0.110)


def panda(bench: Any, engine: Any) -> Any:
    """Return a robot with a hand that can close on things from any side."""
    robot = bench.Robot("panda-1", engine, gripper="panda_hand")
    message = bench.registration("panda-1", "panda_hand", "panda_hand")
    message["end_effectors"][0].update(
        kind="ParallelJawGripper", max_opening=0.08, jaw_width=0.02, finger_length=0.054
    )
    robot.call("register_robot", **message)
    return robot


@pytest.fixture
def box(bench: Any) -> Any:
    return bench.Thing(TALL, texture_seed=1)


@pytest.fixture
def known(bench: Any, engine: Any, box: Any) -> Known:
    """Return a robot, the object it inserted, and what it planned for it."""
    robot = panda(bench, engine)
    thing = robot.insert(bench.sight(box), name="tea box")["objects"][0]["object"]
    robot.insert(bench.sight(box.at(0.16, -0.06, -0.5)), object=thing)
    return robot, thing, robot.call("plan_in_space", object="tea box", **PLAN)


def offered(robot: Any, seen: dict[str, Any], thing: str, **more: Any) -> dict[str, Any]:
    answer: dict[str, Any] = robot.recognise(
        seen, object=thing, propose=False, in_space=True, **more
    )
    return answer


def pose_of(grasp: dict[str, Any]) -> Any:
    return matrix_from_message(grasp["grasp_pose"]["pose"])


def test_what_is_planned_is_stored_once_with_what_it_was_computed_from(
    known: Known, engine: Any
) -> None:
    robot, thing, plan = known
    assert plan["shape"] == "model"
    assert plan["reason"] == ""
    kinds = {grasp["kind"] for grasp in plan["grasps"]}
    assert kinds == {"planar", "spatial"}
    rows = engine.kb.select(
        "PREFIX rt: <https://w3id.org/rtask-kg/ns#> PREFIX prov: <http://www.w3.org/ns/prov#> "
        "SELECT ?grasp ?c ?l ?e ?from WHERE { ?grasp rt:hasEvaluation ?v . ?v rt:graspConfidence "
        "?c ; rt:confidenceLower95 ?l ; rt:epsilonQuality ?e ; rt:sampleCount 40 ; "
        "prov:wasDerivedFrom ?from . ?from a rt:ObjectModel }"
    )
    assert {str(row.value("grasp")) for row in rows} == {g["id"] for g in plan["grasps"]}
    again = robot.call("plan_in_space", object=thing, **PLAN)
    assert again["commit"] == ""
    assert [g["id"] for g in again["grasps"]] == [g["id"] for g in plan["grasps"]]


def test_who_asks_for_it_is_offered_grasps_in_space_where_the_object_is_now(
    known: Known, bench: Any, box: Any
) -> None:
    robot, thing, plan = known
    moved = bench.sight(box.at(0.20, 0.05, 1.1))
    plain = robot.recognise(moved, object=thing, propose=False)
    assert {grasp["kind"] for grasp in plain["grasps"]} == {"planar"}
    answer = offered(robot, moved, thing, decide=True)
    assert answer["decision"]["answer"] == "grasp"
    spatial = [grasp for grasp in answer["grasps"] if grasp["kind"] == "spatial"]
    assert len(spatial) >= 5
    stored = {grasp["id"]: grasp for grasp in plan["grasps"]}
    c, s = np.cos(1.1), np.sin(1.1)
    frame_from_object = np.array(
        [[c, -s, 0, 0.20], [s, c, 0, 0.05], [0, 0, 1, bench.TABLE], [0, 0, 0, 1]]
    )
    for grasp in spatial:
        wanted = frame_from_object @ pose_of(stored[grasp["id"]])
        # A box looks the same after half a turn; print tells, but either is a way to hold it.
        turned = frame_from_object @ np.diag([-1, -1, 1, 1]) @ pose_of(stored[grasp["id"]])
        off = min(np.linalg.norm(pose_of(grasp)[:3, 3] - one[:3, 3]) for one in (wanted, turned))
        assert off < 0.006
        assert angle_between_axes(grasp["theta"], np.arctan2(*wanted[[1, 0], 0])) < 0.08
        assert grasp["grasp_pose"]["header"]["frame_id"] == "base_footprint"
        assert grasp["pre_grasp_posture"]["points"][0]["positions"][0] >= grasp["width"]
    ring = [[0.20 + 0.07 * np.cos(a), 0.05 + 0.07 * np.sin(a), z]
            for a in np.linspace(0, 6.1, 40) for z in (0.29, 0.32, 0.35, 0.38)]  # fmt: skip
    fenced = offered(robot, moved, thing, neighbours=ring)
    assert {grasp["kind"] for grasp in fenced["grasps"]} <= {"planar"}
    nobody = offered(robot, moved, thing, min_grasp=0.999)
    assert nobody["decision"]["too_low"] == "grasp"
    assert nobody["grasps"] == []


def test_outcomes_of_a_grasp_in_space_move_its_statistics_its_belief_and_the_order(
    known: Known, bench: Any, box: Any, engine: Any
) -> None:
    robot, thing, _ = known
    seen = bench.sight(box)
    first = offered(robot, seen, thing)
    best = next(grasp for grasp in first["grasps"] if grasp["kind"] == "spatial")
    told = robot.call(
        "report_outcome", task_id=first["task_id"], object=thing, grasp=best,
        outcome=bench.missed(),
    )  # fmt: skip
    assert (told["grasp"], told["statistics"]["attempts"]) == (best["id"], 1)
    robot.call("report_outcome", task_id="again", object=thing, grasp=best["id"],
               outcome=bench.missed(attempt_number=2))  # fmt: skip
    after = {grasp["id"]: grasp for grasp in offered(robot, seen, thing)["grasps"]}
    before = {grasp["id"]: grasp for grasp in first["grasps"]}
    assert after[best["id"]]["statistics"]["attempts"] == 2
    assert after[best["id"]]["mean"] < best["mean"] - 0.2
    planar = [name for name in after if after[name]["kind"] == "planar"]
    # From above is another way to hold it, whatever failed from the side.
    assert [after[k]["mean"] for k in planar] == [before[k]["mean"] for k in planar]
    recalled = robot.call("recall_grasps", object=thing, max_grasps=50)["grasps"]
    (mine,) = [grasp for grasp in recalled if grasp["id"] == best["id"]]
    assert mine["confidence"]["mean"] < mine["confidence"]["prior"]
    steps = experience(engine.context)
    assert [(step.action, step.reward) for step in steps] == [
        (quadrant(best["in_object"]["theta"]), -1.0)
    ] * 2
    assert mine["grasp_pose"]["header"]["frame_id"].startswith("object/")


def test_a_grasp_in_space_that_was_never_offered_becomes_one_of_the_object(
    known: Known, bench: Any
) -> None:
    robot, thing, plan = known
    new = next(g for g in plan["grasps"] if g["kind"] == "spatial")
    turn = dict(zip(("qx", "qy", "qz", "qw"), (0.5, 0.5, 0.5, 0.5), strict=True))
    at = {"x": 0.01, "y": 0.0, "z": 0.05, "theta": 0.0, **turn}
    sent: dict[str, Any] = {"in_object": at, "width": 0.04, "opening": 0.07}
    told = robot.call("report_outcome", task_id="t", object=thing, grasp=sent, outcome=bench.held())
    assert told["grasp"] != new["id"]
    same = robot.call("report_outcome", task_id="u", object=thing, grasp=sent, outcome=bench.held())
    assert (same["grasp"], same["statistics"]["successes"]) == (told["grasp"], 2)
    recalled = robot.call("recall_grasps", object=thing)["grasps"][0]
    assert (recalled["id"], recalled["kind"]) == (told["grasp"], "spatial")
    assert np.allclose(pose_of(recalled)[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-6)
    flat = robot.call("recall_grasps", object=thing, in_space=False)["grasps"]
    assert {grasp["kind"] for grasp in flat} == {"planar"}
    sent["in_object"]["qw"] = 3.0
    with pytest.raises(UsageError, match="no unit quaternion"):
        robot.call("report_outcome", task_id="v", object=thing, grasp=sent, outcome=bench.held())
    with pytest.raises(UnknownTermError, match="unknown object"):
        robot.call("plan_in_space", object="nothing", **PLAN)
    wide = robot.call("plan_in_space", object=thing, **{**PLAN, "min_confidence": 1.0, "mass": 900})
    assert (wide["grasps"], wide["commit"]) == ([], "")
    assert "confidence" in wide["reason"]


def test_a_closed_mesh_is_planned_on_before_clouds_and_a_round_thing_is_swept(
    bench: Any, engine: Any
) -> None:
    robot = panda(bench, engine)
    can = robot.insert(bench.sight(bench.CAN), name="can")["objects"][0]["object"]
    swept = object_shape(engine.context, can)
    assert swept.mesh is not None
    assert np.abs(swept.mesh.extent[:2] - bench.CAN.size[:2]).max() < 0.006
    box = box_mesh((0.03, 0.03, 0.08))
    store_mesh(engine, can, box, range(len(box.faces)))
    found = object_shape(engine.context, "can")
    assert found.mesh is not None
    assert len(found.mesh.faces) == 12
    # Without its sides it is not closed, so the sweep stands again.
    sides = np.flatnonzero(np.abs(box.normals[:, 0]) < 0.5)
    store_mesh(engine, can, box, sides)
    assert "swept" in object_shape(engine.context, "can").note


def store_mesh(engine: Any, thing: str, mesh: Any, faces: Any) -> None:
    """State a mesh of an object, in place of the one before."""
    from features.modelling import mesh_to_ply
    from rtask.engine.triples import Triples
    from rtask.rdf.namespaces import RT
    from rtask.rdf.terms import iri

    triples, node = Triples(), iri(thing + "/cad")
    kept = mesh.faces[list(faces)]
    grey = np.full((len(mesh.vertices), 3), 90, np.uint8)
    data = mesh_to_ply(mesh.vertices + np.array([0, 0, 0.04]), kept, grey)
    blob = engine.kb.blobs.put(data, "model/ply")
    triples.add(iri(thing), RT.hasFeature, node)
    triples.node(node, [RT.TriangleMesh], {RT.hasBlob: triples.blob(blob)})
    with engine.kb.transaction(note="a mesh") as tx:
        for quad in engine.kb.match(node, RT.hasBlob):
            tx.remove(node, RT.hasBlob, quad.object)
        triples.write(tx)
