"""Reports that cannot be so: clocks ahead, grasps beside the object, a success without a hold."""

from __future__ import annotations

import datetime as dt
import time

import pytest

import rtask
from rtask.engine import Engine
from rtask.errors import ForgottenError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow

HOUR_S = 3600.0
IN_2099 = 4_070_908_800.0


@pytest.fixture
def reported(bench, robots):
    """Return a function that reports an attempt at the box by insert_object."""
    seen, robot = bench.sight(bench.BOX), robots("nao-1")

    def report(outcome, grasp=None, **look):
        offered = robot.recognise({**seen, **look})["grasps"][0]
        return robot.insert({**seen, **look}, grasp=grasp or offered, outcome=outcome)["objects"][0]

    return report


def single_time(kb, pattern):
    (row,) = kb.select(f"{PREFIXES} SELECT ?time WHERE {{ {pattern} }}").to_dicts()
    return dt.datetime.fromisoformat(str(row["time"])).timestamp()


def test_a_clock_that_is_ahead_is_told_and_the_time_of_receipt_stored(bench, reported, kb):
    before = time.time()
    stored = reported(bench.held(started=IN_2099, ended=IN_2099 + 4))
    ended = single_time(kb, "?attempt a rt:GraspAttempt ; prov:endedAtTime ?time")
    started = single_time(kb, "?attempt a rt:GraspAttempt ; prov:startedAtTime ?time")
    assert before - 1 <= ended <= time.time()
    assert ended - started == pytest.approx(4, abs=0.01)
    words = "the clock of the robot said 2099-01-01T00:00:04"
    assert stored["message"].startswith(words)
    comments = [str(quad.object) for quad in kb.match(None, RT.comment)]
    assert any(words in comment for comment in comments), "the robot's time is kept as well"


@pytest.mark.parametrize("seconds", [-50 * 365 * 24 * HOUR_S, -HOUR_S, 120.0])
def test_a_time_long_past_or_a_little_ahead_is_the_robots(bench, reported, kb, seconds):
    happened = round(time.time() + seconds)
    stored = reported(bench.held(ended=happened))
    ended = single_time(kb, "?attempt a rt:GraspAttempt ; prov:endedAtTime ?time")
    assert ended == happened
    assert "message" not in stored


def test_a_place_dated_2099_does_not_outdo_what_is_seen_later(bench, robots, kb):
    robot, seen = robots("nao-1"), bench.sight(bench.BOX)
    where = {"frame_id": "base_link", "name": "tea box"}
    stored = robot.insert(seen, stamp=IN_2099, **where)["objects"][0]
    assert "2099" in stored["message"]
    seen_at = single_time(kb, "?estimate rt:estimatedPose/rt:atTime ?time")
    assert seen_at <= time.time()


def test_the_bound_is_a_setting(bench, reported, engine, monkeypatch):
    policy = type(engine.context.policy)(clock_ahead_s=2 * HOUR_S)
    monkeypatch.setattr(engine.context, "policy", policy)
    assert "message" not in reported(bench.held(ended=time.time() + HOUR_S))
    assert reported(bench.held(ended=time.time() + 3 * HOUR_S))["message"]


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("width", 3.0, r"grasp\.width: 3 is above 1"),
        ("width", -0.1, r"grasp\.width: -0.1 is below 0"),
        ("opening", -0.1, r"grasp\.opening: -0.1 is below 0"),
        ("theta", 90.0, r"theta: 90 is above 12.57 rad"),
        ("x", 5.0, "x is .* m from the object, more than 4"),
    ],
)
def test_an_implausible_grasp_is_refused_with_its_field(
    bench, reported, robots, kb, field, value, words
):
    offered = robots("nao-1").recognise(bench.sight(bench.BOX))["grasps"][0]
    pose = {"x": 0.0, "y": 0.0, "z": 0.02, "theta": 0.0}
    grasp = {"id": "", "width": 0.03, "opening": 0.05, "in_object": pose}
    given = grasp | ({"in_object": pose | {field: value}} if field in pose else {field: value})
    assert offered
    with pytest.raises(UsageError, match=words):
        reported(bench.held(), grasp=given)
    assert not kb.match(None, RT.objectId)


