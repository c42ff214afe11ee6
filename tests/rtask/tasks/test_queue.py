"""Robots claim the steps of stored plans by commits, and never two of them one thing."""

from __future__ import annotations

import datetime as dt
import json
import subprocess
import sys
import time

import httpx
import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from rtask.errors import ConflictError, ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.queue import claiming
from rtask.tasks.queue.reading import read_queue
from tests.rtask.tasks.conftest import BASE, CUP, LAB, NAO, PANDA, PEN, RIGHT, TABLE, placed
from tests.servers import running_server

pytestmark = pytest.mark.slow

ANN = Access("ann", "teacher")
AS_NAO, AS_PANDA = Access("nao-1", "robot"), Access("panda-1", "robot")
GOAL = "every cup into the left box"
NOW = dt.datetime(2026, 1, 2, tzinfo=dt.UTC)


@pytest.fixture
def engine():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(LAB)
        yield engine


def store(engine, goal=GOAL, **more):
    return engine.call("store_plan", {"goal": goal, **more}, ANN).task


def claim(engine, access, **more):
    return engine.call("claim_step", more, access)


def move(engine, number, place):
    """Let the graph say that a thing is somewhere else from now on."""
    thing, at = f"<{BASE}thing/{number}>", f"<{BASE}placement/{number}>"
    graph = f"{BASE}graph/shared"
    engine.kb.update(
        f"{PREFIXES} DELETE WHERE {{ GRAPH <{graph}> {{ {at} ?p ?o }} }} ; INSERT DATA {{ GRAPH "
        f"<{graph}> {{ {placed(number, place)} }} }} # {thing}"
    )


def test_each_robot_gets_its_steps_in_turn_with_the_reason_and_one_robot_one_step(engine):
    store(engine)
    first = claim(engine, AS_PANDA)
    assert (first.claimed, first.resumed, first.arguments["thing"]) == (True, False, CUP)
    assert "the plan gives step 1 of 4 to panda-1" in first.reason
    again = claim(engine, AS_PANDA)
    assert (again.task, again.resumed, again.reason) == (first.task, True, first.reason)
    idle = claim(engine, AS_NAO)
    assert (idle.claimed, idle.waiting[0].why) == (False, "step 2 of panda-1 comes before")
    engine.call("end_step", {"task": first.task, "result": "done"}, AS_PANDA)
    assert engine.call("end_step", {"task": first.task, "result": "done"}, AS_PANDA).commit == ""
    with pytest.raises(ConflictError, match="ended before: done"):
        engine.call("end_step", {"task": first.task, "result": "failed"}, AS_PANDA)


def test_what_the_graph_does_not_support_is_not_begun_and_said_to_be_stuck(engine):
    store(engine)
    step = claim(engine, AS_PANDA)
    engine.call("end_step", {"task": step.task, "result": "done"}, AS_PANDA)
    waits = claim(engine, AS_PANDA).waiting
    assert [(one.why, one.stuck) for one in waits] == [
        ("it does not hold that red cup located on panda-1 hand", True)
    ]
    move(engine, 1, f"{PANDA}/hand")
    assert "puts red cup" in claim(engine, AS_PANDA).text


def test_a_robot_puts_nothing_into_the_hand_of_one_that_has_no_part_in_its_step(engine):
    store(engine)
    step = claim(engine, AS_PANDA)
    with pytest.raises(ForbiddenError, match=r"belongs to 'panda-1', and .*nao-1/hand is"):
        engine.call(
            "end_step", {"task": step.task, "result": "done", "place": f"{NAO}/hand"}, AS_PANDA
        )
    own = {"task": step.task, "result": "done", "place": f"{PANDA}/hand"}
    assert engine.call("end_step", own, AS_PANDA).commit


def test_the_hand_of_a_partner_is_named_by_who_gives_it_something(engine):
    store(engine)
    step = claim(engine, AS_PANDA)
    graph = f"{BASE}graph/shared"
    both = f"<{step.task}> rt:assignedTo <{NAO}>"
    engine.kb.update(f"{PREFIXES} INSERT DATA {{ GRAPH <{graph}> {{ {both} }} }}")
    given = {"task": step.task, "result": "done", "place": f"{NAO}/hand"}
    assert engine.call("end_step", given, AS_PANDA).commit


def test_priority_deadline_and_cancelling_decide_what_comes_next(engine):
    cup = store(engine)
    pen = store(engine, "the pen into the right box", priority=5)
    assert claim(engine, AS_PANDA).arguments["thing"] == PEN
    engine.call("end_step", {"task": f"{pen}/1", "result": "released"}, AS_PANDA)
    engine.call("cancel_plan", {"plan": pen, "reason": "the pen is needed"}, ANN)
    assert engine.call("cancel_plan", {"plan": pen, "reason": "again"}, ANN).commit == ""
    first = claim(engine, AS_PANDA)
    assert first.arguments["thing"] == CUP
    engine.call("end_step", {"task": first.task, "result": "released"}, AS_PANDA)
    with pytest.raises(UsageError, match="over already"):
        store(engine, "the pen into the right box", deadline=NOW.timestamp(), replaces=cup)
    late = store(engine, "the pen into the right box", replaces=cup)
    due = f'<{late}> rt:taskDeadline "{NOW.isoformat()}"^^xsd:dateTimeStamp'
    engine.kb.update(f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ {due} }} }}")
    assert not claim(engine, AS_PANDA).claimed
    states = {p.task: p.state for p in engine.call("list_plans", {"state": "all"}, ANN).plans}
    assert states == {cup: "replaced", pen: "cancelled", late: "late"}


