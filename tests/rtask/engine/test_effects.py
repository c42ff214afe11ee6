"""Each operation does to the graph what it declares: a spy on commits watches all of them."""

from __future__ import annotations

from collections import Counter

import pytest

from rtask.engine.operations.operation import operation
from rtask.engine.operations.table import OPERATIONS
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES

TEACHER = Access("ada", "teacher")
REACHED = f"""{PREFIXES}
INSERT DATA {{
  <urn:arm> a cora:Robot ; rt:name "arm" ; rt:hasEndEffector <urn:hand> ; rt:reaches <urn:shelf> ;
    rt:canGrasp <urn:cup> .
  <urn:hand> a rt:EndEffector ; rt:providesCapability rt:grasping .
  <urn:cup> a rt:Exemplar ; rt:locatedOn <urn:shelf> .
  <urn:shelf> a sumo:Object, rt:SupportSurface .
}}"""
"""What a reasoner would derive of a cup on a shelf is stated here, for the store has none."""


@pytest.fixture
def spied(kb, engine):
    """Return a caller of operations, and how often each was called and committed."""
    calls, commits = Counter(), Counter()

    def call(name, access, /, **args):
        seen = []
        stop = kb.on_commit(seen.append)
        try:
            return engine.call(name, args, access).as_json()
        finally:
            stop()
            calls[name] += 1
            commits[name] += len(seen)

    return call, calls, commits


def test_what_reads_commits_nothing_and_what_records_or_writes_commits(kb, spied, bench):
    call, calls, commits = spied
    nao, pepper = Access("nao-1", "robot"), Access("pepper", "robot")
    for robot in (nao, pepper):
        call("register_robot", robot, **bench.registration(robot.agent, "right_hand"))
    box = bench.sight(bench.BOX)
    ask = {**box, "task": "pick", "gripper_id": "right_hand", "propose": True}
    first = call("recognise_for_grasp", nao, **ask)
    assert not commits["recognise_for_grasp"], "nothing is known of it yet"
    item = {**box, "gripper_id": "right_hand", "grasp": first["grasps"][0],
            "task_id": first["task_id"], "outcome": bench.held()}  # fmt: skip
    stored = call("insert_object", nao, objects=[item])["objects"][0]
    thing = stored["object"]
    call("recognise_for_grasp", Access("visitor", "reader"), **ask)
    assert not commits["recognise_for_grasp"], "a mere reader leaves no record"
    asked = call("recognise_for_grasp", pepper, **ask)
    assert asked["object"] == thing
    assert commits["recognise_for_grasp"] == 1, "its place in another robot's frame"
    unknown = bench.sight(bench.CAN)
    refused = call("recognise_for_grasp", nao, **{**ask, **unknown, "decide": True})
    refusal = refused["decision"]["refusal"]
    assert commits["recognise_for_grasp"] == 2, "the refusal"
    call("report_refusal", nao, refusal=refusal, response="left_alone")
    call("recall_grasps", nao, object=thing)
    call("recall_motions", nao)
    call("plan_in_space", nao, object=thing, gripper_id="right_hand", samples=20)
    call("plan_on_scene", nao, gripper_id="right_hand", **box)
    assert call("reconstruct_mesh", nao, object=thing)["commit"]
    call("search_object", nao, data=box["data"])
    call("resolve_request", nao, wanted="box", gripper_id="right_hand")
    assert call("where_is", nao, name="box")["known"]
    pose = {"position": dict.fromkeys("xyz", 0.5), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    seen = {"object": thing, "pose": pose}
    (other,) = call("report_sightings", nao, frame="base_footprint", seen=[seen])["things"]
    assert call("trace_thing", nao, name=other)["places"]
    assert call("show_world", nao)["nodes"]
    call("report_outcome", nao, object=thing, grasp=stored["grasp"], outcome={"success": True})
    call("give_feedback", TEACHER, object=thing, verdict="confirm")
    call("teach_object", TEACHER, operation="search", class_description="box", data=box["data"])
    assert not commits["teach_object"]
    call("teach_object", TEACHER, operation="teach", object=thing, class_description="box",
         name="blue box")  # fmt: skip
    call("curate_object", TEACHER, operation="forget", object=thing)
    call("compare_contributors", TEACHER)
    call("withdraw_contributor", TEACHER, contributor="nao-1")
    kb.update(REACHED)
    goal = {"goal": "<urn:cup> rt:locatedOn <urn:hand>"}
    prices = {"asking_price": 1, "failing_price": 60}
    digest = call("plan_goal", nao, **goal)["digest"]
    plan = call("store_plan", TEACHER, **goal, **prices, digest=digest)
    owner = {"robot": "urn:arm"}
    step = call("claim_step", Access(), **owner)
    call("end_step", Access(), task=step["task"], result="released", **owner)
    assert call("list_plans", nao)["plans"][0]["state"] == "waiting"
    call("claim_step", Access(), **owner)
    choices = [{"code": "go_on", "text": "try it"}, {"code": "leave", "text": "leave it"}]
    call("ask_person", Access(), task=step["task"], kind="act", text="shall I?", choices=choices,
         chance=0.0, **owner)  # fmt: skip
    (question,) = call("list_questions", nao)["questions"]
    call("answer_question", TEACHER, question=question["question"], choice=1)
    call("claim_step", Access(), **owner)
    call("end_step", Access(), task=step["task"], result="failed", **owner)
    assert call("explain_failure", nao, subject=plan["task"])["step"] == step["task"]
    call("state_place", TEACHER, thing="urn:cup", lost=True)
    call("state_place", TEACHER, thing="urn:cup", place="urn:shelf")
    call("state_reach", nao, place="urn:shelf")
    for name in ("map", "table"):
        call("state_frame", TEACHER, frame=name)
    assert call("locate_frame", nao, frame="table")["known"]
    call("cancel_plan", TEACHER, plan=plan["task"], reason="enough")
    assert set(calls) == set(OPERATIONS), "an operation is not watched; call it here"
    for name, one in OPERATIONS.items():
        assert bool(commits[name]) == (one.effect != "reads"), f"{name} declares {one.effect}"


def test_an_unknown_effect_is_refused_where_it_is_declared():
    with pytest.raises(ValueError, match="expected one of reads, records, writes"):
        operation("read", "asks", "do something")