@pytest.mark.parametrize("reason", ["missed", "no_grasp"])
def test_a_success_with_the_reason_that_nothing_was_held_is_refused(bench, reported, reason):
    with pytest.raises(UsageError, match=f"outcome.reason: {reason} does not fit") as caught:
        reported({**bench.held(), "reason": reason})
    assert caught.value.details["field"].endswith("outcome.reason")


@pytest.mark.parametrize(("purge", "reason"), [(False, True), (False, False), (True, False)])
def test_a_forgotten_object_does_not_come_back_half(bench, purge, reason):
    with rtask.open(":memory:", reason=reason) as kb, Engine(kb) as engine:
        robot, seen = bench.Robot("nao-1", engine), bench.sight(bench.BOX)
        robot.register()
        offered = robot.recognise(seen)["grasps"][0]
        tried = {"grasp": offered, "outcome": bench.held()}
        stored = robot.insert(seen, **tried, name="tea box")["objects"][0]
        name = stored["object"]
        untried = iri(f"{kb.base}grasp/2")
        with kb.transaction() as tx:
            tx.add(iri(name), RT.hasGrasp, untried)
            tx.add(untried, RT.graspPose, iri(f"{untried.value}/pose"))
        assert len(kb.match(iri(name), RT.hasGrasp)) == 2
        forget = {"operation": "forget", "object": name, "purge": purge}
        commit = engine.call("curate_object", forget, Access("anna", "teacher")).as_json()["commit"]
        with pytest.raises(ForgottenError, match="was forgotten") as caught:
            robot.insert(seen, object=name)
        assert caught.value.status == 404
        with pytest.raises(ForgottenError, match="was forgotten"):
            robot.call("recall_grasps", object=name)
        with pytest.raises(ForgottenError, match="was forgotten"):
            robot.call("report_outcome", object=name, gripper_id=robot.gripper, **tried)
        with pytest.raises(ForgottenError, match="was forgotten"):
            robot.recognise(seen, object=name)
        assert not kb.match(iri(name), RT.objectId)
        assert not kb.match(iri(name), RT.hasView)
        grasps = {quad.subject for quad in kb.match(None, RT.graspPose)}
        assert grasps == {quad.object for quad in kb.match(None, RT.hasGrasp)}
        assert grasps == (set() if purge else {iri(stored["grasp"])}), "only what was executed"
        if not purge:
            undo = {"operation": "undo", "commit": commit}
            engine.call("curate_object", undo, Access("anna", "teacher"))
            assert len(kb.match(iri(name), RT.hasGrasp)) == 2
            assert robot.call("recall_grasps", object=name)["grasps"][0]["id"] == stored["grasp"]


_HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.05, "max_payload": 0.3}
_CAMERA = {"name": "eye", "frame_id": "eye"}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"end_effectors": [{**_HAND, "max_opening": 50}]}, r"max_opening: 50 is above 1 m"),
        ({"end_effectors": [{**_HAND, "finger_length": 45}]}, r"finger_length: 45 is above 1 m"),
        ({"end_effectors": [{**_HAND, "max_payload": 3e4}]}, r"payload: 30000 is above 5000 kg"),
        ({"end_effectors": [_HAND, _HAND]}, r"end_effectors\[1\].name: another part is called"),
        ({"cameras": [{**_CAMERA, "max_range": 4000}]}, r"max_range: 4000 is above 200 m"),
        ({"cameras": [{**_CAMERA, "name": "hand"}]}, r"cameras\[0\].name: another part is called"),
        ({"cameras": [{**_CAMERA, "min_range": 5, "max_range": 1}]}, "not below max_range"),
    ],
)
def test_a_body_in_other_units_is_refused_with_its_field(engine, kb, body, words):
    request = {"name": "nao-9", "model": "x", "end_effectors": [_HAND], **body}
    with pytest.raises(UsageError, match=words):
        engine.call("register_robot", request)
    assert not kb.match(None, RT.maxOpening)