def test_a_plan_that_will_be_late_is_stored_with_a_word_of_warning(engine):
    def stored(deadline):
        return engine.call("store_plan", {"goal": GOAL, "deadline": deadline}, ANN)

    due = stored(time.time() + 10.0)
    assert due.late_s >= due.duration_s - 10.0 > 0.0  # and more, by what planning takes
    assert stored(time.time() + 1e6).late_s == 0.0


def test_a_thing_that_one_robot_has_is_not_given_to_another(engine):
    engine.kb.update(f"{PREFIXES} INSERT DATA {{ <{NAO}> rt:reaches <{RIGHT}> }}")
    store(engine, "the pen into the right box")
    store(engine, f"<{PEN}> rt:locatedOn <{NAO}/hand>")
    first = claim(engine, AS_NAO)
    other = claim(engine, AS_PANDA)
    assert first.arguments["thing"] == PEN
    assert not other.claimed
    assert all("nao-1 has the thing" in one.why or "before" in one.why for one in other.waiting)


def test_a_claim_runs_out_and_whoever_lost_it_cannot_end_it(engine):
    kb = engine.kb
    kb.update(f"{PREFIXES} INSERT DATA {{ <{NAO}> rt:meets <{PANDA}> }}")
    store(engine)
    later = dt.datetime.now(dt.UTC)
    step = claiming.claim_step(kb, PANDA, AS_PANDA, lease_s=1.0, now=NOW).step
    (plan,) = read_queue(kb)
    assert plan.steps[0].claim(NOW) is not None
    assert plan.steps[0].claim(later) is None
    assert claiming.claim_step(kb, PANDA, AS_PANDA, now=later).claim.begun == later
    with pytest.raises(ConflictError, match="has not claimed"):
        claiming.end_claim(kb, NAO, step.task, "done", AS_NAO, now=later)
    with pytest.raises(UsageError, match="more than 0 and at most 3600"):
        claiming.claim_step(kb, PANDA, AS_PANDA, lease_s=0.0)
    with pytest.raises(UnknownTermError, match="no robot"):
        claiming.claim_step(kb, TABLE, AS_PANDA)


def test_no_jump_of_the_clock_keeps_a_step_for_a_robot_that_is_gone(engine):
    kb = engine.kb
    kb.update(f"{PREFIXES} INSERT DATA {{ <{NAO}> rt:meets <{PANDA}> }}")
    store(engine)
    ahead, back = NOW + dt.timedelta(days=365), NOW - dt.timedelta(days=1)
    lost = claiming.claim_step(kb, PANDA, AS_PANDA, now=ahead)
    (plan,) = read_queue(kb)
    step = next(step for step in plan.steps if step.task == lost.step.task)
    assert step.claim(ahead) is not None
    assert step.claim(NOW) is None  # the clock was set right: nothing waits for a year
    again = claiming.claim_step(kb, PANDA, AS_PANDA, now=NOW)
    assert (again.step.task, again.claim.begun) == (step.task, NOW)
    assert again.claim.iri != lost.claim.iri
    soon = NOW + dt.timedelta(hours=2)
    assert claiming.claim_step(kb, PANDA, AS_PANDA, now=soon).claim.begun == soon
    held = claiming.claim_step(kb, PANDA, AS_PANDA, now=back).claim
    assert held.begun == back
    claiming.end_claim(kb, PANDA, step.task, "released", AS_PANDA, now=back)
    (plan,) = read_queue(kb)
    ended = {c.iri: c.result for step in plan.steps for c in step.claims}
    assert ended[held.iri] == "released"  # that which lasts, not the last by the clock


def test_nobody_claims_or_cancels_for_another_and_a_robot_orders_nobody(engine):
    task = store(engine)
    with pytest.raises(ForbiddenError, match="cannot act for 'panda-1'"):
        claim(engine, AS_NAO, robot="panda-1")
    with pytest.raises(ForbiddenError, match="is no robot"):
        claim(engine, ANN, robot="panda-1")
    with pytest.raises(UsageError, match="robot is missing"):
        claim(engine, Access())
    with pytest.raises(ForbiddenError, match="plans of its own alone"):
        engine.call("cancel_plan", {"plan": task, "reason": "no"}, AS_NAO)
    forged = engine.kb.tasks.store(engine.kb.tasks.plan("the pen into the right box"), "nao-1")
    assert forged not in {plan.task for plan in read_queue(engine.kb)}


