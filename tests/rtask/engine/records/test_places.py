"""Places of things: seen by robots, held by them, or no longer known to anybody."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pytest

import ontology
from grasp.messages import pose_message
from grasp.spatial.frames import surface_from_object
from rtask.engine.records import places
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow

SAMPLE = "PREFIX : <https://w3id.org/rtask-kg/kb/sample/>"
QUESTION = next(path for path in ontology.queries() if path.name == "cq22.rq").read_text()


@pytest.fixture
def nao(robots):
    return robots()


def fill_store(bench, robots):
    """Store a box that one robot has seen; return its IRI."""
    return robots().insert(bench.sight(bench.BOX), name="box")["objects"][0]["object"]


@pytest.fixture
def box(filled):
    """Return the IRI of a box that one robot has stored."""
    return filled


def where(kb, thing):
    """Return the answer to "where is it?", or None."""
    text = QUESTION.replace(SAMPLE, "").replace(":mug", f"<{thing}>")
    rows = kb.select(text)
    return rows[0].to_dict() if rows else None


def estimates(kb, thing):
    return [quad.subject for quad in kb.match(None, RT.poseOf, iri(thing))]


def given(bench, x, y, yaw, stamp=None):
    """Return a view of the box with the pose that the robot itself found."""
    pose = pose_message(surface_from_object(x, y, bench.TABLE, yaw))
    seen = {**bench.sight(bench.BOX), "object_pose": pose}
    return seen if stamp is None else {**seen, "stamp": stamp}


def report(nao, box, **outcome):
    """Report the outcome of the first grasp that was offered last."""
    offered = nao.log[-1]["grasps"][0]
    return nao.call(
        "report_outcome", object=box, task_id=nao.log[-1]["task_id"], grasp=dict(offered),
        gripper_id=nao.gripper, outcome=outcome,
    )  # fmt: skip


def test_an_inserted_object_is_where_it_was_seen(nao, box, kb):
    answer = where(kb, box)
    assert [answer["x"], answer["y"], answer["z"]] == pytest.approx([0.16, -0.06, 0.27], abs=5e-3)
    assert (answer["frame"], answer["by"], answer["holder"]) == ("base_footprint", "nao-1", None)
    assert answer["confidence"] == 1.0


def test_a_recognised_object_is_remembered_where_it_stands_now(nao, box, kb, bench):
    there = bench.BOX.at(0.20, -0.02, 0.3)
    assert nao.recognise(bench.sight(there))["object"] == box
    answer = where(kb, box)
    assert [answer["x"], answer["y"]] == pytest.approx([0.20, -0.02], abs=5e-3)
    assert 0 < answer["confidence"] <= 1


@pytest.mark.parametrize(
    ("x", "yaw", "more"),
    [(0.165, 0.3, 0), (0.16, 0.3 + np.deg2rad(14), 0), (0.181, 0.3, 1),
     (0.16, 0.3 + np.deg2rad(16), 1)],
    ids=["5 mm", "14 degrees", "21 mm", "16 degrees"],
)  # fmt: skip
def test_only_a_thing_that_moved_gets_a_new_estimate(nao, box, kb, bench, x, yaw, more):
    nao.recognise(given(bench, 0.16, -0.06, 0.3), object=box)
    before = len(estimates(kb, box))
    nao.recognise(given(bench, x, -0.06, yaw), object=box)
    assert len(estimates(kb, box)) == before + more


def test_a_round_thing_does_not_move_by_turning(nao, kb, bench):
    can = nao.insert(bench.sight(bench.CAN))["objects"][0]["object"]
    nao.recognise(given(bench, 0.16, -0.06, 0.0), object=can)
    nao.recognise(given(bench, 0.16, -0.06, 2.0), object=can)
    assert len(estimates(kb, can)) == 1


def test_frames_of_two_robots_are_not_compared(nao, box, robots, kb, bench):
    other = robots("nao-2")
    other.recognise(given(bench, 0.16, -0.06, 0.3), object=box)
    assert len(estimates(kb, box)) == 2
    found = {quad.object for one in estimates(kb, box)
              for pose in kb.match(one, RT.estimatedPose)
              for quad in kb.match(pose.object, RT.inFrame)}  # fmt: skip
    assert len(found) == 2


def test_a_pose_without_a_named_frame_is_not_stored(nao, kb, bench):
    seen = bench.sight(bench.BOX)
    del seen["frame_id"]
    box = nao.insert(seen)["objects"][0]["object"]
    assert estimates(kb, box) == []


def test_a_reader_leaves_no_trace(nao, box, kb, bench, engine):
    seq = kb.seq
    args = {**given(bench, 0.3, 0.1, 0.3), "object": box, "gripper_id": nao.gripper}
    engine.call("recognise_for_grasp", args, Access("eve", "reader"))
    assert kb.seq == seq


def test_only_the_last_estimates_are_kept(nao, box, kb, bench, monkeypatch):
    monkeypatch.setattr(places, "MAX_ESTIMATES", 3)
    start = dt.datetime.now(dt.UTC).timestamp() + 1
    for k in range(4):
        nao.recognise(given(bench, 0.03 * k, 0.1, 0.3, start + k), object=box)
    assert len(estimates(kb, box)) == 3
    assert where(kb, box)["x"] == pytest.approx(0.09)
    for pose in kb.match(None, RT.estimatedPose):
        assert kb.match(pose.subject, RT.poseOf), "no remains of an estimate that went"


def test_a_held_thing_is_in_the_hand_until_it_is_seen_again(nao, box, kb, bench):
    nao.recognise(bench.sight(bench.BOX))
    report(nao, box, success=True, reason="ok")
    (hand,) = (quad.object for quad in kb.match(None, RT.heldBy))
    answer = where(kb, box)
    assert (answer["holder"], answer["by"], answer["x"]) == (str(hand.value), "nao-1", None)
    assert kb.world.where_is("box").exemplars[0].relation == "held_by"
    nao.recognise(bench.sight(bench.BOX))
    assert [place.relation for place in kb.world.where_is("box").exemplars] == ["at"]
    assert where(kb, box)["x"] == pytest.approx(0.16, abs=5e-3)


def test_a_thing_seen_in_the_box_where_it_was_put_is_there(nao, box, kb, bench):
    nao.recognise(bench.sight(bench.BOX))
    report(nao, box, success=True, placed=True, reason="ok", place="right box")
    (place,) = (quad.object for quad in kb.match(None, RT.placedIn))
    answer = where(kb, box)
    assert (answer["holder"], answer["by"], answer["x"]) == (str(place.value), "nao-1", None)


def test_a_thing_let_go_without_being_seen_there_is_not_in_the_hand_any_more(nao, box, kb, bench):
    nao.recognise(bench.sight(bench.BOX))
    report(nao, box, success=True, reason="ok", place="right box")
    assert not kb.world.where_is("box").is_known
    assert where(kb, box) is None


@pytest.mark.parametrize("outcome", ["held", "missed"])
def test_a_placed_or_lost_thing_is_nowhere_until_it_is_seen(nao, box, kb, bench, outcome):
    nao.recognise(bench.sight(bench.BOX))
    report(nao, box, **getattr(bench, outcome)())
    assert where(kb, box) is None
    assert len(kb.match(None, PROV.invalidatedAtTime)) == len(estimates(kb, box)) == 1
    nao.recognise(bench.sight(bench.BOX))
    assert where(kb, box)["frame"] == "base_footprint"


def test_a_plan_that_failed_leaves_the_thing_where_it_was(nao, box, kb, bench):
    nao.recognise(bench.sight(bench.BOX))
    report(nao, box, success=False, reason="ik")
    assert where(kb, box)["x"] == pytest.approx(0.16, abs=5e-3)


def test_the_places_of_a_forgotten_thing_are_forgotten(nao, box, kb, engine):
    args = {"object": box, "operation": "forget"}
    engine.call("curate_object", args, Access("ann", "teacher"))
    assert kb.match(None, RT.poseOf) == kb.match(None, RT.estimatedPose) == []


def test_a_view_stored_with_its_outcome_tells_where_the_thing_was(nao, kb, bench):
    seen = bench.sight(bench.BOX)
    answer = nao.recognise(seen)
    box = nao.insert(
        seen, grasp=dict(answer["grasps"][0]), outcome=bench.missed(), task_id=answer["task_id"]
    )["objects"][0]["object"]
    assert len(estimates(kb, box)) == 1
    assert where(kb, box) is None