CLAIMER = """
import json, sys, urllib.request
def call(name, **args):
    request = urllib.request.Request(f"{sys.argv[1]}/engine/{name}", json.dumps(args).encode(),
                                     {"Content-Type": "application/json"})
    return json.load(urllib.request.urlopen(request, timeout=60))
sys.stdin.readline()
got = 0
for _ in range(15):
    step = call("claim_step", robot=sys.argv[2])
    if step["claimed"]:
        got += 1
        call("end_step", robot=sys.argv[2], task=step["task"], result="released")
print(got)
"""


def test_two_processes_at_once_never_get_one_thing():
    lab = LAB.replace("rt:Hand", "rt:ParallelJawGripper")
    with running_server(None) as server:

        def post(path, **form):
            httpx.post(f"{server.url}{path}", **form, timeout=60).raise_for_status()

        post("/update", data={"update": lab})
        more = f"{PREFIXES} INSERT DATA {{ <{NAO}> rt:reaches <{RIGHT}> }}"
        post("/update", data={"update": more})
        for goal in (f"<{PEN}> rt:locatedOn <{NAO}/hand>", "the pen into the right box"):
            post("/engine/store_plan", json={"goal": goal, "agent": "ann"})
        robots = [
            subprocess.Popen(
                [sys.executable, "-c", CLAIMER, server.url, name],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )
            for name in (NAO, PANDA)
        ]  # fmt: skip
        for robot in robots:
            robot.stdin.write("go\n")
            robot.stdin.flush()
        got = [int(robot.communicate(timeout=120)[0]) for robot in robots]
        ask = f"""{PREFIXES} SELECT ?a ?b {{
  ?a rt:claimsExemplar ?thing ; prov:startedAtTime ?begun ; prov:endedAtTime ?ended .
  ?b rt:claimsExemplar ?thing ; prov:startedAtTime ?other
  FILTER(?a != ?b && ?begun <= ?other && ?other < ?ended) }}"""
        answer = httpx.get(f"{server.url}/sparql", params={"query": ask}, timeout=60).json()
    assert sum(got) >= 2
    assert answer["results"]["bindings"] == [], "two claims of one thing at one time"


def test_commands_list_who_does_what_and_why_and_cancel(tmp_path, capsys):
    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        kb.update(LAB)
    data = ("-d", str(tmp_path / "kb"))

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, *data])
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    assert run("tasks", "list") == (1, "", "no plan is open\n")
    assert run("plan", GOAL, "--priority", "3")[0] == 2
    due = ("--deadline", "2100-01-01T00:00:00Z")
    _, _, err = run("plan", GOAL, "--store", "--agent", "ann", "--priority", "3", *due)
    task = err.partition("stored as ")[2].split()[0]
    assert "after its deadline" not in err
    with rtask.open(tmp_path / "kb") as kb:
        claiming.claim_step(kb, PANDA, kb.access("panda-1"))
    code, out, _ = run("tasks", "list")
    assert (code, "(running, priority 3)" in out) == (0, True)
    assert "to panda-1, which is expected" in out
    assert "due 2100-01-01 00:00 UTC" in out
    (listed,) = json.loads(run("tasks", "list", "--json")[1])
    assert (listed["task"], listed["steps"][0]["claimed_by"]) == (task, PANDA)
    _, out, err = run("tasks", "cancel", task, "--reason", "enough", "--agent", "ann")
    assert ("is cancelled" in out, "undo: rtask undo" in err) == (True, True)
    again = ("tasks", "cancel", task, "--reason", "enough", "--json")
    assert json.loads(run(*again)[1]) == {"commit": ""}
    assert run("tasks", "list")[0] == 1
    assert "cancelled: enough" in run("tasks", "list", "--all")[1]


def test_what_is_out_of_reach_is_stored_as_open_and_listed_with_the_reason(tmp_path, capsys):
    """Even where nothing at all can be done now."""
    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        kb.update(LAB)
    data = ("-d", str(tmp_path / "kb"))
    goal = "every bottle into the left box"

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, *data])
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    assert "for --store" in run("plan", goal, "--partly")[2]
    assert "stored" not in run("plan", goal, "--store")[2]
    code, _, err = run("plan", goal, "--store", "--partly", "--agent", "ann")
    assert (code, "left open" in err) == (1, True)
    (listed,) = json.loads(run("tasks", "list", "--json")[1])
    assert (listed["state"], listed["steps"]) == ("blocked", [])
    assert "left open: jug located on left box: " in run("tasks", "list")[1]
    with rtask.open(tmp_path / "kb") as kb:
        assert claiming.claim_step(kb, PANDA, kb.access("panda-1")).step is None
    task = err.partition("stored as ")[2].split()[0]
    assert run("tasks", "cancel", task, "--reason", "enough")[0] == 0
    assert run("tasks", "list")[0] == 1
